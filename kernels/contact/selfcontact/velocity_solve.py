"""Velocities behind contacts of pairs, by impulses that change no place, so that momentum stays what it was.

Displacements say where pairs end, and most integrators take velocities from them. Two need more, each along a way n of a pair
that pushes with P [m kg] in a substep h:

    BDF2       a multistep formula takes the velocity before an impact for a part of the one after it and bounces. So the
               relative velocity along n = P/|P| is the relative motion over h, and the one before it is the same:
               n . sum_k b_k v_k = n . sum_k b_k (d_k - e_k) / h,   by impulses Q n of any sign, |P|/g + Q >= 0
    leapfrog   is read behind half a kick, which knows no contact: of what it brings a pair nearer along P, its contact takes
               back up to half of an impulse:  n . sum_k b_k (v_k - w_k) >= 0,   0 <= Q <= |P| / (2 h),   w before the kick;
               where it pushed alike in the substep before, all of the half belongs to the kick. Runge-Kutta steps end with
               all that forces changed velocities by, where a contact that lasts gives half: read likewise, without a kick,
               and what stands on a collider across its push as it moved (`sustained_contact_kernel`)

Sweeps of Jacobi with the masses of kernels/contact/selfcontact/rows.py, from Q = 0 or, by leapfrog, from all of the half: at
rest it is the solution. By BDF2 they go on, and lead ahead, while a pair lacks much. As `settle` of kernels/contact/project.py
and kernels/motion/explicit.py, of points against colliders.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs, rows
from wsim.kernels.contact.selfcontact.moment_correction import couple_funcs
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import ALIKE
from wsim.kernels.motion.points import point_states

LITTLE = 0.1           # of the distance that a pair keeps: sweeps go on while a substep's motion errs by more


@cache
def aim_type(real):
    """Struct of the pairs that push at the end of a substep, (capacity,)."""
    t = types(real)

    @wp.struct
    class VelocityAims:
        count: wp.array(dtype=int)                # of pairs, (1,)
        ids: wp.array(dtype=wp.vec4i)             # places of the points
        b: wp.array(dtype=t.vec4)                 # weights
        n: wp.array(dtype=t.vec3)                 # along the push; 0: there is none
        aim: wp.array(dtype=t.scalar)             # relative velocity along n that is wanted [m/s]
        least: wp.array(dtype=t.scalar)           # of q
        most: wp.array(dtype=t.scalar)
        q: wp.array(dtype=t.scalar)               # impulse along n [kg m/s]
        swept: wp.array(dtype=t.scalar)           # that the sweep before made [kg m/s]
        keep: wp.array(dtype=t.scalar)            # distance that the pair keeps [m]

    return VelocityAims


@cache
def pair_aim_kernel(real, module):
    """Kernel: the pairs that push. back: by leapfrog, |P| / back is the most that is given, from which sweeps begin; or, < 0,
    what may be taken."""
    alike = real(ALIKE)
    t = types(real)
    Pairs, Aims = pairs.pair_type(real), aim_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def gather_aims(near_at: wp.array(dtype=Pairs), back: real, threads: int, to_at: wp.array(dtype=Aims)):
        near = near_at[0]
        to = to_at[0]
        j = wp.tid()
        if j == 0:
            to.count[0] = near.rows[0]
        while j < near.rows[0]:
            i = near.row[j]
            push = near.push[i]
            to.ids[j] = near.ids[i]
            to.b[j] = near.b[i]
            to.keep[j] = near.keep[i]
            to.aim[j] = real(0.0)
            size = wp.length(push)
            n = t.vec3()
            if back < real(0.0):
                size = wp.dot(push, near.n[i])
                if size > real(0.0):
                    n = near.n[i]
            elif size > real(0.0):
                n = push / size
            to.n[j] = n
            to.least[j] = wp.min(size / back, real(0.0))
            if back > real(0.0) and wp.length(push - near.past[i]) < alike * size:
                to.least[j] = size / back                 # fixed
            to.most[j] = wp.where(back > real(0.0), size / wp.abs(back), real(1.0e30))
            to.q[j] = wp.where(back > real(0.0), size / wp.abs(back), real(0.0))
            j += threads

    return gather_aims


@cache
def aim_weight_kernel(real, module):
    """Kernel: adds the weights of pairs to the shares of points, as each sweep needs them."""
    Aims, Sums = aim_type(real), pairs.sum_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def spread_aims(aim_at: wp.array(dtype=Aims), threads: int, to: Sums):
        aim = aim_at[0]
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > real(0.0):
                for k in range(4):
                    share = int(wp.ceil(wp.abs(aim.b[j][k]) * real(pairs.SHARES)))
                    if share > 0:
                        wp.atomic_add(to.share, aim.ids[j][k], share)
            j += threads

    return spread_aims


@cache
def aim_impulse_kernel(real, module):
    """Kernel: adds `scale` times the impulses Q, with the couples of such pushes, to the sums of points [m/s], and to their
    shares, so that they are taken."""
    Surfaces, State, Aims, Sums = pairs.surface_type(real), point_states(real), aim_type(real), pairs.sum_type(real)
    fixed, (arms, lever, _) = pairs.fixed_point_sum(real), couple_funcs(real)

    @wp.kernel(module=module, enable_backward=False)
    def give_aims(s: Surfaces, at: State, aim_at: wp.array(dtype=Aims), scale: real, threads: int, to: Sums):
        aim = aim_at[0]
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > real(0.0):
                ids = aim.ids[j]
                b = aim.b[j]
                push = scale * aim.q[j] * aim.n[j]
                rubs, mu = real(1.0), real(0.0)
                for k in range(4):
                    rubs *= s.w[ids[k]]
                    mu += wp.abs(b[k]) * s.friction[ids[k]][0]
                r, D = arms(s, at, ids, b)
                back = wp.cross(D, push)
                back = wp.where(mu * rubs > real(0.0), lever(r) * back, real(0.0) * back)
                for k in range(4):
                    wp.atomic_add(to.share, ids[k], 1)
                    fixed(to, ids[k], s.w[ids[k]] * (b[k] * push - wp.cross(back, r[k])))
            j += threads

    return give_aims


@cache
def motion_aim_kernel(real, module):
    """Kernel: relative motions over h, which BDF2's velocities are to have."""
    State, Aims = point_states(real), aim_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def aim_motion(at: State, h: real, threads: int, to_at: wp.array(dtype=Aims)):
        to = to_at[0]
        j = wp.tid()
        while j < to.count[0]:
            ids = to.ids[j]
            b = to.b[j]
            r = real(0.0)
            for k in range(4):
                r += b[k] * wp.dot(to.n[j], at.d[ids[k]] - at.e[ids[k]])
            to.aim[j] = r / h
            to.q[j] = real(0.0)
            j += threads

    return aim_motion


@cache
def aim_sweep_kernel(real, module):
    """Kernel: one sweep; v: velocities that pairs look at [m/s]; more: as `press` of kernels/contact/selfcontact/rows.py."""
    t = types(real)
    Aims, Sums = aim_type(real), pairs.sum_type(real)
    fixed, lead_of = pairs.fixed_point_sum(real), rows.nesterov_func(real)

    @wp.func
    def clamped_aim_impulse(aim: Aims, j: int, r: real, lead: real):
        """The impulse behind a sweep, by the velocity r that is lacking times the mass."""
        over = real(pairs.OVER)
        if lead > real(0.0):
            over = real(1.0)
        then = wp.clamp(aim.q[j] - over * r, aim.least[j], aim.most[j])
        ahead = then
        if lead > real(0.0):
            ahead = wp.clamp(then + lead * (then - aim.swept[j]), aim.least[j], aim.most[j])
        aim.swept[j] = then
        return ahead

    @wp.kernel(module=module, enable_backward=False)
    def strike_pairs(w: wp.array(dtype=real), v: wp.array(dtype=t.vec3), aim_at: wp.array(dtype=Aims), more: int,
                     words: wp.array(dtype=int), threads: int, to: Sums):
        aim = aim_at[0]
        lead = lead_of(more, words)
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > aim.least[j]:
                ids = aim.ids[j]
                b = aim.b[j]
                n = aim.n[j]
                W = real(0.0)
                r = -aim.aim[j]
                for k in range(4):
                    W += wp.abs(b[k]) * w[ids[k]] * real(to.share[ids[k]]) / real(pairs.SHARES)
                    r += b[k] * wp.dot(n, v[ids[k]])
                if W > real(0.0):
                    before = aim.q[j]
                    now = clamped_aim_impulse(aim, j, r / W, lead)
                    aim.q[j] = now
                    for k in range(4):
                        fixed(to, ids[k], (w[ids[k]] * b[k] * (now - before)) * n)
            j += threads

    return strike_pairs


@cache
def lacking_velocity_kernel(real, module):
    """Kernel: words[NEARER] becomes 1 where a pair that could be given more lacks a velocity by which it goes LITTLE of its
    distance in h. first 1: words[MORE] begins."""
    t = types(real)
    Aims = aim_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def lacking_pairs(v: wp.array(dtype=t.vec3), aim_at: wp.array(dtype=Aims), h: real, first: int, threads: int,
                      words: wp.array(dtype=int)):
        aim = aim_at[0]
        j = wp.tid()
        if j == 0 and first > 0:
            words[pairs.MORE] = 0
        while j < aim.count[0]:
            ids = aim.ids[j]
            b = aim.b[j]
            r = -aim.aim[j]
            for k in range(4):
                r += b[k] * wp.dot(aim.n[j], v[ids[k]])
            free = (r > real(0.0) and aim.q[j] > aim.least[j]) or (r < real(0.0) and aim.q[j] < aim.most[j])
            if free and wp.abs(r) * h > real(LITTLE) * aim.keep[j]:
                wp.atomic_max(words, pairs.NEARER, 1)
            j += threads

    return lacking_pairs


@cache
def combination_kernel(real, module):
    """Kernel over points: out = a x + b y."""
    vectors = wp.array(dtype=types(real).vec3)

    def combine_point_vectors(point: wp.array(dtype=int), a: real, x: vectors, b: real, y: vectors, out: vectors):
        i = point[wp.tid()]
        out[i] = a * x[i] + b * y[i]

    return wp.kernel(combine_point_vectors, name=f"combine_{types(real).name}", module=module, enable_backward=False)


@cache
def sustained_contact_kernel(real, module):
    """Kernel over points: where colliders pushed c alike in two substeps of Runge-Kutta, they give half of that again, and
    across it the velocity u of how the point moved, if they can: what changes within a step is not met by half of what holds
    against it. That is the others' change no more."""
    vec3, alike = types(real).vec3, real(ALIKE)
    vectors = wp.array(dtype=vec3)

    @wp.kernel(module=module, enable_backward=False)
    def stand_points(point: wp.array(dtype=int), u: vectors, earlier: vectors, v: vectors, change: vectors,
                     v_out: vectors, change_out: vectors):
        i = point[wp.tid()]
        c = change[i]
        size = wp.length(c)
        if size > real(0.0) and wp.length(c - earlier[i]) < alike * size:
            v1 = v[i] + real(0.5) * c
            more = u[i] - v1
            more -= (wp.dot(more, c) / (size * size)) * c
            if wp.length(more) < real(0.5) * size:
                v1 += more
            v_out[i] = v1
            change_out[i] = vec3()

    return stand_points
