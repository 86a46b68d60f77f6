"""Further Newton steps of a substep: whether a system needs one, and where they lead together.

A system goes on while its residual is above what its integrator needs (`met` in wsim/scene/integrator.py), for so many steps.
One that has met it keeps its d to the bit, whatever others do: worlds do not see each other.

Where a part of the Jacobian is left out, steps y(d) go to the solution by a ratio. The last ones say by which: their secants
lead ahead (Anderson 1965; Walker, Ni 2011, Anderson acceleration for fixed-point iterations, eq. 2.2, in the norm of own):

    p = y - sum_j gamma_j (dd_j + dy_j),    |y - sum_j gamma_j dy_j| is least,    j = 1 .. SECANTS

dd_j, dy_j are what d and y have changed by in the last steps. p is looked at as y is. Where Phi is not less along it, the
system stays where it is and forgets its secants: what they led back to was a saddle. It leaves that along y, by the best of
FAR, FAR/2 .. FAR / 2^HALVINGS of a step, where each step would leave it by a ratio only.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.block import BLOCK
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum

SECANTS = 3            # kept
FAR = 32.0
NEVER = 1e30           # times what a step should bring: the whole way alone is not taken before parts of it are looked at
LEAST = 1e-12          # of the diagonal of their products, that is added to it: secants that are nearly parallel


@cache
def further_look_kernel(real, module):
    """Kernel of one thread: words[0] is 1 while some of the residuals is above `least`, for `most` looks; words[1] counts
    them. A residual that is no number goes on as well."""

    @wp.kernel(module=module, enable_backward=False)
    def look_further(residual: wp.array(dtype=real), least: real, most: int, first: int, words: wp.array(dtype=int)):
        looks = words[1] + 1
        if first == 1:
            looks = int(0)  # noqa: UP018
        words[1] = looks
        on = int(0)  # noqa: UP018
        for i in range(residual.shape[0]):
            if not residual[i] <= least:
                on = 1
        words[0] = wp.where(looks < most, on, 0)

    return look_further


@cache
def stand_still_kernel(real, module):
    """Kernel over points: no step for those of systems that have met `least`. of: system of a point."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def stand_still(of: wp.array(dtype=int), residual: wp.array(dtype=real), least: real, y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if residual[of[i]] <= least:
            y_out[i] = t.vec3()

    return stand_still


@cache
def newton_secants(real):
    """Struct of the secants of all points, and of what systems make of them."""
    t = types(real)

    @wp.struct
    class Secants:
        d: wp.array(dtype=t.vec3)                   # d and y of the last step, (points,)
        y: wp.array(dtype=t.vec3)
        dd: wp.array2d(dtype=t.vec3)                # (SECANTS, points), in turn
        dy: wp.array2d(dtype=t.vec3)
        known: wp.array(dtype=int)                  # steps since it has begun anew, (systems,)
        gamma: wp.array2d(dtype=wp.float64)         # (systems, SECANTS)
        scale: wp.array(dtype=t.scalar)             # of y, (systems,)

    return Secants


@cache
def secant_storage_kernel(real, module):
    """Kernel over points: the secants of this step; d and y are kept for the next. step: what words[1] of `further_look_kernel`
    counts."""
    Secants, vectors = newton_secants(real), wp.array(dtype=types(real).vec3)

    @wp.kernel(module=module, enable_backward=False)
    def keep_secants(words: wp.array(dtype=int), d: vectors, y: vectors, out: Secants):
        i = wp.tid()
        row = words[1] % SECANTS
        out.dd[row, i] = d[i] - out.d[i]
        out.dy[row, i] = y[i] - out.y[i]
        out.d[i] = d[i]
        out.y[i] = y[i]

    return keep_secants


@cache
def secant_weight_kernel(real, module):
    """Kernel over systems times a block of threads: gamma of each secant, and the scale of y. step: of the line search before,
    not above 0 where it found nothing."""
    t, Secants = types(real), newton_secants(real)
    square = wp.types.matrix((SECANTS, SECANTS), wp.float64)
    column = wp.types.vector(SECANTS, wp.float64)

    @wp.func
    def solve_secant_system(M: square, r: column, n: int):
        """Solution of the first n rows of M g = r, symmetric; of others g = 0. By Gauss's elimination."""
        g = column()
        for k in range(n):
            M[k, k] = M[k, k] * wp.float64(1.0 + LEAST)
        for k in range(n):
            for i in range(k + 1, n):
                if M[k, k] > wp.float64(0.0):
                    f = M[i, k] / M[k, k]
                    for j in range(k, n):
                        M[i, j] = M[i, j] - f * M[k, j]
                    r[i] = r[i] - f * r[k]
        for back in range(n):
            k = n - 1 - back
            left = r[k]
            for j in range(k + 1, n):
                left -= M[k, j] * g[j]
            if M[k, k] > wp.float64(0.0):
                g[k] = left / M[k, k]
        return g

    def weigh_secants(words: wp.array(dtype=int), first: wp.array(dtype=int), own: wp.array(dtype=real),
                      y: wp.array(dtype=t.vec3),
                      step: wp.array(dtype=wp.float64), drop_out: wp.array(dtype=wp.float64), out: Secants):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        n = wp.min(out.known[body], SECANTS)
        far = words[1] > 0 and step[body] <= wp.float64(0.0)
        if words[1] == 0 or far:
            n = 0
        M, r = square(), column()
        for i in range(first[body] + lane, first[body + 1], wp.block_dim()):
            m = wp.float64(own[i])
            for a in range(n):
                va = out.dy[(words[1] + SECANTS - a) % SECANTS, i]
                r[a] = r[a] + m * wp.float64(wp.dot(va, y[i]))
                for b in range(a + 1):
                    M[a, b] = M[a, b] + m * wp.float64(wp.dot(va, out.dy[(words[1] + SECANTS - b) % SECANTS, i]))
        for a in range(n):
            r[a] = block_sum(r[a])
            for b in range(a + 1):
                M[a, b] = block_sum(M[a, b])
                M[b, a] = M[a, b]
        if lane == 0:
            g = solve_secant_system(M, r, n)
            for a in range(SECANTS):
                out.gamma[body, a] = g[a]
            out.known[body] = n + 1
            near = out.scale[body] == real(1.0)
            out.scale[body] = real(1.0)
            if far and near:                             # else it was too far
                out.scale[body] = real(FAR)
                drop_out[body] = wp.float64(NEVER)

    return wp.kernel(weigh_secants, name=f"weigh_secants_{t.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)


@cache
def secant_step_kernel(real, module):
    """Kernel over points: the way p, of the step y. of: system of a point."""
    t, Secants = types(real), newton_secants(real)

    @wp.kernel(module=module, enable_backward=False)
    def lead_ahead(words: wp.array(dtype=int), of: wp.array(dtype=int), w: wp.array(dtype=real), s: Secants,
                   y: wp.array(dtype=t.vec3), y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if w[i] > real(0.0):
            p = s.scale[of[i]] * y[i]
            for a in range(SECANTS):
                g = s.gamma[of[i], a]
                if g != wp.float64(0.0):
                    row = (words[1] + SECANTS - a) % SECANTS
                    p -= real(g) * (s.dd[row, i] + s.dy[row, i])
            y_out[i] = p

    return lead_ahead
