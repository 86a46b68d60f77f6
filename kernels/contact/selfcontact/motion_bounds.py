"""The rigid motion that surfaces go by together, and tubes about what points do beside it, which say how long a list holds.

Best rigid motion of a substep, of points of mass m at p that go by f (least squares of the mass times the error squared):

    c = sum m p / M,   u = sum m f / M,   theta = I^-1 sum m (p - c) x (f - u),   R p = c + u + Rot(theta) (p - c)

Sums are taken in a fixed order. When a list is made, A = 1; A takes on R each substep. k substeps later a point is expected at

    P + min(k, lead) V,   V its motion beside R in the first substep,   lead = 1, 2, 4, 8 or 16: LONG mean edges at most,
                          of the fastest point (whose tube is the first to end), for all

and while A^-1 p is within beta_i of it where substeps begin and end, it is all the time between, when it goes along with what
is expected: both are linear then. Pairs that come no nearer than their betas by what is expected do not meet, whatever A is:
only differences of V count. Between, p goes along a chord of what A makes of a straight line, and leaves
it by |p - c| theta^2 / 8 at most, which counts too. A bad R, V or beta_i costs searches and nothing else. beta_i is what would
have made the last list hold for L substeps, between beta and WIDEST beta, and STAYS of what it was at least: few points
that go another way have wide tubes. L is LASTS, or SPARE times what the widest tube would have held the point for that went
furthest: with it a list ends, however wide the others' are (SPARE, since it is another point each time). Where the widest would
not have lasted for PAYS substeps, all tubes are as narrow as they may be: there a list is made in each, and what counts is how
many pairs it has.

Wide tubes cost as many pairs more as there are pairs: with more than MANY a point by tubes of beta, `dense` times MANY, the
widest is smaller by sqrt(dense), and has to last for min(dense, DEAR) times PAYS substeps. Where the list that is made behind
the solve would not last beyond its substep, it serves the proof alone: tubes of THIN beta (twice that for each further list of
the substep, 4 THIN at most), and pairs that come within PROOF of what they keep, since a proof asks for the rounding of a file
only (thicknesses of less than 8 units of it are warned of: PROOF of them is 2, and 1.75 are asked for). The next substep has a
list of its own, whose tubes have NARROW beta, and TURNS where pairs are pressed in turn (kernels/contact/selfcontact/rows.py),
which costs a CPU by pairs: of a scrunch of 5041 points a half listed 270,000, of which 75,000 pushed, a quarter 160,000; what
leaves them has the list behind the solve (13 of 250 substeps are projected, and 5 were).
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

FOLD, COLUMNS = 16, 17           # of the sums: how many partial ones are one in a pass, numbers of each
ENERGY = 16                              # the one of m |f|^2
LEAD, LONG = 16, 2.0                     # substeps that tubes lead ahead at most; how far, in mean edges
GROWS = 2                                # times the last list's substeps that tubes lead ahead at most
LASTS, WIDEST, STAYS = 20.0, 4.0, 0.75   # substeps that a list is to hold; the widest tube over beta; least over that before
PAYS, SPARE = 1.4, 3.0                   # substeps that lists last, at least, where tubes are widened; see above
MANY, DEAR = 40.0, 3.0                   # pairs a point; times PAYS at most, that wide tubes have to last; see above
NARROW, THIN, PROOF = 0.5, 0.25, 0.25    # of beta: tubes behind a list for a proof, and of one; of what pairs keep; see above
TURNS = 0.25                             # NARROW where pairs are pressed in turn; see above
RATE = 0.5                               # part of a radian that a substep turns by at most, else it is not turned with


@cache
def frame_type(real):
    """Struct: rigid = (c, u, v, led), v the vector part of the quaternion of the substep's turn, led (1, 0, 0) where it is what
    colliders do; A before and after the substep; axes by point."""
    t = types(real)

    @wp.struct
    class CommonFrames:
        rigid: wp.array(dtype=t.vec3)             # [m], [m], [1], [1], (4,)
        frame: wp.array(dtype=t.transform)        # A, R A, (2,)
        start: wp.array(dtype=t.vec3)             # P [m], (points,)
        way: wp.array(dtype=t.vec3)               # V [m] a substep, (points,)
        lead: wp.array(dtype=int)                 # substeps that tubes lead ahead, (1,)
        beta: wp.array(dtype=t.scalar)            # radius of the tube [m], (points,)
        off: wp.array(dtype=t.scalar)             # distance from what was expected, where the last substep ended [m], (points,)
        most: wp.array(dtype=t.scalar)            # the greatest of them, (1,)
        least: wp.array(dtype=t.scalar)           # least radius of a tube over beta, (1,)
        dense: wp.array(dtype=t.scalar)           # pairs a point that tubes of beta would have, over MANY; at least 1, (1,)
        part: wp.array(dtype=t.scalar)            # of what pairs keep, by which the list holds those that come near, (1,)

    return CommonFrames


@cache
def motion_moment_kernel(real, module):
    """Kernel: partial sums of moments about the last centre, of a stretch of points each: (lanes, COLUMNS)."""
    Surfaces, State, Frames = pairs.surface_type(real), point_states(real), frame_type(real)
    row = wp.types.vector(COLUMNS, real)

    @wp.kernel(module=module, enable_backward=False)
    def tally_motion(s: Surfaces, at: State, f: Frames, lanes: int, out: wp.array2d(dtype=real)):
        lane = wp.tid()
        m = s.point.shape[0]
        each = (m + lanes - 1) / lanes
        c = f.rigid[0]
        a = row()
        for j in range(lane * each, wp.min((lane + 1) * each, m)):
            i = s.point[j]
            if s.w[i] > real(0.0):
                mass = real(1.0) / s.w[i]
                p = (at.x[i] + s.shift[i]) - c
                d = at.d[i] - at.e[i]
                turn = wp.cross(p, d)
                a[0] = a[0] + mass
                a[ENERGY] = a[ENERGY] + mass * wp.dot(d, d)
                for k in range(3):
                    a[1 + k] = a[1 + k] + mass * p[k]
                    a[4 + k] = a[4 + k] + mass * d[k]
                    a[7 + k] = a[7 + k] + mass * turn[k]
                    a[10 + k] = a[10 + k] + mass * p[k] * p[k]
                a[13] = a[13] + mass * p[0] * p[1]
                a[14] = a[14] + mass * p[1] * p[2]
                a[15] = a[15] + mass * p[2] * p[0]
        for k in range(COLUMNS):
            out[lane, k] = a[k]

    return tally_motion


@cache
def moment_fold_kernel(real, module):
    """Kernel: sums of FOLD rows each."""
    @wp.kernel(module=module, enable_backward=False)
    def fold_sums(rows: wp.array2d(dtype=real), out: wp.array2d(dtype=real)):
        i, k = wp.tid()
        total = real(0.0)
        for j in range(FOLD):
            total += rows[i * FOLD + j, k]
        out[i, k] = total

    return fold_sums


@cache
def rigid_fit_kernel(real, module):
    """Kernel: R from the sums, and A after the substep. fresh: A begins anew; else points are to be watched."""
    t = types(real)
    Frames = frame_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def fit_motion(a: wp.array2d(dtype=real), fresh: int, f: Frames):
        zero, one = real(0.0), real(1.0)
        c, u, theta = t.vec3(), t.vec3(), t.vec3()
        M = a[0, 0]
        if M > zero:
            c = t.vec3(a[0, 1], a[0, 2], a[0, 3]) / M
            u = t.vec3(a[0, 4], a[0, 5], a[0, 6]) / M
            L = t.vec3(a[0, 7], a[0, 8], a[0, 9]) - M * wp.cross(c, u)
            xx, yy, zz = a[0, 10] - M * c[0] * c[0], a[0, 11] - M * c[1] * c[1], a[0, 12] - M * c[2] * c[2]
            xy, yz, zx = a[0, 13] - M * c[0] * c[1], a[0, 14] - M * c[1] * c[2], a[0, 15] - M * c[2] * c[0]
            whole = real(1.001) * (xx + yy + zz)
            turn = t.mat33(whole - xx, -xy, -zx, -xy, whole - yy, -yz, -zx, -yz, whole - zz)
            if wp.determinant(turn) > zero:
                theta = wp.inverse(turn) * L
        size = wp.length(theta)
        v = t.vec3()
        if size > zero and size < real(RATE):
            v = (wp.sin(real(0.5) * size) / size) * theta
        before = f.frame[1]
        if fresh > 0:
            before = wp.transform_identity(dtype=real)
        c = c + f.rigid[0]
        q = t.quat(v[0], v[1], v[2], wp.sqrt(one - wp.dot(v, v)))
        R = t.transform(c + u - wp.quat_rotate(q, c), q)
        after = R * before
        f.frame[0] = before
        f.frame[1] = t.transform(wp.transform_get_translation(after), wp.normalize(wp.transform_get_rotation(after)))
        f.rigid[0] = c
        f.rigid[1] = u
        f.rigid[2] = v
        if fresh == 0:
            f.most[0] = zero

    return fit_motion


@cache
def rigid_carry_func(real):
    """Function: how far R takes a place p [m]; (Rot - 1) y = 2 w (v x y) + 2 v x (v x y), without cancellation."""
    t = types(real)
    Frames = frame_type(real)

    @wp.func
    def rigid_displacement(f: Frames, p: t.vec3):
        y = p - f.rigid[0]
        v = f.rigid[2]
        side = wp.cross(v, y)
        return f.rigid[1] + real(2.0) * (wp.sqrt(real(1.0) - wp.dot(v, v)) * side + wp.cross(v, side))

    return rigid_displacement


@cache
def tube_axis_kernel(real, module):
    """Kernel: tubes, where lists are made: A before the substep is 1; lead: the least that one of the points has, from what
    stands there on. Behind a list for a proof all have `narrow` beta. tube: < 1: all have so much of beta."""
    Surfaces, State, Frames = pairs.surface_type(real), point_states(real), frame_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def lay_axes(s: Surfaces, at: State, narrow: real, tube: real, words: wp.array(dtype=int), f: Frames):
        i = s.point[wp.tid()]
        p = (at.x[i] + s.shift[i]) + at.e[i]
        q = wp.transform_point(wp.transform_inverse(f.frame[1]), (at.x[i] + s.shift[i]) + at.d[i])
        way = q - p
        size = wp.length(way)
        lead = f.lead[0]
        while lead > 1 and (real(lead) * size > s.longest or lead > GROWS * wp.max(words[pairs.AGE], 1)):
            lead = lead / 2
        held = real(wp.max(words[pairs.AGE], 1))
        widest = real(WIDEST) * s.beta / wp.sqrt(f.dense[0])
        if f.most[0] * real(PAYS) * wp.min(f.dense[0], real(DEAR)) > widest * held:
            widest = s.beta
        last = wp.min(real(LASTS) * f.most[0], real(SPARE) * widest * held)        # L times the greatest distance
        wide = wp.max(f.off[i] * last / wp.max(held * f.most[0], real(1.0e-30)), real(STAYS) * f.beta[i])
        least = wp.where(f.part[0] < real(1.0), narrow, real(1.0))
        f.beta[i] = wp.where(least < real(1.0), least * s.beta, wp.clamp(wide, s.beta, widest))
        if tube < real(1.0):
            f.beta[i] = tube * s.beta
        f.least[0] = least
        f.off[i] = real(0.0)
        f.start[i] = p
        f.way[i] = way
        if lead < f.lead[0]:
            wp.atomic_min(f.lead, 0, lead)

    return lay_axes


@cache
def thin_tube_kernel(real, module):
    """Kernel: thin tubes about what was solved for, where this list would not last beyond the substep: it leads no further, or
    the widest tube would not."""
    Surfaces, Frames = pairs.surface_type(real), frame_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def thin_tubes(s: Surfaces, words: wp.array(dtype=int), f: Frames):
        j = wp.tid()
        held = real(wp.max(words[pairs.AGE], 1))
        dense = f.dense[0]
        wanted = f.most[0] * real(PAYS) * wp.min(dense, real(DEAR))
        if f.lead[0] > 1 and wanted * wp.sqrt(dense) <= real(WIDEST) * s.beta * held:
            return
        rate = real(THIN)
        for _ in range(wp.clamp(words[pairs.MADE], 1, 3) - 1):
            rate = real(2.0) * rate
        f.beta[s.point[j]] = rate * s.beta
        if j == 0:
            f.part[0] = real(PROOF)

    return thin_tubes


@cache
def tube_watch_kernel(real, module):
    """Kernel: counts points that are out of their tubes where the substep ends, or began, in words[OUT]; words[SOON] where one
    would leave it in the next substep. In a frame that a list had no room in: neither. fresh 1: of a list that was just made,
    in the frame that goes by R. What a chord leaves the arc by differs between two points by theta^2 / 8 of their distance
    alone, which is what they go beside R, and the width of their tubes, where they may meet."""
    t = types(real)
    Surfaces, State, Frames = pairs.surface_type(real), point_states(real), frame_type(real)

    @wp.func
    def distance_from_axis(p: t.vec3, k: int, i: int, f: Frames):
        """Distance from p to where point i is expected after k substeps."""
        return wp.length((p - f.start[i]) - real(wp.min(k, f.lead[0])) * f.way[i])

    @wp.kernel(module=module, enable_backward=False)
    def watch_tubes(s: Surfaces, at: State, f: Frames, fresh: int, words: wp.array(dtype=int)):
        if words[pairs.LACKED] > 0:
            return
        i = s.point[wp.tid()]
        p = at.x[i] + s.shift[i]
        q0 = wp.transform_point(wp.transform_inverse(f.frame[0]), p + at.e[i])
        q1 = wp.transform_point(wp.transform_inverse(f.frame[1]), p + at.d[i])
        v = f.rigid[2]
        arm = wp.length(p - f.rigid[0])
        if fresh > 0:
            arm = wp.length(f.way[i]) + real(2.0) * (f.beta[i] + s.reach[i])
        sag = real(0.5) * arm * wp.dot(v, v)
        size = wp.length(p) + wp.length(wp.transform_get_translation(f.frame[1]))
        room = f.beta[i] - sag - real(64.0) * s.ulp * size
        k = words[pairs.AGE]
        f.off[i] = distance_from_axis(q1, k + 1, i, f)
        if f.off[i] > f.most[0]:
            wp.atomic_max(f.most, 0, f.off[i])
        if not (wp.max(distance_from_axis(q0, k, i, f), f.off[i]) <= room):
            wp.atomic_add(words, pairs.OUT, 1)
        if not (distance_from_axis(real(2.0) * q1 - q0, k + 2, i, f) <= room):
            words[pairs.SOON] = 1

    return watch_tubes


@cache
def frame_displacement_kernel(real, module):
    """Kernel: displacement of a whole frame, from where it began."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def way_of_frame(began: wp.array(dtype=t.vec3), x: wp.array(dtype=t.vec3), e: wp.array(dtype=t.vec3),
                     d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        d_out[i] = (x[i] - began[i]) + e[i]

    return way_of_frame
