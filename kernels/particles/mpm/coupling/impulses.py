"""Sums of impulses in whole numbers (tables.py): whatever the order, the same bits."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.tables import FINE, GIVEN, SUMS, push_tables


@wp.func
def add_whole(sums: wp.array2d(dtype=wp.int64), share: int, at: int, value: wp.float64):
    """Adds a value, in units, rounded."""
    wp.atomic_add(sums, share, at, wp.int64(wp.rint(value)))


@cache
def impulse_functions(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """give_body(walls, body, y, J, T, h, share): a body gets the impulse J [kg m/s] at a place y [m], and the angular impulse
    T [kg m^2/s] besides. nearest_mesh, give_mesh: alike, points of a mesh. add_response(walls, body, y, K, v, h, share): of a
    node at y with the velocity v whose impulse on the body is K (v - u(y)), the matrix and vector of the body's response."""
    t, tables = types(real), push_tables(real)
    ask = collider_queries(kinds, real)

    @wp.func
    def momentum_unit(w: tables.Walls, h: real):
        return wp.float64(w.pushed.mass) * wp.float64(w.pushed.dx) / wp.float64(h) * FINE

    @wp.func
    def give_body(w: tables.Walls, b: int, y: t.vec3, J: t.vec3, T: t.vec3, h: real, share: int):
        unit = momentum_unit(w, h)
        twist = T + wp.cross(y - w.pushed.center[b], J)
        at = SUMS * b + GIVEN
        for a in range(3):
            add_whole(w.pushed.sums, share, at + a, wp.float64(J[a]) / unit)
            add_whole(w.pushed.sums, share, at + 3 + a, wp.float64(twist[a]) / (unit * wp.float64(w.pushed.reach[b])))

    @wp.func
    def nearest_mesh(w: tables.Walls, world: int, y: t.vec3, time: real, reach: real):
        """(row or -1, place in its frame) of the nearest mesh of points of the state."""
        found = int(-1)
        least = reach
        place = t.vec3()
        for k in range(w.table.kind.shape[0]):
            if w.pushed.first[k] >= 0 and w.table.owner[k] < 0 and w.pushed.world[k] == world:
                q = ask.local(w.table, k, y, time)
                near = wp.mesh_query_point_no_sign(w.table.mesh[k], wp.vec3f(q), float(least))
                if near.result:
                    at = wp.mesh_eval_position(w.table.mesh[k], near.face, near.u, near.v)
                    found = k
                    place = q
                    least = real(wp.length(wp.vec3f(q) - at))
        return found, place

    @wp.func
    def give_mesh(w: tables.Walls, k: int, q: t.vec3, J: t.vec3):
        """The corners of the triangle nearest to q, in the frame of the mesh, get their parts of the impulse; returns where."""
        mesh = w.table.mesh[k]
        place = q
        near = wp.mesh_query_point_no_sign(mesh, wp.vec3f(q), float(1.0e9))
        if near.result:
            unit = momentum_unit(w, w.pushed.dt)
            left = J
            for c in range(3):
                part = left
                if c == 0:
                    part = real(near.u) * J
                elif c == 1:
                    part = real(near.v) * J
                left -= part
                at = 3 * (w.pushed.first[k] + wp.mesh_get_index(mesh, 3 * near.face + c))
                for a in range(3):
                    wp.atomic_add(w.pushed.point, at + a, wp.int64(wp.rint(wp.float64(part[a]) / unit)))
            on = wp.mesh_eval_position(mesh, near.face, near.u, near.v)
            place = t.vec3(real(on[0]), real(on[1]), real(on[2]))
        return place

    @wp.func
    def add_response(w: tables.Walls, b: int, y: t.vec3, K: t.mat33, v: t.vec3, h: real, share: int):
        r = (y - w.pushed.center[b]) / w.pushed.reach[b]       # arms in units of the reach
        X = wp.skew(r)
        A = K * X
        B = X * K
        D = B * X
        s = K * ((h / w.pushed.dx) * v)
        T = wp.cross(r, s)
        one = wp.float64(1.0) / (wp.float64(w.pushed.mass) * FINE)
        at = SUMS * b
        for i in range(3):
            for j in range(3):
                add_whole(w.pushed.sums, share, at + 6 * i + j, one * wp.float64(K[i, j]))
                add_whole(w.pushed.sums, share, at + 6 * i + j + 3, -one * wp.float64(A[i, j]))
                add_whole(w.pushed.sums, share, at + 6 * i + j + 18, one * wp.float64(B[i, j]))
                add_whole(w.pushed.sums, share, at + 6 * i + j + 21, -one * wp.float64(D[i, j]))
            add_whole(w.pushed.sums, share, at + 36 + i, one * wp.float64(s[i]))
            add_whole(w.pushed.sums, share, at + 39 + i, one * wp.float64(T[i]))

    return SimpleNamespace(give_body=give_body, nearest_mesh=nearest_mesh, give_mesh=give_mesh, add_response=add_response)
