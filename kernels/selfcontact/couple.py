"""Friction of a pair without a moment.

The closest points of a pair are D = sum_k b_k r_k apart, r_k its four points from their middle. A push P along D has no moment;
friction across it has one, D x P, that turns what slides. A couple on the same points takes it back, and what a pair looks at
is the slip beside their common turn, which is the transpose of it (so that friction still only takes energy):

    J = sum_k (|r_k|^2 - r_k r_k^T)      P_k = b_k P - (J^-1 (D x P)) x r_k
    slip = sum_k b_k d_k - (J^-1 sum_k r_k x d_k) x D

Sums of P_k and of r_k x P_k are zero. It is the least change of the four pushes that does so, and it is small: some D / L of P,
where the points are L apart; of two edges one above the other friction across them has no other way, and vanishes.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import pairs

THIN = 1e-6            # of the third of a trace cubed, that a determinant is at least; less: four points in a line


@cache
def couple(real):
    """Functions, r and d being matrices of four rows:

    arms   (s, at, ids, b) -> r, D: points of a pair from their middle, where the substep begins; way between the closest
    lever  r -> J^-1, 0 of points in a line
    turn   (J^-1, r, d) -> J^-1 sum_k r_k x d_k
    """
    t = types(real)
    Surfaces, State = pairs.surfaces(real), states(real)
    points = wp.types.matrix((4, 3), real)
    place, _ = pairs.reading(real)

    @wp.func
    def arms(s: Surfaces, at: State, ids: wp.vec4i, b: t.vec4):
        r, D, middle = points(), t.vec3(), t.vec3()
        for k in range(4):
            r[k] = place(s, at.x, at.e, ids[k], ids[0])
            D += b[k] * r[k]
            middle += real(0.25) * r[k]
        for k in range(4):
            r[k] = r[k] - middle
        return r, D

    @wp.func
    def lever(r: points):
        x, y, z = t.vec3(), t.vec3(), t.vec3()             # rows of J
        for k in range(4):
            p = r[k]
            size = wp.dot(p, p)
            x += t.vec3(size - p[0] * p[0], -p[0] * p[1], -p[0] * p[2])
            y += t.vec3(-p[1] * p[0], size - p[1] * p[1], -p[1] * p[2])
            z += t.vec3(-p[2] * p[0], -p[2] * p[1], size - p[2] * p[2])
        mean = (x[0] + y[1] + z[2]) / real(3.0)
        cofactor = wp.cross(y, z)
        determinant = wp.dot(x, cofactor)
        if determinant <= real(THIN) * mean * mean * mean:
            return t.mat33()
        return wp.matrix_from_rows(cofactor, wp.cross(z, x), wp.cross(x, y)) / determinant     # J is symmetric

    @wp.func
    def turn(K: t.mat33, r: points, d: points):
        L = t.vec3()
        for k in range(4):
            L += wp.cross(r[k], d[k])
        return K * L

    return arms, lever, turn
