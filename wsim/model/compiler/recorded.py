"""Recording of launches in a graph of a CPU: arguments as bytes, without what only a graph that is saved to a file needs.

Warp 1.19 records each launch of a captured frame so that it could be saved, and loaded by another process: it looks for every
pointer in the arguments, also in structs of a hundred arrays, and writes down of which allocation each is a part. A replay then
puts the same pointers back where they were. That is most of the time a recording takes, and the bytes of the arguments hold the
pointers already. Here a launch is recorded as those bytes, with no pointer to be put back: the same bits. It does not speed
up a first frame, but it does gradients. CPU seconds of 24 frames of 12 x 12 points, with it and without: forward 1.3 and 2.4
(leapfrog), 1.0 and 1.7 (XPBD), 11 and 15 (Newton); backward 1.0 and 2.9, 0.8 and 1.8, 1.1 and 2.4;
memory of all three 386 MB and 815.

    kept      Warp keeps the allocations that it has written down, so that none is freed before the graph: arrays of the
              arguments, those in structs, and their gradients are kept here likewise
    form      what is the same for all launches of a kernel: names, and where each argument begins
    packs     what arguments were packed into, by array or number: looked up, where Warp looks at types and devices anew
    known     kernels that were launched before in this capture, which `launch` does not look up again
    regions   if the capture copies or clears an array, Warp saves the contents of its whole allocation, and the graph keeps
              them. Here a region is the array alone, and the saved contents are dropped (`end_capture`)

Where Warp has other structs, arguments or functions than those known here, it records as ever.
"""

import ctypes
import inspect
from functools import cache
from typing import Any

import warp as wp

from wsim.model.warp_private import Instance, Struct, context, private_module

INFO = ("kernel_key", "module_hash", "is_forward", "_pad", "params", "num_params", "kernel_dim", "value_data_size",
        "value_data", "adj_params", "num_relocs", "_pad2", "relocs")
PARAMETER = ("param_index", "num_relocs", "value_offset", "value_size", "value_align")
ARGUMENTS = ("self", "kernel", "module_exec", "hooks", "params", "fwd_args", "adjoint", "adj_args")
CALLED = ("pack_arg", "_normalize_launch_dim", "_validate_kernel_tid_extents", "_build_launch_bounds_from_tuple")
BACK = frozenset(("adjoint", "adj_inputs", "adj_outputs"))         # words of a launch of an adjoint


@cache
def lean_capture_class() -> type | None:
    """A class of captures of the installed Warp that records so; None: Warp is not as known here."""
    try:
        capture, types = private_module("apic.capture"), private_module("apic.types")
        known = (tuple(field[0] for field in types.APICLaunchInfo._fields_) == INFO
                 and tuple(field[0] for field in types.APICLaunchParamRecord._fields_) == PARAMETER
                 and tuple(inspect.signature(capture.APICapture.build_launch_info).parameters) == ARGUMENTS
                 and all(hasattr(context, name) for name in CALLED)
                 and tuple(inspect.signature(capture.APICapture._find_base).parameters) == ("self", "arr"))
    except (ImportError, AttributeError, ValueError):
        return None
    return type("Lean", (LeanCapture, capture.APICapture), {"types": types}) if known else None


def lighten_capture() -> None:
    """Lets the capture of a CPU that has begun record arguments as bytes."""
    capture: Any = getattr(getattr(context, "runtime", None), "_apic_capture", None)
    found: Any = lean_capture_class() if capture is not None else None
    if found and type(capture) is found.__mro__[2] and capture.device.is_cpu and not capture.apic_savable:
        capture.__class__ = found
        capture.kept, capture.structs, capture.forms, capture.known, capture.bounds = {}, {}, {}, {}, {}
        capture.packs = {}


def end_capture() -> None:
    """Frees what a replay does not need, before a capture on a CPU ends: saved contents of arrays, which only a graph that is
    saved to a file needs, and the lookup tables."""
    capture: Any = getattr(getattr(context, "runtime", None), "_apic_capture", None)
    if isinstance(capture, LeanCapture):
        core, state, mark = capture.runtime.core, capture.apic_state, ctypes.c_uint8()
        last = core.wp_apic_register_memory_region_by_ptr(state, ctypes.addressof(mark), 1, 1)     # numbers go up by one
        for region in range(1, last + 1):
            core.wp_apic_register_memory_region(state, region, 0, 1, None)
        capture.kept = [*capture.kept.values(), *(values for values, _ in capture.structs.values())]
        capture.forms, capture.known, capture.bounds, capture.packs, capture.structs = {}, {}, {}, {}, {}


def launch(kernel, dim: int | tuple[int, ...], inputs: list, outputs: list, device=None, **how) -> None:
    """Launches a kernel as `wp.launch`. In a capture of a CPU it is recorded without a look where it was launched before."""
    capture = getattr(getattr(context, "runtime", None), "_apic_capture", None)
    if not isinstance(capture, LeanCapture) or not capture.again(kernel, dim, [*inputs, *outputs], device, how):
        wp.launch(kernel, dim, inputs, outputs, device=device, **how)


class LeanCapture:
    """Captures of Warp with another record of launches."""

    device: Any
    runtime: Any
    types: Any                               # module of structs
    kept: Any                                # arrays that must outlive the graph, by address; a list once the capture has ended
    structs: dict[tuple, tuple]              # as well: (values, those that are structs) of each, by addresses of values
    forms: dict[tuple, tuple]
    packs: dict[tuple, Any]                  # what arguments have had, by argument and address, or number
    known: dict[tuple, tuple]                # (executable, hooks, function) of a kernel, and whether of its adjoint
    bounds: dict[tuple, Any]                 # of launches, by threads and dimensions
    apic_state: Any                          # handle of the capture in Warp's library

    def _find_base(self, arr) -> tuple:
        """As of Warp, for an array that is no part of another: (array, address, bytes, 0)."""
        return arr, arr.ptr, arr.capacity, 0

    def build_launch_info(self, kernel, module_exec, hooks, params, fwd_args, adjoint, adj_args=None):
        """As of Warp: what its library is to append to the graph, which it copies at once."""
        key = kernel, module_exec, adjoint, tuple(map(type, params))
        form = self.forms.get(key)
        if form is None:
            form = self.forms[key] = launch_form(self.types, *key)
            function = hooks.backward if adjoint else hooks.forward
            self.known[kernel, adjoint] = module_exec, hooks, ctypes.cast(function, ctypes.c_void_p)
        info, place = form[:2]
        data = b"".join(params[1:])
        ctypes.memmove(place, data, len(data))
        self.keep(fwd_args)
        if adjoint:
            self.keep(adj_args)
        return info

    def again(self, kernel, dim: int | tuple[int, ...], values: list, device, how: dict) -> bool:
        """Records a launch of a kernel that this capture knows. False: nothing is recorded, and Warp is to launch it."""
        adjoint = how.get("adjoint", False)
        found, count = self.known.get((kernel, adjoint)), len(kernel.adj.args)
        back = [*how.get("adj_inputs", ()), *how.get("adj_outputs", ())]
        there = device is self.device or wp.get_device(device) == self.device
        if (found is None or len(values) != count or len(back) != adjoint * count or how.keys() - BACK or not there
                or self.runtime.tape or wp.config.print_launches
                or wp.config.launch_array_access_mode != wp.config.LaunchArrayAccessMode.RELAXED):
            return False
        bounds = self.bounds.get((dim, kernel.adj.kernel_dim)) or self.bound(kernel, dim)
        if not bounds:
            return False
        executable, hooks, function = found
        params = [bounds, *self.packed(kernel, values, False), *self.packed(kernel, back, True)]
        info = self.build_launch_info(kernel, executable, hooks, params, values, adjoint, back)
        self.runtime.core.wp_cpu_launch_kernel(function, ctypes.byref(bounds), None, None, ctypes.byref(info))
        return True

    def bound(self, kernel, dim: int | tuple[int, ...]):
        """Bounds of launches of so many threads; None: of no thread."""
        dimensions, (extents, threads) = kernel.adj.kernel_dim, context._normalize_launch_dim(dim)
        if not threads:
            return None
        context._validate_kernel_tid_extents(kernel, extents, threads, 1)
        found = self.bounds[dim, dimensions] = context._build_launch_bounds_from_tuple(extents, dimensions)
        return found

    def packed(self, kernel, values: list, adjoint: bool) -> list:
        """Values as a kernel takes them. Arrays and numbers that an argument has had are not looked at again."""
        found, before, key = [], self.packs, ()                      # type: list, dict, tuple
        for argument, value in zip(kernel.adj.args, values, strict=False):
            kind = type(value)
            if kind is wp.array:
                key = id(argument), id(value), adjoint
                if key not in before:
                    self.kept[id(value)] = value                     # so that no other has its address
                    before[key] = context.pack_arg(kernel, argument.type, argument.label, value, self.device, adjoint)
                found.append(value.__ctype__())
            elif kind is int or kind is float and value:              # 0.0 and -0.0 are equal
                key = id(argument), kind, value
                pack = before.get(key)
                if pack is None:
                    pack = before[key] = context.pack_arg(kernel, argument.type, argument.label, value, self.device, adjoint)
                found.append(pack)
            elif isinstance(value, Instance) and isinstance(argument.type, Struct):
                found.append(value.__ctype__())
            else:
                found.append(context.pack_arg(kernel, argument.type, argument.label, value, self.device, adjoint))
        return found

    def keep(self, values) -> None:
        for value in values:
            if isinstance(value, Instance):
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
            found = self.structs[of] = values, [value for value in values if isinstance(value, Instance)]
            self.keep(value for value in values if isinstance(value, wp.array))
        for value in found[1]:
            self.keep_struct(value)


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
