"""Accelerations of points: springs gathered by point, forces of elements, gravity, drag of the air.

    a = (sum over springs of k (1 - L / |r|) r + k tau (n.dv~) n + sum of corner forces) / m + g - decay v~
    r = (x_j - x_i) + (d_j - d_i),  n = r / |r|;  both ends compute the same bits, so momentum is kept exactly

    x   position at the start of the frame [m]; d displacement since then; v~ velocity that damping sees
    `d` holds four rows of n points: displacements and velocities v~, each twice; `source` says which copy is read

A point's springs are added in `sums` parts, each of every so many of them, and the parts in a butterfly. On a GPU `lanes`
neighbouring threads share a point, each with as many of the parts: how many there are changes no bit, so that worlds, which
are many and have few lanes, are what one alone is. Coincident points have no direction to pull in: 0.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.math.real import types


@cache
def spring_nets(real):
    """Struct of what each point keeps for the whole run: reads only."""
    t = types(real)

    @wp.struct
    class SpringNet:
        w: wp.array(dtype=t.scalar)          # inverse mass [1/kg], (points,); 0 goes where its pin is
        object: wp.array(dtype=int)          # object of each point, (points,)
        gravity: wp.array(dtype=t.vec3)      # [m/s^2], (objects,)
        decay: wp.array(dtype=t.scalar)      # [1/s], (objects,)
        pin: wp.array(dtype=int)             # column of `target`, or -1, (points,)
        target: wp.array2d(dtype=t.vec3)     # [m], (rows, pins): at the end of each substep, of stages at each of theirs
        start: wp.array(dtype=int)           # springs of each point: entries start[i]:start[i + 1], (points + 1,)
        other: wp.array(dtype=int)           # point at the other end, (entries,)
        rest: wp.array(dtype=t.scalar)       # length [m], (entries,)
        left: wp.array(dtype=t.scalar)       # what float32 leaves of it, (entries,); only when exact
        k: wp.array(dtype=t.scalar)          # [N/m], (entries,)
        damping: wp.array(dtype=t.scalar)    # k tau [N s/m], (entries,); only when damped
        first: wp.array(dtype=int)           # corner forces of each point: item[first[i]:first[i + 1]], (points + 1,)
        item: wp.array(dtype=int)

    return SpringNet


BUTTERFLY = """
#if defined(__CUDA_ARCH__)
    unsigned mask = ((1u << {lanes}) - 1u) << (threadIdx.x & 31u & ~({lanes}u - 1u));
    for (int o = {lanes} / 2; o > 0; o >>= 1)
        for (int k = 0; k < 3; ++k)
            v.c[k] += __shfl_xor_sync(mask, v.c[k], o, {lanes});
#endif
    return v;
"""


@cache
def lane_sum_function(vec3, lanes: int):
    """Function: sum of v over the `lanes` threads of a point, the same in each; all of them must come. A CPU has one."""

    @wp.func_native(BUTTERFLY.format(lanes=lanes))
    def lane_sum(v: vec3) -> vec3: ...

    return lane_sum


def butterfly_halves(whole, sums: int, lanes: int):
    """Function: what a lane has of a point, part `part` and every `lanes`-th after it, added as a butterfly adds them. whole:
    function of one part."""
    if sums <= lanes:
        return whole
    each = butterfly_halves(whole, sums, 2 * lanes)

    @wp.func
    def sum_both_halves(net: Any, f: Any, x: Any, d: Any, i: int, part: int, source: int):
        return each(net, f, x, d, i, part, source) + each(net, f, x, d, i, part + wp.static(lanes), source)

    return sum_both_halves


@cache
def spring_gather_function(real, *, lanes: int = 1, sums: int = 1, width: int = 0, added: bool = False, exact: bool = False,
                           **there):
    """Function: what lane `lane` of point i sums of its forces [N], copy `source` of d. there: springs, corners, damped. See
    `acceleration_function`."""
    t = types(real)
    springs, corners, damped = there["springs"], there["corners"], there["damped"]
    Net, vec3, squared_length_gain = spring_nets(real), t.vec3, None
    if exact:
        from wsim.kernels.math.compensated import squared_length_gain

    @wp.func
    def spring_force(net: Net, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), c: int, x0: vec3, d0: vec3, v0: vec3,
                     source: int):
        n = x.shape[0]
        j = net.other[c]
        k = net.k[c]
        rest = net.rest[c]
        r = (x[j] - x0) + (d[source * n + j] - d0)
        L = wp.length(r)
        over = inverse_or_zero(L)
        if wp.static(exact):
            s = k * over * inverse_or_zero(L + rest) * squared_length_gain(x0, x[j], d0, d[source * n + j], rest, net.left[c])
        else:
            s = k - k * rest * over
        if wp.static(damped):
            s += net.damping[c] * over * over * wp.dot(r, d[(2 + source) * n + j] - v0)
        return s * r

    @wp.func
    def gather_spring_part(net: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), i: int,
                           part: int, source: int):
        """By itself: adjoints see of a sum in a loop what it was before, so who calls may multiply it, but not this."""
        n = x.shape[0]
        x0 = x[i]
        d0 = d[source * n + i]
        v0 = d[(2 + source) * n + i]
        force = vec3()
        if wp.static(added):
            force = f[i]
        if wp.static(springs and not added):
            if wp.static(width > 0):
                for e in range(wp.static(width // sums)):
                    force += spring_force(net, x, d, i * width + part + e * sums, x0, d0, v0, source)
            else:
                for c in range(net.start[i] + part, net.start[i + 1], sums):
                    force += spring_force(net, x, d, c, x0, d0, v0, source)
        if wp.static(corners):
            for e in range(net.first[i] + part, net.first[i + 1], sums):
                force += f[net.item[e]]
        return force

    return butterfly_halves(gather_spring_part, sums, lanes)


@cache
def acceleration_function(real, *, lanes: int = 1, field=None, **kinds):
    """Function: acceleration [m/s^2] of point i, copy `source` of d; `lane` is which of its `lanes` threads this is.

    springs, corners, damped: what there is. sums: parts of a sum, a power of 2 times `lanes`, of which `width` is a multiple.
    added: the springs' forces are summed already, in f[i]
    (kernels/motion/fast_paths/march_cpu.py). width: every point has so many entries, the last of which may pull at nothing; 0:
    see `Net.start`. exact: see kernels/math/compensated.py. field: function (x + d, v~) -> acceleration."""
    t = types(real)
    Net, vec3, total, gathered = (spring_nets(real), t.vec3, lane_sum_function(t.vec3, lanes),
                                  spring_gather_function(real, lanes=lanes, **kinds))

    @wp.func
    def point_acceleration(net: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), i: int,
                           lane: int, source: int):
        n = x.shape[0]
        o = net.object[i]
        pull = net.gravity[o]                             # read before the springs: the reads then wait together
        decay = net.decay[o]
        w = net.w[i]
        v0 = d[(2 + source) * n + i]
        force = gathered(net, f, x, d, i, lane, source)
        if wp.static(lanes > 1):
            force = total(force)
        a = w * force + pull - decay * v0
        if wp.static(field is not None):
            a += field(x[i] + d[source * n + i], v0)
        return a

    return point_acceleration


@cache
def overstretch_kernel(real, module):
    """Kernel over edges: status[own] becomes at least 1 where one is longer than `most` times its rest length [m] or not
    finite, and status[each + body] the largest percentage of it. first (bodies + 1,): a body's edges."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def find_overstretched(point: wp.array(dtype=wp.vec2i), rest: wp.array(dtype=real), most: real, first: wp.array(dtype=int),
                           x: wp.array(dtype=t.vec3), own: int, each: int, status: wp.array(dtype=int)):
        c = wp.tid()
        p = point[c]
        length = wp.length(x[p[1]] - x[p[0]])
        if not length <= most * rest[c]:
            body = int(0)  # noqa: UP018
            while first[body + 1] <= c:
                body += 1
            wp.atomic_max(status, own, 1)
            wp.atomic_max(status, each + body, int(wp.min(real(100.0) * length / rest[c], real(1.0e9))))

    return find_overstretched
