"""Odd-even (cyclic) reduction of the systems of strands (kernels/rods/system.py) by a block of threads. Heller 1976; Golub, Van
Loan, Matrix Computations, section 4.5.

Two points in a row are a node of 8 unknowns, so that a node knows its neighbours alone: D blocks of the diagonal, R between a
node and the next. With a stride of 1, 2, 4 .. nodes, every other node o is eliminated; l and r, beside it, become neighbours:

    D_o = L L^T,   Y_l = L^-1 R_l^T,   Y_r = L^-1 R_o,   D_l -= Y_l^T Y_l,   D_r -= Y_r^T Y_r,   R_l = -Y_l^T Y_r
    right sides    v_l -= A_l^T v_o,   v_r -= A_r^T v_o,         A_l = D_o^-1 R_l^T,   A_r = D_o^-1 R_o
    solution       z_o = D_o^-1 v_o - A_l z_l - A_r z_r

This is Cholesky's factorization with the nodes in another order: it needs no pivots, and its error is of the same size. It has
log2(nodes) steps where the elimination of kernels/rods/eliminate.py has one a point, and about twice its operations. Eight
threads share a node: one a row, or a column of what is factored. Strands of a block are solved side by side. On a CPU one
thread does all.
"""

import warp as wp

SIZE = 8                                 # unknowns of a node
SQUARE = wp.constant(SIZE * SIZE)
# Matrices of a node: D; R, and R of every other step; D^-1, A_l, A_r by columns; A_l, A_r by rows
OWN, NEXT, OTHER, INVERSE, LEFT, RIGHT, LEFT_ROWS, RIGHT_ROWS = range(8)
MATRICES = 8
NODES = 256                              # vectors of so many nodes stand in shared memory: 32 KiB

# Entry (r, c) of node J of strand k is ((c * all + J * m + k) * 8 + r): threads of rows read side by side.
_PLACES = """
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x, lanes = blockDim.x;
    #define TEAM_MEETS() __syncthreads()
#else
    const int lane = 0, lanes = 1;
    #define TEAM_MEETS()
#endif
    const int m = points.shape[0], all = nodes.shape[2] / 8;
    const size_t entries = (size_t)nodes.strides[0] / sizeof(double), column = (size_t)all * 8;
    double* const D = nodes.data;
    double *const inverse = D + 3 * entries, *const left = D + 4 * entries, *const right = D + 5 * entries;
    double *const left_rows = D + 6 * entries, *const right_rows = D + 7 * entries;
    const int* const number = points.data;
"""

_FACTOR = _PLACES + """
    double* R = D + entries;
    double* next = D + 2 * entries;
    for (int s = 1; s < 2 * most; s *= 2) {
        const bool root = s >= most;
        const int odds = root ? 1 : (most - 1 - s) / (2 * s) + 1;
        for (int t = lane; t < odds * count * 8; t += lanes) {
            const int c = t % 8, b = t / 8, k = first + b % count, o = root ? 0 : (2 * (b / count) + 1) * s;
            const int has = (number[k] + 1) / 2;
            if (o >= has) continue;
            const size_t place = (size_t)(o * m + k) * 8;
            double L[8][8], y[8], x[8];
            #pragma unroll
            for (int j = 0; j < 8; ++j)
                #pragma unroll
                for (int i = j; i < 8; ++i) L[i][j] = D[j * column + place + i];
            #pragma unroll
            for (int j = 0; j < 8; ++j) {
                double d = L[j][j];
                #pragma unroll
                for (int n = 0; n < j; ++n) d -= L[j][n] * L[j][n];
                L[j][j] = d > 0.0 ? 1.0 / sqrt(d) : 0.0;         // 0: a point without mass, held: nothing moves it
                #pragma unroll
                for (int i = j + 1; i < 8; ++i) {
                    double a = L[i][j];
                    #pragma unroll
                    for (int n = 0; n < j; ++n) a -= L[i][n] * L[j][n];
                    L[i][j] = a * L[j][j];
                }
            }
            for (int which = 0; which < (root ? 1 : 3); ++which) {       // columns of D^-1, A_l, A_r
                double* const Yl = R + (size_t)((o - s) * m + k) * 8 + c;
                double* const Yr = R + c * column + place;
                if (which == 2 && o + s >= has) break;
                #pragma unroll
                for (int i = 0; i < 8; ++i) y[i] = which == 0 ? (i == c ? 1.0 : 0.0) : which == 1 ? Yl[i * column] : Yr[i];
                #pragma unroll
                for (int i = 0; i < 8; ++i) {
                    #pragma unroll
                    for (int n = 0; n < i; ++n) y[i] -= L[i][n] * y[n];
                    y[i] *= L[i][i];
                }
                #pragma unroll
                for (int j = 7; j >= 0; --j) {
                    x[j] = y[j];
                    #pragma unroll
                    for (int n = j + 1; n < 8; ++n) x[j] -= L[n][j] * x[n];
                    x[j] *= L[j][j];
                }
                double* const into = (which == 0 ? inverse : which == 1 ? left : right) + c * column + place;
                double* const rows = (which == 1 ? left_rows : right_rows) + place + c;
                #pragma unroll
                for (int i = 0; i < 8; ++i) {
                    into[i] = x[i];
                    if (which > 0) rows[i * column] = x[i];
                    if (which == 1) Yl[i * column] = y[i];               // row c of R_l, which no other thread reads here
                    if (which == 2) Yr[i] = y[i];
                }
            }
        }
        TEAM_MEETS();
        const int evens = root ? 0 : (most - 1) / (2 * s) + 1;
        for (int t = lane; t < evens * count * 8; t += lanes) {
            const int r = t % 8, b = t / 8, k = first + b % count, J = 2 * (b / count) * s, has = (number[k] + 1) / 2;
            if (J >= has) continue;
            const size_t place = (size_t)(J * m + k) * 8;
            const size_t before = (size_t)((J - s) * m + k) * 8, behind = (size_t)((J + s) * m + k) * 8;
            double a[8];
            #pragma unroll
            for (int c = 0; c < 8; ++c) a[c] = D[c * column + place + r];
            if (J + s < has)
                for (int n = 0; n < 8; ++n) {
                    const double own = R[n * column + place + r];
                    #pragma unroll
                    for (int c = 0; c < 8; ++c) a[c] -= own * R[n * column + place + c];
                }
            if (J - s >= 0)
                for (int n = 0; n < 8; ++n) {
                    const double own = R[r * column + before + n];
                    #pragma unroll
                    for (int c = 0; c < 8; ++c) a[c] -= own * R[c * column + before + n];
                }
            #pragma unroll
            for (int c = 0; c < 8; ++c) D[c * column + place + r] = a[c];
            if (J + 2 * s < has) {
                #pragma unroll
                for (int c = 0; c < 8; ++c) a[c] = 0.0;
                for (int n = 0; n < 8; ++n) {
                    const double own = R[n * column + place + r];
                    #pragma unroll
                    for (int c = 0; c < 8; ++c) a[c] -= own * R[c * column + behind + n];
                }
                #pragma unroll
                for (int c = 0; c < 8; ++c) next[c * column + place + r] = a[c];
            }
        }
        TEAM_MEETS();
        double* const swap = R; R = next; next = swap;
    }
    #undef TEAM_MEETS
"""

_SOLVE = _PLACES + f"""
#if defined(__CUDA_ARCH__)
    __shared__ double room[2 * 8 * {NODES}];
    const bool small = most * count <= {NODES};
    double* const v = small ? room : work.data;
    double* const z = small ? room + 8 * {NODES} : work.data + 8 * (size_t)all;
    const int wide = small ? count : m, from = small ? first : 0;
#else
    double* const v = work.data;
    double* const z = v + 8 * (size_t)all;
    const int wide = m, from = 0;
#endif
    const double* const given = (const double*)r.data;
    double* const out = (double*)z_out.data;
""" + """
    auto vector = [=](int J, int k) { return (size_t)(J * wide + k - from) * 8; };
    auto entry = [=](int J, int k, int i) { return ((size_t)(2 * J + i / 4) * m + k) * 4 + i % 4; };
    auto product = [=](const double* A, const double* u, size_t row) {
        double a = 0.0, b = 0.0;
        #pragma unroll
        for (int c = 0; c < 4; ++c) {
            a += A[c * column + row] * u[c];
            b += A[(c + 4) * column + row] * u[c + 4];
        }
        return a + b;
    };
    for (int t = lane; t < most * count * 8; t += lanes) {
        const int i = t % 8, b = t / 8, k = first + b % count, J = b / count;
        if (J < (number[k] + 1) / 2) v[vector(J, k) + i] = 2 * J + i / 4 < number[k] ? given[entry(J, k, i)] : 0.0;
    }
    TEAM_MEETS();
    for (int s = 1; s < 2 * most; s *= 2) {                  // the last alone: the node that is left
        for (int t = lane; t < ((most - 1) / s + 1) * count * 8; t += lanes) {
            const int i = t % 8, b = t / 8, k = first + b % count, q = b / count, J = q * s, has = (number[k] + 1) / 2;
            if (J >= has) continue;
            const size_t row = (size_t)(J * m + k) * 8 + i, way = (size_t)s * m * 8;
            if (q % 2 == 1 || s >= most) {
                z[vector(J, k) + i] = product(inverse, v + vector(J, k), row);
            } else {
                double a = v[vector(J, k) + i];
                if (J - s >= 0) a -= product(right_rows, v + vector(J - s, k), row - way);
                if (J + s < has) a -= product(left_rows, v + vector(J + s, k), row + way);
                v[vector(J, k) + i] = a;
            }
        }
        TEAM_MEETS();
    }
    int s = 1;
    while (2 * s < most) s *= 2;
    for (; s >= 1; s /= 2) {
        const int odds = s < most ? (most - 1 - s) / (2 * s) + 1 : 0;
        for (int t = lane; t < odds * count * 8; t += lanes) {
            const int i = t % 8, b = t / 8, k = first + b % count, o = (2 * (b / count) + 1) * s, has = (number[k] + 1) / 2;
            if (o >= has) continue;
            const size_t row = (size_t)(o * m + k) * 8 + i;
            double a = z[vector(o, k) + i] - product(left, z + vector(o - s, k), row);
            if (o + s < has) a -= product(right, z + vector(o + s, k), row);
            z[vector(o, k) + i] = a;
        }
        TEAM_MEETS();
    }
    for (int t = lane; t < most * count * 8; t += lanes) {
        const int i = t % 8, b = t / 8, k = first + b % count, J = b / count;
        if (2 * J + i / 4 < number[k]) out[entry(J, k, i)] = z[vector(J, k) + i];
    }
    TEAM_MEETS();
    #undef TEAM_MEETS
"""


@wp.func_native(_FACTOR)
def factor(points: wp.array(dtype=int), nodes: wp.array3d(dtype=wp.float64), first: int, count: int, most: int):
    """Factors the systems of strands first .. first + count - 1, of `most` nodes at most, from D and R of `nodes`, (MATRICES,
    8, 8 times nodes of all strands). All threads of a block come, and meet at the end."""
    ...


@wp.func_native(_SOLVE)
def solve(points: wp.array(dtype=int), nodes: wp.array3d(dtype=wp.float64), work: wp.array(dtype=wp.float64),
          r: wp.array2d(dtype=wp.vec4d), z_out: wp.array2d(dtype=wp.vec4d), first: int, count: int, most: int):
    """Solves for the right-hand sides r, (points, strands), with what `factor` has left. work: room of 16 numbers a node. All
    threads of a block come, behind a meeting, and meet at the end."""
    ...
