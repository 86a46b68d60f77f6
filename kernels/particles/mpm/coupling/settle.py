"""Where a frame ends: bodies have gone their own way, a little another than the one that particles saw. Particles that are
left within one, or within its skin, are set beside it. The velocity stays, and the angular momentum of the change of place,
-d x m v, goes to the body."""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.impulses import impulse_functions
from wsim.kernels.particles.mpm.coupling.tables import push_tables
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.kernels.particles.mpm.walls import SKIN

ROUNDS = wp.constant(2)            # over all bodies: a particle between two is clear of both


@cache
def settle_kernel(kinds: tuple[str, ...], laws: tuple[str, ...], real, module):
    """Kernel over particles."""
    t, T, tables = types(real), point_tables(real), push_tables(real)
    ask, give, shift = (collider_queries(kinds, real), impulse_functions(kinds, real).give_body,
                        motion_functions(laws, real).shift_particle)

    @wp.func
    def free_part(w: tables.Walls, y: t.vec3, way: t.vec3, skin: real):
        """Part of a way at the end of the frame that colliders leave free."""
        part = real(1.0)
        for k in range(w.table.kind.shape[0]):
            if w.pushed.first[k] < 0:
                s, n = ask.first_hit(w.table, k, y, w.pushed.dt, y + way, w.pushed.dt, skin)
                part = wp.min(part, s)
        return part

    def settle_particles(points: T.PointRows, materials: T.MaterialRows, w: tables.Walls):
        p = wp.tid()
        if points.there:
            if points.there[p] != 1:
                return
        row = points.row[p]
        dx = w.pushed.dx
        skin = real(SKIN) * dx
        y = dx * (t.vec3(real(points.i[p]), real(points.j[p]), real(points.k[p])) + points.o[p])
        whole = t.vec3()
        rounds = int(ROUNDS)
        for _ in range(rounds):
            for k in range(w.table.kind.shape[0]):
                world = w.pushed.world[k]
                if w.pushed.first[k] >= 0 and w.table.kind[k] != SHEET and (world < 0 or world == materials.world[row]):
                    phi, n, near = ask.closest(w.table, k, y, w.pushed.dt)
                    if phi < real(0.5) * skin:
                        way = (skin - phi) * n
                        way = free_part(w, y, way, real(0.5) * skin) * way
                        m = materials.density[row] * points.volume[p]
                        if w.table.owner[k] >= 0:
                            give(w, w.table.owner[k], y, t.vec3(), -m * wp.cross(way, points.v[p]), w.pushed.dt,
                                 p % w.pushed.sums.shape[0])
                        y += way
                        whole += way
        if wp.dot(whole, whole) > real(0.0):
            shift(points, p, points.i[p], points.j[p], points.k[p], points.o[p], whole / dx)

    return wp.kernel(settle_particles, name=f"mpm_settle_particles_{'_'.join((*kinds, *laws))}_{t.name}", module=module,
                     enable_backward=False)
