"""What the adjoints of elements share: where they find the gradients by forces, and how points gather what they leave.

An element's adjoint writes a gradient at the place of each of its corners' forces (kernels/cloth/element_adjoint.py,
fem_adjoint.py); a point adds up those at its corners, in their order: no atomics, and the same bits each time.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import lane_sum_function, spring_nets
from wsim.kernels.math.real import types


@cache
def adjoint_works(real):
    """Struct of what an adjoint of forces reads and writes: p by the forces on points."""
    t = types(real)

    @wp.struct
    class ForceAdjointWork:
        p: wp.array(dtype=t.vec3)            # [1/N], (points,), or none: then corners have them
        corners: wp.array(dtype=t.vec3)      # by the positions of corners, written, at the places of their forces
        rates: wp.array(dtype=t.vec3)        # by the velocities of corners, written, at the same places

    return ForceAdjointWork


@cache
def corner_reader(real, direct: bool):
    """Function of (work, point, place of its corner): the gradient by the force there."""
    vec3, Work = types(real).vec3, adjoint_works(real)

    @wp.func
    def by_force(w: Work, i: int, at: int):
        p = vec3()
        if wp.static(direct):
            p = w.p[i]
        if wp.static(not direct):
            p = w.corners[at]
        return p

    return by_force


@cache
def corner_gather_kernel(real, module, lanes: int, rated: bool):
    """Kernel over the lanes of points: adds what stands at all of their corners to the gradients `by` and, where there is one,
    `also`; rated: and that at `rates` to `by_v`."""
    t, Net, together_ = types(real), spring_nets(real), lane_sum_function(types(real).vec3, lanes)
    vec3 = wp.array(dtype=t.vec3)

    def gather_all_corners(net: Net, corners: vec3, rates: vec3, by: vec3, also: vec3, by_v: vec3):
        i = wp.tid() // lanes
        lane = wp.tid() % lanes
        sum = t.vec3()
        rate = t.vec3()
        for c in range(net.first[i] + lane, net.first[i + 1], lanes):
            at = net.item[c]
            sum += corners[at]
            if wp.static(rated):
                rate += rates[at]
        if wp.static(lanes > 1):
            sum = together_(sum)
            rate = together_(rate)
        if lane > 0:
            return
        by[i] = by[i] + sum
        if also:
            also[i] = also[i] + sum
        if wp.static(rated):
            by_v[i] = by_v[i] + rate

    return wp.kernel(gather_all_corners, name="take_all" + "_rated" * rated, module=module, enable_backward=False)


@cache
def corner_range_kernel(real, module):
    """Kernel over points: adds what stands at their corners, those from `first` to `last`, to the gradients `by` and, where
    there is one, `also`; the place of a corner in `corners` is less by `shift`."""
    t, Net = types(real), spring_nets(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def gather_corner_range(net: Net, corners: vec3, first: int, last: int, shift: int, by: vec3, also: vec3):
        i = wp.tid()
        sum = t.vec3()
        for c in range(net.first[i], net.first[i + 1]):
            at = net.item[c]
            if at >= first and at < last:
                sum += corners[at - shift]
        by[i] = by[i] + sum
        if also:
            also[i] = also[i] + sum

    return gather_corner_range
