"""One Newton step of an implicit substep: forces, and the positive part of their Jacobian, point by point.

    Phi(d) = 1/2 sum own |d - b|^2 + 1/2 C alpha^-1 C + damping            (Baraff, Witkin 1998; Martin et al. 2011, eq. 5)

    d    displacement [m], the unknown; b what it would be without forces       own  m / g^2 [N/m], g the effective step
    C, G, alpha   constraint, its gradient, its compliance (kernels/cloth/constraint.py)        v = (d - a) / g, a the anchor
    tau  relaxation time [s]: damping force -tau G^T alpha^-1 G v, Jacobian (tau / g) G^T alpha^-1 G, G held fixed

    force = -own (d - b) - G^T alpha^-1 (C + tau G v)

What is kept of the Jacobian is never negative, so that conjugate gradients apply and every step goes downhill:

    spring     k (1 + tau/g) n n^T + k max(0, 1 - l0/l) (I - n n^T): exact but for the negative part across (Choi, Ko 2002)
    bending, membrane   see kernels/cloth/hessian.py

Springs pressed together in a plane balance there, though Phi falls across it. Where the exact block of a point with itself is
not positive, a substep begins with the force on a point that stands off by ASIDE of its longest spring: the saddle is left.

Springs are gathered by both ends: entry e of a point's row keeps `link` = (m, side), its Jacobian is side I + m m^T. Hinges and
triangles leave forces on their corners and blocks of pairs, which points gather: an assembled row has 12 blocks on
a regular mesh, its product is one pass, where products element by element would take two and a buffer of 12 numbers a hinge.
All rows sum to `own`, so products use differences, (A p)_i = own p_i + sum_j A_ij (p_j - p_i): float32 loses nothing to
large equal displacements. No atomics: the order of sums is that of the lists.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import DISTANCE, inverse_or_zero
from wsim.kernels.cloth.hessian import WHOLE, elements_of
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

UNIT = {wp.float32: 6e-8, wp.float64: 1.1e-16}       # rounding of a number near 1
ASIDE = 6e-8           # unit of float32; its square shows in sums of float64: with less a step aside would seem to gain nothing
LANES = 16             # threads of a GPU that gather the blocks of a point: one took 65 us for 825 points of tets, H100
ROUNDED = 16.0         # units of the trace of a block that are added to it: what is less is rounding, and of that hinges a few
                       # micrometres high make an inverse 1e12 times as large as its bound 1 / own


@cache
def newton_structs(real) -> SimpleNamespace:
    """Rows: which springs and elements act on a point; constant. Matrix: the Jacobian at one d."""
    t = types(real)

    @wp.struct
    class NewtonPointRows:
        first: wp.array(dtype=int)           # points of a system: first[b] .. first[b + 1], (systems + 1,)
        w: wp.array(dtype=t.scalar)          # inverse mass [1/kg]; 0: the point keeps its d, (points,)
        spring: wp.array(dtype=int)          # entries of a point's springs: spring[i] .. spring[i + 1]
        other: wp.array(dtype=int)           # the point at the other end, (entries,)
        number: wp.array(dtype=int)          # row in the table of springs, (entries,)
        pair: wp.array(dtype=int)            # blocks of a point: pair[i] .. pair[i + 1]
        column: wp.array(dtype=int)          # the other point of a block, (blocks,)
        part: wp.array(dtype=int)            # what a block is the sum of: part[b] .. part[b + 1]
        item: wp.array(dtype=wp.vec2i)       # rows of J of two spans, or a triangle's block and WHOLE or TURNED
        corner: wp.array(dtype=int)          # corners at a point: corner[i] .. corner[i + 1]
        pull: wp.array(dtype=int)            # place of a corner's force

    @wp.struct
    class Matrix:
        own: wp.array(dtype=t.scalar)        # [N/m], (points,)
        link: wp.array(dtype=t.vec4)         # of each entry of springs: (m [sqrt(N/m)], side [N/m])
        block: wp.array(dtype=t.mat33)       # A_ij, i != j, of hinges and triangles [N/m], (blocks,)
        aside: wp.array(dtype=t.scalar)      # ASIDE, or 0 after the first Newton step of a substep, (1,)
        P: wp.array(dtype=t.mat33)           # inverse of A_ii without filtered directions [m/N], (points,)

    return SimpleNamespace(Rows=NewtonPointRows, Matrix=Matrix)


@wp.func
def side_of(L: Any, l0: Any):
    """max(0, 1 - l0 / L): stiffness of a spring across its direction over that along it; 1 where l0 = 0."""
    zero = type(L)(0.0)
    s = zero
    if L > zero:
        s = wp.max(zero, type(L)(1.0) - l0 / L)
    if l0 <= zero:
        s = type(L)(1.0)
    return s


@wp.func
def inverse_of(D: Any, least: Any):
    """Inverse of a symmetric matrix whose eigenvalues are at least `least`; symmetric and positive in any rounding."""
    q0 = type(least)(1.0) / wp.max(D[0, 0], least)
    l10 = D[1, 0] * q0
    l20 = D[2, 0] * q0
    q1 = type(least)(1.0) / wp.max(D[1, 1] - l10 * D[1, 0], least)
    s21 = D[2, 1] - l20 * D[1, 0]
    l21 = s21 * q1
    q2 = type(least)(1.0) / wp.max(D[2, 2] - l20 * D[2, 0] - l21 * s21, least)
    o = type(least)(0.0)
    e0 = wp.vector(type(least)(1.0), o, o)
    e1 = wp.vector(-l10, type(least)(1.0), o)
    e2 = wp.vector(l21 * l10 - l20, -l21, type(least)(1.0))
    return q0 * wp.outer(e0, e0) + q1 * wp.outer(e1, e1) + q2 * wp.outer(e2, e2)


@wp.func
def spring_newton_force(rows: Any, batch: Any, x: Any, d: Any, a: Any, i: int, e: int, rate: Any):
    """Entry e of the springs of point i: force [N], `link`, and (k (1 - l0/L) [N/m], negative if pressed; l0 [m])."""
    one = type(rate)(1.0)
    j = rows.other[e]
    c = rows.number[e]
    moved = d[j] - d[i]
    X = (x[j] - x[i]) + moved
    L = wp.length(X)
    n = inverse_or_zero(L) * X
    k = inverse_or_zero(batch.alpha[c])
    gamma = rate * batch.tau[c]
    l0 = batch.rest[c]
    side = k * side_of(L, l0)
    size = k * ((L - l0) + gamma * wp.dot(n, moved - (a[j] - a[i])))
    m = wp.sqrt((one + gamma) * k - side) * n
    return size * n, wp.vector(m[0], m[1], m[2], side), wp.vector(k * (one - l0 * inverse_or_zero(L)), l0)


@wp.func
def has_negative_direction(H: Any):
    """Whether a symmetric matrix has a negative direction: some leading minor is below zero."""
    zero = type(H[0, 0])(0.0)
    minor = H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0]
    return H[0, 0] < zero or minor < zero or wp.determinant(H) < zero


@wp.func
def aperiodic_wave(x: Any, k0: float, k1: float, k2: float, phase: float):
    """sin(k.x + phase)."""
    return wp.sin(type(x[0])(k0) * x[0] + type(x[0])(k1) * x[1] + type(x[0])(k2) * x[2] + type(x[0])(phase))


@wp.func
def asymmetric_direction(x: Any):
    """Some direction at x, the same in each world, that has no symmetry."""
    return wp.vector(aperiodic_wave(x, 977.0, 631.0, 353.0, 1.0), aperiodic_wave(x, 743.0, 419.0, 887.0, 2.0),
                     aperiodic_wave(x, 569.0, 811.0, 461.0, 3.0))


@wp.func
def sum_block_items(rows: Any, el: Any, e: int):
    """Block e: the sum of its items."""
    A = el.block.dtype()
    for k in range(rows.part[e], rows.part[e + 1]):
        at = rows.item[k]
        if at[1] >= 0:
            for r in range(3):
                A += wp.outer(el.J[at[0] + r], el.J[at[1] + r])
        elif at[1] == wp.static(WHOLE):
            A += el.block[at[0]]
        else:
            A += wp.transpose(el.block[at[0]])
    return A


@cache
def block_gather_kernel(real, module):
    """Kernel over LANES of the points: the blocks of their rows."""
    s, Elements = newton_structs(real), elements_of(real)

    @wp.kernel(module=module, enable_backward=False)
    def gather_blocks(rows: s.Rows, el: Elements, A_out: s.Matrix):
        i = wp.tid() // wp.static(LANES)
        if rows.w[i] > real(0.0):
            for e in range(rows.pair[i] + wp.tid() - wp.static(LANES) * i, rows.pair[i + 1], wp.static(LANES)):
                A_out.block[e] = sum_block_items(rows, el, e)

    return gather_blocks


@cache
def newton_assembly_kernel(real, module, springs: bool, elements: bool, apart: bool = False):
    """Kernel over points: force f [N] (minus the gradient of Phi), and the row of the Jacobian. Pinned points: zero. Reads
    x, d, a of the points. apart: blocks are gathered already (`block_gather_kernel`)."""
    t, s, Batch, Elements = types(real), newton_structs(real), batch_of(DISTANCE, real), elements_of(real)
    PointState = point_states(real)

    def assemble_newton_rows(rows: s.Rows, batch: Batch, el: Elements, at: PointState, b: wp.array(dtype=t.vec3), rate: real,
                             f_out: wp.array(dtype=t.vec3), A_out: s.Matrix):
        i = wp.tid()
        f = t.vec3()
        P = t.mat33()
        if rows.w[i] > real(0.0):
            own = A_out.own[i]
            f = -own * (at.d[i] - b[i])
            D = own * wp.identity(n=3, dtype=real)
            if wp.static(springs):
                bent = t.vec2()
                H = t.mat33()
                for e in range(rows.spring[i], rows.spring[i + 1]):
                    pulled, link, across = spring_newton_force(rows, batch, at.x, at.d, at.a, i, e, rate)
                    f += pulled
                    bent = t.vec2(bent[0] + across[0], wp.max(bent[1], across[1]))
                    m = t.vec3(link[0], link[1], link[2])
                    D += link[3] * wp.identity(n=3, dtype=real) + wp.outer(m, m)
                    A_out.link[e] = link
                    if across[0] < real(0.0):
                        H += across[0] * (wp.identity(n=3, dtype=real) - inverse_or_zero(wp.dot(m, m)) * wp.outer(m, m))
                if own + bent[0] < real(0.0) and has_negative_direction(D + H):
                    f -= (A_out.aside[0] * bent[0] * bent[1]) * asymmetric_direction(at.x[i])
            if wp.static(elements):
                for e in range(rows.pair[i], rows.pair[i + 1]):
                    if wp.static(apart):
                        D -= A_out.block[e]
                    else:
                        block = sum_block_items(rows, el, e)
                        D -= block
                        A_out.block[e] = block
                for e in range(rows.corner[i], rows.corner[i + 1]):
                    f += el.force[rows.pull[e]]
            D += (real(wp.static(ROUNDED * UNIT[real])) * wp.trace(D)) * wp.identity(n=3, dtype=real)
            P = inverse_of(D, own)
        f_out[i] = f
        A_out.P[i] = P

    name = "_".join(["assemble", *["springs"] * springs, *["elements"] * elements, *["apart"] * apart, t.name])
    return wp.kernel(assemble_newton_rows, name=name, module=module, enable_backward=False)


@cache
def begin(real, module):
    """Kernel over points: own, b: d as the prediction left it, and the way from there by which the last step's forces led."""
    t, s = types(real), newton_structs(real)

    @wp.kernel(module=module, enable_backward=False)
    def begin_newton(rows: s.Rows, d: wp.array(dtype=t.vec3), c: wp.array(dtype=t.vec3), rate: real,
                     A_out: s.Matrix, b_out: wp.array(dtype=t.vec3), y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        A_out.own[i] = rate * rate * inverse_or_zero(rows.w[i])
        b_out[i] = d[i]
        y = t.vec3()
        if rows.w[i] > real(0.0):
            y = c[i]
        y_out[i] = y

    return begin_newton


@cache
def stay(real, module):
    """Kernel over points: the way from d back to where the substep began. Pinned points: none."""
    t, s = types(real), newton_structs(real)

    @wp.kernel(module=module, enable_backward=False)
    def stay_at_start(rows: s.Rows, e: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        y = t.vec3()
        if rows.w[i] > real(0.0):
            y = e[i] - d[i]
        y_out[i] = y

    return stay_at_start


@cache
def end(real, module):
    """Kernel over points: c = d - b, what forces have moved a point by."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def force_displacement(d: wp.array(dtype=t.vec3), b: wp.array(dtype=t.vec3), c_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        c_out[i] = d[i] - b[i]

    return force_displacement
