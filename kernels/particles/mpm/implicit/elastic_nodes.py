"""Nodes of implicit elastic steps: velocities without stress, and the colliders that they are within.

A node within a collider that is pressed keeps its normal velocity. Coulomb friction is a drag, see elastic_solve.py. Between
two colliders that press it, a node stays with the deeper one; without friction it is free along the edge of both.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.faces import face_functions
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.transfers import node_function
from wsim.kernels.particles.mpm.walls import ON, wall_functions

OUTSIDE, FREE, SLIDES = -1.0, 0.0, 1.0     # of a node: outside of colliders; not pressed; pressed
STICKS, EDGES = 2.0, 3.0                   # pressed by several, or held by a pin; by two that do not rub: free along their edge

LIKE = wp.constant(1.0e-4)         # square of the sine between normals, below which two faces are one


@cache
def node_rows(real):
    """Struct of what nodes carry, (nodes,) each."""
    t = types(real)

    @wp.struct
    class NodeRows:
        star: wp.array(dtype=t.vec4)       # velocity without stress [m/s], mass [kg]
        v: wp.array(dtype=t.vec4)          # velocity [m/s], and 1 where a collider is near
        f: wp.array(dtype=t.vec4)          # impulses that particles add on a CPU [kg m/s]
        r: wp.array(dtype=t.vec4)          # residual [kg m/s]
        z: wp.array(dtype=t.vec4)          # [m/s]
        w: wp.array(dtype=t.vec4)          # [kg m/s]
        p: wp.array(dtype=t.vec4)          # [m/s]
        s: wp.array(dtype=t.vec4)          # [kg m/s]
        y: wp.array(dtype=t.vec4)          # change of v [m/s]
        hold: wp.array(dtype=t.vec4)       # normal of the collider, and OUTSIDE, FREE, SLIDES or STICKS
        wall: wp.array(dtype=t.vec4)       # its velocity [m/s], dynamic friction
        rub: wp.array(dtype=real)          # its static friction
        load: wp.array(dtype=real)         # impulse of the collider along the normal [kg m/s]
        inverse: wp.array(dtype=t.mat33)   # of the node's block of the matrix [1/kg]
        drag: wp.array(dtype=real)         # impulse of friction over the velocity that the node slides by [kg]

    return NodeRows


@cache
def solve_functions(real) -> SimpleNamespace:
    """head(a): the vector of a row; filtered(hold, a): a without what colliders hold."""
    t = types(real)

    @wp.func
    def head(a: t.vec4):
        return t.vec3(a[0], a[1], a[2])

    @wp.func
    def filtered(hold: t.vec4, a: t.vec3):
        found = a
        n = head(hold)
        if hold[3] == real(STICKS):
            found = t.vec3()
        elif hold[3] == real(SLIDES):
            found = a - wp.dot(a, n) * n
        elif hold[3] == real(EDGES):
            found = wp.dot(a, n) * n
        return found

    @wp.func
    def row(a: t.vec3, last: real):
        return t.vec4(a[0], a[1], a[2], last)

    return SimpleNamespace(head=head, filtered=filtered, row=row)


@cache
def start_kernel(kinds: tuple[str, ...], cpu: bool, real, module):
    """Kernel over nodes: velocities without stress, and the collider that each is within."""
    t, T, N, Colliders = types(real), point_tables(real), node_rows(real), collider_type(real)
    gather, wall, f, walls = node_function(real), wall_functions(kinds, real), solve_functions(real), bool(kinds)
    ask, faces = collider_queries(kinds or ("sphere",), real), face_functions(kinds, real)

    @wp.func
    def find_wall(c: Colliders, g: T.BlockGrid, n: int, time: real, v: t.vec3, mass: real, nodes: N):
        """v, held by the deepest of the faces that matter touches (faces.py); its row is kept."""
        y = wall.node_place(g, n // CELLS, n % CELLS)
        met, near = wall.meets_node(c, y, time, g.dx)
        side = t.vec3()
        if met:
            side = faces.matter_side(g, n // CELLS, n % CELLS)
        state = real(OUTSIDE)
        deepest = real(1.0e30)
        normal = t.vec3()
        rubs = bool(False)
        held = v
        for k in range(c.kind.shape[0]):
            holds, m, p = faces.holding_face(c, k, y, side, time, g.dx, real(ON))
            phi = wp.dot(y - p, m)
            if met and holds:
                u = ask.rate(c, k, y, time)
                into = wp.dot(held - u, m)
                before = state
                edge = wp.cross(normal, m)                     # of two faces; of one that goes on in another row it is 0
                both = state > real(FREE) and into < real(0.0) and wp.length_sq(edge) > real(LIKE)
                rubs = rubs or c.friction[k][0] > real(0.0)
                if phi < deepest:
                    deepest = phi
                    normal = m
                    nodes.wall[n] = f.row(u, c.friction[k][1])
                    nodes.rub[n] = c.friction[k][0]
                state = wp.max(state, real(FREE))
                if into < real(0.0):
                    nodes.load[n] = -mass * into
                    held -= into * m
                    state = wp.max(state, real(SLIDES))
                if both:                                       # a corner of two: it stays with the deeper
                    slip = v - f.head(nodes.wall[n])
                    held = f.head(nodes.wall[n])
                    nodes.rub[n] = real(1.0e30)
                    if rubs or before > real(SLIDES):
                        state = real(STICKS)
                    else:
                        state = real(EDGES)
                        normal = wp.normalize(edge)
                        held += wp.dot(slip, normal) * normal
        nodes.hold[n] = f.row(normal, state)
        return held, near

    def start_nodes(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), materials: T.MaterialRows, c: Colliders,
                    clock: wp.array(dtype=real), nodes: N):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = t.vec4()
        if wp.static(cpu):                                     # noqa: SIM108 - one of them is compiled
            sum = nodes.f[n]
        else:
            sum = gather(g, sums, b, n % CELLS)
        v = t.vec3()
        near = real(0.0)
        star = t.vec4()
        nodes.hold[n] = t.vec4(real(0.0), real(0.0), real(0.0), real(OUTSIDE))
        if sum[3] > real(0.0):
            world = int(g.key[b] >> wp.int64(3 * g.bits))
            v = f.head(sum) / sum[3] + clock[0] * materials.gravity[world]
            star = f.row(v, sum[3])
            if wp.static(walls):
                v, near = find_wall(c, g, n, clock[0] + clock[1], v, sum[3], nodes)
            if nodes.hold[n][3] == real(OUTSIDE):              # the first guess: what rests goes on so
                v = f.head(sum) / sum[3]
        nodes.star[n] = star
        nodes.drag[n] = real(0.0)
        nodes.v[n] = f.row(v, near)

    return wp.kernel(start_nodes, name=f"mpm_start_nodes_{'_'.join(kinds)}_{'cpu_' * cpu}{t.name}", module=module,
                     enable_backward=False)
