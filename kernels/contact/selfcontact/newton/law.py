"""Contact rows of surfaces in a Newton step: an augmented Lagrangian with Coulomb friction.

    u = C n + [sum_k G_k^T (d_k - a_k)]_t        C = away + n . sum_k b_k (d_k - e_k) - keep
    P+ = the push of P - k u that Coulomb's law allows       force on point k:  G_k P+ / g^2
    Jacobian  k / g^2 G_k H G_l^T,   H = n n^T + rho (I - n n^T), of a row that slides without the direction that it slides in

u [m] is how far the end of a substep is from what a row asks for: C along its normal, slip across it. P [m kg] is its push, as
in kernels/contact/selfcontact/rows.py: an impulse times the step. G_k is b_k I and the couple that takes the moment of friction
back (kernels/contact/selfcontact/moment_correction.py). n, b and G are those of the start of the substep, so that u is linear
in d.

Newton steps solve with forces P+ and with their Jacobian beside that of elasticity. P is zero where a substep begins: lists
of pairs end when they like, and a run that is resumed has others. It becomes P+ where steps have settled and a row is still
wrong by DEPTH (method of multipliers: Hestenes 1969, Powell 1969; with friction Alart, Curnier 1991), and at the end of the
substep. Where P no longer changes, C >= 0, P . n >= 0 and the product of both is zero, whatever k is. k is STIFF times what
the points resist by, by the diagonal blocks of the system: less takes more steps, more takes more iterations of conjugate
gradients. P stands still while steps go on: they end where Phi with psi (below) is less than where the substep began, however
few there are. Pushes that were renewed behind each step led 170 rows of crossed sheets to and fro, and to 20,000 J of 0.25 J.
A row that does not push is not in the system: where it would stop the step it makes the step short, or nothing of it, in each
further step again. Such a row (AHEAD) is held where it is by the next step.

Friction of a step is that of the push before it, and right once steps are solved: a residual is asked of every substep. Where
layers slide by s in a substep, a row from a point to the edge of the triangle beside it is passed, and its plane says that it
ends s^2 / (2 away) nearer than it does: such rows braked a cloth that slid by 0.3 mm a substep on 4 mm by half. `passed` adds
that way, of the prediction, to `away`. So does what lies in another by little, whose rows to edges lean: a row goes apart by
BACK of RECOVERY at least, so that what rests comes to where it keeps all.

The Jacobian of the law of Coulomb is not symmetric. What is kept of it is: the bound of friction stands still within a step.
The potential whose gradient that is says how far to go along a step (kernels/solver/line_search.py):

    psi(u) = (max(0, P_n - k C)^2 + huber(P_t - k u_t; c)) / (2 k),   c the bound of friction;   Phi gains psi / g^2

Where a step goes on from its middle to its end (implicit midpoint), rows ask for what they ask for at the end: u and P are
those of the end, d - e of points that are solved for counts `ahead` times, and forces are P+ / (ahead g^2).

Sums over the rows of a point are in whole numbers, so that their order has no effect (kernels/contact/selfcontact/pairs.py):
forces as displacements, times the inverse of the trace of the point's diagonal block.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.moment_correction import couple_funcs
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver.line_search import HALVINGS

PARTS = 1 + HALVINGS    # of a step, that a line search looks at
STIFF = 10.0           # see above
BLOCK = 2.0 ** 20      # units of a diagonal block over own
UNITS, MOST = 2.0 ** 30, 2.0 ** 20         # of a change of energy over that which a step promises; most of one row
DEPTH = 0.03           # of what a row keeps: Newton steps go on while a row ends nearer, or is thrown farther, by more
LITTLE = 0.05          # likewise: a step that moves no row by more has settled, and pushes may be renewed
BACK = 0.02            # of what a row is nearer than it keeps, or of `climb`, by which it goes apart: more would throw it
BALL_BACK = 0.2        # of rows with a ball: what rests is as deep as a step lets it sink, by 1 / STIFF, over this. With 0.02
#                        piles of grains lay 19 % of a radius deep in a cloth, with this 1 %
PRESS, RENEW, CHECK, STORE, LOOK = range(5)
AHEAD = -0.5           # rho of a row that does not push, and would behind the whole of the last step
WRONG, STEPS, MOVING, GOING = range(4)     # words, see `renew`; STEPS: how many further ones; GOING: one more


@cache
def law_type(real):
    """Struct of what rows have in a Newton step, (capacity,), and of what points sum up, (points,)."""
    t = types(real)

    @wp.struct
    class ContactLaw:
        points: int                               # that are solved for: places below
        climb: t.scalar                           # [m] that a row which begins too near goes apart by
        rate: t.scalar                            # 1 / g^2 [1/s^2]
        ahead: t.scalar                           # 1; 2 by the implicit midpoint
        sum: wp.array(dtype=wp.int64)             # forces, (3 points,)
        block: wp.array(dtype=wp.int64)           # diagonal blocks, (6 points,)
        scale: wp.array(dtype=t.scalar)           # inverse trace of a diagonal block [m/N]
        change: wp.array2d(dtype=wp.int64)        # of psi, (worlds, 1 + HALVINGS)
        unit: wp.array(dtype=wp.float64)          # energy that the step promises [J], (worlds,)

    return ContactLaw


@cache
def contact_row_funcs(real):
    """Functions of row j: (friction, K) ; (u) ; sums of vectors of points, as u has them, without constants."""
    t = types(real)
    Surfaces, State, Pairs, Laws = pairs.surface_type(real), point_states(real), pairs.pair_type(real), law_type(real)
    arms, lever, turn = couple_funcs(real)
    place, _ = pairs.pair_geometry_funcs(real)
    points = wp.types.matrix((4, 3), real)

    @wp.func
    def mean_pair_friction(s: Surfaces, ids: wp.vec4i, b: t.vec4):
        mu = t.vec2()
        for k in range(4):
            mu += real(0.5) * wp.abs(b[k]) * s.friction[ids[k]]
        return mu

    @wp.func
    def row_friction_levers(s: Surfaces, at: State, ids: wp.vec4i, b: t.vec4):
        """(r, D, J^-1) of a row whose friction has a couple; J^-1 is zero for others."""
        r, D, K = points(), t.vec3(), t.mat33()
        free = s.w[ids[0]] * s.w[ids[1]] * s.w[ids[2]] * s.w[ids[3]]          # what cannot move takes moments
        if free > real(0.0) and mean_pair_friction(s, ids, b)[0] > real(0.0):
            r, D = arms(s, at, ids, b)
            K = lever(r)
        return r, D, K

    @wp.func
    def relative_row_motion(r: points, D: t.vec3, K: t.mat33, b: t.vec4, d: points):
        """sum_k G_k^T d_k."""
        u = t.vec3()
        for k in range(4):
            u += b[k] * d[k]
        return u - wp.cross(turn(K, r, d), D)

    @wp.func
    def push_on_row_point(r: points, D: t.vec3, K: t.mat33, b: t.vec4, P: t.vec3, k: int):
        """G_k P."""
        return b[k] * P - wp.cross(K * wp.cross(D, P), r[k])

    @wp.func
    def gap_gained_in_passing(s: Surfaces, at: State, law: Laws, ids: wp.vec4i, b: t.vec4, n: t.vec3, away: real):
        """How much further apart a row whose nearest place is on an edge or a corner gets by passing it [m]."""
        zeros = int(0)
        way = t.vec3()
        for k in range(4):
            zeros += wp.where(b[k] == real(0.0), 1, 0)
            way += b[k] * wp.where(ids[k] < law.points, law.ahead, real(1.0)) * (at.d[ids[k]] - at.e[ids[k]])
        if zeros == 0:
            return real(0.0)
        across = way - wp.dot(way, n) * n
        if zeros == 1:
            for k in range(3):
                for m in range(k + 1, 4):
                    if b[k] * b[m] > real(0.0):
                        along = place(s, at.x, at.e, ids[m], ids[k])
                        across -= (wp.dot(across, along) / wp.dot(along, along)) * along
        return real(0.5) * wp.dot(across, across) / away

    @wp.func
    def row_constraint_value(s: Surfaces, at: State, near: Pairs, law: Laws, j: int, r: points, D: t.vec3, K: t.mat33):
        """u of displacements at.d."""
        ids = near.four[j]
        b = near.swept[4 * j + pairs.B]
        there = near.swept[4 * j + pairs.NORMAL]
        n = t.vec3(there[0], there[1], there[2])
        short = near.swept[4 * j + pairs.PUSH][3] - there[3]
        back = real(BACK)
        for k in range(4):
            if s.role[ids[k]] == pairs.BALL:
                back = real(BALL_BACK)
        C = -wp.min(short, wp.min(law.climb, back * wp.max(short, law.climb)))
        slid = points()
        for k in range(4):
            i = ids[k]
            part = wp.where(i < law.points, law.ahead, real(1.0))
            C += b[k] * part * wp.dot(n, at.d[i] - at.e[i])
            slid[k] = part * (at.d[i] - at.a[i])
        slip = relative_row_motion(r, D, K, b, slid)
        return C * n + (slip - wp.dot(slip, n) * n)

    return (mean_pair_friction, row_friction_levers, relative_row_motion, push_on_row_point, row_constraint_value,
            gap_gained_in_passing)


@cache
def coulomb_law_func(real):
    """Function: (P+, rho) of P - k u."""
    t = types(real)

    @wp.func
    def coulomb_admissible_push(n: t.vec3, P: t.vec3, mu: t.vec2):
        lam = wp.dot(P, n)
        if lam <= real(0.0):
            return t.vec3(), real(-1.0)
        T = P - lam * n
        size = wp.length(T)
        rho = real(1.0)
        if size > mu[0] * lam:
            rho = mu[1] * lam / size
            T = rho * T
        return lam * n + T, rho

    return coulomb_admissible_push


@cache
def row_sum_func(real):
    """Function: adds a vector to the sum of a point, as a displacement [m]."""
    t, Laws = types(real), law_type(real)

    @wp.func
    def add_force_to_sum(law: Laws, i: int, f: t.vec3):
        scale = real(pairs.SCALE) * law.scale[i]
        for k in range(3):
            wp.atomic_add(law.sum, 3 * i + k, wp.int64(scale * f[k]))

    return add_force_to_sum
