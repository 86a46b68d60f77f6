"""The pressure of a box without obstacles, directly, by fast diagonalisation (Lynch, Rice, Thomas 1964): A is the sum of one
operator an axis, A = sum_a T_a, each with eigenvectors Q_a and eigenvalues l_a, so that

    A^-1 b = Q (Q^T b / (l_0 + l_1 + l_2)),    Q = Q_0 x Q_1 x Q_2:    a dense product along each axis, there and back

T_a is 2 -1, closed ends 1, open ends 3, or around: cosines, sines and waves are its eigenvectors. What is 0 in the sum, the
constant of a sealed box, is left out. Work: n^4 for n^3 cells.

A product goes by tiles of 64 x 64 numbers, each by a block of 128 threads on CUDA, which keeps 64 x 16 numbers of both factors
in shared memory, and 4 x 8 sums in each thread; on the CPU by one thread.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import functions
from wsim.kernels.math.real import types

SIDE = 64                                 # of a tile

PRODUCT = """
    typedef TYPE R;
    const int M = size[0], N = size[1], K = size[2], batch = at[0];
    const int m0 = at[1] * 64, j0 = at[2] * 64;
    const R* a = first.data + (LEFT ? 0 : batch * M * K);
    const R* b = second.data + (LEFT ? batch * K * N : 0);
    R* y = out.data + batch * M * N;
#if defined(__CUDA_ARCH__)
    __shared__ __align__(16) R A[16][68];
    __shared__ __align__(16) R B[16][64];
    const int t = threadIdx.x, x = t & 7, z = t >> 3;
    R sum[4][8];
    #pragma unroll
    for (int i = 0; i < 4; ++i)
        #pragma unroll
        for (int j = 0; j < 8; ++j) sum[i][j] = 0;
    for (int k0 = 0; k0 < K; k0 += 16) {
        #pragma unroll
        for (int e = 0; e < 8; ++e) {
            const int s = t + 128 * e, m = LEFT ? s & 63 : s >> 4, k = LEFT ? s >> 6 : s & 15, j = s & 63, l = s >> 6;
            const int mm = m0 + m, kk = k0 + k;
            A[k][m] = mm < M && kk < K ? (LEFT ? a[kk * M + mm] : a[mm * K + kk]) : (R)0;
            B[l][j] = k0 + l < K && j0 + j < N ? b[(k0 + l) * N + j0 + j] : (R)0;
        }
        __syncthreads();
        #pragma unroll
        for (int k = 0; k < 16; ++k) {
            R p[4], q[8];
            #pragma unroll
            for (int i = 0; i < 4; ++i) { p[i] = A[k][4 * z + i]; q[i] = B[k][4 * x + i]; q[i + 4] = B[k][32 + 4 * x + i]; }
            #pragma unroll
            for (int i = 0; i < 4; ++i)
                #pragma unroll
                for (int j = 0; j < 8; ++j) sum[i][j] += p[i] * q[j];
        }
        __syncthreads();
    }
    #pragma unroll
    for (int i = 0; i < 4; ++i)
        #pragma unroll
        for (int j = 0; j < 8; ++j) {
            const int m = m0 + 4 * z + i, n = j0 + 4 * x + (j & 3) + 8 * (j & 4);
            if (m < M && n < N) y[m * N + n] = sum[i][j];
        }
#else
    const int rows = M - m0 < 64 ? M - m0 : 64, columns = N - j0 < 64 ? N - j0 : 64;
    for (int i = 0; i < rows; i += 4) {
        R sum[4][64] = {};
        for (int k = 0; k < K; ++k) {
            const R* c = b + k * N + j0;
            for (int e = 0; e < 4; ++e) {
                const int m = i + e < rows ? m0 + i + e : m0 + i;
                const R v = LEFT ? a[k * M + m] : a[m * K + k];
                if (columns == 64) for (int j = 0; j < 64; ++j) sum[e][j] += v * c[j];
                else for (int j = 0; j < columns; ++j) sum[e][j] += v * c[j];
            }
        }
        for (int e = 0; e < 4 && i + e < rows; ++e)
            for (int j = 0; j < columns; ++j) y[(m0 + i + e) * N + j0 + j] = sum[e][j];
    }
#endif
"""


@cache
def product(last: bool, real, module):
    """Kernel over blocks of threads, one for each tile (batch, rows, columns) of y_out (batch, M, N), size (M, N, K).
    last: y = x[b] Q, with x (batch, M, K) and Q (K, N), along the last axis of x; else y = Q^T x[b], with Q (K, M) and x
    (batch, K, N)."""
    t = types(real)
    kind = "float" if real is wp.float32 else "double"

    @wp.func_native(PRODUCT.replace("TYPE", kind).replace("LEFT", str(int(not last))))
    def tile(first: wp.array(dtype=real), second: wp.array(dtype=real), size: wp.vec3i, at: wp.vec3i,
             out: wp.array(dtype=real)):
        ...

    def product(Q: wp.array(dtype=real), x: wp.array(dtype=real), size: wp.vec3i, y_out: wp.array(dtype=real)):
        c = wp.tid() // wp.block_dim()
        rows = (size[0] + SIDE - 1) // SIDE
        columns = (size[1] + SIDE - 1) // SIDE
        batch = c // (rows * columns)
        c = c - batch * rows * columns
        at = wp.vec3i(batch, c // columns, c - c // columns * columns)
        if wp.static(last):
            tile(x, Q, size, at, y_out)
        else:
            tile(Q, x, size, at, y_out)

    return wp.kernel(product, name=f"diagonal_{'last' if last else 'along'}_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def divide(dim: int, real, module):
    """Kernel over cells: y over the sum of the eigenvalues of each axis, which stand one behind the other; 0 where that is
    below `least`."""
    f = functions(dim, real)

    def divide(n: wp.vec3i, values: wp.array(dtype=real), least: real, y_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, n)
        sum = values[i[0]] + values[n[0] + i[1]]
        if wp.static(dim == 3):
            sum += values[n[0] + n[1] + i[2]]
        y_out[c] = wp.where(sum > least, y_out[c] / sum, real(0.0))

    return wp.kernel(divide, name=f"diagonal_divide_{f.name}", module=module, enable_backward=False)
