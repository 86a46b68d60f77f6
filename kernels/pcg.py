"""Conjugate gradients for A y = f, each body by itself. A: kernels/newton.py. Bodies share no row, so worlds do not mix.

    z = P r,  w = A z,  gamma = r.z,  delta = z.w,  beta = gamma / gamma',  alpha = gamma / (delta - beta gamma / alpha')
    p = z + beta p,  s = w + beta s,  y += alpha p,  r -= alpha s                      (Chronopoulos, Gear 1989; ' is the last)

The usual method with its two sums next to each other: two passes an iteration, where the textbook's order takes three.
P = F (A_ii)^-1 F is block Jacobi with a filter F per point: zero for pins, I - n n^T for a contact. From y = 0 every z, p
and y stays in the filter's range, which makes it the modified method of Baraff and Witkin 1998 in the form of Ascher and
Boxerman 2003, section 3. It ends when sqrt(r.P r) is `tolerance` times that of f.

Two ways to run it: `solve` gives a block of threads to each body (on the CPU one thread), all iterations in one launch;
`multiply` and `advance` give several blocks to a body, two launches an iteration. Sums are in float64 and in a fixed order.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.newton import structs
from wsim.kernels.real import types

THREADS = 256          # of a block of `advance`


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ double part[32];
    double sum = v;
    for (unsigned k = 16; k > 0; k >>= 1) sum += __shfl_xor_sync(0xffffffffu, sum, k);
    unsigned warps = blockDim.x >> 5;
    __syncthreads();
    if ((threadIdx.x & 31) == 0) part[threadIdx.x >> 5] = sum;
    __syncthreads();
    sum = 0.0;
    for (unsigned k = 0; k < warps; ++k) sum += part[k];
    return sum;
#else
    return v;
#endif
""")
def total(v: wp.float64) -> wp.float64:
    """Sum over the threads of a block, the same in each; they meet here, and every one must come. Blocks of whole warps."""
    ...


@cache
def vectors(real):
    """Struct of what an iteration carries: y [m], r, w, s [N], z, p [m], (points,)."""
    t = types(real)

    @wp.struct
    class Vectors:
        y: wp.array(dtype=t.vec3)
        r: wp.array(dtype=t.vec3)
        z: wp.array(dtype=t.vec3)
        w: wp.array(dtype=t.vec3)
        p: wp.array(dtype=t.vec3)
        s: wp.array(dtype=t.vec3)

    return Vectors


@cache
def parts(real, springs: bool, elements: bool) -> SimpleNamespace:
    """Functions of one point: product (A z)_i, begin, and step: what follows once alpha and beta are known."""
    t, s, Vectors = types(real), structs(real), vectors(real)

    @wp.func
    def product(i: int, rows: s.Rows, A: s.Matrix, z: wp.array(dtype=t.vec3)):
        y = t.vec3()
        if rows.w[i] > real(0.0):
            zi = z[i]
            y = A.own[i] * zi
            if wp.static(springs):
                for e in range(rows.spring[i], rows.spring[i + 1]):
                    k = A.link[e]
                    dz = zi - z[rows.other[e]]
                    m = t.vec3(k[0], k[1], k[2])
                    y += k[3] * dz + wp.dot(m, dz) * m
            if wp.static(elements):
                for e in range(rows.pair[i], rows.pair[i + 1]):
                    y += A.block[e] * (z[rows.column[e]] - zi)
        return y

    @wp.func
    def begin(i: int, A: s.Matrix, f: wp.array(dtype=t.vec3), v: Vectors):
        r = f[i]
        z = A.P[i] * r
        v.y[i] = t.vec3()
        v.p[i] = t.vec3()
        v.s[i] = t.vec3()
        v.r[i] = r
        v.z[i] = z
        return wp.float64(wp.dot(r, z))

    @wp.func
    def step(i: int, A: s.Matrix, alpha: real, beta: real, v: Vectors):
        p = v.z[i] + beta * v.p[i]
        q = v.w[i] + beta * v.s[i]
        r = v.r[i] - alpha * q
        z = A.P[i] * r
        v.p[i] = p
        v.s[i] = q
        v.y[i] = v.y[i] + alpha * p
        v.r[i] = r
        v.z[i] = z
        return wp.float64(wp.dot(r, z))

    return SimpleNamespace(product=product, begin=begin, step=step, name="_".join(
        [*["springs"] * springs, *["elements"] * elements, t.name]))


@cache
def solve(real, module, springs: bool, elements: bool):
    """Kernel over bodies times a block of threads: y of v becomes A^-1 f. first (bodies + 1,): a body's points.

    tolerance of sqrt(r.P r), cap of iterations; drop_out (bodies,) becomes f.y, twice what the quadratic model of Phi
    falls by [J]; count_out (bodies,) grows by the iterations.
    """
    s, o, Vectors, t = structs(real), parts(real, springs, elements), vectors(real), types(real)
    product, begin, step = o.product, o.begin, o.step

    def solve(rows: s.Rows, A: s.Matrix, first: wp.array(dtype=int), f: wp.array(dtype=t.vec3), tolerance: wp.float64, cap: int,
              v: Vectors, drop_out: wp.array(dtype=wp.float64), count_out: wp.array(dtype=int)):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        lo = first[body] + lane
        hi = first[body + 1]
        zero = wp.float64(0.0)
        gamma = zero + zero
        for i in range(lo, hi, wp.block_dim()):
            gamma += begin(i, A, f, v)
        gamma = total(gamma)
        enough = tolerance * tolerance * gamma
        before = wp.float64(1.0)
        alpha = wp.float64(1.0)
        beta = wp.float64(0.0)
        drop = wp.float64(0.0)
        count = int(0)  # noqa: UP018
        for k in range(cap):
            if not gamma > enough:
                break
            delta = wp.float64(0.0)
            for i in range(lo, hi, wp.block_dim()):
                w = product(i, rows, A, v.z)
                v.w[i] = w
                delta += wp.float64(wp.dot(v.z[i], w))
            delta = total(delta)
            if k > 0:
                beta = gamma / before
                delta -= beta * gamma / alpha
            if not delta > zero:                       # rounding has eaten what is left
                break
            alpha = gamma / delta
            before = gamma
            drop += alpha * gamma
            gamma = wp.float64(0.0)
            for i in range(lo, hi, wp.block_dim()):
                gamma += step(i, A, real(alpha), real(beta), v)
            gamma = total(gamma)
            count += 1
        if lane == 0:
            drop_out[body] = drop
            count_out[body] = count_out[body] + count

    return wp.kernel(solve, name=f"pcg_{o.name}", module=module, enable_backward=False, grid_stride=False)
