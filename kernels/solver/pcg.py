"""Conjugate gradients for A y = f, each body by itself. A: kernels/solver/newton.py. Bodies share no row, so worlds do not mix.

    z = P r,  w = A z,  gamma = r.z,  delta = z.w,  beta = gamma / gamma',  alpha = gamma / (delta - beta gamma / alpha')
    p = z + beta p,  s = w + beta s,  y += alpha p,  r -= alpha s                      (Chronopoulos, Gear 1989; ' is the last)

The usual method with its two sums next to each other: two passes an iteration, where the textbook's order takes three.
P = F (A_ii)^-1 F is block Jacobi with a filter F per point: zero for pins, I - n n^T for a contact. From y = 0 every z, p
and y stays in the filter's range, which makes it the modified method of Baraff and Witkin 1998 in the form of Ascher and
Boxerman 2003, section 3. It ends when sqrt(r.P r) is `tolerance` times that of f.

Two ways to run it: `pcg_body_kernel` gives a block of threads to each body (on the CPU one thread), all iterations in one
launch; `pcg_chunk_kernels` gives several blocks to a body, two launches an iteration. Sums are in float64 and in a fixed order.
With a coarse space (kernels/solver/coarse_space.py) z gets more than P r between `advance` and `multiply`, and r is kept in the
filter's range.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.math.block import BLOCK
from wsim.kernels.math.real import types
from wsim.kernels.solver.newton import newton_structs


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
def block_sum(v: wp.float64) -> wp.float64:
    """Sum over the threads of a block, the same in each; they meet here, and every one must come. Blocks of whole warps."""
    ...


@wp.func
def range_projector(P: Any):
    """Projector on the range of a symmetric positive matrix: what a filter has left. Eigenvalues 1e5 apart are told from 0."""
    least = type(P[0, 0])(1.0e-5)
    S = P - P
    size = wp.trace(P)
    if size > type(size)(0.0):
        M = P / size
        a = wp.cross(M[1], M[2])
        b = wp.cross(M[2], M[0])
        c = wp.cross(M[0], M[1])
        pairs = a[0] + b[1] + c[2]
        if not pairs > least:
            S = M
        elif wp.dot(M[0], a) > least * pairs:
            S = wp.identity(n=3, dtype=type(size))
        else:
            S = wp.identity(n=3, dtype=type(size)) - wp.matrix_from_rows(a, b, c) / pairs
    return S


@cache
def pcg_vectors(real):
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
def pcg_point_functions(real, springs: bool, elements: bool, coarse: bool = False) -> SimpleNamespace:
    """Functions of one point: product (A z)_i, begin, and step: what follows once alpha and beta are known."""
    t, s, Vectors = types(real), newton_structs(real), pcg_vectors(real)

    @wp.func
    def newton_row_product(i: int, rows: s.Rows, A: s.Matrix, z: wp.array(dtype=t.vec3)):
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
    def begin_pcg_point(i: int, A: s.Matrix, f: wp.array(dtype=t.vec3), v: Vectors):
        r = f[i]
        if wp.static(coarse):
            r = range_projector(A.P[i]) * r
        z = A.P[i] * r
        v.y[i] = t.vec3()
        v.p[i] = t.vec3()
        v.s[i] = t.vec3()
        v.r[i] = r
        v.z[i] = z
        return wp.float64(wp.dot(r, z))

    @wp.func
    def step_pcg_point(i: int, A: s.Matrix, alpha: real, beta: real, v: Vectors):
        p = v.z[i] + beta * v.p[i]
        q = v.w[i] + beta * v.s[i]
        r = v.r[i] - alpha * q
        if wp.static(coarse):
            r = range_projector(A.P[i]) * r
        z = A.P[i] * r
        v.p[i] = p
        v.s[i] = q
        v.y[i] = v.y[i] + alpha * p
        v.r[i] = r
        v.z[i] = z
        return wp.float64(wp.dot(r, z))

    return SimpleNamespace(product=newton_row_product, begin=begin_pcg_point, step=step_pcg_point, name="_".join(
        [*["springs"] * springs, *["elements"] * elements, *["coarse"] * coarse, t.name]))


@cache
def pcg_body_kernel(real, module, springs: bool, elements: bool):
    """Kernel over bodies times a block of threads: y of v becomes A^-1 f.

    tolerance of sqrt(r.P r), cap of iterations; drop_out (bodies,) becomes f.y, twice what the quadratic model of Phi
    falls by [J]; count_out (bodies,) grows by the iterations.
    """
    s, o, Vectors, t = newton_structs(real), pcg_point_functions(real, springs, elements), pcg_vectors(real), types(real)
    product, begin, step = o.product, o.begin, o.step

    def solve_body_pcg(rows: s.Rows, A: s.Matrix, f: wp.array(dtype=t.vec3), tolerance: wp.float64, cap: int, v: Vectors,
                       drop_out: wp.array(dtype=wp.float64), count_out: wp.array(dtype=int)):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        lo = rows.first[body] + lane
        hi = rows.first[body + 1]
        zero = wp.float64(0.0)
        gamma = zero + zero
        for i in range(lo, hi, wp.block_dim()):
            gamma += begin(i, A, f, v)
        gamma = block_sum(gamma)
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
            delta = block_sum(delta)
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
            gamma = block_sum(gamma)
            count += 1
        if lane == 0:
            drop_out[body] = drop
            count_out[body] = count_out[body] + count

    return wp.kernel(solve_body_pcg, name=f"pcg_{o.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)


@wp.struct
class Chunks:
    """Points of bodies by block, and what blocks tell each other; of two rows, one is read while the other is written."""

    body: wp.array(dtype=int)                    # of each chunk, (chunks,)
    first: wp.array(dtype=int)                   # its points: first[c] .. first[c + 1], (chunks + 1,)
    own: wp.array(dtype=int)                     # chunks of a body: own[b] .. own[b + 1], (bodies + 1,)
    gamma: wp.array2d(dtype=wp.float64)          # part of r.z, (2, chunks)
    delta: wp.array(dtype=wp.float64)            # part of z.w, (chunks,)
    last: wp.array2d(dtype=wp.vec4d)             # the last gamma and alpha, gamma to end at, iterations, (2, bodies)
    done: wp.array2d(dtype=int)                  # (2, bodies)
    going: wp.array(dtype=int)                   # not 0 while some body is not done, (1,)


@wp.func
def sum_chunk_parts(parts: wp.array(dtype=wp.float64), first: int, last: int, lane: int):
    """Sum of parts first .. last, by all threads of a block."""
    sum = wp.float64(0.0)
    for c in range(first + lane, last, wp.block_dim()):
        sum += parts[c]
    return block_sum(sum)


@cache
def pcg_chunk_kernels(real, module, springs: bool, elements: bool, coarse: bool = False) -> SimpleNamespace:
    """Kernels over chunks times a block of threads: `start`, then `multiply` and `advance` in turn until none is going.

    `advance` reads row `side` of `gamma`, `last` and `done` and writes the other.
    """
    s, o, Vectors, t = (newton_structs(real), pcg_point_functions(real, springs, elements, coarse), pcg_vectors(real),
                        types(real))
    product, begin, step = o.product, o.begin, o.step

    def start(c: Chunks, A: s.Matrix, f: wp.array(dtype=t.vec3), v: Vectors, drop_out: wp.array(dtype=wp.float64)):
        chunk = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        body = c.body[chunk]
        gamma = wp.float64(0.0)
        for i in range(c.first[chunk] + lane, c.first[chunk + 1], wp.block_dim()):
            gamma += begin(i, A, f, v)
        c.gamma[0, chunk] = block_sum(gamma)
        if chunk == c.own[body] and lane == 0:
            c.last[0, body] = wp.vec4d(wp.float64(1.0), wp.float64(1.0), wp.float64(-1.0), wp.float64(0.0))
            c.done[0, body] = 0
            c.going[0] = 1
            drop_out[body] = wp.float64(0.0)

    def multiply(c: Chunks, rows: s.Rows, A: s.Matrix, side: int, v: Vectors):
        chunk = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        if wp.tid() == 0:
            c.going[0] = 0
        if c.done[side, c.body[chunk]] != 0:
            return
        delta = wp.float64(0.0)
        for i in range(c.first[chunk] + lane, c.first[chunk + 1], wp.block_dim()):
            w = product(i, rows, A, v.z)
            v.w[i] = w
            delta += wp.float64(wp.dot(v.z[i], w))
        c.delta[chunk] = block_sum(delta)

    def advance(c: Chunks, A: s.Matrix, tolerance: wp.float64, cap: int, side: int, v: Vectors,
                drop_out: wp.array(dtype=wp.float64), count_out: wp.array(dtype=int)):
        chunk = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        body = c.body[chunk]
        first = chunk == c.own[body] and lane == 0
        if c.done[side, body] != 0:
            if first:
                c.done[1 - side, body] = 1
            return
        last = c.last[side, body]
        gamma = sum_chunk_parts(c.gamma[side], c.own[body], c.own[body + 1], lane)
        delta = sum_chunk_parts(c.delta, c.own[body], c.own[body + 1], lane)
        enough = last[2]
        beta = wp.float64(0.0)
        if enough < wp.float64(0.0):
            enough = tolerance * tolerance * gamma
        else:
            beta = gamma / last[0]
            delta -= beta * gamma / last[1]
        goes = gamma > enough and delta > wp.float64(0.0) and last[3] < wp.float64(cap)
        if not goes:
            if first:
                c.done[1 - side, body] = 1
            return
        alpha = gamma / delta
        rest = wp.float64(0.0)
        for i in range(c.first[chunk] + lane, c.first[chunk + 1], wp.block_dim()):
            rest += step(i, A, real(alpha), real(beta), v)
        c.gamma[1 - side, chunk] = block_sum(rest)
        if first:
            c.done[1 - side, body] = 0
            c.last[1 - side, body] = wp.vec4d(gamma, alpha, enough, last[3] + wp.float64(1.0))
            c.going[0] = 1
            drop_out[body] = drop_out[body] + alpha * gamma
            count_out[body] = count_out[body] + 1

    return SimpleNamespace(**{f.__name__: wp.kernel(
        f, name=f"pcg_{f.__name__}_{o.name}", module=module, enable_backward=False, grid_stride=False, launch_bounds=BLOCK)
        for f in (start, multiply, advance)})
