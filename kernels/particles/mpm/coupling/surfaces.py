"""Points of cloth and soft bodies among material points, through a frame.

Particles go first: they see each surface go on as fast as it is, and give its points an impulse J in all. Then the points go
through the frame by their own method. Sand outweighs cloth by hundreds: what lies on it must not stay behind while it moves.
So each point carries, in its own frame, the mass M of the particles that press on it and that a wave reaches in the frame,

    (m + M) dv = (f + m g) dt + J,      and those particles then get dv too:      -J + M dv  in all

and go where it goes. The sum of both is kept, and a light point under heavy sand is as heavy as that: the impulse of the next
frame would else make up for dv, by M / m times as much (added mass). A particle takes the parts (u, v, 1 - u - v) of the
nearest triangle's corners.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.segment import segment_queries
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.balance import balance_functions
from wsim.kernels.particles.mpm.coupling.impulses import impulse_functions
from wsim.kernels.particles.mpm.coupling.tables import FINE, push_tables
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.kernels.particles.mpm.walls import SKIN

REACH = wp.constant(1.5)           # cells from a surface within which particles count as next to it


@cache
def surface_tables(real) -> SimpleNamespace:
    """Structs SurfacePoints (rows: points of all meshes), Attached (rows: particles)."""
    t = types(real)

    @wp.struct
    class SurfacePoints:
        row: wp.array(dtype=int)               # of the points of the state
        mass: wp.array(dtype=wp.int64)         # of particles that each carries, in units
        before: wp.array(dtype=t.vec3)         # its velocity where the frame begins [m/s], then how much that has changed
        place: wp.array(dtype=t.vec3)          # and its place [m], then how far it has come from the one that particles saw
        w: wp.array(dtype=real)                # what it has by itself: inverse mass [1/kg]
        gravity: wp.array(dtype=t.vec3)        # and gravity [m/s^2]

    @wp.struct
    class Attached:
        near: wp.array(dtype=int)              # row of the collider table that is nearest; -1: none
        place: wp.array(dtype=t.vec3)          # in its frame
        corner: wp.array(dtype=wp.vec3i)       # points of the nearest triangle
        part: wp.array(dtype=t.vec3)           # of each, of the nearest place
        share: wp.array(dtype=t.vec3)          # of each, of what it carries; 0: it carries none of the particle

    return SimpleNamespace(SurfacePoints=SurfacePoints, Attached=Attached)


@cache
def surface_kernels(kinds: tuple[str, ...], laws: tuple[str, ...], real, module) -> SimpleNamespace:
    """attach_particles, release_particles, turn_particles over particles; load_points, unload_points over points of meshes."""
    t, T, tables, own = types(real), point_tables(real), push_tables(real), surface_tables(real)
    nearest_mesh, balance = impulse_functions(kinds, real).nearest_mesh, balance_functions(real)
    ask, shape, shift = (collider_queries(kinds, real), segment_queries(kinds, real),
                         motion_functions(laws, real).shift_particle)

    @wp.func
    def particle_place(points: T.PointRows, p: int, dx: real):
        return dx * (t.vec3(real(points.i[p]), real(points.j[p]), real(points.k[p])) + points.o[p])

    @wp.func
    def point_impulse(w: tables.Walls, n: int):
        """Of a point of meshes in the frame, in units."""
        return t.vec3(real(w.pushed.point[3 * n]), real(w.pushed.point[3 * n + 1]), real(w.pushed.point[3 * n + 2]))

    def attach_particles(points: T.PointRows, materials: T.MaterialRows, w: tables.Walls, s: own.SurfacePoints,
                         out: own.Attached):
        p = wp.tid()
        out.near[p] = -1
        if points.there:
            if points.there[p] != 1:
                return
        row = points.row[p]
        dx = w.pushed.dx
        speed = wp.sqrt(points.a[p] / materials.density[row])
        y = particle_place(points, p, dx)
        k, q = nearest_mesh(w, materials.world[row], y, w.pushed.dt, real(REACH) * dx + speed * w.pushed.dt)
        out.near[p] = k
        out.place[p] = q
        out.share[p] = t.vec3()
        if k < 0:
            return
        mesh = w.table.mesh[k]
        near = wp.mesh_query_point_no_sign(mesh, wp.vec3f(q), float(1.0e9))
        first = w.pushed.first[k]
        c = wp.vec3i(first + wp.mesh_get_index(mesh, 3 * near.face), first + wp.mesh_get_index(mesh, 3 * near.face + 1),
                     first + wp.mesh_get_index(mesh, 3 * near.face + 2))
        b = t.vec3(real(near.u), real(near.v), real(1.0) - real(near.u) - real(near.v))
        J = b[0] * point_impulse(w, c[0]) + b[1] * point_impulse(w, c[1]) + b[2] * point_impulse(w, c[2])
        at = wp.mesh_eval_position(mesh, near.face, near.u, near.v)
        off = q - t.vec3(real(at[0]), real(at[1]), real(at[2]))
        out.corner[p] = c
        out.part[p] = b
        if wp.dot(J, wp.quat_rotate(ask.turned(w.table, k, w.pushed.dt), off)) < real(0.0):       # it presses from its side
            out.share[p] = b
            m = wp.float64(materials.density[row] * points.volume[p]) / (wp.float64(w.pushed.mass) * FINE)
            for a in range(3):
                wp.atomic_add(s.mass, c[a], wp.int64(wp.rint(m * wp.float64(b[a]))))

    @wp.func
    def carried_mass(w: tables.Walls, s: own.SurfacePoints, n: int):
        return real(wp.float64(w.pushed.mass) * FINE * wp.float64(s.mass[n]))

    def load_points(w: tables.Walls, s: own.SurfacePoints, x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3),
                    w_out: wp.array(dtype=real), gravity_out: wp.array(dtype=t.vec3)):
        n = wp.tid()
        i = s.row[n]
        s.before[n] = v[i]
        s.place[n] = x[i]
        s.w[n] = w_out[i]
        g = gravity_out[i]
        s.gravity[n] = g
        if s.w[n] > real(0.0):
            unit = wp.float64(w.pushed.mass) * wp.float64(w.pushed.dx) / wp.float64(w.pushed.dt) * FINE
            J = real(unit) * point_impulse(w, n)
            M = carried_mass(w, s, n)
            whole = real(1.0) / s.w[n] + M
            w_out[i] = real(1.0) / whole
            gravity_out[i] = g + (J / w.pushed.dt - M * g) / whole

    def unload_points(w: tables.Walls, s: own.SurfacePoints, x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3),
                      w_out: wp.array(dtype=real), gravity_out: wp.array(dtype=t.vec3)):
        """A frame has ended: points weigh what they do by themselves."""
        n = wp.tid()
        i = s.row[n]
        w_out[i] = s.w[n]
        gravity_out[i] = s.gravity[n]
        s.place[n] = (x[i] - s.place[n]) - w.pushed.dt * s.before[n]
        change = t.vec3()
        if s.w[n] > real(0.0):
            change = v[i] - s.before[n]
        s.before[n] = change
        s.mass[n] = wp.int64(0)
        for a in range(3):
            w.pushed.point[3 * n + a] = wp.int64(0)

    def release_particles(points: T.PointRows, materials: T.MaterialRows, w: tables.Walls, s: own.SurfacePoints,
                          of: own.Attached, x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3)):
        p = wp.tid()
        k = of.near[p]
        if k < 0:
            return
        dx = w.pushed.dx
        y = particle_place(points, p, dx)
        way = t.vec3()
        D = t.vec3()
        b = of.share[p]
        if wp.dot(b, b) > real(0.0):
            c = of.corner[p]
            for e in range(3):                                 # what the mesh has lost to it, about y
                moved = s.before[c[e]]
                row = s.row[c[e]]
                D += b[e] * (wp.cross(wp.transform_point(w.table.pose[0, k], x[row]) - y, moved)
                             + wp.cross(s.place[c[e]], v[row] - moved))
            points.v[p] = points.v[p] + (b[0] * s.before[c[0]] + b[1] * s.before[c[1]] + b[2] * s.before[c[2]])
            way += b[0] * s.place[c[0]] + b[1] * s.place[c[1]] + b[2] * s.place[c[2]]
        if w.table.kind[k] == SHEET:                           # it stays on its side of where the sheet has gone
            a = of.place[p]
            q = ask.local(w.table, k, y + way, w.pushed.dt)
            part, n = shape.first_hit(w.table.kind[k], w.table.size[k], w.table.mesh[k], a, q, real(SKIN) * dx)
            if part < real(1.0):
                way = ask.world(w.table, k, a + part * (q - a), w.pushed.dt) - y
        part = real(1.0)
        for other in range(w.table.kind.shape[0]):             # what is not pushed stays in the way
            if w.pushed.first[other] < 0:
                free, n = ask.first_hit(w.table, other, y, w.pushed.dt, y + way, w.pushed.dt, real(SKIN) * dx)
                part = wp.min(part, free)
        shift(points, p, points.i[p], points.j[p], points.k[p], points.o[p], part * way / dx)
        m = points.volume[p] * materials.density[points.row[p]]
        balance.add_lack(w, k, m * (D - wp.cross(part * way, points.v[p])))
        if wp.dot(b, b) > real(0.0):
            balance.add_carried(w, k, particle_place(points, p, dx), m)

    def turn_particles(points: T.PointRows, w: tables.Walls, of: own.Attached):
        p = wp.tid()
        b = of.share[p]
        if of.near[p] >= 0 and wp.dot(b, b) > real(0.0):
            spin, center = balance.find_turn(w, of.near[p])
            points.v[p] = points.v[p] + wp.cross(spin, particle_place(points, p, w.pushed.dx) - center)

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join((*kinds, *laws))}_{t.name}", module=module,
                                  enable_backward=False)
            for k in (attach_particles, load_points, unload_points, release_particles, turn_particles)}
    return SimpleNamespace(**made)


@cache
def loaded_kernel(real, module):
    """Kernel over points that bear loads: their gravity without loads follows that of the points, and back."""
    t = types(real)

    def follow_gravity(point: wp.array(dtype=int), gravity: wp.array(dtype=t.vec3), own_out: wp.array(dtype=t.vec3)):
        j = wp.tid()
        own_out[j] = gravity[point[j]]

    return wp.kernel(follow_gravity, name=f"mpm_follow_gravity_{t.name}", module=module, enable_backward=False)
