"""Conjugate gradients of a body by a cluster of blocks, all iterations in one launch (CUDA, sm_90 and up).

The recurrence is that of kernels/solver/pcg.py, for rows of elements. A point has `lanes` threads, which keep its row of A in
registers; z stands in the shared memory of the point's block, where all blocks of the cluster read it:

    z of own points                                  | the cluster meets
    w = A z, parts of r.z and z.w to every block     | the cluster meets
    alpha, beta, and y, r, p, s of own points, which never leave the registers

Sums are in float64: over the points of a warp, of a block and of the cluster, each in a fixed order, the same in every block.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver.newton import newton_structs
from wsim.kernels.solver.pcg import pcg_vectors

SNIPPET = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    typedef {real} T;
    constexpr int L = {lanes}, E = {entries}, N = {points}, B = {size}, W = N * L / 32, Q = {stride};
    __shared__ __align__(16) T room[Q * N];          // z of the points of this block
    __shared__ double part[2][W], every[2][B];       // of r.z and z.w: of its warps, of all blocks
    unsigned rank;
    asm("mov.u32 %0, %%cluster_ctarank;" : "=r"(rank));
    const int body = blockIdx.x / B, own = threadIdx.x / L, lane = threadIdx.x % L;
    const int first = rows.first.data[body], i = first + rank * N + own;
    const bool there = i < rows.first.data[body + 1], free = there && rows.w.data[i] > T(0);
    const unsigned base = (unsigned)__cvta_generic_to_shared(&room[0]);
    T K[E][9], P[9], D = 0, r[3], y[3], z[3], p[3], s[3];
    unsigned at[E];                                  // of the other point's z
    const int begin = free ? rows.pair.data[i] : 0, end = free ? rows.pair.data[i + 1] : 0;
    #pragma unroll
    for (int e = 0; e < E; ++e) {{
        const int b = begin + lane + e * L;
        const int other = b < end ? rows.column.data[b] - first : (int)rank * N + own;
        const unsigned here = base + (unsigned)sizeof(T) * Q * (other % N);
        asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(at[e]) : "r"(here), "r"(other / N));
        for (int k = 0; k < 9; ++k) K[e][k] = b < end ? ((const T*)A.block.data)[9 * b + k] : T(0);
    }}
    if (free) D = A.own.data[i];
    for (int k = 0; k < 9; ++k) P[k] = there ? ((const T*)A.P.data)[9 * i + k] : T(0);
    for (int k = 0; k < 3; ++k) {{
        r[k] = there ? ((const T*)f.data)[3 * i + k] : T(0);
        y[k] = p[k] = s[k] = T(0);
    }}
    double before = 1.0, alpha = 1.0, enough = 0.0, drop = 0.0;
    int count = 0;
    for (;;) {{
        for (int k = 0; k < 3; ++k) z[k] = P[3 * k] * r[0] + P[3 * k + 1] * r[1] + P[3 * k + 2] * r[2];
        if (lane == 0)
            for (int k = 0; k < 3; ++k) room[Q * own + k] = z[k];
        __syncwarp();
        asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
        T w[3] = {{0, 0, 0}};
        #pragma unroll
        for (int e = 0; e < E; ++e) {{
            T q[3];
            {load}
            for (int k = 0; k < 3; ++k) q[k] -= z[k];
            for (int k = 0; k < 3; ++k)
                w[k] = fma(K[e][3 * k], q[0], fma(K[e][3 * k + 1], q[1], fma(K[e][3 * k + 2], q[2], w[k])));
        }}
        #pragma unroll
        for (int o = L / 2; o > 0; o >>= 1)
            for (int k = 0; k < 3; ++k) w[k] += __shfl_xor_sync(0xffffffffu, w[k], o);
        for (int k = 0; k < 3; ++k) w[k] = fma(D, z[k], w[k]);
        double gamma = (double)(r[0] * z[0] + r[1] * z[1] + r[2] * z[2]);
        double delta = (double)(z[0] * w[0] + z[1] * w[1] + z[2] * w[2]);
        #pragma unroll
        for (int o = 16; o >= L; o >>= 1) {{          // the lanes of a point have the same
            gamma += __shfl_xor_sync(0xffffffffu, gamma, o);
            delta += __shfl_xor_sync(0xffffffffu, delta, o);
        }}
        if (threadIdx.x % 32 == 0) {{
            part[0][threadIdx.x / 32] = gamma;
            part[1][threadIdx.x / 32] = delta;
        }}
        __syncthreads();
        if (threadIdx.x < 2 * B) {{                   // one thread for each block and sum
            const int which = threadIdx.x / B, block = threadIdx.x % B;
            double sum = 0.0;
            for (int k = 0; k < W; ++k) sum += part[which][k];
            const unsigned here = (unsigned)__cvta_generic_to_shared(&every[which][rank]);
            unsigned to;
            asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(to) : "r"(here), "r"(block));
            asm volatile("st.shared::cluster.f64 [%0], %1;" :: "r"(to), "d"(sum) : "memory");
        }}
        __syncwarp();
        asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
        gamma = delta = 0.0;
        for (int k = 0; k < B; ++k) {{
            gamma += every[0][k];
            delta += every[1][k];
        }}
        if (count == 0) enough = tolerance * tolerance * gamma;
        if (!(gamma > enough) || count == cap) break;
        double beta = 0.0;
        if (count > 0) {{
            beta = gamma / before;
            delta -= beta * gamma / alpha;
        }}
        if (!(delta > 0.0)) break;                   // rounding has eaten what is left
        alpha = gamma / delta;
        before = gamma;
        drop += alpha * gamma;
        for (int k = 0; k < 3; ++k) {{
            p[k] = z[k] + T(beta) * p[k];
            s[k] = w[k] + T(beta) * s[k];
            y[k] += T(alpha) * p[k];
            r[k] -= T(alpha) * s[k];
        }}
        ++count;
    }}
    if (there && lane == 0)
        for (int k = 0; k < 3; ++k) ((T*)v.y.data)[3 * i + k] = y[k];
    if (rank == 0 && threadIdx.x == 0) {{
        drop_out.data[body] = drop;
        count_out.data[body] += count;
    }}
#endif
"""
LOAD = {   # z of the other point
    "float": """asm volatile("{.reg .f32 u; ld.shared::cluster.v4.f32 {%0, %1, %2, u}, [%3];}"
                         : "=f"(q[0]), "=f"(q[1]), "=f"(q[2]) : "r"(at[e]) : "memory");""",
    "double": """for (int k = 0; k < 3; ++k)
                asm volatile("ld.shared::cluster.f64 %0, [%1];" : "=d"(q[k]) : "r"(at[e] + 8 * k) : "memory");""",
}


@dataclass(frozen=True)
class PcgCluster:
    """Blocks that solve for a body: so many points each, `lanes` threads a point, which keep `entries` of its row."""

    lanes: int
    entries: int
    points: int                # of a block
    size: int                  # blocks

    @property
    def threads(self) -> int:
        """Threads of a block."""
        return self.points * self.lanes


@cache
def cluster_pcg_kernel(real, module, plan: PcgCluster):
    """Kernel over bodies times the blocks of a cluster, plan.threads each: arguments as
    `wsim.kernels.solver.pcg.pcg_body_kernel` has them; of v only y is written."""
    t, s, Vectors = types(real), newton_structs(real), pcg_vectors(real)
    name = "float" if real is wp.float32 else "double"
    code = SNIPPET.format(real=name, lanes=plan.lanes, entries=plan.entries, points=plan.points, size=plan.size,
                          stride=4 if name == "float" else 3, load=LOAD[name])

    @wp.func_native(code)
    def native_cluster_pcg(rows: s.Rows, A: s.Matrix, f: wp.array(dtype=t.vec3), tolerance: wp.float64, cap: int, v: Vectors,
                           drop_out: wp.array(dtype=wp.float64), count_out: wp.array(dtype=int)): ...

    def cluster_pcg(rows: s.Rows, A: s.Matrix, f: wp.array(dtype=t.vec3), tolerance: wp.float64, cap: int, v: Vectors,
                    drop_out: wp.array(dtype=wp.float64), count_out: wp.array(dtype=int)):
        native_cluster_pcg(rows, A, f, tolerance, cap, v, drop_out, count_out)

    return wp.kernel(cluster_pcg, name=f"pcg_cluster_{t.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=plan.threads, cluster_dim=plan.size)
