"""Recording of launches in a graph of a CPU: arguments as bytes, without what only a graph that is saved to a file needs.

Warp 1.19 records each launch of a captured frame so that it could be saved, and loaded by another process: it looks for every
pointer in the arguments, also in structs of a hundred arrays, and writes down of which allocation each is a part. A replay then
puts the same pointers back where they were. That is most of the time a frame takes to record, and the bytes of the arguments
hold the pointers already. Here a launch is recorded as those bytes, with no pointer to be put back: the same bits.

    kept      Warp keeps the allocations that it has written down, so that none is freed before the graph: arrays of the
              arguments, those in structs, and their gradients are kept here likewise
    form      what is the same for all launches of a kernel: names, and where each argument begins

Where Warp has other structs or arguments than those known here, it records as ever.
"""

import ctypes
import inspect
from functools import cache
from typing import Any

import warp as wp

INFO = ("kernel_key", "module_hash", "is_forward", "_pad", "params", "num_params", "kernel_dim", "value_data_size",
        "value_data", "adj_params", "num_relocs", "_pad2", "relocs")
PARAMETER = ("param_index", "num_relocs", "value_offset", "value_size", "value_align")
ARGUMENTS = ("self", "kernel", "module_exec", "hooks", "params", "fwd_args", "adjoint", "adj_args")


def lighten() -> None:
    """Lets the capture of a CPU that has begun record arguments as bytes."""
    capture = getattr(wp._src.context.runtime, "_apic_capture", None)
    found = lean() if capture is not None else None
    if found and type(capture) is found.__base__ and capture.device.is_cpu and not capture.apic_savable:
        capture.__class__, capture.kept, capture.structs, capture.forms = found, {}, {}, {}


@cache
def lean() -> type | None:
    """A class of captures of the installed Warp that records so; None: it is not as known here."""
    try:
        from warp._src.apic import types
        from warp._src.apic.capture import APICapture
        from warp._src.codegen import StructInstance
        known = (tuple(name for name, _ in types.APICLaunchInfo._fields_) == INFO
                 and tuple(name for name, _ in types.APICLaunchParamRecord._fields_) == PARAMETER
                 and tuple(inspect.signature(APICapture.build_launch_info).parameters) == ARGUMENTS)
    except (ImportError, AttributeError, ValueError):
        return None
    if not known:
        return None

    class Lean(APICapture):
        kept: dict[int, Any]                     # arrays that must outlive the graph, by address
        structs: dict[tuple, tuple]              # as well: (values, those that are structs) of each, by addresses of values
        forms: dict[tuple, tuple]

        def build_launch_info(self, kernel, module_exec, hooks, params, fwd_args, adjoint, adj_args=None):
            """As of Warp: what its library is to append to the graph, which it copies at once."""
            key = kernel, module_exec, adjoint, tuple(map(type, params))
            form = self.forms.get(key)
            if form is None:
                form = self.forms[key] = launch_form(types, *key)
            info, place = form[:2]
            data = b"".join(params[1:])
            ctypes.memmove(place, data, len(data))
            self.keep(fwd_args)
            if adjoint:
                self.keep(adj_args)
            return info

        def keep(self, values) -> None:
            for value in values:
                if isinstance(value, StructInstance):
                    self.keep_struct(value)
                elif not isinstance(value, (int, float)):
                    self.kept[id(value)] = value
                    grad = getattr(value, "grad", None)
                    if grad is not None:
                        self.kept[id(grad)] = grad

        def keep_struct(self, struct) -> None:
            values = tuple(struct.__dict__.values())
            of = tuple(map(id, values))
            found = self.structs.get(of)
            if found is None:
                found = self.structs[of] = values, [value for value in values if isinstance(value, StructInstance)]
                self.keep(value for value in values if isinstance(value, wp.array))
            for value in found[1]:
                self.keep_struct(value)
    return Lean


def launch_form(types, kernel, module_exec, adjoint: bool, kinds: tuple[type, ...]) -> tuple:
    """(APICLaunchInfo of a launch, where its arguments go, what those two point to). kinds: of the bounds and arguments, in
    order, then of their adjoints. Bytes of arguments stand in a row; each is put at its alignment when the graph is replayed.
    """
    count = len(kernel.adj.args)
    if len(kinds) != 1 + count * (1 + adjoint):
        raise ValueError(f"kernel {kernel.key}: {len(kinds) - 1} arguments for {count}, adjoint={adjoint}")
    sizes = [ctypes.sizeof(kind) for kind in kinds[1:]]
    records = [(types.APICLaunchParamRecord * count)() for _ in range(1 + adjoint)]
    for i, size in enumerate(sizes):
        record = records[i // count][i % count]
        record.param_index, record.num_relocs = i + 1, 0
        record.value_offset, record.value_size, record.value_align = sum(sizes[:i]), size, ctypes.alignment(kinds[1 + i])
    place = (ctypes.c_uint8 * max(sum(sizes), 1))()
    names = kernel.key.encode(), module_exec.module_hash.hex().encode()
    info = types.APICLaunchInfo(kernel_key=names[0], module_hash=names[1], is_forward=int(not adjoint), num_params=count,
                                kernel_dim=kernel.adj.kernel_dim, value_data_size=sum(sizes))
    info.params, info.value_data = records[0], ctypes.cast(place, ctypes.POINTER(ctypes.c_uint8))
    if adjoint:
        info.adj_params = records[1]
    return info, place, records, names
