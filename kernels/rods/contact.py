"""Contact of a strand's points with colliders: a stiff spring along the normal, and Coulomb friction by
bristles (Cundall, Strack 1979).

    N = k e,  e = r - phi,  k = max(STIFF m / h^2, FIRM A)            sinks by N / k; where |e| < w = SOFT r it begins smoothly,
                                                                     N = k (e + w)^2 / (4 w), else iterations go in and out
    F_t = -k s, |F_t| <= mu N,  s = what it has slid over the collider since it touched, cut back where it slips

Newton's system knows both by their forces, not by how deep or how far a point is (mixed, or primal and dual, iterations):

    N <- N + N'(e) (e_new - e)  where N(e) is the N of the last correction     (`tangent_of_pressed_side`; Hintermueller, Ito,
    Kunisch 2002) mu N / |s| (1 - n n^T - (y s^T + s y^T) / (2 |s|)),  y: friction over mu N as the last correction has it, |y|
    <= 1
                                                                               (`add_bristle_friction`; Chan, Golub, Mulet 1999)

A hair's weight presses it by 2e-3 of k w: at the foot of N(e) its N is what the hair makes it, while Newton's method by depth
halves e + w an iteration. y is the slip's direction in the end: stiffness along the slip is 0 then, and that across before,
so that no correction turns a slip back and overshoots.

The N of friction is that of the substep before, at most twice the present one (a point that is let go would keep it, and come
back), or where there was none at most what stops the point and bears its weight, twice: one that an iteration leaves too deep
would be thrown aside. The present one is that of the last correction, N - k n . z, which is right before places are
(`expect_normal_force`). Friction is with the collider that a point is deepest in.

A point that a correction leaves pressed, but outside (strands turn, colliders are round), is drawn back: let go it would dive
in again, and be thrown out, by turns. One that a correction leaves drawn is let go, even inside. A point that an iteration
finds inside anew is pressed by its depth, and has no friction in that one: it may throw it out again. No substep is solved with
a point let go inside, or anew, nor while N is not that of the depth.

Colliders go straight from where they are at the start of a substep to where they are at its end. A mesh that deforms has a
shape at each of these times; what a point slides over is the place of the mesh that is nearest to it.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type, into_pose_frame
from wsim.kernels.contact.collider.nearest import nearest_shape_func
from wsim.kernels.rods.tables import RodMotion, RodTable, RodTrial

STIFF = wp.constant(wp.float64(30.0))        # a point at rest sinks by g h^2 / STIFF; much more, and iterations gain less
# part of the stretching stiffness: a rope strained by s round a radius R sinks by s L^2 / (FIRM R), edges of L. As stiff as
# edges, and iterations let points in and out by turns: of 40 hairs on a shaken ball 26 were left unsolved in a frame; so, none
FIRM = wp.constant(wp.float64(0.03))
SOFT = wp.constant(wp.float64(0.05))         # of a radius, at which a strand floats; less, and grazing points never settle
TINY = wp.constant(wp.float64(1e-30))
FAR = wp.constant(wp.float64(1e9))           # [m] farther than anything
# What an edge has had between its points in this substep (T.edge): not known yet; nothing; contact, and its rows are filled;
# not known yet, and the substep before left contact
NEW, CLEAR, MET, OLD = (wp.constant(k) for k in range(4))

Colliders = collider_type(wp.float64)        # in the world; moments are the starts and ends of substeps


@wp.struct
class RodTouch:
    """Forces of colliders on a point, and their stiffness; s: bristle in the end [m], deep: how far it is in the deepest [m],
    with the normal force N [N]."""

    f: wp.vec3d
    K: wp.mat33d
    s: wp.vec3d
    deep: wp.float64
    N: wp.float64


@wp.struct
class DeepestCollider:
    """Collider that a point is deepest in, or nearest to: its normal, how deep [m], what was slid over it in the substep [m],
    the normal times the stiffness [N/m] with the normal force [N]."""

    c: int
    n: wp.vec3d
    deep: wp.float64
    slid: wp.vec3d
    hit: wp.vec4d


@wp.func
def soft_normal_force(stiff: wp.float64, w: wp.float64, deep: wp.float64):
    """Normal force [N] of a point so deep, and its slope."""
    e = wp.clamp(deep + w, wp.float64(0.0), w + w)
    slope = stiff * e / (w + w)
    return slope * wp.float64(0.5) * e + stiff * wp.max(deep - w, wp.float64(0.0)), slope


@wp.func
def add_bristle_friction(t: RodTouch, n: wp.vec3d, s: wp.vec3d, N: wp.float64, k: wp.float64, mu: wp.vec2d, lean: wp.vec3d):
    """Friction of a bristle s across n, under the normal force N. lean: that of one that slips, over - mu N, as the last
    correction has it; 0: it is as stiff along the slip as across, and iterations settle without a line search, if slowly."""
    across = wp.identity(n=3, dtype=wp.float64) - wp.outer(n, n)
    b = across * s
    size = wp.length(b)
    if k * size > mu[0] * N:
        q = mu[1] * N / size
        d = b * (wp.float64(0.5) / size)
        y = across * lean
        t.f = t.f - b * q
        t.K = t.K + (across - wp.outer(y, d) - wp.outer(d, y)) * q
        t.s = b * (q / k)
    else:
        t.f = t.f - b * k
        t.K = t.K + across * k
        t.s = b
    return t


@wp.func
def strand_collider_friction(C: Colliders, S: RodTable, c: int, k: int):
    """Coefficients of a strand and a collider: their means."""
    return wp.float64(0.5) * (S.friction[k] + C.friction[c])


@wp.func
def friction_load_bound(before: wp.float64, m: wp.float64, v: wp.vec3d, g: wp.vec3d, n: wp.vec3d, N: wp.float64,
                        hh: wp.float64):
    """Normal force that friction goes by [N], of a place that is pressed with N. before: that of the substep before [N]; m:
    mass [kg]; v: velocity [m/s]; g: gravity [m/s^2]."""
    load = wp.min(before, wp.float64(2.0) * N)
    if load == wp.float64(0.0):
        blow = wp.abs(wp.dot(n, v)) / wp.sqrt(hh) + wp.length(g)
        load = wp.min(N, wp.float64(2.0) * m * blow)
    return load


@wp.func
def tangent_of_pressed_side(T: RodTrial, side: DeepestCollider, stiff: wp.float64, w: wp.float64, i: int, k: int):
    """`hit` of a point that the last correction leaves pressed: the tangent of N(e) where N is that. Outside its force may be
    below 0, towards the collider."""
    N = T.load[i, k]
    slope = stiff
    e = N / stiff
    if N < stiff * w:
        slope = wp.sqrt(stiff * N / w)
        e = wp.sqrt(wp.float64(4.0) * w * N / stiff) - w
    wp.atomic_max(T.drawn, k, wp.abs(e - side.deep))
    return wp.vec4d(side.n[0] * slope, side.n[1] * slope, side.n[2] * slope, N + slope * (side.deep - e))


@wp.func
def correct_normal_force(T: RodTrial, t: RodTouch, side: DeepestCollider, stiff: wp.float64, w: wp.float64, i: int, k: int):
    """Touch with the side's normal force by the last correction instead of by depth, and the normal force of friction."""
    N = t.N
    load = T.load[i, k]
    hit = side.hit
    if load != wp.float64(0.0):
        hit = wp.vec4d()
        if load > wp.float64(0.0):
            hit = tangent_of_pressed_side(T, side, stiff, w, i, k)
        elif N > wp.float64(0.0):
            wp.atomic_max(T.drawn, k, side.deep + w)
        more = hit - side.hit
        t.f = t.f + side.n * more[3]
        t.K = t.K + wp.outer(side.n, wp.vec3d(more[0], more[1], more[2]))
        N = load
    elif N > wp.float64(0.0) and T.slip[i, k][0] != FAR:
        wp.atomic_max(T.drawn, k, side.deep + w)
        N = wp.float64(0.0)
    T.hit[i, k] = hit
    return t, N


@wp.func
def expect_normal_force(T: RodTrial, d: wp.vec3d, i: int, k: int):
    """Normal force of a point as its correction d makes it, and the direction of friction. Friction goes by that force, and
    moves what makes it, at times to and fro: a change that turns back by more than half of the last is halved."""
    hit = T.hit[i, k]
    half = wp.float64(0.5)
    N = hit[3] - wp.dot(wp.vec3d(hit[0], hit[1], hit[2]), d)
    change = N - wp.max(T.load[i, k], wp.float64(0.0))
    last = T.change[i, k]
    T.change[i, k] = change
    if change * last < -half * last * last:
        N = N - half * change
    T.load[i, k] = N
    b = T.slip[i, k]
    size = wp.length(b)
    lean = wp.vec3d()
    if size > wp.float64(0.0):
        lean = (b + d - T.lean[i, k] * (wp.dot(b, d) / size)) / size
    T.lean[i, k] = lean / wp.max(wp.length(lean), wp.float64(1.0))


@wp.func
def expect_all(T: RodTrial, z0: wp.vec4d, z1: wp.vec4d, i: int, k: int):
    """`expect_normal_force` of a point, and of both places of the edge behind it, of corrections z0 and z1 of its points."""
    d0 = wp.vec3d(z0[0], z0[1], z0[2])
    expect_normal_force(T, d0, i, k)
    if T.edge[i, k] == MET:
        d1 = wp.vec3d(z1[0], z1[1], z1[2])
        for which in range(1, 3):
            row = T.x.shape[0] * which + i
            expect_normal_force(T, d0 + (d1 - d0) * T.inside[row, k][0], row, k)


@wp.func
def forget_contact_force(T: RodTrial, i: int, k: int):
    """A point, or an edge, that no correction has moved yet."""
    T.load[i, k] = wp.float64(0.0)
    T.change[i, k] = wp.float64(0.0)
    T.slip[i, k] = wp.vec3d(FAR, wp.float64(0.0), wp.float64(0.0))
    T.lean[i, k] = wp.vec3d()


@cache
def strand_touch_functions(kinds: tuple[str, ...]) -> SimpleNamespace:
    """Functions touch(C, S, Q, T, hh, at, i, k) -> Touch of a point in the substep at, hh: h^2; signed(C, c, at, q) -> distance
    [m] and normal of a place q in the frame of a collider, where a substep ends, and the same place of it where that began.
    kinds: of colliders, "" none."""
    near, meshes = nearest_shape_func(kinds, wp.float64), "solid" in kinds or "sheet" in kinds

    @wp.func
    def signed_collider_distance(C: Colliders, c: int, at: int, q: wp.vec3d):
        rows = C.kind.shape[0]
        mesh = C.mesh[(at + 1) * rows + c]
        phi, n, face, u, v = near(C.kind[c], C.size[c], mesh, q)
        before = q
        if wp.static(meshes):
            if face >= 0:
                was = C.mesh[at * rows + c]
                if was != mesh:                                # as the place of the mesh nearest to it was
                    before = q + (wp.vec3d(wp.mesh_eval_position(was, face, u, v))
                                  - wp.vec3d(wp.mesh_eval_position(mesh, face, u, v)))
        return phi, n, before

    @wp.func
    def touch_strand_point(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, hh: wp.float64, at: int, i: int, k: int):
        found = RodTouch()
        side = DeepestCollider()
        side.deep = -FAR
        stiff = wp.max(STIFF * S.m[i, k] / hh, FIRM * S.A[wp.max(i - 1, 0), k])
        w = SOFT * S.radius[i, k]
        x = T.x[i, k] + S.origin[k]
        for c in range(C.kind.shape[0]):
            frame = C.pose[at + 1, c]
            q = into_pose_frame(frame, x)
            phi, m, before = signed_collider_distance(C, c, at, q)
            deep = S.radius[i, k] + C.thick[c] - phi
            N, slope = soft_normal_force(stiff, w, deep)
            n = wp.transform_vector(frame, m)
            if N > found.N or (found.N == wp.float64(0.0) and deep > side.deep):
                side.c = c
                side.n = n
                side.deep = deep
                side.slid = (T.x[i, k] - Q.x[i, k]) - (x - wp.transform_point(C.pose[at, c], before))
                side.hit = wp.vec4d(n[0] * slope, n[1] * slope, n[2] * slope, N)
            if N > wp.float64(0.0):
                found.f = found.f + n * N
                found.K = found.K + wp.outer(n, n) * slope
                if N > found.N:
                    found.deep = deep
                    found.N = N
        N = found.N
        s = Q.stick[i, k] + side.slid
        lean = wp.vec3d()
        if T.hit:
            found, N = correct_normal_force(T, found, side, stiff, w, i, k)
            lean = T.lean[i, k]
            T.slip[i, k] = (s - side.n * wp.dot(side.n, s)) * wp.where(N > wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
        if N > wp.float64(0.0):
            N = friction_load_bound(Q.load[i, k], S.m[i, k], Q.v[i, k], S.gravity[k], side.n, N, hh)
            found = add_bristle_friction(found, side.n, s, N, stiff, strand_collider_friction(C, S, side.c, k), lean)
        return found

    return SimpleNamespace(touch=touch_strand_point, signed=signed_collider_distance, name="_".join(kinds))
