"""Conjugate gradients (kernels/rods/coupled_newton/conjugate.py, without rigid bodies) in the motions of pairs that press: a
few.

    U       (unknowns, 6 pairs): weights by which a pair's two edges move, three directions each;   A = M + U C U^T
    C       swaps the edges of a pair, and has its stiffness K

Residuals and directions are combinations of few vectors, so that a round needs no solve of strands:

    r = a r_0 + U s,   z = M^-1 r = a z_0 + M^-1 U s,   c = U^T z = a c_0 + W s,   W = U^T M^-1 U,   c_0 = U^T z_0
    r.z = a^2 r_0.z_0 + s.(a c_0 + c);   of a direction p = (a_p, s_p), c_p:   A p = a_p r_0 + U (s_p + C c_p)

and the correction is x = a_x z_0 + M^-1 U s_x, one solve at the end. The rounds are those of conjugate.py but for rounding.

W comes of the factors (kernels/rods/coupled_newton/reduction.py). A column of U stands at an edge, one node or two beside each
other, and still does when every other node is eliminated. So in each step it is eliminated at one node o at most:

    W_ij = sum over steps where both have the same o of  v_i . D_o^-1 v_j          v: what is left of the column at o

Eight threads share a column, and a thread has 9 entries of W. On 135 points a round of all points takes 8 us (H200), and there
are up to 35; one in the motions of 9 pairs takes 2.
"""

import warp as wp

from wsim.kernels.rods.coupled_newton.conjugate import GAIN, ROUNDS
from wsim.kernels.rods.coupled_newton.coupled import CoupledRods
from wsim.kernels.rods.coupled_newton.nodes import RodTeam
from wsim.kernels.rods.coupled_newton.pressing import list_pressing_pairs
from wsim.kernels.rods.coupled_newton.reduction import PLACES, solve_cyclic_reduction
from wsim.kernels.rods.coupled_newton.warps import BLOCK_SUM
from wsim.kernels.rods.tables import EdgePairs, RodTable, RodTrial

PAIRS = 32               # of a world that press, at most
COLUMNS = 6 * PAIRS

_COLUMNS = """
    // Eight threads a column, a row of its nodes each; on a CPU one has all.
#if defined(__CUDA_ARCH__)
    const int ROWS = 1, row_0 = lane & 7, team = lane >> 3, teams = lanes >> 3;
    auto gather = [=](const double* own, double* all) {
        #pragma unroll
        for (int c = 0; c < 8; ++c) all[c] = __shfl_sync(0xffffffffu, own[0], c, 8);
    };
#else
    const int ROWS = 8, row_0 = 0, team = 0, teams = 1;
    auto gather = [=](const double* own, double* all) { for (int c = 0; c < 8; ++c) all[c] = own[c]; };
#endif
    #pragma unroll 1
    for (int turn_of = 0; turn_of < n; turn_of += teams) {
        const bool alive = turn_of + team < n;                   // all threads of a warp come to `gather`
        const int e = alive ? turn_of + team : 0, pair = chosen[e / 6], side = 2 * ((e / 3) % 2), d = e % 3;
        const int p = A.ids.data[pair][side], p1 = A.ids.data[pair][side + 1];
        const int i = p / m, k = p - i * m, has = (number[k] + 1) / 2;
        const double b = S.hold.data[p] < 0 ? A.b.data[pair][side] : 0.0;
        const double b1 = S.hold.data[p1] < 0 ? A.b.data[pair][side + 1] : 0.0;
        const bool within = i % 2 == 0;                          // both points are of one node
        double own[ROWS], next[ROWS], mine[ROWS], v[8];          // rows of nodes j and j + s
        #pragma unroll
        for (int y = 0; y < ROWS; ++y) {
            const int row = row_0 + y;
            own[y] = row == (within ? d : 4 + d) ? b : within && row == 4 + d ? b1 : 0.0;
            next[y] = !within && row == d ? b1 : 0.0;
        }
        int j = i / 2;
        bool alone = within;                                     // there is nothing at j + s
        #pragma unroll 1
        for (int s = 1, level = 0; level < steps; s *= 2, ++level) {
            const bool root = s >= most, odd = root || (j / s) % 2 == 1, some = odd || !alone;
            const int o = odd ? j : j + s, place = (o * m + k) * 8;
            #pragma unroll
            for (int y = 0; y < ROWS; ++y) mine[y] = odd ? own[y] : next[y];
            gather(mine, v);
            if (alive && row_0 == 0) where[level * room + e] = some ? o * m + k : -1;
            if (!some) continue;
            const bool right_too = !root && o + s < has;
            #pragma unroll
            for (int y = 0; y < ROWS; ++y) {
                const int row = row_0 + y;
                double u = 0.0, l = 0.0, r = 0.0;
                #pragma unroll
                for (int c = 0; c < 8; ++c) {
                    u += inverse[place + c * column + row] * v[c];
                    if (!root) l += left_rows[place + c * column + row] * v[c];
                    if (right_too) r += right_rows[place + c * column + row] * v[c];
                }
                if (alive) {
                    path[(16 * level + row) * room + e] = mine[y];
                    path[(16 * level + 8 + row) * room + e] = u;
                }
                own[y] = (odd ? 0.0 : own[y]) - l;               // of node o - s
                next[y] = (odd ? next[y] : 0.0) - r;             // and of o + s
            }
            alone = !right_too;
            if (odd && !root) j -= s;
        }
    }
"""

# Blocks of W of two edges, in the order of a triangle whose first and last row, second and last but one ... are one row.
_COMPLIANCE = """
    const int edges = 2 * pairs;
    #pragma unroll 1
    for (int t = lane; t < pairs * (edges + 1); t += lanes) {
        const int row = t / (edges + 1), b = t - row * (edges + 1), across = edges - row;
        const int g = b < across ? row : edges - 1 - row, f = b < across ? row + b : g + b - across;
        double a[3][3] = {};
        #pragma unroll 1
        for (int l = 0; l < steps; ++l) {
            const int o = where[l * room + 3 * g];
            if (o < 0 || o != where[l * room + 3 * f]) continue;
            #pragma unroll
            for (int c = 0; c < 8; ++c)
                #pragma unroll
                for (int x = 0; x < 3; ++x)
                    #pragma unroll
                    for (int y = 0; y < 3; ++y)
                        a[x][y] += path[(16 * l + 8 + c) * room + 3 * g + x] * path[(16 * l + c) * room + 3 * f + y];
        }
        #pragma unroll
        for (int x = 0; x < 3; ++x)
            #pragma unroll
            for (int y = 0; y < 3; ++y)
                W[(3 * g + x) * room + 3 * f + y] = W[(3 * f + y) * room + 3 * g + x] = a[x][y];
    }
"""

_REDUCED = """
    const auto& points = S.points;
    const auto& nodes = A.nodes;
    const int first = at[0], count = at[1], most = at[2], world = at[3];
""" + PLACES + f"""
    const int n = 6 * pairs, room = {COLUMNS};
    const double gain = {float(GAIN.val if hasattr(GAIN, "val") else GAIN)!r}, rho0 = rho;
    const int rounds_at_most = {int(ROUNDS)};
#if defined(__CUDA_ARCH__)
    const int EACH = 1, warps = lanes / 32;
    __shared__ double shared_s[{COLUMNS}], shared_c[{COLUMNS}], part[2][32];
    int turn = 0;
#else
    const int EACH = {COLUMNS};
    double shared_s[{COLUMNS}], shared_c[{COLUMNS}];
#endif
""" + BLOCK_SUM + """    int steps = 1;
    while ((1 << (steps - 1)) < most) ++steps;
    const int* const chosen = A.chosen.data + world * (room / 6);
    const size_t levels = A.where.shape[1];
    int* const where = A.where.data + world * levels * room;
    double* const path = A.path.data + world * levels * 16 * room;
    double* const W = A.compliance.data + (size_t)world * room * room;
    TEAM_MEETS();
""" + _COLUMNS + """
    TEAM_MEETS();
""" + _COMPLIANCE + """
    double s[EACH], s_p[EACH], s_x[EACH], c[EACH], c_0[EACH], c_p[EACH], g[EACH];
    #pragma unroll
    for (int y = 0; y < EACH; ++y) {
        const int e = lane + y * lanes;
        s[y] = s_p[y] = s_x[y] = c_0[y] = 0.0;
        if (e < n) {
            const int pair = chosen[e / 6], side = 2 * ((e / 3) % 2), d = e % 3;
            for (int h = side; h < side + 2; ++h) {
                const int p = A.ids.data[pair][h];
                if (S.hold.data[p] < 0) c_0[y] += A.b.data[pair][h] * G.p.data[p][d];
            }
        }
        c[y] = c_p[y] = c_0[y];
    }
    double a = 1.0, a_p = 1.0, a_x = 0.0;
    int rounds = 0;
    const double least = gain * rho;
    TEAM_MEETS();
    for (bool turning = true; turning; ) {
        for (int y = 0; y < EACH; ++y)
            if (lane + y * lanes < n) shared_c[lane + y * lanes] = c_p[y];
        TEAM_MEETS();
        double total = 0.0;
        for (int y = 0; y < EACH; ++y) {
            const int e = lane + y * lanes;
            g[y] = 0.0;
            if (e >= n) continue;
            const int other = (e / 6) * 6 + ((e / 3) % 2 == 0 ? 3 : 0);
            const auto& K = P.K.data[chosen[e / 6]];
            for (int d = 0; d < 3; ++d) g[y] += K.data[e % 3][d] * shared_c[other + d];
            total += s_p[y] * (a_p * c_0[y] + c_p[y]) + c_p[y] * g[y];
        }
        total = sum(total) + a_p * a_p * rho0;
        const double alpha = total > 0.0 ? rho / total : 0.0;
        a_x += alpha * a_p;
        a -= alpha * a_p;
        for (int y = 0; y < EACH; ++y) {
            s_x[y] += alpha * s_p[y];
            s[y] -= alpha * (s_p[y] + g[y]);
            if (lane + y * lanes < n) shared_s[lane + y * lanes] = s[y];
        }
        TEAM_MEETS();
        total = 0.0;
        for (int y = 0; y < EACH; ++y) {
            const int e = lane + y * lanes;
            if (e >= n) continue;
            double six[6] = {a * c_0[y], 0.0, 0.0, 0.0, 0.0, 0.0};
            #pragma unroll 2
            for (int f = 0; f < n; f += 6)
                #pragma unroll
                for (int x = 0; x < 6; ++x) six[x] += W[(f + x) * room + e] * shared_s[f + x];
            c[y] = ((six[0] + six[1]) + (six[2] + six[3])) + (six[4] + six[5]);
            total += s[y] * (a * c_0[y] + c[y]);
        }
        total = sum(total) + a * a * rho0;
        const double beta = total / rho;
        rho = total;
        ++rounds;
        turning = rho > least && rounds < rounds_at_most && alpha != 0.0;
        a_p = a + beta * a_p;
        for (int y = 0; y < EACH; ++y) {
            s_p[y] = s[y] + beta * s_p[y];
            c_p[y] = c[y] + beta * c_p[y];
        }
    }
    for (int y = 0; y < EACH; ++y)
        if (lane + y * lanes < n) shared_c[lane + y * lanes] = s_x[y];
    TEAM_MEETS();
    #pragma unroll 1
    for (int t = lane; t < 2 * most * count; t += lanes) {       // U s_x, a point a thread
        int i;
        const int k = strand_of(t, i), point = i * m + k;
        if (i >= number[k]) continue;
        double f[4] = {0.0, 0.0, 0.0, 0.0};
        if (S.hold.data[point] < 0)
            for (int j = 0; j < P.ons.data[point]; ++j) {
                const int slot = P.on.data[point * P.on.shape[1] + j], pair = slot >> 2, corner = slot & 3;
                const double* const x = shared_c + 6 * A.number.data[pair] + (corner < 2 ? 0 : 3);
                for (int d = 0; d < 3; ++d) f[d] += A.b.data[pair][corner] * x[d];
            }
        for (int d = 0; d < 4; ++d) G.r.data[point][d] = f[d];
    }
    TEAM_MEETS();
    #undef TEAM_MEETS
    #undef RECIPROCAL_ROOT
    return wp::vec_t<2, double>(a_x, rounds);
"""


@wp.func_native(_REDUCED)
def reduce_rounds(S: RodTable, G: CoupledRods, P: EdgePairs, A: RodTeam, rho: wp.float64, at: wp.vec4i, pairs: int) -> wp.vec2d:
    """(a_x, rounds) of at[1] strands from at[0] on, of at[2] nodes at most, of world at[3], whose pairs are listed; U s_x into
    G.r. G.p: z_0; rho: r_0 . z_0. All threads of a block come, and meet at the end."""
    ...


@wp.func
def go_reduced(S: RodTable, T: RodTrial, G: CoupledRods, P: EdgePairs, A: RodTeam, rho: wp.float64, at: wp.vec3i):
    """All rounds of world at[2] by thread at[0] of at[1], and the correction into G.x; how many, 0 where there are too many
    pairs. G.p, rho: see `reduce_rounds`."""
    first = G.first[at[2]]
    count = G.first[at[2] + 1] - first
    pairs = int(0)
    if A.chosen:
        pairs = list_pressing_pairs(S, G, P, A, at[0], at[1], at[2])
    if pairs == 0:
        return 0
    found = reduce_rounds(S, G, P, A, rho, wp.vec4i(first, count, A.most[at[2]], at[2]), pairs)
    solve_cyclic_reduction(S.points, A.nodes, A.work, G.r, T.z, first, count, A.most[at[2]])
    for t in range(at[0], count * S.length.shape[0], at[1]):
        i = t / count
        k = first + t - i * count
        if i < S.points[k]:
            G.x[i, k] = T.z[i, k] + G.p[i, k] * found[0]
    return int(found[1])
