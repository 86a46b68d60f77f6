"""Dense blocks of 96 rows: W = D^(-1/2) L^-1 of A = L D L^T, so that W^T W = A^-1, and products with W and W^T.

    for every row k:   l_i = A_ki / A_kk for i > k,   row_i -= l_i row_k    of (A, I) side by side

A lies above the diagonal and W below, in one square: who eliminates A needs no more of what W takes (Gauss-Jordan in place;
Golub, Van Loan 2013, section 4.1.2). W^T W is symmetric and positive in any rounding, where an inverse is not. A pivot that is
less than `lost` times what its row began with is rounding: its row of W is zero, its direction is left out. At the end the
upper triangle has W^T, so that threads read both products one beside the other.

By a block of threads, or one thread of the CPU. In float32 the square is kept in the block's memory.
"""

from functools import cache

import warp as wp

SIDE = 96              # rows: 32 points, or 8 nodes of 12 affine motions
LOST = {wp.float32: 1e-5, wp.float64: 1e-12}

FACTOR = """
    typedef {real} T;
    constexpr int N = 96;
    T* out = (T*)W.data + (long long)block * N * N;
    T* diag = (T*)scratch.data + (long long)block * N;
#if defined(__CUDA_ARCH__)
    {room}
    for (int e = lane; e < n * N; e += lanes) a[e] = out[e];
    __syncthreads();
    for (int i = lane; i < n; i += lanes) diag[i] = a[i * N + i];
    __syncthreads();
    for (int k = 0; k < n; ++k) {{
        const T p = a[k * N + k], all = diag[k];
        const bool kept = p > T({lost}) * all;
        const T q = kept ? T(1) / p : T(0);
        for (int e = lane; e < (n - 1 - k) * N; e += lanes) {{
            const int i = k + 1 + e / N, j = e % N;
            const T l = a[k * N + i] * q;
            if (j == k) a[i * N + j] = -l;
            else if (j >= i || j < k) a[i * N + j] -= l * a[k * N + j];
        }}
        __syncthreads();
        const T s = kept ? T(1) / sqrt(p) : T(0);
        for (int j = lane; j <= k; j += lanes) a[k * N + j] = j == k ? s : (kept ? s * a[k * N + j] : T(0));
    }}
    __syncthreads();
    for (int e = lane; e < n * N; e += lanes) {{
        const int i = e / N, j = e % N;
        if (j < n) out[e] = j <= i ? a[i * N + j] : a[j * N + i];
    }}
#else
    T* a = out;
    for (int i = 0; i < n; ++i) diag[i] = a[i * N + i];
    for (int k = 0; k < n; ++k) {{
        T* row = a + k * N;
        const T p = row[k];
        if (!(p > T({lost}) * diag[k])) {{
            for (int j = 0; j <= k; ++j) row[j] = T(0);
            for (int i = k + 1; i < n; ++i) a[i * N + k] = T(0);
            continue;
        }}
        const T q = T(1) / p, s = T(1) / sqrt(p);
        for (int i = k + 1; i < n; ++i) {{
            const T l = row[i] * q;
            T* other = a + i * N;
            other[k] = -l;
            if (l == T(0)) continue;
            for (int j = 0; j < k; ++j) other[j] -= l * row[j];
            for (int j = i; j < n; ++j) other[j] -= l * row[j];
        }}
        for (int j = 0; j < k; ++j) row[j] *= s;
        row[k] = s;
    }}
    for (int i = 0; i < n; ++i)
        for (int j = i + 1; j < n; ++j) a[i * N + j] = a[j * N + i];
#endif
"""
BELOW = """
    typedef {real} T;
    constexpr int N = 96;
    const T* a = (const T*)W.data + (long long)block * N * N;
    const T* v = (const T*)m.data + at;
    T* u = (T*)out.data + at;
#if defined(__CUDA_ARCH__)
    T sum = T(0);
    if (row >= n) return;
    {cuda}
    u[row] = sum;
#else
    {cpu}
#endif
"""
# W v of row `row`, or of all rows; W^T v
PRODUCTS = {
    "lower": ("for (int j = 0; j <= row; ++j) sum += a[j * N + row] * v[j];",
              """for (int i = 0; i < n; ++i) {
        T s[8] = {0, 0, 0, 0, 0, 0, 0, 0};
        int j = 0;
        for (; j + 8 <= i + 1; j += 8)
            for (int k = 0; k < 8; ++k) s[k] += a[i * N + j + k] * v[j + k];
        for (; j <= i; ++j) s[0] += a[i * N + j] * v[j];
        u[i] = ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
    }"""),
    "upper": ("for (int i = row; i < n; ++i) sum += a[i * N + row] * v[i];",
              """for (int j = 0; j < n; ++j) u[j] = T(0);
    for (int i = 0; i < n; ++i) {
        const T f = v[i];
        for (int j = 0; j <= i; ++j) u[j] += f * a[i * N + j];
    }"""),
}
ROOM = {"float": "__shared__ T a[N * N];", "double": "T* a = out;"}


@cache
def dense_factor_function(real):
    """Function: block `block` of W, which holds the upper triangle of a symmetric positive A, becomes W and its transpose.
    n: its rows, 96 at most; scratch (96 blocks,). Every thread of a block must come, lane of lanes."""
    name = "float" if real is wp.float32 else "double"
    code = FACTOR.format(real=name, lost=LOST[real], room=ROOM[name])

    @wp.func_native(code)
    def factor_dense_block(W: wp.array(dtype=real), scratch: wp.array(dtype=real), block: int, n: int, lane: int,
                           lanes: int): ...

    return factor_dense_block


@cache
def dense_product_function(which: str, real):
    """Function: 96 entries of out, from `at`, become W m or W^T m of the same entries of m: on CUDA the one of `row`, on the
    CPU all n. which: lower or upper."""
    cuda, cpu = PRODUCTS[which]
    code = BELOW.format(real="float" if real is wp.float32 else "double", cuda=cuda, cpu=cpu)

    @wp.func_native(code)
    def triangular_product(W: wp.array(dtype=real), block: int, n: int, m: wp.array(dtype=real), at: int, row: int,
                           out: wp.array(dtype=real)): ...

    return triangular_product
