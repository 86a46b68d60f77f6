"""A kernel owns its adjoint: vector-Jacobian products by hand, which a tape looks up where a kernel is launched.

`Model.vjp` is the table, {kernel: record}. record(inputs) is called where a launch is recorded, and returns backward(read,
wrote), of the arrays as that launch has read and written them (`wsim.model.tape.Tape.launch`). A kernel that is not in the
table has the adjoint that Warp makes.

The adjoints of x.py stand in x_adjoint.py beside it: `beside` makes one where gradients are asked for, and nothing of it is
imported where not. Who launches never says so.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wsim.model.model import Model

Backward = Callable[[list, list], None]
Record = Callable[[list], Backward]


def beside(model: Model, file: str, name: str, *given) -> Any:
    """The adjoint of that name from the file beside `file` (a module's __name__), made of `given`, its `vjp` in the model's
    table; None where no gradients are asked for."""
    if not model.gradients:
        return None
    adjoint = getattr(import_module(f"{file}_adjoint"), name)(*given)
    model.vjp |= getattr(adjoint, "vjp", {})
    return adjoint


def fixed_adjoint(backward: Backward) -> Record:
    """Wrapper for adjoints that need to know nothing of a launch but its arrays."""
    return lambda inputs: backward


def taken_along(read: list, wrote: list) -> None:
    """Adjoint of launches that another's adjoint takes along."""


def of_table(model: Model, kernel, data, record: Record) -> dict:
    """Entry of a kernel for launches whose first argument is the struct `data`: two tables may share a kernel."""
    before = model.vjp.get(kernel)
    return {kernel: lambda inputs: record(inputs) if inputs[0] is data or before is None else before(inputs)}
