"""MuJoCo's soft contact: a reference acceleration and a regulariser R, from solref and solimp.

    a_ref = -b u - k r,   b = 2 / (d_max t),   k = d(r) / (d_max t zeta)^2             solref = (t, zeta)
    R = (1 - d) / d (A_a + A_b)                                                        d: impedance at the depth |r|, solimp
    0 <= f,   u' - u - h a_ref + h R f >= 0,   one of them 0                           where points overlap, r < 0
    u_t' - u_t + h b u_t + h R f_t = 0,   |f_t| <= mu f                                along tangents: it sticks, and creeps

with u, r where the substep begins. A_a, A_b: translational responses of both bodies at their centres, the mean over axes, as
MuJoCo has them (`invweight0`), but where the joints are now. solref below 0 is (-k, -b) d_max^2 and d_max, as there. Shapes are
mixed by the mean. R along tangents is that along the normal (impratio 1). What slips does so by Coulomb's law; MuJoCo's convex
cone lifts it by mu times the slip besides.

(Todorov 2014, Convex and analytically-invertible dynamics with contacts and constraints; MuJoCo, Computation.)
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.tree.contact.link_pair import LinkPair, link_pair_functions
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier
from wsim.kernels.rigid.joint.tree.tables import Trees, mat66d, vec5d

LEAST, MOST = wp.constant(wp.float64(1.0e-4)), wp.constant(wp.float64(0.9999))         # of an impedance


@wp.func
def contact_impedance(s: vec5d, depth: wp.float64):
    """d at a depth [m]. s: solimp (d_0, d_width, width [m], midpoint, power)."""
    one = wp.float64(1.0)
    d0 = wp.clamp(s[0], LEAST, MOST)
    d1 = wp.clamp(s[1], LEAST, MOST)
    x = wp.min(depth / wp.max(s[2], wp.float64(1.0e-15)), one)
    middle = wp.clamp(s[3], LEAST, MOST)
    power = wp.max(s[4], one)
    y = x
    if power > one:
        if x <= middle:
            y = wp.pow(x, power) / wp.pow(middle, power - one)
        else:
            y = one - wp.pow(one - x, power) / wp.pow(one - middle, power - one)
    return d0 + y * (d1 - d0)


@wp.func
def reference_gains(ref: wp.vec2d, d: wp.float64, d_max: wp.float64, h: wp.float64):
    """(k, b) of solref. A time constant is at least 2 h, as MuJoCo's refsafe has it."""
    most = wp.clamp(d_max, LEAST, MOST)
    k = -ref[0] * d / (most * most)
    b = -ref[1] / most
    if ref[0] > wp.float64(0.0):
        t = wp.max(ref[0], wp.float64(2.0) * h)
        k = d / (most * most * t * t * ref[1] * ref[1])
        b = wp.float64(2.0) / (most * t)
    return wp.vec2d(k, b)


@wp.func
def central_response(D: mat66d, x: wp.vec3d):
    """Mean over axes of the response of a link's centre x from O to a force there. D: Z^T Z at O."""
    K = wp.skew(x)
    found = wp.mat33d()
    W = wp.mat33d()
    C = wp.mat33d()
    for i in range(3):
        for j in range(3):
            found[i, j] = D[3 + i, 3 + j]
            C[i, j] = D[3 + i, j]
            W[i, j] = D[i, j]
    found = found + C * K - K * wp.transpose(C) - K * W * K
    return wp.trace(found) / wp.float64(3.0)


@cache
def soft_goal_func(real, moving: bool):
    """Function of a manifold m: of its points `goal`, u + h a_ref along n, and `scrape`, across it; `hit`, R over their
    response, and `when`, R."""
    Rig, links = rig_type(real), link_pair_functions(real, moving)
    read, slip = links.read, links.slip

    @wp.func
    def pair_central_response(pair: LinkPair, T: Trees):
        found = wp.float64(0.0)
        if pair.l_a >= 0:
            found += central_response(T.swing[pair.l_a], pair.x_a)
        if pair.l_b >= 0:
            found += central_response(T.swing[pair.l_b], pair.x_b)
        return found

    @standalone_function
    @wp.func
    def note_soft_goals(m: int, k: int, h: wp.float64, rig: Rig, T: Trees):
        if rig.c.count[m] > 0:
            pair = read(m, k, rig, T)
            a = rig.c.a[m]
            b = rig.c.b[m]
            half = wp.float64(0.5)
            ref = half * (T.solref[a] + T.solref[b])
            imp = half * (T.solimp[a] + T.solimp[b])
            A = rig.work.A[m]
            whole = pair_central_response(pair, T)
            for i in range(rig.c.count[m]):
                j = 4 * m + i
                gap = wp.float64(rig.work.now[j])
                slides = slip(pair, m, i, rig)
                u = wp.float64(wp.dot(rig.c.n[m], slides))
                d = contact_impedance(imp, wp.abs(gap))
                gains = reference_gains(ref, d, imp[1], h)
                rig.work.goal[j] = real(u - h * (gains[1] * u + gains[0] * gap))
                R = (wp.float64(1.0) - d) / d * whole
                rig.work.hit[j] = real(R / wp.max(wp.float64(A[i, i]), wp.float64(1.0e-30)))
                rig.work.when[j] = real(R)
                rig.work.scrape[j] = real(wp.float64(1.0) - h * gains[1]) * (slides - real(u) * rig.c.n[m])
            tree_barrier()

    return note_soft_goals
