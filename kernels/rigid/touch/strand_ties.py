"""Points of strands that are tied to rigid bodies, both ways: an augmented Lagrangian of the gap c, in the iterations of
Newton's method (kernels/rods/coupled_newton/coupled.py).

    c = x - a(q),   f = lam - k c on the point, -f on the body at x,   -df/dx = k,   lam <- lam - k c behind each full step
    k = TIE (m / h^2 + sum of E A / l of the edges that meet there)

The tie is a contact in the table of those that strands have with bodies (strand_forces.py), that pulls too. So points and
bodies are solved for together (strands.py). A heavy body on a light rope takes no more iterations than a light one on a heavy
rope: seen from the tie, the rope gives way to a force at least as m / h^2 + E A / l does, so that each step leaves some
1 / TIE of the gap, whatever a body weighs. lam begins as it was in the substep before: what hangs still needs one step. f acts
on both at the same place x: momentum is kept to rounding, angular momentum by what a backward Euler step keeps of it.

(Hestenes 1969; Powell 1969; Nocedal, Wright 2006, section 17.3.)
"""

from functools import cache

import warp as wp

from wsim.kernels.math.rotation import rotate_vector
from wsim.kernels.rigid.touch.strand_contacts import trial_turn
from wsim.kernels.rigid.touch.strands import RodBodies
from wsim.kernels.rods.tables import RodContacts, RodTable, RodTrial

TIE = wp.constant(wp.float64(100.0))     # 1000: 3 iterations for 4, and rounds of conjugate gradients grow by its root


@wp.func
def tie_gap(S: RodTable, T: RodTrial, W: RodBodies, i: int, k: int):
    """c [m] of a tied point in the trial."""
    j = W.tied[i, k]
    return T.x[i, k] + S.origin[k] - (W.c1[j] + W.xi[j, 0] + rotate_vector(trial_turn(W, j), W.tie_at[i, k]))


@wp.func
def tie_stiffness(S: RodTable, h: wp.float64, i: int, k: int):
    """k [N/m]."""
    return TIE * (S.m[i, k] / (h * h) + S.A[i, k] + S.A[wp.max(i - 1, 0), k])


@wp.func
def add_body_tie(S: RodTable, T: RodTrial, W: RodBodies, B: RodContacts, i: int, k: int):
    """The tie of a point as the first contact of its row."""
    j = W.tied[i, k]
    if j < 0:
        return
    p = i * W.strand.shape[0] + k
    world = W.strand[k]
    c = tie_gap(S, T, W, i, k)
    stiff = tie_stiffness(S, W.h, i, k)
    if B.count[world] == 0:
        B.pull[p] = W.tie[i, k]
    elif B.on[world] == 1 and B.back[world] == 0:
        B.pull[p] = B.pull[p] - c * stiff
    B.many[p] = 1
    B.body[p, 0] = j
    B.u[p, 0] = wp.float64(0.0)
    B.f[p, 0] = B.pull[p] - c * stiff
    B.K[p, 0] = wp.identity(n=3, dtype=wp.float64) * stiff
    B.arm[p, 0] = T.x[i, k] + S.origin[k] - (W.c1[j] + W.xi[j, 0])


@cache
def tie_end_kernel(module: str):
    """Kernel over points, where a substep ends: forces of ties, which the next one begins with, and gaps [m]."""
    @wp.kernel(module=module, enable_backward=False)
    def keep_tie_forces(S: RodTable, T: RodTrial, W: RodBodies, B: RodContacts, gap: wp.array(dtype=wp.float64)):
        p = wp.tid()
        i = p / S.points.shape[0]
        k = p - i * S.points.shape[0]
        if i < S.points[k]:
            if W.tied[i, k] >= 0:
                c = tie_gap(S, T, W, i, k)
                W.tie[i, k] = B.pull[p] - c * tie_stiffness(S, W.h, i, k)
                gap[p] = wp.length(c)

    return keep_tie_forces
