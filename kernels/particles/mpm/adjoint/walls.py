"""Derivatives of colliders in the material point method (`wsim.kernels.particles.mpm.walls`), carried along as matrices.

A node that is held (n the normal, w the velocity relative to the wall, P = 1 - n n^T, W = |P w|, dv = -w . n):

    d held = (s P + mu_d P w (n / W + dv P w / W^3)^T) dv,   s = 1 - mu_d dv / W;   0 where it sticks

A particle that is stopped at a flat face, after the part s of its way r, at a distance phi of which the skin is kept:

    ds = (n . dy + s n . dr) / -n . (r - u h)

n and u do not change with the place: faces are flat, and walls do not turn (`wsim.physics.mpm.adjoint` refuses others).
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.faces import face_functions
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.kernels.particles.mpm.walls import OFF, ON, SKIN, SLIDES, wall_functions


@cache
def wall_slopes(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """held_slope(colliders, grid, block, cell, v, time) -> d held / dv;  stopped_slopes(colliders, place [cells], way [cells],
    v, time, h, dx) -> derivatives of the way with respect to the place and the way, (3, 6), and of the velocity to itself."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    ask, wall, faces = collider_queries(kinds or ("sphere",), real), wall_functions(kinds, real), face_functions(kinds, real)
    mat36, vec6 = wp.types.matrix((3, 6), real), wp.types.vector(6, real)

    @wp.func
    def held_slope(c: Colliders, g: T.BlockGrid, b: int, cell: int, v: t.vec3, time: real):
        y = wall.node_place(g, b, cell)
        met, near = wall.meets_node(c, y, time, g.dx)
        held = v
        D = wp.identity(n=3, dtype=real)
        if met:
            side = faces.matter_side(g, b, cell)
            for k in range(c.kind.shape[0]):
                holds, n, p = faces.holding_face(c, k, y, side, time, g.dx, real(ON))
                u = ask.rate(c, k, y, time)
                w = held - u
                press = -wp.dot(w, n)
                if holds and press > real(0.0):
                    w += press * n
                    speed = wp.length(w)
                    rub = c.friction[k]
                    part = real(0.0)
                    own = t.mat33()
                    if speed > rub[0] * press:
                        part = wp.max(real(1.0) - rub[1] * press / speed, real(0.0))
                        own = part * (wp.identity(n=3, dtype=real) - wp.outer(n, n))
                        if part > real(0.0):
                            own += (rub[1] / speed) * wp.outer(w, n + (press / (speed * speed)) * w)
                    held = u + part * w
                    D = own * D
        return D

    @wp.func
    def first_wall(c: Colliders, y: t.vec3, rest: t.vec3, begin: real, end: real, skin: real):
        part = real(1.0)
        n = t.vec3()
        hit = int(-1)
        for k in range(c.kind.shape[0]):
            s, m = ask.first_hit(c, k, y, begin, y + rest, end, skin)
            if s < part:
                part = s
                n = m
                hit = k
        return part, n, hit

    @wp.func
    def stopped_slopes(c: Colliders, at: t.vec3, way: t.vec3, v: t.vec3, time: real, h: real, dx: real):
        y = dx * at
        rest = dx * way
        skin = real(SKIN) * dx
        gone = t.vec3()
        slow = v
        D = wp.identity(n=3, dtype=real)
        by_gone = mat36()                                      # of what is gone, with respect to the place and the way
        by_rest = mat36()
        by_last = mat36()
        for k in range(3):
            by_rest[k, k + 3] = real(1.0)
        hit = int(-1)
        begin = time
        slides = int(SLIDES)
        for _ in range(slides + 1):
            part, n, hit = first_wall(c, y + gone, rest, begin, time + h, skin)
            if hit < 0:
                by_gone += by_rest
                break
            left = time + h - begin
            u = ask.rate(c, hit, y + gone + part * rest, begin + part * left)
            by_part = vec6()
            if part > real(0.0):                               # else it is as near as may be, and stays so
                by_part = wp.transpose(by_gone + part * by_rest) * n + vec6(n[0], n[1], n[2], real(0.0), real(0.0), real(0.0))
                by_part = by_part / wp.dot(n, left * u - rest)
            by_gone += part * by_rest + wp.outer(rest, by_part)
            by_rest = (real(1.0) - part) * by_rest - wp.outer(rest, by_part)
            gone += part * rest
            rest = (real(1.0) - part) * rest
            begin += part * left
            against = wp.dot(slow - u, n)
            if against < real(0.0):
                slow -= against * n
                D = D - wp.outer(n, wp.transpose(D) * n)
            by_last = -left * wp.outer(u, by_part)
            into = wp.dot(rest - (time + h - begin) * u, n)
            if into < real(0.0):
                rest += (real(OFF) * skin - into) * n
                by_rest = by_rest - wp.outer(n, wp.transpose(by_rest - by_last) * n)
        if hit >= 0:
            by_gone += by_last
        return by_gone, D

    return SimpleNamespace(held_slope=held_slope, stopped_slopes=stopped_slopes)
