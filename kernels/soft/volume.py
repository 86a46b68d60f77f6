"""Volume that soft bodies of the corotational law lose, and what another law would lose at the same shape and pressure.

    J = det F,  I = |F|^2,  S = s_1 + s_2 + s_3          of the stretches s_i
    corotational    3 J p = 2 mu (I - S) + lam (S - 3) S                                      p: mean Cauchy stress [Pa]
    neo_hookean       j p = mu (I/3 - j) + mu/9 I (I - 3)/(I + 1) + (lam + 5/6 mu) (j - 1) j,     I of the same shape at j

The corotational law resists the sum of the stretches less three in the place of J - 1: stretches 1.3, 1.3, 0.4 have the sum 3,
and J = 0.68. A material of a small Poisson ratio gives way to pressure by any law, and j is then as small as J. In cubes
pressed by 0.3, with held ends, j comes within 3 % of the volume to what neo_hookean leaves.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft import fem, shape10
from wsim.kernels.soft.material import stretch_sum
from wsim.kernels.soft.neo_hookean import cofactor_matrix
from wsim.kernels.soft.principal import clamp_entries


@wp.func
def other_volume(J: wp.float64, size: wp.float64, S: wp.float64, mu: wp.float64, lam: wp.float64):
    """j of neo_hookean where corotational has J, I (size) and S, by Newton's method; 1 of what is flat or inside out."""
    one, three = wp.float64(1.0), wp.float64(3.0)
    stiff = lam + mu * wp.float64(5.0 / 6.0)
    if J < wp.float64(0.1) or not stiff > wp.float64(0.0):
        return one
    p = (wp.float64(2.0) * mu * (size - S) + lam * (S - three) * S) / (three * J)
    shape = size / wp.pow(J, wp.float64(2.0 / 3.0))
    j = J
    n = int(8)                                                # a variable: not unrolled
    for _k in range(n):
        square = shape * wp.pow(j, wp.float64(2.0 / 3.0))
        g = mu * (square / three + square * (square - three) / (wp.float64(9.0) * (square + one)))
        change = (square * square + wp.float64(2.0) * square - three) / (wp.float64(9.0) * (square + one) * (square + one))
        slope = stiff + (mu * (one / three + change) * square * wp.float64(2.0 / 3.0) - g) / (j * j)
        found = g / j - mu + stiff * (j - one) - p
        j = wp.clamp(j - found / wp.max(slope, wp.float64(0.1) * stiff), wp.float64(0.1), three)
    return j


@cache
def volume_change_function(real):
    """Function (H, mu, lam): (J - 1, j - 1)."""
    t = types(real)

    @wp.func
    def tet_volume_change(H: t.mat33, mu: real, lam: real):
        K = clamp_entries(H)
        C = cofactor_matrix(K)
        stretch, more = stretch_sum(K)
        J = wp.float64(wp.trace(K) + wp.trace(C) + wp.dot(K[0], C[0]))
        one, three = wp.float64(1.0), wp.float64(3.0)
        j = other_volume(one + J, three + wp.float64(more), three + wp.float64(stretch), wp.float64(mu), wp.float64(lam))
        return wp.vec3d(one, J, j - one)

    return tet_volume_change


@cache
def volume_change_kernel(nodes: int, real, module):
    """Kernel over bodies times lanes: sums of V, V (J - 1), V (j - 1) [m^3] of a lane's tets. first: of each body, (bodies +
    1,); nodes: of a tet."""
    t = types(real)
    Tets = (fem if nodes == 4 else shape10).elements(real)
    vec3, of = wp.array(dtype=t.vec3), volume_change_function(real)
    (linear, _) = fem.linear_displacement(real, real)
    (slopes, moved, _) = shape10.quadratic_displacement(real, real)

    @wp.func
    def tet_volume_sums(tets: Tets, c: int, x: vec3, d: vec3):
        sum = wp.vec3d()
        volume = wp.float64(tets.volume[c])
        if wp.static(nodes == 4):
            sum = volume * of(linear(tets, c, x, d), tets.mu[c], tets.lam[c])
        else:
            u = moved(tets, c, x, d)
            points = int(shape10.POINTS)
            for a in range(points):
                H = shape10.node_field_gradient(u, slopes(tets, c, a), tets.point.shape[1])
                sum += wp.float64(0.25) * volume * of(H, tets.mu[c], tets.lam[c])
        return sum

    def sum_volume_changes(tets: Tets, first: wp.array(dtype=int), lanes: int, x: vec3, d: vec3,
                           part_out: wp.array(dtype=wp.vec3d)):
        row = wp.tid()
        body = row // lanes
        sum = wp.vec3d()
        for c in range(first[body] + row - body * lanes, first[body + 1], lanes):
            sum += tet_volume_sums(tets, c, x, d)
        part_out[row] = sum

    return wp.kernel(sum_volume_changes, name=f"solid_changes_{nodes}_{t.name}", module=module, enable_backward=False)


@cache
def lost_volume_kernel(real, module):
    """Kernel over bodies: tell_out, 1e-4 of the volume at rest that is lost, and 1e-4 that the other law would lose."""

    @wp.func
    def ten_thousandths(part: wp.float64):
        found = int(0)
        if part > wp.float64(0.0):                            # false of what is not finite
            found = int(wp.rint(wp.float64(1.0e4) * wp.min(part, wp.float64(1.0e4))))
        return found

    def report_lost_volume(part: wp.array(dtype=wp.vec3d), lanes: int, offset: int, tell_out: wp.array(dtype=int)):
        body = wp.tid()
        sum = wp.vec3d()
        for k in range(body * lanes, (body + 1) * lanes):
            sum += part[k]
        tell_out[offset + 2 * body] = ten_thousandths(-sum[1] / sum[0])
        tell_out[offset + 2 * body + 1] = ten_thousandths(-sum[2] / sum[0])

    return wp.kernel(report_lost_volume, name=f"solid_lost_{types(real).name}", module=module, enable_backward=False)
