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
NODES = 128                              # vectors of so many nodes stand in shared memory: 16 KiB, beside those of rounds.py

# Entry (r, c) of node J of strand k is c * column + (J * m + k) * 8 + r: threads of rows read side by side.
PLACES = """
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x, lanes = blockDim.x;
    #define TEAM_MEETS() __syncthreads()
    #define RECIPROCAL_ROOT(a) rsqrt(a)
#else
    const int lane = 0, lanes = 1;
    #define TEAM_MEETS()
    #define RECIPROCAL_ROOT(a) (1.0 / sqrt(a))
#endif
    const int m = points.shape[0], column = nodes.shape[2];
    const size_t entries = (size_t)nodes.strides[0] / sizeof(double);
    double* const D = nodes.data;
    double *const inverse = D + 3 * entries, *const left = D + 4 * entries, *const right = D + 5 * entries;
    double *const left_rows = D + 6 * entries, *const right_rows = D + 7 * entries;
    const int* const number = points.data;
    auto strand_of = [=](int b, int& q) {                        // of b = q * count + strand; most often there is one
        q = count == 1 ? b : b / count;
        return first + b - q * count;
    };
"""

_FACTOR = PLACES + """
    double* R = D + entries;
    double* next = D + 2 * entries;
    for (int s = 1; s < 2 * most; s *= 2) {
        const bool root = s >= most;
        const int odds = root ? 1 : (most - 1 - s) / (2 * s) + 1;
        const int all = odds * count * 8, ways = !root && 3 * all <= lanes ? 3 : 1;      // D^-1, A_l, A_r side by side
        #pragma unroll 1
        for (int task = lane; task < all * ways; task += lanes) {
            int q;
            const int way = task / all, t = task - way * all;
            const int c = t & 7, k = strand_of(t >> 3, q), o = root ? 0 : (2 * q + 1) * s, has = (number[k] + 1) / 2;
            if (o >= has) continue;
            const int place = (o * m + k) * 8;
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
                L[j][j] = d > 0.0 ? RECIPROCAL_ROOT(d) : 0.0;    // 0: a point without mass, held: nothing moves it
                #pragma unroll
                for (int i = j + 1; i < 8; ++i) {
                    double a = L[i][j];
                    #pragma unroll
                    for (int n = 0; n < j; ++n) a -= L[i][n] * L[j][n];
                    L[i][j] = a * L[j][j];
                }
            }
            #pragma unroll 1
            for (int which = way; which < (root ? 1 : 3); which += ways) {
                double* const Yl = R + (root ? 0 : ((o - s) * m + k) * 8 + c);
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
        #pragma unroll 1
        for (int t = lane; t < evens * count * 8; t += lanes) {
            int q;
            const int r = t & 7, k = strand_of(t >> 3, q), J = 2 * q * s, has = (number[k] + 1) / 2;
            if (J >= has) continue;
            const int place = (J * m + k) * 8, before = ((J - s) * m + k) * 8, behind = ((J + s) * m + k) * 8;
            double a[8];
            #pragma unroll
            for (int c = 0; c < 8; ++c) a[c] = D[c * column + place + r];
            if (J + s < has)
                #pragma unroll 4
                for (int n = 0; n < 8; ++n) {
                    const double own = R[n * column + place + r];
                    #pragma unroll
                    for (int c = 0; c < 8; ++c) a[c] -= own * R[n * column + place + c];
                }
            if (J - s >= 0)
                #pragma unroll 4
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
                #pragma unroll 4
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
    #undef RECIPROCAL_ROOT
"""

PRODUCT = """
    auto vector = [=](int J, int k) { return (J * wide + k - from) * 8; };
    auto product = [=](const double* A, const double* u, int row) {
        double a[4];
        #pragma unroll
        for (int c = 0; c < 4; ++c) a[c] = A[c * column + row] * u[c];
        #pragma unroll
        for (int c = 0; c < 4; ++c) a[c] += A[(c + 4) * column + row] * u[c + 4];
        return (a[0] + a[1]) + (a[2] + a[3]);
    };
"""

# Eliminates nodes of v, and solves for z.
LEVELS = """
    #pragma unroll 1
    for (int s = 1; s < 2 * most; s *= 2) {                  // the last alone: the node that is left
        #pragma unroll 1
        for (int t = lane; t < ((most - 1) / s + 1) * count * 8; t += lanes) {
            int q;
            const int i = t & 7, k = strand_of(t >> 3, q), J = q * s, has = (number[k] + 1) / 2;
            if (J >= has) continue;
            const int row = (J * m + k) * 8 + i, way = s * m * 8, at = vector(J, k), step = s * wide * 8;
            if (q % 2 == 1 || s >= most) {
                z[at + i] = product(inverse, v + at, row);
            } else {
                double a = v[at + i];
                if (J + s < has) a -= product(left_rows, v + at + step, row + way);
                if (J >= s) a -= product(right_rows, v + at - step, row - way);
                v[at + i] = a;
            }
        }
        TEAM_MEETS();
    }
    int s = 1;
    while (2 * s < most) s *= 2;
    #pragma unroll 1
    for (; s >= 1; s /= 2) {
        const int odds = s < most ? (most - 1 - s) / (2 * s) + 1 : 0;
        #pragma unroll 1
        for (int t = lane; t < odds * count * 8; t += lanes) {
            int q;
            const int i = t & 7, k = strand_of(t >> 3, q), o = (2 * q + 1) * s, has = (number[k] + 1) / 2;
            if (o >= has) continue;
            const int row = (o * m + k) * 8 + i, at = vector(o, k), step = s * wide * 8;
            double a = z[at + i] - product(left, z + at - step, row);
            if (o + s < has) a -= product(right, z + at + step, row);
            z[at + i] = a;
        }
        TEAM_MEETS();
    }
"""

# From r through all levels to z, with vectors at v and z.
_ALL = PRODUCT + """    #pragma unroll 1
    for (int t = lane; t < 2 * most * count; t += lanes) {       // a point a thread
        int i;
        const int k = strand_of(t, i), has = number[k];
        if (i >= 2 * ((has + 1) / 2)) continue;
        double* const to = v + vector(i / 2, k) + 4 * (i % 2);
        #pragma unroll
        for (int c = 0; c < 4; ++c) to[c] = i < has ? given[4 * (i * m + k) + c] : 0.0;
    }
    TEAM_MEETS();
""" + LEVELS + """    #pragma unroll 1
    for (int t = lane; t < 2 * most * count; t += lanes) {
        int i;
        const int k = strand_of(t, i);
        if (i >= number[k]) continue;
        const double* const of = z + vector(i / 2, k) + 4 * (i % 2);
        #pragma unroll
        for (int c = 0; c < 4; ++c) out[4 * (i * m + k) + c] = of[c];
    }
"""

# Shared memory is named as it is, and not as one of two: the compiler then knows where loads go.
_SOLVE = PLACES + f"""
    const double* const given = (const double*)r.data;
    double* const out = (double*)z_out.data;
#if defined(__CUDA_ARCH__)
    if (most * count <= {NODES}) {{
        __shared__ double room[2 * 8 * {NODES}];
        double *const v = room, *const z = room + 8 * {NODES};
        const int wide = count, from = first;
""" + _ALL + """
    } else
#endif
    {
        double *const v = work.data, *const z = v + column;
        const int wide = m, from = 0;
""" + _ALL + """
    }
    TEAM_MEETS();
    #undef TEAM_MEETS
    #undef RECIPROCAL_ROOT
"""


@wp.func_native(_FACTOR)
def factor_cyclic_reduction(points: wp.array(dtype=int), nodes: wp.array3d(dtype=wp.float64), first: int, count: int,
                            most: int):
    """Factors the systems of strands first .. first + count - 1, of `most` nodes at most, from D and R of `nodes`, (MATRICES,
    8, 8 times nodes of all strands). All threads of a block come, and meet at the end."""
    ...


@wp.func_native(_SOLVE)
def solve_cyclic_reduction(points: wp.array(dtype=int), nodes: wp.array3d(dtype=wp.float64), work: wp.array(dtype=wp.float64),
                           r: wp.array2d(dtype=wp.vec4d), z_out: wp.array2d(dtype=wp.vec4d), first: int, count: int, most: int):
    """Solves for the right-hand sides r, (points, strands), with what `factor_cyclic_reduction` has left. work: room of 16
    numbers a node. All threads of a block come, behind a meeting, and meet at the end."""
    ...
