"""A whole frame of explicit steps in one launch, by a cluster of blocks that keeps the net in registers (CUDA, sm_90 and up).

    v' = v + kick (f/m + g - decay v~),   d' = d + drift v',   f by springs without damping (kernels/cloth/spring.py,
                                          explicit.py)

A block has a share of the points, `lanes` threads to each, and keeps their displacements in shared memory with those of the
points of other blocks that its springs hang on. Whoever moves such a point sends it there, and the bytes that arrive count on
the receiver's barrier (st.async, mbarrier: PTX ISA 8.1): a block waits for its own threads and its neighbours, never for all.
Three copies in turn and two barriers in turn, since a neighbour may be one substep ahead, and no more: it needs what this
block sends. A frame without contacts (`bounded`) is watched: each displacement must be no longer than the clearance of its
point (kernels/motion/free_flight_test.py), in every substep. Tables, velocities, remainders and rest vectors x_j - x_i never
leave the registers of their thread. The sums are those of `leap`, in the same order; 1 / length is within an ulp of it. Worlds
have a cluster each, of one launch.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import spring_nets
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps

SNIPPET = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    typedef {real} T;
    constexpr int L = {lanes}, E = {entries}, P = {points}, S = {slots}, W = {pushes}, Q = {stride};
    __shared__ __align__(16) T room[3][Q * S];
    __shared__ __align__(8) unsigned long long gate[2];
    const int n = h.points, own = threadIdx.x / L, lane = threadIdx.x % L;
    unsigned rank, world;
    asm("mov.u32 %0, %%cluster_ctarank;" : "=r"(rank));
    asm("mov.u32 %0, %%clusterid.x;" : "=r"(world));
    const int i = rank * P + own, g0 = world * n + i;        // in the world, and in all arrays
    const bool there = i < n;
    const T* X = (const T*)x.data;
    T *Y = (T*)x_out.data, *D = (T*)e.data, *V = (T*)v.data, *C = (T*)carry.data;
    {room}
    T w = 0, decay = 0, g[3] = {{0, 0, 0}}, d0[3] = {{0, 0, 0}}, s[3] = {{0, 0, 0}}, v0[3], q[3], r[3], x0[3];
    int column = -1;
    if (there) {{
        const int o = c.object.data[g0];
        w = c.w.data[g0];
        decay = c.decay.data[o];
        column = c.pin.data[g0];
        for (int k = 0; k < 3; ++k) {{
            g[k] = ((const T*)c.gravity.data)[3 * o + k];
            d0[k] = D[3 * g0 + k];
            v0[k] = q[k] = V[3 * g0 + k];
            r[k] = C[3 * g0 + k];
            x0[k] = X[3 * g0 + k];
        }}
    }}
    unsigned to[W], by[W];               // where others keep this point (all ones: nowhere), and their barrier
    const unsigned base = (unsigned)__cvta_generic_to_shared(&room[0][0]), bars = (unsigned)__cvta_generic_to_shared(gate);
    #pragma unroll
    for (int p = 0; p < W; ++p) {{
        const int goal = there ? h.push.data[(i * W + p) * L + lane] : -1;
        const int block = goal < 0 ? (int)rank : goal >> 16;
        const unsigned here = base + (unsigned)sizeof(T) * Q * (goal & 0xffff);
        asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(to[p]) : "r"(here), "r"(block));
        asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(by[p]) : "r"(bars), "r"(block));
        if (goal < 0) to[p] = ~0u;
    }}
    const unsigned bytes = sizeof(T) * (sizeof(T) == 4 ? 4 : 3) * h.guests.data[rank];
    if (threadIdx.x == 0) {{
        for (int b = 0; b < 2; ++b)
            asm volatile("mbarrier.init.shared::cta.b64 [%0], %1;" :: "r"(bars + 8 * b), "r"(P * L / 32) : "memory");
        asm volatile("fence.mbarrier_init.release.cluster;" ::: "memory");
    }}
    unsigned at[E];                      // of the other end in the first copy [bytes]
    T rest[E], stiff[E], R[E][3];        // rest: k L
    #pragma unroll
    for (int e = 0; e < E; ++e) {{
        const int entry = g0 * E * L + lane + e * L;
        const int j = there ? c.other.data[entry] : 0;
        const int slot = there ? h.slot.data[i * E * L + lane + e * L] : 0;
        at[e] = (unsigned)sizeof(T) * Q * slot;
        stiff[e] = there ? c.k.data[entry] : T(0);
        rest[e] = there ? stiff[e] * c.rest.data[entry] : T(0);
        for (int k = 0; k < 3; ++k) {{
            R[e][k] = there ? X[3 * j + k] - x0[k] : T(0);
            if (there) room[0][Q * slot + k] = D[3 * j + k];
        }}
    }}
    if (there && lane == 0)
        for (int k = 0; k < 3; ++k) room[0][Q * own + k] = d0[k];
    const bool moves = there && column >= 0 && !(w > T(0)) && step.drift > T(0);
    T goal[3] = {{0, 0, 0}};               // of a prescribed point at the end of the substep
    const T* goals = (const T*)c.target.data + 3 * (step.row * c.target.shape[1] + column);
    for (int k = 0; k < 3 && moves; ++k) goal[k] = goals[k];
    T kick = step.kick;
    int from = 0;
    asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
    for (int sub = 0; ; ++sub) {{
        const bool last = sub == step.count;
        if (last && step.close == T(0)) break;
        T f[3] = {{0, 0, 0}};
        const char* held = (const char*)&room[0][0] + (unsigned)sizeof(T) * Q * S * from;
        #pragma unroll
        for (int e = 0; e < E; ++e) {{
            T p[3];
            {load}
            T a[3];
            for (int k = 0; k < 3; ++k) a[k] = R[e][k] + (p[k] - d0[k]);
            const T square = {greater}(a[0] * a[0] + a[1] * a[1] + a[2] * a[2], {tiny});     // a is 0 where it counts
            T over;
            {root}
            over = fma(T(0.5) * over, fma(-square * over, over, T(1)), over);
            const T pull = fma(-rest[e], over, stiff[e]);
            for (int k = 0; k < 3; ++k) f[k] = fma(pull, a[k], f[k]);
        }}
        #pragma unroll
        for (int o = L / 2; o > 0; o >>= 1)
            for (int k = 0; k < 3; ++k) f[k] += __shfl_xor_sync(0xffffffffu, f[k], o, L);
        if (last) {{
            for (int k = 0; k < 3 && w > T(0); ++k) {{
                const T y = step.close * (w * f[k] + g[k] - decay * q[k]) + r[k], v1 = v0[k] + y;
                r[k] = y - (v1 - v0[k]);
                v0[k] = v1;
            }}
            break;
        }}
        if (w > T(0)) {{
            for (int k = 0; k < 3; ++k) {{
                const T a = w * f[k] + g[k] - decay * q[k], y = kick * a + r[k], v1 = v0[k] + y;
                r[k] = y - (v1 - v0[k]);
                v0[k] = v1;
                const T z = step.drift * v1 + s[k], d1 = d0[k] + z;
                s[k] = z - (d1 - d0[k]);
                d0[k] = d1;
                q[k] = v1 + step.ahead * a;
            }}
            {within}
        }} else if (moves && (sub < 2 || step.stride)) {{
            for (int k = 0; k < 3; ++k) {{
                const T d1 = goal[k] - x0[k];
                v0[k] = q[k] = (d1 - d0[k]) / step.h;
                d0[k] = d1;
            }}
        }}
        from = from == 2 ? 0 : from + 1;
        const unsigned ahead = (unsigned)sizeof(T) * Q * S * from, turn = 8 * (sub & 1);
        #pragma unroll
        for (int p = 0; p < W; ++p)
            if (to[p] != ~0u) {{ {send} }}
        if (lane == 0 && there)
            for (int k = 0; k < 3; ++k) room[from][Q * own + k] = d0[k];
        __syncwarp();
        if (threadIdx.x == 0)
            asm volatile("{{.reg .b64 t; mbarrier.arrive.expect_tx.release.cta.shared::cta.b64 t, [%0], %1;}}"
                         :: "r"(bars + turn), "r"(bytes) : "memory");
        else if (threadIdx.x % 32 == 0)
            asm volatile("{{.reg .b64 t; mbarrier.arrive.release.cta.shared::cta.b64 t, [%0];}}"
                         :: "r"(bars + turn) : "memory");
        kick = step.later;
        if (moves && step.stride && sub + 1 < step.count) {{      // read before the wait: 1100 cycles if read when needed
            goals += 3 * c.target.shape[1];
            for (int k = 0; k < 3; ++k) goal[k] = goals[k];
        }}
        for (unsigned done = 0; !done; )
            asm volatile("{{.reg .pred p; mbarrier.try_wait.parity.acquire.cluster.shared::cta.b64 p, [%1], %2;"
                         "selp.u32 %0, 1, 0, p;}}" : "=r"(done) : "r"(bars + turn), "r"((sub >> 1) & 1) : "memory");
    }}
    // nobody leaves while others may still send to it
    asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
    {met}
    if (there && lane == 0)
        for (int k = 0; k < 3; ++k) {{
            const T x1 = x0[k] + d0[k];
            Y[3 * g0 + k] = x1;
            D[3 * g0 + k] = (d0[k] - (x1 - x0[k])) + s[k];
            V[3 * g0 + k] = v0[k];
            C[3 * g0 + k] = r[k];
        }}
#endif
"""
LOAD = {   # displacement p of the other end
    "float": "const float4 q4 = *(const float4*)(held + at[e]); p[0] = q4.x; p[1] = q4.y; p[2] = q4.z;",
    "double": "for (int k = 0; k < 3; ++k) p[k] = ((const T*)(held + at[e]))[k];",
}
SEND = {   # own displacement, to where another block keeps it
    "float": """asm volatile("st.async.shared::cluster.mbarrier::complete_tx::bytes.v4.f32 [%0], {%1, %2, %3, %3}, [%4];"
                         :: "r"(to[p] + ahead), "f"(d0[0]), "f"(d0[1]), "f"(d0[2]), "r"(by[p] + turn) : "memory");""",
    "double": """for (int k = 0; k < 3; ++k)
                asm volatile("st.async.shared::cluster.mbarrier::complete_tx::bytes.f64 [%0], %1, [%2];"
                             :: "r"(to[p] + ahead + 8 * k), "d"(d0[k]), "r"(by[p] + turn) : "memory");""",
}
ROOT = {   # 1 / length before its last Newton step, and the least square of a length
    "float": ('asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(over) : "f"(square));', "fmaxf", "1.2e-38f"),
    "double": ("over = rsqrt(square);", "fmax", "1e-300"),
}
# square of the clearance [m^2], -2 once it was not enough
BOUNDED = {"room": "T room2 = there ? h.room.data[g0] : T(1e30);  room2 = room2 > T(0) ? room2 * room2 : T(-1);",
           "within": "if (!(d0[0] * d0[0] + d0[1] * d0[1] + d0[2] * d0[2] <= room2)) room2 = T(-2);",
           "met": "if (room2 < T(-1.5)) atomicMax(h.met.data, 1);"}


@wp.struct
class Shares:
    """How the blocks of a world share its net, see `wsim.physics.motion.fast_paths.cluster.Halo`: alike in all."""

    points: int                    # of a world
    slot: wp.array(dtype=int)      # where a spring's other end stands in its block's memory, (entries of a world,)
    push: wp.array(dtype=int)      # where others keep a point: block << 16 | slot, or -1; (points * pushes * lanes,)
    guests: wp.array(dtype=int)    # points of others that a block keeps, (blocks,)


@cache
def bounded_shares(real):
    """Struct of the same, and the bounds of a frame without contacts."""

    @wp.struct
    class BoundedShares:
        points: int
        slot: wp.array(dtype=int)
        push: wp.array(dtype=int)
        guests: wp.array(dtype=int)
        room: wp.array(dtype=real)     # clearance [m], (points,)
        met: wp.array(dtype=int)       # becomes 1 where a point goes further

    return BoundedShares


@cache
def cluster_frame_kernel(real, module, plan, bounded: bool = False):
    """Kernel, launched over plan.size blocks of plan.threads for each world: `count` substeps, the last half kick where
    `ExplicitStep.close` asks for one, and the position x + d with its remainder. r is the remainder of v, (points,).

    plan     `wsim.physics.motion.fast_paths.cluster.SpringCluster`; the net is padded to plan.lanes * plan.entries a point (see
             `wsim.physics.motion.forces.ForceGather.place`)
    bounded  frames are watched; `Shares` are `bounded_shares` then
    """
    vec3, Net, Step, Held = (types(real).vec3, spring_nets(real), explicit_steps(real),
                             bounded_shares(real) if bounded else Shares)
    name = "float" if real is wp.float32 else "double"
    root, greater, tiny = ROOT[name]
    bounds = {key: text if bounded else "" for key, text in BOUNDED.items()}
    code = SNIPPET.format(real=name, root=root, greater=greater, tiny=tiny, lanes=plan.lanes, entries=plan.entries,
                          points=plan.points, slots=plan.slots, pushes=plan.pushes, stride=4 if name == "float" else 3,
                          load=LOAD[name], send=SEND[name], **bounds)

    @wp.func_native(code)
    def native_cluster_frame(c: Net, h: Held, x: wp.array(dtype=vec3), step: Step, x_out: wp.array(dtype=vec3),
                             e: wp.array(dtype=vec3), v: wp.array(dtype=vec3), carry: wp.array(dtype=vec3)): ...

    def cluster_frame(c: Net, h: Held, x: wp.array(dtype=vec3), step: Step, x_out: wp.array(dtype=vec3),
                      e_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3), r_out: wp.array(dtype=vec3)):
        native_cluster_frame(c, h, x, step, x_out, e_out, v_out, r_out)

    return wp.kernel(cluster_frame, module=module, enable_backward=False, grid_stride=False, launch_bounds=plan.threads,
                     cluster_dim=plan.size, **({"name": "frame_bounded"} if bounded else {}))
