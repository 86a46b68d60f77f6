"""Adjoint of the search for contacts (kernels/contact/search.py), point by point, of lists that are frozen.

Convex shapes, with the iterates tau_k of kernels/contact/collide.py at q = q0 + tau dq, H the Hessian of phi (dn = H dq), and
gradients gC, gn, gp, g by C, n, p and tau:

    C = phi - r + (1 - tau) n.dq,  p = q - phi n:
        by q    gC n + gp - (gp.n) n + H ((1 - tau) gC dq + gn - phi gp)       by dq    gC (1 - tau) n       by tau  -gC n.dq
    tau' = tau + (phi - r) / f,  f = -n.dq:
        by q    g (n / f + (phi - r) / f^2 H dq)                               by dq    g (phi - r) / f^2 n  by tau  g
        by r    -g / f

A further face along the first has a plane that does not depend on the way to it, which is taken as it was.

Meshes: Warp differentiates what kernels/contact/mesh.py computes of the face, edge or corner that was found.

By the motion of a collider: kernels/contact/collider_gradients.py.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact import collide, mesh
from wsim.kernels.contact.collide import NEWTON_LIMIT, newton_sweep_step, sweep_is_done
from wsim.kernels.contact.collider.colliders import collider_frame_funcs
from wsim.kernels.contact.collider.shape import convex_distance_func
from wsim.kernels.contact.collider_gradients import corner_type, gradients_in_frame, pose_slope
from wsim.kernels.contact.mesh import SOLID
from wsim.kernels.contact.project import contact_tables, slot_type
from wsim.kernels.contact.project_adjoint import gradient_type, read_type
from wsim.kernels.math.real import types


@cache
def touch_products(kinds: tuple[str, ...], real):
    """Functions that Warp differentiates: v.n of a convex shape at q, whose gradient is H v; and what a mesh gives times the
    gradients by it: how is r and those by C and s0, G has those by n, p and slip in rows."""
    t, formula, settled = types(real), convex_distance_func(kinds), mesh.mesh_plane_func(real)
    vec3, two = t.vec3, wp.types.matrix((2, 3), real)

    @wp.func
    def convex_hessian_product(kind: int, size: vec3, q: vec3, v: vec3):
        phi, n = formula(kind, size, q)
        return wp.dot(v, n)

    @wp.func
    def mesh_contact_product(X: t.mat33, V: t.mat33, Y: t.mat33, what: int, sides: t.vec2, ends: two, how: vec3, G: t.mat33):
        C, n, p, s0, slip = settled(X, V, Y, what, sides, ends, how[0])
        return how[1] * C + how[2] * s0 + wp.dot(G[0], n) + wp.dot(G[1], p) + wp.dot(G[2], slip)

    return convex_hessian_product, mesh_contact_product


@cache
def compile_search_gradient(kinds: tuple[str, ...], real, module) -> None:
    """A kernel that never runs: see kernels/solver/xpbd_vjp.py."""
    t, (bent, faced) = types(real), touch_products(kinds, real)
    convex, meshes = map(bool, collide.split_convex_and_meshes(kinds))
    vec3 = t.vec3

    def call_search_gradient(kind: int, b: real, out: wp.array(dtype=real)):
        o = vec3()
        if convex:
            out[0] = bent(kind, o, o, o)
        if meshes:
            X = t.mat33()
            out[0] = faced(X, X, X, kind, t.vec2(b, b), wp.matrix_from_rows(o, o), o, X)

    wp.kernel(call_search_gradient, name=f"need_search_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=True)


@cache
def convex_adjoint_func(kinds: tuple[str, ...], real):
    """Function: gradients by q0, q1 and r (first of the last row) of `collide.convex_touch_func` from those by C and s0 (`by`),
    n and p (rows of G). ends: q0 and q1; how: r, margin, width."""
    t, formula, (bent, _) = types(real), convex_distance_func(kinds), touch_products(kinds, real)
    vec3, path = t.vec3, wp.types.vector(NEWTON_LIMIT + 1, real)

    @wp.func
    def sweep_iterates(kind: int, size: vec3, q0: vec3, dq: vec3, how: vec3):
        """tau_0 .. tau_k, and k."""
        r = how[0]
        taus = path()
        k = int(0)
        while k < NEWTON_LIMIT:
            phi, n = formula(kind, size, q0 + taus[k] * dq)
            if sweep_is_done(taus[k], phi - r, wp.length(dq), how[1]) or (k == 0 and phi - r < how[2]):
                break
            taus[k + 1] = newton_sweep_step(taus[k], phi - r, -wp.dot(n, dq))
            k += 1
        return taus, k

    @wp.func
    def convex_contact_adjoint(kind: int, size: vec3, ends: wp.types.matrix((2, 3), real), how: t.vec3, by: t.vec2, G: t.mat33):
        q0 = ends[0]
        dq = ends[1] - q0
        r = how[0]
        gC = by[0]
        gp = G[1]
        taus, k = sweep_iterates(kind, size, q0, dq, how)
        tau = taus[k]
        q = q0 + tau * dq
        phi, n = formula(kind, size, q)
        rest = real(1.0) - tau
        _kind, _size, Hv, _v = wp.grad(bent)(kind, size, q, (rest * gC) * dq + G[0] - phi * gp)    # only here: a function that
        gq = gC * n + gp - wp.dot(gp, n) * n + Hv                              # calls one with wp.grad would come before it
        g0 = gq
        gd = tau * gq + (rest * gC) * n
        gr = -gC - by[1]
        g = wp.dot(gq, dq) - gC * wp.dot(n, dq)
        if tau != real(1.0):
            for back in range(k):
                tau = taus[k - 1 - back]
                q = q0 + tau * dq
                phi, n = formula(kind, size, q)
                over = real(1.0) / -wp.dot(n, dq)
                share = (phi - r) * over * over
                _kind, _size, Hv, _v = wp.grad(bent)(kind, size, q, dq)
                gq = (g * over) * n + (g * share) * Hv
                gr -= g * over
                g0 += gq
                gd += tau * gq + (g * share) * n
                g += wp.dot(gq, dq)
        phi, n = formula(kind, size, q0)
        return wp.matrix_from_rows(g0 - gd + by[1] * n, gd, vec3(gr, real(0.0), real(0.0)))

    return convex_contact_adjoint


@cache
def mesh_adjoint_func(kinds: tuple[str, ...], real):
    """Function, as `convex_adjoint_func`, of `mesh.mesh_touch_func`; how: r, margin, depth; last row of G: by slip. The face is
    looked for once more. Then gradients by X, V and Y in rows, and the faces, as `mesh.feature_search_func` has them."""
    t, find, (_, faced) = types(real), mesh.feature_search_func(kinds, real), touch_products(kinds, real)

    @wp.func
    def mesh_contact_adjoint(kind: int, surface: wp.uint64, ends: wp.types.matrix((2, 3), real), how: t.vec3, by: t.vec2,
                             G: t.mat33):
        X, V, Y, what, sides, faces = find(kind, surface, 1, how[2], ends[0], ends[1], how[1] + how[0])
        gX, gV, gY, _what, _sides, by_ends, by_how, _G = wp.grad(faced)(
            X, V, Y, what, sides, ends, t.vec3(how[0], by[0], by[1]), G)
        by_corners = wp.matrix_from_rows(gX[0], gX[1], gX[2], gV[0], gV[1], gV[2], gY[0], gY[1], gY[2])
        found = wp.matrix_from_rows(by_ends[0], by_ends[1], t.vec3(by_how[0], real(0.0), real(0.0)))
        return found, by_corners, faces

    return mesh_contact_adjoint


@cache
def replayed_funcs(kinds: tuple[str, ...], real):
    """Functions of point i. One contact, with the collider of a row: ends of the path, (distance kept, margin, overlap, part of
    it that is left), and in rows its normal, where the surface is touched, and the surface's own way. How far it was carried
    before slot `last`."""
    t, touch, (inside, outside), (Rows, Points), Slots = (
        types(real), collide.collider_touch_func(kinds, real), collider_frame_funcs(real), contact_tables(real),
        slot_type(real))
    vec3 = t.vec3

    @wp.func
    def replay_contact(c: Rows, points: Points, i: int, row: int, k: int, x: vec3, d: vec3):
        T0 = c.of.pose[k, row]
        T1 = c.of.pose[k + 1, row]
        q0, q1 = inside(T0, T1, x, d)
        margin = wp.length(q1 - q0) + c.skin + c.stride[k, row]
        r = points.reach[i] + c.of.thick[row] - c.width
        C, m, p, s0, slip = touch(c.of.kind[row], c.of.size[row], c.of.mesh[row], 1, q0, q1, r, t.vec2(margin, c.width))
        n, way = outside(T0, T1, c.of.step[k, row], m, p, vec3())
        out = wp.min(wp.max(-s0, real(0.0)), c.recovery * c.h)
        return wp.matrix_from_rows(q0, q1), t.vec4(r, margin, -s0, out), wp.matrix_from_rows(n, p, slip)

    @wp.func
    def replay_overlap_shift(c: Rows, points: Points, s: Slots, i: int, last: int, k: int, x: vec3, d: vec3):
        far = vec3()
        for slot in range(last):
            ends, how, its = replay_contact(c, points, i, s.row[slot * s.points + i], k, x + far, d)
            far += how[3] * its[0]
        return far

    return replay_contact, replay_overlap_shift


@wp.func
def slid_way(s: Any, i: int, last: int, d: Any, carried: Any):
    """The displacement by which slot `last` was found: d, along the planes of the same mesh before it."""
    way = type(d)(d)
    for slot in range(last):
        j = slot * s.points + i
        if s.row[j] == s.row[last * s.points + i]:
            way = way - (wp.dot(s.n[j], way + carried) + s.b[j]) * s.n[j]
    return way


@wp.func
def overlap_gradient(gb: Any, by_out: Any, how: Any, most: Any):
    """Gradient by s0, from those by b and by what is left of the overlap, at most `most`."""
    found = gb
    if how[2] < most:
        found += by_out
    if how[2] > type(gb)(0.0):
        return -found
    return type(gb)(0.0)


@cache
def search_adjoint(kinds: tuple[str, ...], real, module, kept: bool = False):
    """Kernel over points: the adjoint of the search of substep k; gradients by d and a that it has moved are left where they
    are, for the copies before it. Arguments: rows, points, slots, what was read (x, d), gradients, gradients by corners of
    meshes, which are written where they are kept, k."""
    t, (meet, carry), (shapes, surfaces) = types(real), replayed_funcs(kinds, real), collide.split_convex_and_meshes(kinds)
    of_convex, of_mesh = convex_adjoint_func(shapes, real), mesh_adjoint_func(surfaces, real)
    convex, meshes, Corners, vec3 = bool(shapes), bool(surfaces), corner_type(real), t.vec3
    (Rows, Points), Slots, Read, Grads = contact_tables(real), slot_type(real), read_type(real), gradient_type(real)

    def accumulate_search_adjoint(c: Rows, points: Points, s: Slots, at: Read, o: Grads, by_corners: Corners, k: int):
        i = wp.tid()
        x = at.x[i]
        d = at.d[i]
        K = o.d_out[i] + o.a_out[i]
        by_x, by_d = vec3(), vec3()
        count = s.count[i]
        if kept:
            for slot in range(s.capacity):
                by_corners.row[k, slot * s.points + i] = -1
        for later in range(count):
            last = count - 1 - later
            carried = carry(c, points, s, i, last, k, x, d)
            j = last * s.points + i
            row = s.row[j]
            slid = slid_way(s, i, last, d, carried)
            ends, how, its = meet(c, points, i, row, k, x + carried, slid)
            n = its[0]
            gb = o.b[j]
            N = o.n[j] + how[3] * K - gb * (slid + carried)
            W = o.u[j] / c.h
            by = t.vec2(gb, overlap_gradient(gb, wp.dot(K, n) - gb, how, c.recovery * c.h))
            G = gradients_in_frame(c, row, k, N, W)
            kind = c.of.kind[row]
            g = t.mat33()
            if convex:                                        # not in a function: see `convex_adjoint_func`
                if kind < SOLID:
                    g = of_convex(kind, c.of.size[row], ends, vec3(how[0], how[1], c.width), by, G)
            if meshes:
                if kind >= SOLID:
                    g, each, faces = of_mesh(kind, c.of.mesh[row], ends, vec3(how[0], how[1], c.of.size[row][0]), by, G)
                    if kept:
                        by_corners.row[k, j] = row
                        by_corners.face[k, j] = faces
                        by_corners.by[k, j] = each
            g0 = wp.quat_rotate(wp.transform_get_rotation(c.of.pose[k, row]), g[0])
            g1 = wp.quat_rotate(wp.transform_get_rotation(c.of.pose[k + 1, row]), g[1])
            place = (row - c.first[points.object[i]]) * s.points + i
            o.gap[place] = o.gap[place] + g[2][0]
            o.motion[place] = o.motion[place] + pose_slope(c, row, k, x + carried, slid, wp.matrix_from_rows(g0, g1, N, W), its)
            by_x += g0 + g1
            by_d += g1 - gb * n
            K += g0 + g1 - gb * n
        o.x[i] = o.x[i] + by_x
        o.d[i] = o.d[i] + by_d

    compile_search_gradient(kinds, real, module)
    name = f"adjoint_search_{'_'.join(kinds)}{'_kept' * kept}_{t.name}"
    return wp.kernel(accumulate_search_adjoint, name=name, module=module, enable_backward=False)
