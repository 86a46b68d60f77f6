"""Colliders in the material point method: nodes within one keep its velocity along the normals of the faces that matter touches
(faces.py), with Coulomb friction on what they press; and a particle's way ends at the first hit, or slides on along the wall.

    dv = -min((v - u) . n, 0);   tangential velocity relative to the wall w: 0 where |w| <= mu_s dv, else w (1 - mu_d dv / |w|)
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.faces import HALF, face_functions
from wsim.kernels.particles.mpm.tables import point_tables

ON = wp.constant(0.01)             # cells: nodes so near are within
NEAR = wp.constant(3.0)            # cells: particles at nodes that are further from all colliders reach none in a step
SKIN = wp.constant(0.01)           # cells that a particle keeps from a collider
OFF = wp.constant(0.05)            # of the skin: a wall is left by so much, so that rounding meets it no second time
SLIDES = wp.constant(2)            # walls that a particle may slide along in a step


@cache
def wall_functions(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """node_place(grid, block, cell) [m]; hold_node(colliders, grid, block, cell, v, time) -> (v, 1 where a collider is near);
    stop_particle(colliders, place [cells], way [cells], v, time, h, dx) -> (way, v)."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    ask, faces = collider_queries(kinds or ("sphere",), real), face_functions(kinds, real)

    @wp.func
    def node_place(g: T.BlockGrid, b: int, c: int):
        n = wp.int64(g.bits)
        mask = (wp.int64(1) << n) - wp.int64(1)
        half = wp.int64(1) << wp.int64(g.bits - 1)
        key = g.key[b]
        x = 4 * int(((key >> (n + n)) & mask) - half) + c // 16
        y = 4 * int(((key >> n) & mask) - half) + (c // 4) % 4
        z = 4 * int((key & mask) - half) + c % 4
        return g.dx * t.vec3(real(x), real(y), real(z))

    @wp.func
    def meets_node(c: Colliders, y: t.vec3, time: real, dx: real):
        """Whether a node is within a collider, and 1 where one is near."""
        near = real(0.0)
        met = bool(False)
        for k in range(c.kind.shape[0]):
            phi = ask.signed(c, k, y, time)
            if phi < real(NEAR) * dx:
                near = real(1.0)
            inside = real(ON) * dx
            if c.kind[k] == SHEET:
                inside = real(HALF) * dx
            met = met or phi <= inside
        return met, near

    @wp.func
    def hold_node(c: Colliders, g: T.BlockGrid, b: int, cell: int, v: t.vec3, time: real):
        y = node_place(g, b, cell)
        met, near = meets_node(c, y, time, g.dx)
        held = v
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
                    if speed > rub[0] * press:
                        part = wp.max(real(1.0) - rub[1] * press / speed, real(0.0))
                    held = u + part * w
        return held, near

    @wp.func
    def turning_shift(c: Colliders, k: int, y: t.vec3, way: t.vec3, part: real, begin: real, end: real):
        """From the part of a way from y to where it meets a collider that turns: a way is straight in the frame of that."""
        shift = t.vec3()
        if wp.length_sq(c.spin[k]) > real(0.0):
            p = ask.local(c, k, y, begin)
            q = p + part * (ask.local(c, k, y + way, end) - p)
            shift = ask.world(c, k, q, begin + part * (end - begin)) - y - part * way
        return shift

    @wp.func
    def wall_way(c: Colliders, k: int, y: t.vec3, u: t.vec3, begin: real, end: real):
        """Way of collider k at y, of the velocity u, in the time that is left."""
        way = (end - begin) * u
        if wp.length_sq(c.spin[k]) > real(0.0):
            way = ask.world(c, k, ask.local(c, k, y, begin), end) - y
        return way

    @wp.func
    def stop_particle(c: Colliders, at: t.vec3, way: t.vec3, v: t.vec3, time: real, h: real, dx: real):
        y = dx * at
        rest = dx * way
        skin = real(SKIN) * dx
        gone = t.vec3()
        slow = v
        last = t.vec3()
        hit = int(-1)
        begin = time
        slides = int(SLIDES)
        for _ in range(slides + 1):
            part = real(1.0)
            n = t.vec3()
            hit = int(-1)
            for k in range(c.kind.shape[0]):
                s, m = ask.first_hit(c, k, y + gone, begin, y + gone + rest, time + h, skin)
                if s < part:
                    part = s
                    n = m
                    hit = k
            if hit < 0:
                gone += rest
                break
            turn = turning_shift(c, hit, y + gone, rest, part, begin, time + h)
            gone += part * rest + turn
            rest = (real(1.0) - part) * rest - turn
            begin += part * (time + h - begin)
            u = ask.rate(c, hit, y + gone, begin)
            slow -= wp.min(wp.dot(slow - u, n), real(0.0)) * n
            ride = wall_way(c, hit, y + gone, u, begin, time + h)
            into = wp.dot(rest - ride, n)
            if into < real(0.0):
                rest += (real(OFF) * skin - into) * n
            last = ride
        if hit >= 0:                                           # between walls: it goes with the last
            gone += last
        return gone / dx, slow

    return SimpleNamespace(node_place=node_place, meets_node=meets_node, hold_node=hold_node, stop_particle=stop_particle)
