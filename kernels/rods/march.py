"""Substeps of strands, all of a frame in one launch, a thread each: a strand meets no other here.

BDF2; the first step of all is backward Euler, and so are those of points that touched a collider in the one before: else they
would bounce. Each substep is solved by Newton's method to TOLERANCE of the shortest edge, or MOST iterations.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.contact import MET, NEW, OLD, Colliders, RodTouch, forget_contact_force, strand_touch_functions
from wsim.kernels.rods.element import director_twist_angle, orthogonal_director, rotated_director, transport_director
from wsim.kernels.rods.eliminate import substitute_strand_backward
from wsim.kernels.rods.forces import multistep_memory
from wsim.kernels.rods.seam import close_seam, copy_ring_start, factor_seam
from wsim.kernels.rods.system import apply_strand_corrections, strand_assembly_func
from wsim.kernels.rods.tables import RodMotion, RodPins, RodStep, RodTable, RodTrial, is_own_point

TOLERANCE = wp.constant(wp.float64(1e-6))    # last correction over the shortest edge; 1e-8 took twice the time
MOST = wp.constant(50)                       # iterations; what is left then is told (wsim/physics/rods/method.py)
CALM = wp.constant(wp.float64(0.05))         # part of a full step's gain below which the next step is halved, down to LEAST
LEAST = wp.constant(wp.float64(0.125))
EARLY = wp.constant(8)                       # iterations that take full steps: they find what touches, corrections may grow


@wp.func
def predict_point_place(S: RodTable, H: RodPins, Q: RodMotion, h: wp.float64, at: int, i: int, k: int):
    """First guess of a place: free points go on as they did, held ones go where they are held."""
    row = S.hold[i, k]
    x = Q.x[i, k] + Q.v[i, k] * h
    if row >= 0:
        x = wp.transform_point(H.frame[at, H.pin[row]], H.place[row]) - S.origin[k]
    return x


@wp.func
def begin_point(S: RodTable, H: RodPins, Q: RodMotion, T: RodTrial, h: wp.float64, at: int, i: int, k: int):
    """A first guess of a point, and of the edge behind it."""
    x = predict_point_place(S, H, Q, h, at, i, k)
    T.x[i, k] = x
    if T.hit:
        forget_contact_force(T, i, k)
    if T.edge:
        T.edge[i, k] = wp.where(T.edge[i, k] >= MET, OLD, NEW)
    if i + 1 < S.points[k]:
        T.phi[i, k] = Q.phi[i, k]
        T.pull[i, k] = S.A[i, k] * (wp.length(Q.x[i + 1, k] - Q.x[i, k]) - S.length[i, k])
        t = wp.normalize(predict_point_place(S, H, Q, h, at, i + 1, k) - x)
        old = wp.normalize(Q.x[i + 1, k] - Q.x[i, k])
        if S.clamped[i, k] == 1:
            row = S.hold[i, k]
            d = orthogonal_director(t, wp.transform_vector(H.frame[at, H.pin[row]], H.director[row]))
            T.d[i, k] = d
            T.turn[i, k] = director_twist_angle(old, t, Q.d[i, k], d, wp.float64(0.0))
        else:
            angle = Q.w[i, k][0] * h
            T.d[i, k] = rotated_director(t, orthogonal_director(t, transport_director(old, t, Q.d[i, k])), angle)
            T.turn[i, k] = angle


@wp.func
def begin_strand_trial(S: RodTable, H: RodPins, Q: RodMotion, T: RodTrial, h: wp.float64, at: int, k: int):
    """A first guess of a strand."""
    for i in range(S.points[k]):
        begin_point(S, H, Q, T, h, at, i, k)


@wp.func
def eased_newton_share(share: wp.float64, z: wp.float64, before: wp.float64, count: int):
    """Part of a step that is taken, after corrections of z behind those of before."""
    if count >= EARLY and z > (wp.float64(1.0) - CALM * share) * before:
        return wp.max(wp.float64(0.5) * share, LEAST)
    return wp.min(wp.float64(2.0) * share, wp.float64(1.0))


@wp.func
def spin_after_turn(w: wp.vec3d, turn: wp.float64, b: wp.float64, h: wp.float64):
    """Spin [rad/s] after a turn [rad], the turn, the spin before."""
    return wp.vec3d((turn * (wp.float64(1.0) + b) - w[1] * b) / h, turn, w[0])


@wp.func
def edge_normal_forces(T: RodTrial, i: int, k: int):
    """Normal forces of colliders [N] at both places of an edge."""
    one = wp.float64(0.0)
    other = wp.float64(0.0)
    if T.edge[i, k] == MET:
        row = T.x.shape[0] + i
        one = T.inside[row, k][1]
        other = T.inside[row + T.x.shape[0], k][1]
    return one, other


@cache
def finish_point(kinds: tuple[str, ...]):
    """Function (S, C, Q, T, p, i, k) -> how deep a point is in a collider [m]: its velocity, and what the next substep
    remembers."""
    meets, touch = bool(kinds), strand_touch_functions(kinds).touch if kinds else None

    @wp.func
    def finish_one_point(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, p: RodStep, i: int, k: int):
        deep = wp.float64(0.0)
        d = T.x[i, k] - Q.x[i, k]
        b = multistep_memory(Q, i, k)
        v = (d * (wp.float64(1.0) + b) - Q.s[i, k] * b) / p.h
        Q.w[i, k] = spin_after_turn(Q.w[i, k], T.turn[i, k], b, p.h)
        begun = int(1)
        if wp.static(meets):
            t = RodTouch()
            if T.hit:
                forget_contact_force(T, i, k)
            if S.hold[i, k] < 0 and is_own_point(S, i, k):
                t = touch(C, S, Q, T, p.h * p.h, p.at, i, k)
            Q.stick[i, k] = t.s
            Q.load[i, k] = t.N
            one, other = edge_normal_forces(T, i, k)     # edges as the last correction found them: points are moving on
            if one + other > wp.float64(0.0):
                begun = int(0)
            if i > 0:
                last1, last2 = edge_normal_forces(T, i - 1, k)
                if last1 + last2 > wp.float64(0.0):
                    begun = int(0)
            stick1 = wp.vec3d()
            stick2 = wp.vec3d()
            if T.edge[i, k] == MET:
                row = T.x.shape[0] + i
                stick1 = T.bristle[row, k]
                stick2 = T.bristle[row + T.x.shape[0], k]
                deep = wp.max(T.inside[row, k][2], T.inside[row + T.x.shape[0], k][2])
            Q.stick1[i, k] = stick1
            Q.stick2[i, k] = stick2
            Q.load1[i, k] = one
            Q.load2[i, k] = other
            if t.N > wp.float64(0.0):
                begun = int(0)
                deep = wp.max(deep, t.deep)
        Q.s[i, k] = d
        Q.u[i, k] = Q.v[i, k]
        Q.begun[i, k] = begun
        Q.v[i, k] = v
        Q.x[i, k] = T.x[i, k]
        Q.d[i, k] = T.d[i, k]
        Q.phi[i, k] = T.phi[i, k]
        return deep

    return finish_one_point


@cache
def strand_finish_func(kinds: tuple[str, ...]):
    """Function (S, C, Q, T, p, k) -> how deep a strand is in a collider [m]: `finish_point` of all its points."""
    end = finish_point(kinds)

    @wp.func
    def finish_whole_strand(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, p: RodStep, k: int):
        deep = wp.float64(0.0)
        for i in range(S.points[k]):
            deep = wp.max(deep, end(S, C, Q, T, p, i, k))
        return deep

    return finish_whole_strand


@cache
def strand_march_kernel(kinds: tuple[str, ...], airy: bool, module: str, closed: bool = False):
    """Kernel over strands. said: (strands, 3): most iterations of a substep; greatest last correction over the shortest edge's
    length; how deep a point is in a collider at the end of a substep [m]. kinds: of colliders, () for none.
    airy: with air. closed: some strands are."""
    assemble, end = strand_assembly_func(kinds, airy, closed=closed), strand_finish_func(kinds)

    @wp.kernel(enable_backward=False, module=module)
    def march_strands(S: RodTable, H: RodPins, C: Colliders, Q: RodMotion, T: RodTrial, h: wp.float64, substeps: int,
                      said: wp.array2d(dtype=wp.float64)):
        k = wp.tid()
        short = S.length[0, k]
        for i in range(1, S.points[k] - 1):
            short = wp.min(short, S.length[i, k])
        most = int(0)
        left = wp.float64(0.0)
        deep = wp.float64(0.0)
        for at in range(substeps):
            p = RodStep()
            p.h = h
            p.at = at
            begin_strand_trial(S, H, Q, T, h, at, k)
            z = short
            before = short
            share = wp.float64(1.0)
            off = z
            count = int(0)
            while count < MOST and off > TOLERANCE * short:
                assemble(S, C, Q, T, p, k)
                z = substitute_strand_backward(S, T, k)
                if wp.static(closed):
                    if S.own[k] < S.points[k]:
                        factor_seam(S, T, k)
                        _, z = close_seam(S, T, k)
                off = z
                if T.hit:
                    off = wp.max(z, T.drawn[k])
                    T.drawn[k] = wp.float64(0.0)
                share = eased_newton_share(share, z, before, count)
                apply_strand_corrections(S, T, share * wp.min(wp.float64(1.0), short / wp.max(z, short * wp.float64(1e-12))), k)
                before = z
                count += 1
            deep = wp.max(deep, end(S, C, Q, T, p, k))
            if wp.static(closed):
                copy_ring_start(S, Q, k)
            most = wp.max(most, count)
            left = wp.max(left, off / short)
        said[k, 0] = wp.float64(most)
        said[k, 1] = left
        said[k, 2] = deep

    return march_strands
