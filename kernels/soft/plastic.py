"""Plastic flow of tets: where strain is larger than a body bears, its shape at rest follows, and its volume stays.

    F = F_e F_p,  det F_p = 1                        (Lee 1969; for elements: Irving, Teran, Fedkiw 2004, section 6; Bargteil et
                                                      al. 2007, section 4)
    |dev E| <= y,   E = V diag(s - 1) V^T of F_e     the yield, in strain, of O'Brien, Bargteil, Hodgins 2002, eq. 1 to 4
    beyond it:  F_e -> F_e G^-1,  F_p -> G F_p,      G = V diag(g) V^T,  g = exp((1 - theta) dev log s)

so that s_i -> s_i / g_i keeps its product, the volume, and the directions; theta in (0, 1) is where |dev E| = y. It does
not depend on how long it takes (no creep), and nothing hardens. An energy of tr E, as the corotational one, may rise a little
where a body that hardly changes its volume (nu near 1/2) is pressed by tenths of its size; else flow takes energy.

An element knows F_p as its shape at rest, edges F_p r_k and gradients F_p^-T g_k, both always from those of the start, so
that no error adds up. Tets that are flat or inside out do not flow, nor do those whose F_p or F_p^-1 would grow beyond MOST:
needles are as stiff as they are thin.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import identity_like, polar_rotation
from wsim.kernels.soft.fem import elements, linear_displacement
from wsim.kernels.soft.principal import corotated_strain

THIN = wp.constant(0.05)          # least stretch that flows
MOST = wp.constant(8.0)           # of |F_p| and |F_p^-1|, which begin at 1.7; explicit steps would have to shrink as much
ROUNDS = wp.constant(12)          # theta <- theta y / |dev E|; the error falls by about |E| a round


@cache
def plastic_tets(real):
    """Struct of what flows: reads only."""
    t = types(real)

    @wp.struct
    class PlasticTets:
        limit: wp.array(dtype=real)              # y, inf where the tet is elastic, (t,)
        edge: wp.array(dtype=t.mat33)            # rows r_k of the start [m], (t,)
        gradient: wp.array(dtype=t.mat33)        # rows g_k of the start [1/m], (t,)

    return PlasticTets


@wp.func
def deviatoric_part(a: Any):
    """a - mean(a)."""
    m = (a[0] + a[1] + a[2]) / type(a[0])(3.0)
    return a - wp.vector(m, m, m)


@wp.func
def exponential_entries(a: Any):
    return wp.vector(wp.exp(a[0]), wp.exp(a[1]), wp.exp(a[2]))


@wp.func
def plastic_stretch(s: Any, y: Any):
    """g of the stretches s > 0 at a yield strain y; 1 where they are within it."""
    zero = type(y)(0.0)
    one = type(y)(1.0)
    theta = one
    b = wp.vector(zero, zero, zero)
    if wp.length(deviatoric_part(s)) > y:
        logs = wp.vector(wp.log(s[0]), wp.log(s[1]), wp.log(s[2]))
        b = deviatoric_part(logs)
        size = wp.exp((logs[0] + logs[1] + logs[2]) / type(y)(3.0))
        n = int(ROUNDS)
        for _i in range(n):
            theta = wp.min(one, theta * y / wp.length(deviatoric_part(size * exponential_entries(theta * b))))
    return exponential_entries((one - theta) * b)


@wp.func
def yield_test(H: Any, q: Any, y: Any):
    """Whether a tet flows at a yield strain y, its stretches s and their axes, the columns of V. q: of a nearby state."""
    E = corotated_strain(H, polar_rotation(H, q))
    one = type(y)(1.0)
    dev = E - (wp.trace(E) / type(y)(3.0)) * identity_like(E)
    if not wp.ddot(dev, dev) > y * y:
        return False, wp.vector(one, one, one), identity_like(E)
    e, V = eigen_three(E)
    s = e + wp.vector(one, one, one)
    return wp.min(s) > type(y)(THIN), s, V


@wp.func
def flow_is_bounded(F: Any, back: Any):
    """Whether F_p and its inverse are no larger than they may be."""
    most = type(F[0, 0])(MOST) * type(F[0, 0])(MOST)
    return wp.ddot(F, F) < most and wp.ddot(back, back) < most


@wp.func
def write_rest_shape(c: int, Fp: Any, edge: Any, gradient: Any, edge_out: Any, gradient_out: Any):
    """The shape at rest of tet c."""
    edge_out[c] = edge * wp.transpose(Fp)
    gradient_out[c] = gradient * wp.inverse(Fp)


@cache
def plastic_shape_kernel(real, module):
    """Kernel over tets: edges and gradients of F_p."""
    t, Plastic = types(real), plastic_tets(real)
    mat33 = wp.array(dtype=t.mat33)

    def set_plastic_shape(p: Plastic, Fp: mat33, edge_out: mat33, gradient_out: mat33):
        c = wp.tid()
        write_rest_shape(c, Fp[c], p.edge[c], p.gradient[c], edge_out, gradient_out)

    return wp.kernel(set_plastic_shape, name=f"plastic_shape_{t.name}", module=module, enable_backward=False)


@cache
def plastic_flow_kernel(real, module):
    """Kernel over tets: F_p at x + d and with it the shape at rest of `tets`, where a tet is beyond its yield. q: of a nearby
    state."""
    t, Tets, Plastic = types(real), elements(real), plastic_tets(real)
    gradient, _ = linear_displacement(real, real)
    vec3, mat33 = wp.array(dtype=t.vec3), wp.array(dtype=t.mat33)

    def flow_plastic_tets(p: Plastic, tets: Tets, x: vec3, d: vec3, q: wp.array(dtype=t.quat), Fp: mat33, Fp_out: mat33):
        c = wp.tid()
        flows, s, V = yield_test(gradient(tets, c, x, d), q[c], p.limit[c])
        if not flows:
            return
        G = V * wp.diag(plastic_stretch(s, p.limit[c])) * wp.transpose(V)
        now = G * Fp[c]
        now = (real(1.0) / wp.cbrt(wp.determinant(now))) * now
        if flow_is_bounded(now, wp.inverse(now)):
            Fp_out[c] = now
            write_rest_shape(c, now, p.edge[c], p.gradient[c], tets.edge, tets.gradient)

    return wp.kernel(flow_plastic_tets, name=f"plastic_flow_{t.name}", module=module, enable_backward=False)
