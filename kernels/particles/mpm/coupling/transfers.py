"""Kernels of a step where material points push what they meet, beside transfers.py: nodes, and the particles' ways."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.blocks import block_functions
from wsim.kernels.particles.mpm.coupling.contact import contact_functions
from wsim.kernels.particles.mpm.coupling.tables import push_tables
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.transfers import gather_function


@cache
def push_kernels(kinds: tuple[str, ...], laws: tuple[str, ...], cpu: bool, real, module) -> SimpleNamespace:
    """sense_nodes, push_nodes over nodes of all blocks, which have momentum and mass: the velocity at the end of the step and 1
    where something is near; push_particles over rows of the order, when they have moved. clock: h, time [s]."""
    t, T, tables = types(real), point_tables(real), push_tables(real)
    gather_velocity, meshes = gather_function(cpu, real), "forming" in kinds
    meet, local = contact_functions(kinds, real), block_functions(real).local_cell
    shift = motion_functions(laws, real).shift_particle

    @wp.func
    def free_velocity(g: T.BlockGrid, materials: T.MaterialRows, n: int, sum: t.vec4, h: real):
        world = int(g.key[n // CELLS] >> wp.int64(3 * g.bits))
        return world, t.vec3(sum[0], sum[1], sum[2]) / sum[3] + h * materials.gravity[world]

    def sense_nodes(g: T.BlockGrid, materials: T.MaterialRows, w: tables.Walls, clock: wp.array(dtype=real),
                    node: wp.array(dtype=t.vec4)):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = node[n]
        if sum[3] > real(0.0):
            world, v = free_velocity(g, materials, n, sum, clock[0])
            meet.sense_node(w, g, n, world, v, sum[3], clock)

    def push_nodes(g: T.BlockGrid, materials: T.MaterialRows, w: tables.Walls, clock: wp.array(dtype=real),
                   node: wp.array(dtype=t.vec4), node_out: wp.array(dtype=t.vec4), lost_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = node[n]
        v = t.vec3()
        lost = t.vec3()
        near = real(0.0)
        if sum[3] > real(0.0):
            world, free = free_velocity(g, materials, n, sum, clock[0])
            v, near, lost = meet.push_node(w, g, n, world, free, sum[3], clock)
        node_out[n] = t.vec4(v[0], v[1], v[2], near)
        if wp.static(meshes):
            lost_out[n] = t.vec4(lost[0], lost[1], lost[2], wp.length_sq(lost))

    def push_particles(g: T.BlockGrid, node: wp.array(dtype=t.vec4), lost: wp.array(dtype=t.vec4), materials: T.MaterialRows,
                       w: tables.Walls, clock: wp.array(dtype=real), points: T.PointRows):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        v = points.v[p]
        way = clock[0] * v
        o = points.o[p] - way / g.dx                           # where it came from, and from which node's cell
        at = t.vec3(real(points.i[p]), real(points.j[p]), real(points.k[p])) + o
        i = int(wp.floor(at[0] + real(0.5)))
        j = int(wp.floor(at[1] + real(0.5)))
        k = int(wp.floor(at[2] + real(0.5)))
        if node[CELLS * g.block[p] + local(i, j, k)][3] > real(0.0):
            row = points.row[p]
            m = materials.density[row] * points.volume[p]
            took = t.mat44()
            if wp.static(meshes):
                took = gather_velocity(g, g.block[p], i, j, k, at - t.vec3(real(i), real(j), real(k)), lost)
            took[3, 0] = m
            gone, slow = meet.push_particle(w, materials.world[row], g.dx * at, way, v, took, clock,
                                            n % w.pushed.sums.shape[0])
            back = (gone - way) / g.dx
            if wp.dot(back, back) > real(0.0):
                shift(points, p, points.i[p], points.j[p], points.k[p], points.o[p], back)
            points.v[p] = slow

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join((*kinds, *laws))}_{'cpu_' * cpu}{t.name}",
                                  module=module, enable_backward=False)
            for k in (sense_nodes, push_nodes, push_particles)}
    return SimpleNamespace(**made)
