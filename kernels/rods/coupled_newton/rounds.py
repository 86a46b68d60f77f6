"""All rounds of conjugate gradients of a small world (kernels/rods/coupled_newton/conjugate.py, without rigid bodies). A thread
has up to EACH rows of nodes, and what is its own of these stands in registers; what others read of it is in shared memory.

`team.go_round` has the same of any world, in global memory: a round of 135 points took 22 us so (H200).
"""

import warp as wp

from wsim.kernels.rods.coupled_newton.conjugate import GAIN, ROUNDS
from wsim.kernels.rods.coupled_newton.coupled import CoupledRods
from wsim.kernels.rods.coupled_newton.nodes import RodTeam
from wsim.kernels.rods.coupled_newton.reduction import LEVELS, PLACES, PRODUCT
from wsim.kernels.rods.coupled_newton.warps import BLOCK_SUM
from wsim.kernels.rods.tables import EdgePairs, RodTable, RodTrial

SMALL = 128              # nodes of a world, at most: 4 rows for each of 256 threads, 24 KiB

_ROUNDS = """
    const auto& points = S.points;
    const auto& nodes = A.nodes;
    const int first = at[0], count = at[1], most = at[2];
""" + PLACES + f"""
    const int rows = most * count * 8;
#if defined(__CUDA_ARCH__)
    const int EACH = 4, warps = lanes / 32;
    __shared__ double room[3 * 8 * {SMALL}], part[2][32];
    int turn = 0;
#else
    const int EACH = 8 * {SMALL};
    double room[3 * 8 * {SMALL}];
#endif
    double *const v = room, *const z = room + 8 * {SMALL}, *const p = room + 16 * {SMALL};
    const double gain = {float(GAIN.val if hasattr(GAIN, "val") else GAIN)!r};
    const int rounds_at_most = {int(ROUNDS)};
""" + """
    const int wide = count, from = first;
""" + BLOCK_SUM + """    const double *const r0 = (const double*)G.r.data, *const z0 = (const double*)T.z.data;
    double* const out = (double*)G.x.data;
    auto place = [=](int x) {                                    // of a point's flat row in p
        const int i = m == 1 ? x : x / m;
        return ((i / 2) * count + (x - i * m) - first) * 8 + 4 * (i % 2);
    };
    double x[EACH], r[EACH], w[EACH], own[EACH], q[EACH];
    int entry[EACH];                                             // place of a row in vectors of blocks of 4; -1: there is none
    #pragma unroll
    for (int j = 0; j < EACH; ++j) {
        const int t = lane + j * lanes;
        entry[j] = -1;
        x[j] = r[j] = w[j] = own[j] = q[j] = 0.0;
        if (t < rows) {
            int J;
            const int k = strand_of(t >> 3, J), i = 2 * J + (t & 7) / 4;
            if (i < number[k]) {
                entry[j] = 4 * (i * m + k) + t % 4;
                w[j] = r[j] = r0[entry[j]];
                own[j] = z0[entry[j]];
            }
            p[t] = own[j];
        }
    }
""" + PRODUCT + """
    TEAM_MEETS();
    int rounds = 0;
    const double least = gain * rho;
    for (bool turning = true; turning; ) {
        double a = 0.0;
        #pragma unroll
        for (int j = 0; j < EACH; ++j) {
            if (entry[j] < 0) continue;
            const int point = entry[j] >> 2, c = entry[j] & 3;
            double f = 0.0;
            if (c < 3 && S.hold.data[point] < 0)
                for (int e = 0; e < P.ons.data[point]; ++e) {
                    const int slot = P.on.data[point * P.on.shape[1] + e], pair = slot >> 2, other = (slot & 3) < 2 ? 2 : 0;
                    const double b0 = A.b.data[pair][other], b1 = A.b.data[pair][other + 1], b = A.b.data[pair][slot & 3];
                    const double* const u0 = p + place(A.ids.data[pair][other]);
                    const double* const u1 = p + place(A.ids.data[pair][other + 1]);
                    double g = 0.0;
                    for (int d = 0; d < 3; ++d) g += P.K.data[pair].data[c][d] * (u0[d] * b0 + u1[d] * b1);
                    f += g * b;
                }
            q[j] = w[j] + f;
            a += q[j] * own[j];
        }
        a = sum(a);
        const double alpha = a > 0.0 ? rho / a : 0.0;
        #pragma unroll
        for (int j = 0; j < EACH; ++j) {
            x[j] += alpha * own[j];
            r[j] -= alpha * q[j];
            if (lane + j * lanes < rows) v[lane + j * lanes] = r[j];
        }
        TEAM_MEETS();
""" + LEVELS + """
        a = 0.0;
        #pragma unroll
        for (int j = 0; j < EACH; ++j)
            if (entry[j] >= 0) a += r[j] * z[lane + j * lanes];
        a = sum(a);
        const double beta = a / rho;
        rho = a;
        ++rounds;
        turning = rho > least && rounds < rounds_at_most && alpha != 0.0;
        #pragma unroll
        for (int j = 0; j < EACH; ++j)
            if (entry[j] >= 0) {
                w[j] = r[j] + beta * w[j];
                own[j] = z[lane + j * lanes] + beta * own[j];
                p[lane + j * lanes] = own[j];
            }
        TEAM_MEETS();
    }
    #pragma unroll
    for (int j = 0; j < EACH; ++j)
        if (entry[j] >= 0) out[entry[j]] = x[j];
    TEAM_MEETS();
    #undef TEAM_MEETS
    #undef RECIPROCAL_ROOT
    return rounds;
"""


@wp.func_native(_ROUNDS)
def go_rounds(S: RodTable, T: RodTrial, G: CoupledRods, P: EdgePairs, A: RodTeam, rho: wp.float64, at: wp.vec3i) -> int:
    """Rounds of conjugate gradients from the residual G.r and T.z = M^-1 r, r . z = rho, of at[1] strands from at[0] on, of
    at[2] nodes at most; the correction into G.x. All threads of a block come, and meet at the end; how many rounds it took."""
    ...
