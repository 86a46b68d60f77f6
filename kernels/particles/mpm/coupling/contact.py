"""Nodes and particles against colliders, bodies and meshes: as walls.py, and what they lose is an impulse on what they meet.

    node      dv = -min((v - u) . n, 0),  friction on dv;  J = -m (v_out - v_in), at the node
    particle  its way ends at the first hit, or slides on; J = -m (v_out - v_in) at its new place, and the angular momentum
              -(x_out - x_in) x m v_in of the change of place besides: then the sum of both stays as it is
    response  of the body of a node that presses: J = K (v - u(y)),  K = m (b + (1 - b) n n^T),
              b = min(mu press / slip, 1):  friction as drag, which leaves a light body with what rubs on it
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.balance import balance_functions
from wsim.kernels.particles.mpm.coupling.impulses import impulse_functions
from wsim.kernels.particles.mpm.coupling.tables import push_tables
from wsim.kernels.particles.mpm.faces import BEYOND, HALF, face_functions
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.walls import NEAR, OFF, SKIN, SLIDES, wall_functions

HELD = wp.constant(0.75)           # cells: nodes so near are within. Half a cell more than GAP: on the mean over places of
                                   # nodes the grid then moves as the surface where the outermost particles are
GAP = wp.constant(0.25)            # cells that a particle keeps from what it pushes: half of the way to the next particle,
                                   # so that a body displaces its own volume

TOUCH = wp.constant(0.1)           # cells: a body so near to the surface of a collider lies on it
FAR = wp.constant(8.0)             # cells: meshes that nodes have met are nearer than that to the particles of these


@cache
def contact_functions(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """push_node(walls, grid, node, world, v, m, clock) -> (v, 1 where something is near, what meshes took of v); sense_node
    alike adds what the bodies' response needs; push_particle(walls, world, y, way, v, what meshes took of v at nodes and of its
    gradients a cell, below them the mass, clock, share) -> (way, v). Lengths [m].

    What nodes lose to a mesh, their particles lose: each gives its part to what is nearest to it, so that points of the mesh
    which take an impulse are those that carry its particles (surfaces.py)."""
    t, T, tables = types(real), point_tables(real), push_tables(real)
    meshes = "forming" in kinds
    ask, give = collider_queries(kinds, real), impulse_functions(kinds, real)
    balance = balance_functions(real)
    wall, faces = wall_functions(kinds, real), face_functions(kinds, real)

    @wp.func
    def meets_world(w: tables.Walls, k: int, world: int):
        return w.pushed.world[k] < 0 or w.pushed.world[k] == world

    @wp.func
    def press_node(w: tables.Walls, k: int, n: t.vec3, u: t.vec3, v: t.vec3):
        """(velocity of a node that a wall of velocity u holds, part of its slip that friction stops, -1 where it leaves)."""
        rest = v - u
        press = -wp.dot(rest, n)
        held = v
        bound = real(-1.0)
        if press > real(0.0):
            rest += press * n
            speed = wp.length(rest)
            rub = w.table.friction[k]
            part = real(0.0)
            if speed > rub[0] * press:
                part = wp.max(real(1.0) - rub[1] * press / speed, real(0.0))
            bound = real(1.0) - part
            held = u + part * rest
        return held, bound

    @wp.func
    def taking_row(w: tables.Walls, k: int, world: int, p: t.vec3, time: real):
        """The row that takes what a node loses to row k, near p on its surface: k, or that of a body that lies there, where
        the particles of the node press on the collider through the body."""
        taker = int(k)
        if w.pushed.first[k] < 0:
            for other in range(w.table.kind.shape[0]):
                if w.table.owner[other] >= 0 and meets_world(w, other, world):
                    phi, n, q = ask.closest(w.table, other, p, time)
                    if phi <= real(TOUCH) * w.pushed.dx:
                        taker = other
        return taker

    @wp.func
    def meets_node(w: tables.Walls, world: int, y: t.vec3, time: real):
        """Whether a node is within something, 1 where something is near, and whether a body is so near that it may press."""
        near = real(0.0)
        body = bool(False)
        met = bool(False)
        for k in range(w.table.kind.shape[0]):
            if meets_world(w, k, world):
                phi = ask.signed(w.table, k, y, time)
                if phi < real(NEAR) * w.pushed.dx:
                    near = real(1.0)
                inside = real(HELD) * w.pushed.dx
                if w.table.kind[k] == SHEET:
                    inside = real(HALF) * w.pushed.dx
                met = met or phi <= inside
                body = body or (phi < real(BEYOND) * w.pushed.dx and w.table.owner[k] >= 0)
        return met, near, body

    @wp.func
    def sense_node(w: tables.Walls, g: T.BlockGrid, n: int, world: int, v: t.vec3, m: real, clock: wp.array(dtype=real)):
        y = wall.node_place(g, n // CELLS, n % CELLS)
        met, near, body = meets_node(w, world, y, clock[1])
        if not (met and body):
            return
        side = faces.matter_side(g, n // CELLS, n % CELLS)
        held = v
        for k in range(w.table.kind.shape[0]):
            if meets_world(w, k, world):
                holds, normal, p = faces.holding_face(w.table, k, y, side, clock[1], w.pushed.dx, real(HELD))
                if holds:
                    taker = taking_row(w, k, world, p, clock[1])
                    u = ask.rate(w.table, taker, y, clock[1])
                    out, bound = press_node(w, taker, normal, u, held)
                    if bound >= real(0.0) and w.table.owner[taker] >= 0:
                        K = m * (bound * wp.identity(n=3, dtype=real) + (real(1.0) - bound) * wp.outer(normal, normal))
                        give.add_response(w, w.table.owner[taker], y, K, held, clock[0], n % w.pushed.sums.shape[0])
                    held = out

    @wp.func
    def push_node(w: tables.Walls, g: T.BlockGrid, n: int, world: int, v: t.vec3, m: real, clock: wp.array(dtype=real)):
        y = wall.node_place(g, n // CELLS, n % CELLS)
        held = v
        lost = t.vec3()
        met, near, body = meets_node(w, world, y, clock[1])
        if met:
            side = faces.matter_side(g, n // CELLS, n % CELLS)
            for k in range(w.table.kind.shape[0]):
                if meets_world(w, k, world):
                    holds, normal, p = faces.holding_face(w.table, k, y, side, clock[1], w.pushed.dx, real(HELD))
                    if holds:
                        taker = taking_row(w, k, world, p, clock[1])
                        u = ask.rate(w.table, taker, y, clock[1])
                        out, bound = press_node(w, taker, normal, u, held)
                        if bound >= real(0.0):
                            if w.table.owner[taker] >= 0:
                                give.give_body(w, w.table.owner[taker], y, m * (held - out), t.vec3(), clock[0],
                                               n % w.pushed.sums.shape[0])
                            elif w.pushed.first[k] >= 0:
                                lost += held - out
                        held = out
        return held, near, lost

    @wp.func
    def free_ride(w: tables.Walls, world: int, hit: int, y: t.vec3, ride: t.vec3, time: real):
        """Part of the way that a particle goes with what it has hit, where no other collider is that nothing pushes: between
        a body and the floor it stays above the floor."""
        free = real(1.0)
        for k in range(w.table.kind.shape[0]):
            if w.pushed.first[k] < 0 and k != hit and meets_world(w, k, world):
                s, n = ask.first_hit(w.table, k, y, time, y + ride, time, real(0.5) * real(SKIN) * w.pushed.dx)
                free = wp.min(free, s)
        return free

    @wp.func
    def walk_particle(w: tables.Walls, world: int, y: t.vec3, way: t.vec3, v: t.vec3, clock: wp.array(dtype=real)):
        """(way, velocity, rows that it hits, what it loses to each [m/s])."""
        time = clock[1]
        h = clock[0]
        skin = real(SKIN) * w.pushed.dx
        gone = t.vec3()
        rest = way
        slow = v
        last = t.vec3()
        hit = int(-1)
        begin = time
        met = wp.vec3i(-1, -1, -1)
        lost = t.mat33()
        slides = int(SLIDES)
        for slide in range(slides + 1):
            part = real(1.0)
            n = t.vec3()
            hit = int(-1)
            for k in range(w.table.kind.shape[0]):
                if meets_world(w, k, world):
                    gap = skin
                    if w.pushed.first[k] >= 0:
                        gap = real(GAP) * w.pushed.dx
                    s, normal = ask.first_hit(w.table, k, y + gone, begin, y + gone + rest, time + h, gap)
                    if s < part:
                        part = s
                        n = normal
                        hit = k
            gone += part * rest
            rest = (real(1.0) - part) * rest
            if hit < 0:
                break
            begin += part * (time + h - begin)
            u = ask.rate(w.table, hit, y + gone, begin)
            dv = -wp.min(wp.dot(slow - u, n), real(0.0)) * n
            slow += dv
            met[slide] = hit
            lost[slide] = -dv
            ride = (time + h - begin) * u
            into = wp.dot(rest - ride, n)
            if into < real(0.0):
                rest += (real(OFF) * skin - into) * n
            last = ride
        if hit >= 0:
            gone += free_ride(w, world, hit, y + gone, last, time + h) * last
        return gone, slow, met, lost

    @wp.func
    def push_particle(w: tables.Walls, world: int, y: t.vec3, way: t.vec3, v: t.vec3, took: t.mat44,
                      clock: wp.array(dtype=real), share: int):
        m = took[3, 0]
        gone, slow, met, lost = walk_particle(w, world, y, way, v, clock)
        slides = int(SLIDES)
        part = m * t.vec3(took[0, 0], took[1, 0], took[2, 0])
        left = part                                            # of meshes, which the nearest gets
        for slide in range(slides + 1):
            k = met[slide]
            if k >= 0:
                if w.table.owner[k] >= 0:
                    T = t.vec3()
                    if slide == 0:
                        T = -m * wp.cross(gone - way, v)
                    give.give_body(w, w.table.owner[k], y + gone, m * lost[slide], T, clock[0], share)
                elif w.pushed.first[k] >= 0:
                    left += m * lost[slide]
        if wp.static(meshes):
            if wp.dot(left, left) > real(0.0):
                k, q = give.nearest_mesh(w, world, y + gone, clock[1] + clock[0], real(FAR) * w.pushed.dx)
                if k >= 0:
                    at = ask.world(w.table, k, give.give_mesh(w, k, q, left), real(0.5) * w.pushed.dt)
                    curl = t.vec3(took[2, 2] - took[1, 3], took[0, 3] - took[2, 1], took[1, 1] - took[0, 2])
                    D = (m * w.pushed.dx) * curl + wp.cross(y - at, left) + wp.cross(gone, left - part)
                    if met[0] == k:
                        D -= m * wp.cross(gone - way, v)
                    balance.add_lack(w, k, D)
        return gone, slow

    return SimpleNamespace(push_node=push_node, sense_node=sense_node, push_particle=push_particle)
