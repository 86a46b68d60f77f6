"""Pins of material points. A hard pin takes its particles along, and holds the nodes where most of the mass is theirs:

    M_i = sum_p w m,  u_i = sum_p w m (v + C (x_i - x_p)) / M_i                 of pinned particles p
    v_i = u_i where M_i > SHARE m_i                                             m_i: of all particles
    v_p = u(x_p),  x_p = y(t)                                                   y: where the pin has the particle

So matter is held at the surface of what is pinned, to half a cell, as by a collider that goes with it; strain goes on within.
The pin gives the impulse J_i = m_i (u_i - v_i) to a node, of which each pinned particle bears the part w m / M_i, and then
m (v_p - v) to the particle itself. Sums over particles are whole numbers of a small unit, so that each order gives the same
bits. Within a frame pins go straight.

A soft pin of stiffness k and damping c pulls a particle to y, which moves with u, by backward Euler: every k is stable.

    dv = (h k (y(t + h) - x) - (h c + h^2 k) (v + h g) + h c u) / (m + h c + h^2 k)
"""

# ruff: noqa: UP018
# int(3) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.elastic_nodes import STICKS, node_rows
from wsim.kernels.particles.mpm.spline import spline_rows
from wsim.kernels.particles.mpm.tables import CELLS, point_tables

SHARE = wp.constant(0.15)          # of a node's mass, from which it is held: nodes up to half a cell off the surface. On the
                                   # mean over places of nodes a quadratic spline then rests there, within 0.3 cells
HEAVY = wp.constant(1000.0)        # times its mass: a node of a pin gives way so much less to a body that presses on it
FINE = wp.constant(wp.float64(2.0**-40))   # unit of mass over that of the heaviest pinned particle
STUCK = wp.constant(1.0e30)        # static friction of a node that a pin holds


@cache
def pin_tables(real) -> SimpleNamespace:
    """Structs PinRows (rows: pinned particles), PinNodes (rows: nodes)."""
    t = types(real)

    @wp.struct
    class PinRows:
        point: wp.array(dtype=int)         # of the particles
        i: wp.array(dtype=int)             # node nearest to where the frame begins
        j: wp.array(dtype=int)
        k: wp.array(dtype=int)
        o: wp.array(dtype=t.vec3)          # offset from it [cells]
        way: wp.array(dtype=t.vec3)        # in the frame [cells]
        stiffness: wp.array(dtype=real)    # of a soft pin [N/m]
        damping: wp.array(dtype=real)      # [N s/m]
        impulse: wp.array(dtype=t.vec3)    # of the pin on the particle since the frame began [kg m/s]
        mass: real                         # of the heaviest [kg]
        dt: real                           # of a frame [s]

    @wp.struct
    class PinNodes:
        sum: wp.array(dtype=wp.int64)      # momentum and mass of pinned particles, four numbers a node
        held: wp.array(dtype=t.vec4)       # velocity of the pin [m/s]; mass of pinned particles where it holds the node, else 0
        given: wp.array(dtype=t.vec4)      # impulse of the pin [kg m/s], and HEAVY times the node's mass [kg]

    return SimpleNamespace(PinRows=PinRows, PinNodes=PinNodes)


@cache
def pin_functions(real) -> SimpleNamespace:
    """pin_place(pins, n, time) -> node and offset [cells]; pin_velocity(pins, n, dx) [m/s]; node_number(grid, block, i, j, k,
    c) of corner c of 27, -1: there is none."""
    t, T, P = types(real), point_tables(real), pin_tables(real)

    @wp.func
    def pin_place(s: P.PinRows, n: int, time: real):
        to = s.o[n] + wp.clamp(time / s.dt, real(0.0), real(1.0)) * s.way[n]
        x = wp.floor(to[0] + real(0.5))
        y = wp.floor(to[1] + real(0.5))
        z = wp.floor(to[2] + real(0.5))
        return s.i[n] + int(x), s.j[n] + int(y), s.k[n] + int(z), to - t.vec3(x, y, z)

    @wp.func
    def pin_velocity(s: P.PinRows, n: int, dx: real):
        return (dx / s.dt) * s.way[n]

    @wp.func
    def node_number(g: T.BlockGrid, b: int, i: int, j: int, k: int, c: int):
        x = (i & 3) + c // 9 - 1
        y = (j & 3) + (c // 3) % 3 - 1
        z = (k & 3) + c % 3 - 1
        other = g.near[27 * b + (9 * ((x >> 2) + 1) + 3 * ((y >> 2) + 1) + (z >> 2) + 1)]
        found = int(-1)
        if other >= 0:
            found = other * CELLS + (16 * (x & 3) + 4 * (y & 3) + (z & 3))
        return found

    @wp.func
    def is_there(points: T.PointRows, p: int):
        found = bool(True)
        if points.there:
            found = points.there[p] == 1
        return found

    return SimpleNamespace(pin_place=pin_place, pin_velocity=pin_velocity, node_number=node_number, is_there=is_there)


@cache
def pin_kernels(real, module) -> SimpleNamespace:
    """Kernels over pinned particles: begin_pins, where a frame begins; pull_points (soft pins) and sum_pins, where a step
    does; end_pins, where it ends. Over nodes: hold_momentum, before nodes move; hold_velocity, when they have; hold_solve, of
    implicit steps. clock: h, time in the frame [s]."""
    t, T, P, f, N = types(real), point_tables(real), pin_tables(real), pin_functions(real), node_rows(real)

    def begin_pins(s: P.PinRows, points: T.PointRows, dx: real):
        n = wp.tid()
        p = s.point[n]
        s.impulse[n] = t.vec3()
        if f.is_there(points, p):
            i, j, k, o = f.pin_place(s, n, real(0.0))
            points.i[p] = i
            points.j[p] = j
            points.k[p] = k
            points.o[p] = o
            points.e[p] = t.vec3()
            points.v[p] = f.pin_velocity(s, n, dx)

    def pull_points(s: P.PinRows, points: T.PointRows, materials: T.MaterialRows, dx: real, clock: wp.array(dtype=real)):
        n = wp.tid()
        p = s.point[n]
        if clock[1] == real(0.0):
            s.impulse[n] = t.vec3()
        if f.is_there(points, p):
            h = clock[0]
            i, j, k, o = f.pin_place(s, n, clock[1] + h)
            away = dx * (t.vec3(real(i - points.i[p]), real(j - points.j[p]), real(k - points.k[p])) + (o - points.o[p]))
            m = materials.density[points.row[p]] * points.volume[p]
            c = h * s.damping[n]
            pull = h * s.stiffness[n]
            row = points.row[p]
            v = points.v[p] + h * materials.gravity[materials.world[row]]        # as it would be without: what rests stays
            dv = (pull * away - (c + h * pull) * v + c * f.pin_velocity(s, n, dx)) / (m + c + h * pull)
            points.v[p] = points.v[p] + dv
            s.impulse[n] = s.impulse[n] + m * dv

    def sum_pins(s: P.PinRows, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                 nodes: P.PinNodes):
        n = wp.tid()
        p = s.point[n]
        b = g.block[p]
        if not f.is_there(points, p) or b < 0:
            return
        m = materials.density[points.row[p]] * points.volume[p]
        v = f.pin_velocity(s, n, g.dx)                         # whatever loads and air have made of it
        s.impulse[n] = s.impulse[n] + m * (v - points.v[p])
        points.v[p] = v
        one = wp.float64(1.0) / (wp.float64(s.mass) * FINE)
        still = wp.float64(clock[0]) / wp.float64(g.dx)        # momentum in units of mass times dx / h
        o = points.o[p]
        w = spline_rows(o)
        cells = int(27)
        for c in range(cells):
            at = f.node_number(g, b, points.i[p], points.j[p], points.k[p], c)
            if at >= 0:
                part = m * w[c // 9, 0] * w[(c // 3) % 3, 1] * w[c % 3, 2]
                r = g.dx * (t.vec3(real(c // 9 - 1), real((c // 3) % 3 - 1), real(c % 3 - 1)) - o)
                q = part * (v + points.C[p] * r)
                for a in range(3):
                    wp.atomic_add(nodes.sum, 4 * at + a, wp.int64(wp.rint(one * still * wp.float64(q[a]))))
                wp.atomic_add(nodes.sum, 4 * at + 3, wp.int64(wp.rint(one * wp.float64(part))))

    @wp.func
    def pinned_velocity(s: P.PinRows, nodes: P.PinNodes, n: int, m: real, scale: wp.float64):
        """Velocity of the pin at a node of mass m, and its particles' mass where it holds the node, else 0; scale: dx / h."""
        found = t.vec4()
        whole = wp.float64(nodes.sum[4 * n + 3])
        mass = real(whole * FINE * wp.float64(s.mass))
        if mass > real(SHARE) * m:
            for a in range(3):
                found[a] = real(scale * wp.float64(nodes.sum[4 * n + a]) / whole)
            found[3] = mass
        return found

    def hold_momentum(s: P.PinRows, g: T.BlockGrid, materials: T.MaterialRows, clock: wp.array(dtype=real), nodes: P.PinNodes,
                      node: wp.array(dtype=t.vec4), node_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = node[n]
        m = sum[3]
        held = t.vec4()
        given = t.vec4()
        if m > real(0.0):
            h = clock[0]
            held = pinned_velocity(s, nodes, n, m, wp.float64(g.dx) / wp.float64(h))
            if held[3] > real(0.0):
                fall = h * materials.gravity[int(g.key[b] >> wp.int64(3 * g.bits))]
                q = m * (t.vec3(held[0], held[1], held[2]) - fall)
                given = t.vec4(q[0] - sum[0], q[1] - sum[1], q[2] - sum[2], real(HEAVY) * m)
                node_out[n] = real(HEAVY) * t.vec4(q[0], q[1], q[2], m)
        nodes.held[n] = held
        nodes.given[n] = given

    def hold_velocity(g: T.BlockGrid, nodes: P.PinNodes, node: wp.array(dtype=t.vec4), node_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        if n // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        u = nodes.held[n]
        if u[3] > real(0.0):
            v = node[n]
            given = nodes.given[n]
            m = given[3]
            nodes.given[n] = given + t.vec4(m * (u[0] - v[0]), m * (u[1] - v[1]), m * (u[2] - v[2]), real(0.0))
            node_out[n] = t.vec4(u[0], u[1], u[2], v[3])

    def hold_solve(s: P.PinRows, g: T.BlockGrid, clock: wp.array(dtype=real), pinned: P.PinNodes, nodes: N):
        n = wp.tid()
        if n // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        m = nodes.star[n][3]
        if m > real(0.0):
            u = pinned_velocity(s, pinned, n, m, wp.float64(g.dx) / wp.float64(clock[0]))
            if u[3] > real(0.0):
                nodes.hold[n] = t.vec4(real(0.0), real(0.0), real(0.0), real(STICKS))
                nodes.wall[n] = t.vec4(u[0], u[1], u[2], real(0.0))
                nodes.rub[n] = real(STUCK)
                nodes.load[n] = real(0.0)
                nodes.v[n] = t.vec4(u[0], u[1], u[2], nodes.v[n][3])

    def end_pins(s: P.PinRows, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                 nodes: P.PinNodes):
        n = wp.tid()
        p = s.point[n]
        b = g.block[p]
        if not f.is_there(points, p) or b < 0:
            return
        m = materials.density[points.row[p]] * points.volume[p]
        v = f.pin_velocity(s, n, g.dx)
        J = m * (v - points.v[p])
        i, j, k, o = f.pin_place(s, n, clock[1])               # where the step began, from whose nodes it has its part
        w = spline_rows(o)
        cells = int(27)
        for c in range(cells):
            at = f.node_number(g, b, i, j, k, c)
            if at >= 0:
                M = nodes.held[at][3]
                if M > real(0.0):
                    q = nodes.given[at]
                    J += (m * w[c // 9, 0] * w[(c // 3) % 3, 1] * w[c % 3, 2] / M) * t.vec3(q[0], q[1], q[2])
        s.impulse[n] = s.impulse[n] + J
        i, j, k, o = f.pin_place(s, n, clock[1] + clock[0])
        points.i[p] = i
        points.j[p] = j
        points.k[p] = k
        points.o[p] = o
        points.e[p] = t.vec3()
        points.v[p] = v

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{t.name}", module=module, enable_backward=False)
            for k in (begin_pins, pull_points, sum_pins, hold_momentum, hold_velocity, hold_solve, end_pins)}
    return SimpleNamespace(**made)
