"""Which parameters the experiments of a fit share. Others are parameters of each experiment, with its number behind the name:

    stretch               of all experiments
    density@2             of the second experiment alone

A start value, or a prior, of the plain name is that of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from wsim.scene import Problem, Scene

if TYPE_CHECKING:
    from wsim.fitting.parameter import Parameter

AT = "@"


def split_by_experiment(found: list[Parameter], scenes: list[Scene], shared: str | Iterable[str] | None,
                        fail: Callable[[Problem], None]) -> list[Parameter]:
    """Parameters of experiments that share those of the names `shared`; None: all."""
    if shared is None:
        return found
    names = [n.strip() for n in (shared.split(",") if isinstance(shared, str) else shared) if n.strip()]
    for name in names:
        if not any(_is_of_shared_name(p, name) for p in found):
            fail(Problem(name, f"is shared and not fitted; fitted are {', '.join(p.name for p in found)}"))
    if len(scenes) < 2:
        fail(Problem("shared", "there is one experiment, which shares nothing with others; leave it out"))
    return [own for p in found
            for own in ([p] if any(_is_of_shared_name(p, name) for name in names) else parameter_of_each_experiment(p, scenes))]


def parameter_of_each_experiment(p: Parameter, scenes: list[Scene]) -> list[Parameter]:
    """The parameter of each experiment that has it."""
    return [replace(p, name=f"{p.name}{AT}{k + 1}", only=k) for k, scene in enumerate(scenes) if p.rows(scene)]


def name_without_experiment(name: str) -> str:
    """The name without its experiment."""
    return name.partition(AT)[0]


def value_given_by_name(p: Parameter, values: dict[str, Any]) -> tuple[str, Any] | None:
    """(name, value) that values by name have for a parameter, by its own name or the plain one; None: nothing."""
    name = next((name for name in (p.name, name_without_experiment(p.name)) if name in values), None)
    return None if name is None else (name, values[name])


def _is_of_shared_name(p: Parameter, name: str) -> bool:
    """True for a parameter of that name, or one of the three of a vector."""
    return p.name == name or (p.axis is not None and p.name[:-2] == name)
