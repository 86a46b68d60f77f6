"""The passes of a substep, each a launch, where there is more to do than a cluster of blocks can: see kernels/rigid/passes.py.

Counts are on the device: a launch has a fixed number of threads, which walk up to the count. Colours from LAUNCHED on, which
have few constraints, are one launch of a block whose threads meet after each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.impact import impact_func
from wsim.kernels.rigid.kinds import ConstraintKind, acts_of_kind, at_once_func, in_colour
from wsim.kernels.rigid.passes import over_bodies

LAUNCHED = 16             # colours of a kind that have a launch each: an empty one costs 1.9 us on an H200


@dataclass(frozen=True)
class KindKernels:
    """Kernels of a kind, over threads that walk: prepare of all, warm and solve of a colour, and of the colours behind."""

    prepare: Any
    warm: Any
    solve: Any
    rest_warm: Any
    rest_solve: Any


def body_pass_kernels(real, module) -> tuple:
    """(begun, placed, ended): kernels."""
    Rig, (begin, place, end) = rig_type(real), over_bodies(real)

    def rigid_begun(threads: int, h: real, rig: Rig):
        begin(wp.tid(), threads, h, rig)

    def rigid_placed(threads: int, k: int, rig: Rig):
        place(wp.tid(), threads, k, rig)

    def rigid_ended(threads: int, k: int, h: real, rig: Rig):
        end(wp.tid(), threads, k, h, rig)

    return tuple(wp.kernel(f, name=f.__name__, module=module, enable_backward=False)
                 for f in (rigid_begun, rigid_placed, rigid_ended))


def of_kind(kind: ConstraintKind, real, module, block_module, meet, threads: int) -> KindKernels:
    """block_module, meet, threads: of the launch of a block."""
    Rig, act = rig_type(real), acts_of_kind(kind, real)
    prepare_all = at_once_func(kind, act.prepare, real)

    def prepare_kind_constraints(threads: int, k: int, rig: Rig):
        prepare_all(wp.tid(), threads, k, real(0.0), 0, rig)

    def one_colour_kernel(walk, name: str):
        def run_one_colour(colour: int, threads: int, k: int, h: real, biased: int, rig: Rig):
            if colour < kind.colours(rig):
                walk(colour, wp.tid(), threads, k, h, biased, rig)
        return wp.kernel(run_one_colour, name=f"rigid_{name}_{kind.name}", module=module, enable_backward=False)

    def last_colours_kernel(walk, name: str):
        def run_last_colours(threads: int, k: int, h: real, biased: int, rig: Rig):
            for colour in range(int(LAUNCHED), kind.colours(rig)):
                walk(colour, wp.tid(), threads, k, h, biased, rig)
                meet()
        return wp.kernel(run_last_colours, name=f"rigid_{name}_{kind.name}_rest", module=block_module, enable_backward=False,
                         grid_stride=False, **({"launch_bounds": threads} if threads else {}))

    warm, solve = in_colour(kind, act.warm, real), in_colour(kind, act.solve, real)
    return KindKernels(wp.kernel(prepare_kind_constraints, name=f"rigid_prepare_{kind.name}", module=module,
                                 enable_backward=False),
                       one_colour_kernel(warm, "warm"), one_colour_kernel(solve, "solve"), last_colours_kernel(warm, "warm"),
                       last_colours_kernel(solve, "solve"))


def impact_kernel(kinds: Sequence[ConstraintKind], real, module, meet, threads: int, cluster: int):
    """Kernel of the impacts of a substep, of the last kind."""
    Rig, throw = rig_type(real), impact_func(kinds[-1], meet, real)

    def rigid_thrown(threads: int, k: int, h: real, rig: Rig):
        throw(wp.tid(), threads, k, h, rig)

    return wp.kernel(rigid_thrown, name="rigid_thrown", module=module, enable_backward=False, grid_stride=False,
                     **({"launch_bounds": threads} if threads else {}), **({"cluster_dim": cluster} if cluster else {}))
