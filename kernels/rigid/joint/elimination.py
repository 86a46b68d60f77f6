"""Direct solution of all joints of an island: block Cholesky of A = J M^-1 J^T + diag(Gamma).

    block (i, k) = sum over bodies c of both of  s_i s_k J_i M_c^-1 J_k^T,   s = 1 on side b, -1 on side a
    D_i D_i^T = A_ii,   L_ki = A_ki D_i^-T,   A_kl -= L_ki L_li^T       for k, l that are near i and come behind

The order and what fills in are known on the host (wsim/physics/rigid/joints/islands.py): a chain of n joints costs n steps,
loops some more. So a chain with a hundred times its weight at the end is solved as well as any other, where sweeps joint by
joint need more than n^2. Rows without an equation (pivots.py) are those of the identity. Joints that say the same twice (a
plane four-bar loop has three rows too many) leave A singular: held rows have a part EASE of their diagonal added, which the
next sweep makes up for, as it begins from what is left.

A loop is singular where its bars lie in line. Near the line A has an eigenvalue s^2, and s changes its sign as the loop passes
through. A substep knows A no better than by the change of its rows, D = J(x') - J(x): a sweep that divides by s^2 where s
changes as much drives the loop apart. So rows of loops have (D M^-1 D^T)_rr / 2 added to the diagonal. Sweeps make up for it
at a rate of (h omega)^2 in all directions that A does tell, and leave the others as they are (iterated Tikhonov
regularisation: Engl, Hanke, Neubauer 1996, section 5.1). An error of (h omega)^3 may stay at the line; the next substeps
close it. A tree of joints is never singular, and has nothing added.

(Baraff 1996, Linear-time dynamics using Lagrange multipliers; George, Liu 1981, chapter 5.)
"""

import warp as wp

from wsim.kernels.rigid.joint.tables import DRIVEN, HELD, HIGHEST, joint_table_structs

EASE = wp.constant(wp.float64(1.0e-7))       # smaller: loops that do not quite close strain themselves more
TINY = wp.constant(wp.float64(1.0e-300))
mat66d = wp.types.matrix((6, 6), wp.float64)
Linked = joint_table_structs()[1]


@wp.func
def block_product(i: int, k: int, r_i: wp.vec3d, r_k: wp.vec3d, w: wp.float64, S: wp.mat33d, J: Linked):
    """J_i M^-1 J_k^T of one body, without signs."""
    X = wp.skew(r_i)
    SY = S * wp.skew(r_k)
    K = wp.diag(wp.vec3d(w, w, w)) - X * SY
    axis_k = wp.transpose(J.axis[k])
    turn_k = wp.transpose(J.turn[k])
    a = J.axis[i] * K * axis_k
    b = J.axis[i] * (-X * S) * turn_k
    c = J.turn[i] * SY * axis_k
    d = J.turn[i] * S * turn_k
    found = mat66d()
    three = int(3)
    for r in range(three):
        for s in range(three):
            found[r, s] = a[r, s]
            found[r, s + 3] = b[r, s]
            found[r + 3, s] = c[r, s]
            found[r + 3, s + 3] = d[r, s]
    return found


@wp.func(inline=False)
def factor_joint_blocks(first: int, last: int, J: Linked):
    """Cholesky factors of the blocks of joints first .. last, in place."""
    six = int(6)
    n = J.t.a.shape[0]
    for i in range(first, last):
        at = 36 * i
        for c in range(six):
            d = J.block[at + 7 * c]
            for m in range(c):
                d -= J.block[at + 6 * c + m] * J.block[at + 6 * c + m]
            d = wp.sqrt(wp.max(d, TINY))
            J.block[at + 7 * c] = d
            for r in range(c + 1, six):
                v = J.block[at + 6 * r + c]
                for m in range(c):
                    v -= J.block[at + 6 * r + m] * J.block[at + 6 * c + m]
                J.block[at + 6 * r + c] = v / d
        t = J.t.first_target[i]
        for e in range(J.t.first_near[i], J.t.first_near[i + 1]):
            below = 36 * (n + e)
            for r in range(six):
                for c in range(six):
                    v = J.block[below + 6 * r + c]
                    for m in range(c):
                        v -= J.block[below + 6 * r + m] * J.block[at + 6 * c + m]
                    J.block[below + 6 * r + c] = v / J.block[at + 7 * c]
            for f in range(J.t.first_near[i], e + 1):
                other = 36 * (n + f)
                to = 36 * J.t.target_block[t]
                t += 1
                for r in range(six):
                    for c in range(six):
                        v = wp.float64(0.0)
                        for m in range(six):
                            v += J.block[below + 6 * r + m] * J.block[other + 6 * c + m]
                        J.block[to + 6 * r + c] = J.block[to + 6 * r + c] - v


@wp.func(inline=False)
def solve_joint_system(first: int, last: int, J: Linked):
    """rhs <- A^-1 rhs."""
    six = int(6)
    n = J.t.a.shape[0]
    for i in range(first, last):
        at = 36 * i
        for c in range(six):
            v = J.rhs[i, c]
            for m in range(c):
                v -= J.block[at + 6 * c + m] * J.rhs[i, m]
            J.rhs[i, c] = v / J.block[at + 7 * c]
        for e in range(J.t.first_near[i], J.t.first_near[i + 1]):
            below = 36 * (n + e)
            k = J.t.near[e]
            for r in range(six):
                v = J.rhs[k, r]
                for m in range(six):
                    v -= J.block[below + 6 * r + m] * J.rhs[i, m]
                J.rhs[k, r] = v
    for back in range(last - first):
        i = last - 1 - back
        at = 36 * i
        for e in range(J.t.first_near[i], J.t.first_near[i + 1]):
            below = 36 * (n + e)
            k = J.t.near[e]
            for c in range(six):
                v = J.rhs[i, c]
                for m in range(six):
                    v -= J.block[below + 6 * m + c] * J.rhs[k, m]
                J.rhs[i, c] = v
        for last_first in range(six):
            c = 5 - last_first
            v = J.rhs[i, c]
            for m in range(c + 1, six):
                v -= J.block[at + 6 * m + c] * J.rhs[i, m]
            J.rhs[i, c] = v / J.block[at + 7 * c]


@wp.func
def row_has_equation(i: int, r: int, J: Linked):
    """True if row r of joint i has an unknown; others add what is known."""
    return J.active[i, r] >= HELD and J.active[i, r] <= HIGHEST


@wp.func
def put_diagonal(i: int, A: mat66d, J: Linked):
    """A_ii with Gamma; what is not active stays as it is."""
    six = int(6)
    for r in range(six):
        for c in range(six):
            v = A[r, c]
            if not (row_has_equation(i, r, J) and row_has_equation(i, c, J)):
                v = wp.float64(0.0)
            if r == c:
                J.ease[i, r] = EASE * A[r, r] + J.turned[i, r] + TINY
                if not row_has_equation(i, r, J):
                    v = wp.float64(1.0)
                elif J.active[i, r] == DRIVEN:
                    v += J.soft[i, r]
                else:
                    v += J.ease[i, r]
            J.block[36 * i + 6 * r + c] = v


@wp.func
def put_below(block: int, k: int, i: int, A: mat66d, J: Linked):
    """A_ki, rows of k and columns of i."""
    six = int(6)
    for r in range(six):
        for c in range(six):
            v = A[r, c]
            if not (row_has_equation(k, r, J) and row_has_equation(i, c, J)):
                v = wp.float64(0.0)
            J.block[36 * block + 6 * r + c] = v
