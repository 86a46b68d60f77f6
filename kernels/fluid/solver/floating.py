"""Rigid bodies in the equation of the pressure: both are solved for at once (Batty, Bertails, Bridson 2007, section 5).

    (A + s J M^-1 J^T) p = - outflow(u, V)         J     outflow of each cell by a velocity V = (v, omega) of each body:
    V += s M^-1 J^T p                                    sum over its faces of (1 - o) n . (v + omega x r)
                                                   s     density dx^3, of the unit of p (kernels/fluid/pressure.py)

Symmetric and positive: light bodies are stable, where a force that comes a step late is not once a fluid is heavier than its
body. J^T p is one sum a body over a box of cells around it, in float64, by parts and in one order.

Openings are those of areas (kernels/fluid/fractions.py): a body that moves along with a fluid does not disturb it. But J^T p
then takes the pressure at the centres of cells, which a surface across them misses by up to a cell of depth: what it lacks has
the equation beside it, see kernels/fluid/solver/leaning.py.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import cell_from_index, flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.pressure import poisson_stencil
from wsim.kernels.fluid.solver import immersed_bodies
from wsim.kernels.fluid.solver.level import pressure_levels
from wsim.kernels.math.real import types
from wsim.kernels.rigid import motion
from wsim.kernels.solver.pcg import block_sum


@cache
def body_covers(real):
    """Struct: open, body of the faces of each axis (-1: none's), cells that count, axes of the world."""
    S = grid_structs(real)

    @wp.struct
    class Cover:
        open: S.Faces
        x: wp.array(dtype=int)
        y: wp.array(dtype=int)
        z: wp.array(dtype=int)
        mark: wp.array(dtype=int)              # 1: cells whose outflow depends on a body
        axes: wp.vec3i

    return Cover


@cache
def at_faces(dim: int, real) -> SimpleNamespace:
    """share(g, cover, i, axis, side) -> (body of that face of cell i or -1, part of it that is closed, outward positive);
    speed(g, cover, s, i, axis, b, v, spin) -> component across face i of an axis; along(cover, axis, value) -> vector of the
    world; lever(g, cover, i, axis, center) -> from there to the middle of face i [m], in the plane where flat."""
    t, S, f, Cover = types(real), grid_structs(real), grid_functions(dim, real), body_covers(real)

    @wp.func
    def side_face_row(g: S.Grid, i: wp.vec3i, axis: int, side: int):
        j = wp.vec3i(i[0], i[1], i[2])
        j[axis] = i[axis] + side
        if g.periodic[axis] != 0 and j[axis] == g.n[axis]:
            j[axis] = 0
        return flat_cell_index(j, f.faces(g, axis))

    @wp.func
    def body_face_share(g: S.Grid, cover: Cover, i: wp.vec3i, axis: int, side: int):
        c = side_face_row(g, i, axis, side)
        b = int(-1)
        o = real(1.0)
        if axis == 0:
            b = cover.x[c]
            o = cover.open.x[c]
        elif axis == 1:
            b = cover.y[c]
            o = cover.open.y[c]
        else:
            b = cover.z[c]
            o = cover.open.z[c]
        return b, real(2 * side - 1) * (real(1.0) - o)

    @wp.func
    def axis_to_world(cover: Cover, axis: int, value: real):
        v = t.vec3()
        v[cover.axes[axis]] = value
        return v

    @wp.func
    def face_lever_arm(g: S.Grid, cover: Cover, i: wp.vec3i, axis: int, center: t.vec3):
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(axis)
        r = t.vec3()
        for a in range(wp.static(dim)):
            r[cover.axes[a]] = g.dx * x[a] - center[cover.axes[a]]
        return r

    @wp.func
    def body_face_speed(g: S.Grid, cover: Cover, i: wp.vec3i, axis: int, center: t.vec3, v: t.vec3, spin: t.vec3):
        all = v + wp.cross(spin, face_lever_arm(g, cover, i, axis, center))
        return all[cover.axes[axis]]

    return SimpleNamespace(row=side_face_row, share=body_face_share, along=axis_to_world, lever=face_lever_arm,
                           speed=body_face_speed)


@cache
def body_rate_kernel(dim: int, real, module):
    """Kernel over the faces of an axis: velocity of the bodies that cover them, where one does."""
    S, A, f, Cover, of = (grid_structs(real), immersed_bodies.immersed_structs(real), grid_functions(dim, real),
                          body_covers(real), at_faces(dim, real))

    def body_face_rates(g: S.Grid, axis: int, cover: Cover, owner: wp.array(dtype=int), s: A.Afloat,
                        rate_out: wp.array(dtype=real)):
        c = wp.tid()
        b = owner[c]
        if b >= 0:
            i = f.place(c, f.faces(g, axis))
            rate_out[c] = of.speed(g, cover, i, axis, s.at[b], s.v[b], s.spin[b])

    return wp.kernel(body_face_rates, name=f"floating_rates_{f.name}", module=module, enable_backward=False)


@cache
def body_mark_kernel(dim: int, fractions: int, real, module):
    """Kernel over cells: 1 where the equation of the cell knows a body. phi: of a liquid, None: all cells are fluid."""
    S, f, Cover, of, Level = (grid_structs(real), grid_functions(dim, real), body_covers(real), at_faces(dim, real),
                              pressure_levels(real))
    s = poisson_stencil(dim, fractions, real)

    def mark_body_cells(g: S.Grid, level: Level, cover: Cover, phi: wp.array(dtype=real), mark_out: wp.array(dtype=int)):
        c = wp.tid()
        i = f.place(c, g.n)
        found = int(0)
        around = int(wp.static(2 * dim))                       # a variable: the loop is compiled once
        for m in range(around):
            b, part = of.share(g, cover, i, m // 2, m % 2)
            if b >= 0 and part != real(0.0):
                found = int(1)
        if found == 1:
            if s.diagonal(level, i) == real(0.0):
                found = int(0)
            if phi:
                if phi[c] >= real(0.0):
                    found = int(0)
        mark_out[c] = found

    return wp.kernel(mark_body_cells, name=f"floating_mark_{s.name}", module=module, enable_backward=False)


@cache
def pressure_force_kernel(dim: int, real, module):
    """Kernel over blocks of threads, as many for each body: parts of J^T q, about the bodies' centres."""
    t, S, A, Cover, of = (types(real), grid_structs(real), immersed_bodies.immersed_structs(real), body_covers(real),
                          at_faces(dim, real))

    @wp.func
    def body_cell_box(g: S.Grid, cover: Cover, center: t.vec3, reach: real):
        """(first cell, cells along the axes) of a box about a body."""
        low = wp.vec3i(0, 0, 0)
        size = wp.vec3i(1, 1, 1)
        for a in range(wp.static(dim)):
            middle = center[cover.axes[a]] / g.dx
            half = reach / g.dx + real(2.0)
            low[a] = int(wp.clamp(wp.floor(middle - half), real(0.0), real(g.n[a])))
            size[a] = int(wp.clamp(wp.ceil(middle + half), real(0.0), real(g.n[a]))) - low[a]
        return low, size

    def gather_pressure_force(g: S.Grid, cover: Cover, s: A.Afloat, q: wp.array(dtype=real),
                              force_out: wp.array(dtype=wp.vec3d), torque_out: wp.array(dtype=wp.vec3d)):
        block = wp.tid() // wp.block_dim()
        each = force_out.shape[0] // s.row.shape[0]
        b = block // each
        low, size = body_cell_box(g, cover, s.at[b], s.reach[b])
        force = wp.vec3d()
        torque = wp.vec3d()
        lanes = each * wp.block_dim()
        for m in range(wp.tid() - b * lanes, size[0] * size[1] * size[2], lanes):
            i = low + cell_from_index(m, size)
            c = flat_cell_index(i, g.n)
            if cover.mark[c] != 0:
                sides = int(wp.static(2 * dim))                # a variable: the loop is compiled once
                for k in range(sides):
                    a = k // 2
                    owner, part = of.share(g, cover, i, a, k % 2)
                    if owner == b:
                        F = of.along(cover, a, part * q[c])
                        face = wp.vec3i(i[0], i[1], i[2])
                        face[a] = i[a] + k % 2
                        T = wp.cross(of.lever(g, cover, face, a, s.at[b]), F)
                        force += wp.vec3d(wp.float64(F[0]), wp.float64(F[1]), wp.float64(F[2]))
                        torque += wp.vec3d(wp.float64(T[0]), wp.float64(T[1]), wp.float64(T[2]))
        force = wp.vec3d(block_sum(force[0]), block_sum(force[1]), block_sum(force[2]))
        torque = wp.vec3d(block_sum(torque[0]), block_sum(torque[1]), block_sum(torque[2]))
        if wp.tid() % wp.block_dim() == 0:
            force_out[block] = force
            torque_out[block] = torque

    name = f"floating_gather_{dim}d_{t.name}"
    return wp.kernel(gather_pressure_force, name=name, module=module, enable_backward=False, grid_stride=False)


@cache
def body_response_kernel(real, module):
    """Kernel over bodies: the change of velocity by s J^T q, s: scale."""
    t, A, (Bodies, _), whole = (types(real), immersed_bodies.immersed_structs(real), motion.body_structs(real),
                                immersed_bodies.body_sum_function(real))

    def respond_to_pressure(b: Bodies, s: A.Afloat, scale: real, force: wp.array(dtype=wp.vec3d),
                            torque: wp.array(dtype=wp.vec3d), v_out: wp.array(dtype=t.vec3), spin_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        i = s.row[k]
        v_out[k] = (scale * b.w[i]) * whole(force, k, s.row.shape[0])
        spin_out[k] = motion.angular_velocity_of(s.seen[k], scale * whole(torque, k, s.row.shape[0]), b.inverse[i])

    return wp.kernel(respond_to_pressure, name=f"floating_respond_{t.name}", module=module, enable_backward=False)


@cache
def body_motion_kernel(dim: int, real, module):
    """Kernel over cells: w_out += sign J V, of changes of velocity V."""
    t, S, A, f = types(real), grid_structs(real), immersed_bodies.immersed_structs(real), grid_functions(dim, real)
    Cover, of = body_covers(real), at_faces(dim, real)

    def spread_body_motion(g: S.Grid, cover: Cover, sign: real, s: A.Afloat, v: wp.array(dtype=t.vec3),
                           spin: wp.array(dtype=t.vec3), w_out: wp.array(dtype=real)):
        c = wp.tid()
        if cover.mark[c] != 0:
            i = f.place(c, g.n)
            sum = real(0.0)
            sides = int(wp.static(2 * dim))                    # a variable: the loop is compiled once
            for k in range(sides):
                a = k // 2
                b, part = of.share(g, cover, i, a, k % 2)
                if b >= 0:
                    face = wp.vec3i(i[0], i[1], i[2])
                    face[a] = i[a] + k % 2
                    sum += part * of.speed(g, cover, face, a, s.at[b], v[b], spin[b])
            w_out[c] = w_out[c] + sign * sum

    return wp.kernel(spread_body_motion, name=f"floating_spread_{f.name}", module=module, enable_backward=False)
