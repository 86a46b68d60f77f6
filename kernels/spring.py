"""Accelerations of points: springs gathered by point, forces of elements, gravity, drag of the air.

    a = (sum over springs of k (1 - L / |r|) r + k tau (n.dv~) n + sum of corner forces) / m + g - decay v~
    r = (x_j - x_i) + (d_j - d_i),  n = r / |r|;  both ends compute the same bits, so momentum is kept exactly

    x   position at the start of the frame [m]; d displacement since then; v~ velocity that damping sees
    `d` holds four rows of n points: displacements and velocities v~, each twice; `source` says which copy is read

Points of a slice of 32 have their springs interleaved, so that neighbouring threads read neighbouring entries (sliced
ELLPACK: Monakov, Lokhmotov, Avetisyan 2010). Coincident points pull by -k L in no direction: 0.
"""

from functools import cache

import warp as wp

from wsim.kernels.constraint import inverse
from wsim.kernels.real import types

SLICE = 32


@cache
def net(real):
    """Struct of what each point keeps for the whole run: reads only."""
    t = types(real)

    @wp.struct
    class Net:
        w: wp.array(dtype=t.scalar)          # inverse mass [1/kg], (points,); 0 goes where its pin is
        object: wp.array(dtype=int)          # object of each point, (points,)
        gravity: wp.array(dtype=t.vec3)      # [m/s^2], (objects,)
        decay: wp.array(dtype=t.scalar)      # [1/s], (objects,)
        pin: wp.array(dtype=int)             # column of `target`, or -1, (points,)
        target: wp.array2d(dtype=t.vec3)     # [m], (substeps or 1, pins): at the end of each substep
        start: wp.array(dtype=int)           # first entry of each slice, (slices,)
        count: wp.array(dtype=int)           # springs of each point, (points,)
        other: wp.array(dtype=int)           # point at the other end, (entries,)
        rest: wp.array(dtype=t.scalar)       # length [m], (entries,)
        k: wp.array(dtype=t.scalar)          # [N/m], (entries,)
        damping: wp.array(dtype=t.scalar)    # k tau [N s/m], (entries,); only when damped
        first: wp.array(dtype=int)           # corner forces of each point: item[first[i]:first[i + 1]], (points + 1,)
        item: wp.array(dtype=int)

    return Net


@cache
def acceleration(real, *, springs: bool, corners: bool, damped: bool, field=None):
    """Function: acceleration [m/s^2] of point i, copy `source` of d. field: function (x + d, v~) -> acceleration, or None."""
    t = types(real)
    Net, vec3 = net(real), t.vec3

    @wp.func
    def acceleration(net: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), i: int,
                     source: int):
        n = x.shape[0]
        o = net.object[i]
        x0 = x[i]
        d0 = d[source * n + i]
        v0 = d[(2 + source) * n + i]
        force = vec3()
        if wp.static(springs):
            place = net.start[i // SLICE] + i % SLICE
            for e in range(net.count[i]):
                c = place + e * SLICE
                j = net.other[c]
                r = (x[j] - x0) + (d[source * n + j] - d0)
                over = inverse(wp.length(r))
                k = net.k[c]
                force += (k - k * net.rest[c] * over) * r
                if wp.static(damped):
                    force += (net.damping[c] * over * over * wp.dot(r, d[(2 + source) * n + j] - v0)) * r
        if wp.static(corners):
            for e in range(net.first[i], net.first[i + 1]):
                force += f[net.item[e]]
        a = net.w[i] * force + net.gravity[o] - net.decay[o] * v0
        if wp.static(field is not None):
            a += field(x0 + d0, v0)
        return a

    return acceleration


@cache
def stretched(real, module):
    """Kernel over springs: status becomes at least 1 where one is longer than `most` times its rest length, or no number."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def stretched(point: wp.array(dtype=wp.vec2i), rest: wp.array(dtype=real), x: wp.array(dtype=t.vec3),
                  e: wp.array(dtype=t.vec3), most: real, status: wp.array(dtype=int)):
        c = wp.tid()
        p = point[c]
        r = (x[p[1]] - x[p[0]]) + (e[p[1]] - e[p[0]])
        if not wp.length(r) <= most * rest[c]:
            wp.atomic_max(status, 0, 1)

    return stretched
