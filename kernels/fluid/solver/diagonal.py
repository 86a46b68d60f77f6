"""The pressure of a box without obstacles, directly, by fast diagonalisation (Lynch, Rice, Thomas 1964): A is the sum of one
operator an axis, A = sum_a T_a, each with eigenvectors Q_a and eigenvalues l_a, so that

    A^-1 b = Q (Q^T b / (l_0 + l_1 + l_2)),    Q = Q_0 x Q_1 x Q_2:    a dense product along each axis, there and back

T_a is 2 -1, closed ends 1, open ends 3, or around: cosines, sines and waves are its eigenvectors. What is 0 in the sum, the
constant of a sealed box, is left out. Work: n^4 for n^3 cells.

Where both ends of an axis are alike T_a is its own mirror image: what is even about the middle and what is odd stay apart.
`fold_halves_kernel` makes of x the sums and differences of mirrored cells, (x_k + x_m) / sqrt 2 in place k and (x_k - x_m) /
sqrt 2 in place m = n - 1 - k, along all such axes at once; it is its own inverse. There Q has two blocks, and a product half of
the work.

A product goes by tiles of 64 x 64 numbers, each by a block of 128 threads on CUDA, which keeps 64 x 16 numbers of both factors
in shared memory, and 4 x 8 sums in each thread; on the CPU by one thread.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import grid_functions
from wsim.kernels.math.real import types

SIDE = 64                                 # of a tile

PRODUCT = """
    typedef TYPE R;
    const int M = size[0], N = size[1], K = size[2], batch = at[0], m0 = at[1], j0 = at[2], deep = at[3];
    const int me = LEFT ? span[0] : M, je = LEFT ? N : span[0], kb = span[2];
    const R* a = first.data + (LEFT ? 0 : batch * M * K);
    const R* b = second.data + (LEFT ? batch * K * N : 0);
    R* y = out.data + batch * M * N;
    const R* l = values.data + (deep ? M / deep + deep : M);
    auto row = [&](int m) -> R {
        if (LEFT || !values.data || m >= me) return (R)0;
        return deep ? values.data[m / deep] + values.data[M / deep + m % deep] : values.data[m];
    };
    auto over = [&](R v, R own, int n) -> R {
        if (LEFT || !values.data) return v;
        const R all = own + l[n];
        return all > least ? v / all : (R)0;
    };
#if defined(__CUDA_ARCH__)
    __shared__ __align__(16) R A[16][68];
    __shared__ __align__(16) R B[16][64];
    const int t = threadIdx.x, x = t & 7, z = t >> 3;
    R sum[4][8];
    #pragma unroll
    for (int i = 0; i < 4; ++i)
        #pragma unroll
        for (int j = 0; j < 8; ++j) sum[i][j] = 0;
    for (int k0 = span[1]; k0 < kb; k0 += 16) {
        #pragma unroll
        for (int e = 0; e < 8; ++e) {
            const int s = t + 128 * e, m = LEFT ? s & 63 : s >> 4, k = LEFT ? s >> 6 : s & 15, j = s & 63, l = s >> 6;
            const int mm = m0 + m, kk = k0 + k;
            A[k][m] = mm < me && kk < kb ? (LEFT ? a[kk * M + mm] : a[mm * K + kk]) : (R)0;
            B[l][j] = k0 + l < kb && j0 + j < je ? b[(k0 + l) * N + j0 + j] : (R)0;
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
    for (int i = 0; i < 4; ++i) {
        const int m = m0 + 4 * z + i;
        const R own = row(m);
        #pragma unroll
        for (int j = 0; j < 8; ++j) {
            const int n = j0 + 4 * x + (j & 3) + 8 * (j & 4);
            if (m < me && n < je) y[m * N + n] = over(sum[i][j], own, n);
        }
    }
#else
    const int rows = me - m0 < 64 ? me - m0 : 64, columns = je - j0 < 64 ? je - j0 : 64;
    for (int i = 0; i < rows; i += 4) {
        R sum[4][64] = {};
        for (int k = span[1]; k < kb; ++k) {
            const R* c = b + k * N + j0;
            for (int e = 0; e < 4; ++e) {
                const int m = i + e < rows ? m0 + i + e : m0 + i;
                const R v = LEFT ? a[k * M + m] : a[m * K + k];
                for (int h = 0; h < columns; h += 32) {
                    if (columns - h >= 32) for (int j = h; j < h + 32; ++j) sum[e][j] += v * c[j];
                    else for (int j = h; j < columns; ++j) sum[e][j] += v * c[j];
                }
            }
        }
        for (int e = 0; e < 4 && i + e < rows; ++e) {
            const int m = m0 + i + e;
            const R own = row(m);
            for (int j = 0; j < columns; ++j) y[m * N + j0 + j] = over(sum[e][j], own, j0 + j);
        }
    }
#endif
"""
FOLD = """
    typedef TYPE R;
    const int first = (i[0] * n[1] + i[1]) * n[2] + i[2], steps[3] = {n[1] * n[2], n[2], 1};
    int off[3], used = 0;
    R v[8];
    #pragma unroll
    for (int a = 0; a < 3; ++a) {
        off[a] = (n[a] - 1 - 2 * i[a]) * steps[a];
        used |= (folded[a] && off[a] != 0) << a;
    }
    #define AT(m) first + ((m) & 1 ? off[0] : 0) + ((m) & 2 ? off[1] : 0) + ((m) & 4 ? off[2] : 0)
    #pragma unroll
    for (int m = 0; m < 8; ++m) v[m] = m & ~used ? (R)0 : x.data[AT(m)];
    #pragma unroll
    for (int bit = 1; bit < 8; bit *= 2)
        #pragma unroll
        for (int m = 0; m < 8; ++m)
            if (!(m & bit) && used & bit) {
                const R sum = v[m] + v[m + bit], less = v[m] - v[m + bit];
                v[m] = (R)0.70710678118654752 * sum;
                v[m + bit] = (R)0.70710678118654752 * less;
            }
    #pragma unroll
    for (int m = 0; m < 8; ++m) if (!(m & ~used)) out.data[AT(m)] = v[m];
    #undef AT
"""


@cache
def product_tile_function(left: bool, real):
    """Function (first, second, size, at, span, values, least, out): one tile of a product, from place `at` (batch, row, column;
    deep) up to the row (left) or column span[0], summed over span[1] .. span[2]. Not left: over the sum of the eigenvalues,
    where there are some: `values` of all axes, one axis behind the other; deep: cells of the middle one, 0: there is none."""
    kind = "float" if real is wp.float32 else "double"

    @wp.func_native(PRODUCT.replace("TYPE", kind).replace("LEFT", str(int(left))))
    def native_product_tile(first: wp.array(dtype=real), second: wp.array(dtype=real), size: wp.vec3i, at: wp.vec4i,
                            span: wp.vec3i, values: wp.array(dtype=real), least: real, out: wp.array(dtype=real)):
        ...

    return native_product_tile


@cache
def axis_product_kernel(last: bool, real, module):
    """Kernel over blocks of threads, one for each tile (batch, rows, columns) of y_out (batch, M, N), size (M, N, K).
    last: y = x[b] Q, with x (batch, M, K) and Q (K, N), along the last axis of x; else y = Q^T x[b], with Q (K, M) and x
    (batch, K, N). Q: blocks of `even` rows and columns, and of the others. values: those that y is divided by; none: it is not;
    y is 0 where they sum to less than `least`."""
    of = product_tile_function(not last, real)

    @wp.func
    def product_tile_span(part: int, even: int, n: int):
        """(first place, its end, first of the sum, its end) of a tile along the axis."""
        many = (even + SIDE - 1) // SIDE
        found = wp.vec4i(part * SIDE, even, 0, even)
        if part >= many:
            found = wp.vec4i(even + (part - many) * SIDE, n, even, n)
        return found

    def multiply_along_axis(Q: wp.array(dtype=real), x: wp.array(dtype=real), size: wp.vec3i, even: int,
                            values: wp.array(dtype=real), deep: int, least: real, y_out: wp.array(dtype=real)):
        c = wp.tid() // wp.block_dim()
        n = size[2]
        own = (even + SIDE - 1) // SIDE + (n - even + SIDE - 1) // SIDE
        across = (size[wp.static(0 if last else 1)] + SIDE - 1) // SIDE
        batch = c // (own * across)
        c = c - batch * own * across
        if wp.static(last):
            s = product_tile_span(c % own, even, n)
            of(x, Q, size, wp.vec4i(batch, c // own * SIDE, s[0], deep), wp.vec3i(s[1], s[2], s[3]), values, least, y_out)
        else:
            s = product_tile_span(c // across, even, n)
            of(Q, x, size, wp.vec4i(batch, s[0], c % across * SIDE, deep), wp.vec3i(s[1], s[2], s[3]), values, least, y_out)

    return wp.kernel(multiply_along_axis, name=f"diagonal_{'last' if last else 'along'}_{types(real).name}", module=module,
                     enable_backward=False, grid_stride=False)


@cache
def fold_halves_kernel(dim: int, real, module):
    """Kernel over the cells of a corner, of shape `some`, half of the axes that are `folded` (1; else 0): x_out of x, which may
    be the same array."""
    f, kind = grid_functions(dim, real), "float" if real is wp.float32 else "double"

    @wp.func_native(FOLD.replace("TYPE", kind))
    def native_butterflies(i: wp.vec3i, n: wp.vec3i, folded: wp.vec3i, x: wp.array(dtype=real), out: wp.array(dtype=real)):
        ...

    def fold_even_odd(n: wp.vec3i, some: wp.vec3i, folded: wp.vec3i, x: wp.array(dtype=real), x_out: wp.array(dtype=real)):
        native_butterflies(f.place(wp.tid(), some), n, folded, x, x_out)

    return wp.kernel(fold_even_odd, name=f"diagonal_fold_{f.name}", module=module, enable_backward=False)
