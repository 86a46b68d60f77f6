"""Kernels of generalised conjugate residuals (Eisenstat, Elman, Schultz 1983), kept to the last so many directions:

    z = M^-1 r, q = B z;   beta_k = q.q_k / q_k.q_k,  z -= beta_k p_k,  q -= beta_k q_k;   alpha = r.q / q.q
    y += alpha z,  r -= alpha q;   p, q take the place of the oldest

B need not be symmetric, M may differ from step to step; |r| never grows. Sums are in float64 and in a fixed order.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@cache
def gcr_basis(real):
    """Struct of the directions kept, p_k and q_k = B p_k (kept, points); q_k.q_k, or 0 of those that are none yet; beta_k."""
    t = types(real)

    @wp.struct
    class Basis:
        p: wp.array2d(dtype=t.vec3)
        q: wp.array2d(dtype=t.vec3)
        size: wp.array(dtype=wp.float64)
        beta: wp.array(dtype=wp.float64)
        part: wp.array2d(dtype=wp.float64)       # parts of q.q_k, (kept, lanes)

    return Basis


@cache
def gcr_projection_kernel(real, module):
    """Kernel over the directions kept times lanes: parts of q.q_k."""
    t, Basis = types(real), gcr_basis(real)

    @wp.kernel(module=module, enable_backward=False)
    def project_on_directions(o: Basis, q: wp.array(dtype=t.vec3)):
        lanes = o.part.shape[1]
        lane = wp.tid() % lanes
        k = wp.tid() // lanes
        sum = wp.float64(0.0)
        for i in range(lane, q.shape[0], lanes):
            a = q[i]
            b = o.q[k, i]
            for n in range(3):
                sum += wp.float64(a[n]) * wp.float64(b[n])
        o.part[k, lane] = sum

    return project_on_directions


@cache
def gcr_coefficient_kernel(real, module):
    """Kernel over the directions kept: beta."""
    Basis = gcr_basis(real)

    @wp.kernel(module=module, enable_backward=False)
    def gcr_coefficients(o: Basis):
        k = wp.tid()
        sum = wp.float64(0.0)
        for lane in range(o.part.shape[1]):
            sum += o.part[k, lane]
        beta = wp.float64(0.0)
        if o.size[k] > wp.float64(0.0):
            beta = sum / o.size[k]
        o.beta[k] = beta

    return gcr_coefficients


@cache
def gcr_orthogonal_kernel(real, module):
    """Kernel over points: z and q lose what is along the directions kept."""
    t, Basis = types(real), gcr_basis(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def orthogonalise_directions(o: Basis, z_out: vec3, q_out: vec3):
        i = wp.tid()
        z = z_out[i]
        q = q_out[i]
        for k in range(o.beta.shape[0]):
            if o.beta[k] != wp.float64(0.0):
                z -= real(o.beta[k]) * o.p[k, i]
                q -= real(o.beta[k]) * o.q[k, i]
        z_out[i] = z
        q_out[i] = q

    return orthogonalise_directions


@cache
def gcr_storage_kernel(real, module):
    """Kernel over points: z and q take the place of the oldest direction. qq: parts of q.q; count: of directions so far."""
    t, Basis = types(real), gcr_basis(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def store_gcr_direction(o: Basis, z: vec3, q: vec3, qq: wp.array(dtype=wp.float64), count: wp.array(dtype=int)):
        i = wp.tid()
        k = count[0] % o.beta.shape[0]
        o.p[k, i] = z[i]
        o.q[k, i] = q[i]
        if i == 0:
            sum = wp.float64(0.0)
            for lane in range(qq.shape[0]):
                sum += qq[lane]
            o.size[k] = sum

    return store_gcr_direction
