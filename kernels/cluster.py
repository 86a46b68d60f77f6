"""A whole frame of explicit steps in one launch, by a cluster of blocks that keeps the net in registers (CUDA, sm_90 and up).

    v' = v + kick (f/m + g - decay v~),   d' = d + drift v',   f by springs without damping (kernels/spring.py, explicit.py)

A block has a share of the points, `lanes` threads to each, and keeps their displacements in shared memory, twice, with those
of the points of other blocks that its springs hang on: whoever moves such a point writes it there (distributed shared
memory), and all meet after each substep. Tables, velocities, remainders and rest vectors x_j - x_i never leave the registers
of their thread. The sums are those of `leap`, in the same order; 1 / length is within an ulp of it.
"""

from functools import cache

import warp as wp

from wsim.kernels.explicit import steps
from wsim.kernels.real import types
from wsim.kernels.spring import net
from wsim.kernels.stream import BLOCK

SNIPPET = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    typedef {real} T;
    constexpr int L = {lanes}, E = {entries}, P = {block} / L, S = {slots}, W = {pushes};
    __shared__ __align__(16) T room[2][4 * S];
    const int n = x.shape[0], own = threadIdx.x / L, lane = threadIdx.x % L;
    unsigned rank;
    asm("mov.u32 %0, %%cluster_ctarank;" : "=r"(rank));
    const int i = rank * P + own;
    const bool there = i < n;
    const T* X = (const T*)x.data;
    T *Y = (T*)x_out.data, *D = (T*)e.data, *V = (T*)v.data, *C = (T*)carry.data;
    T w = 0, decay = 0, g[3] = {{0, 0, 0}}, d0[3] = {{0, 0, 0}}, s[3] = {{0, 0, 0}}, v0[3], q[3], r[3], x0[3];
    int column = -1;
    if (there) {{
        const int o = c.object.data[i];
        w = c.w.data[i];
        decay = c.decay.data[o];
        column = c.pin.data[i];
        for (int k = 0; k < 3; ++k) {{
            g[k] = ((const T*)c.gravity.data)[3 * o + k];
            d0[k] = D[3 * i + k];
            v0[k] = q[k] = V[3 * i + k];
            r[k] = C[3 * i + k];
            x0[k] = X[3 * i + k];
        }}
        if (lane == 0)
            for (int k = 0; k < 3; ++k) room[0][4 * own + k] = d0[k];
    }}
    unsigned half = 0;                   // bytes from copy 0 to the one that is written
    unsigned to[W];                      // where others keep this point; all ones: nowhere
    #pragma unroll
    for (int p = 0; p < W; ++p) {{
        const int goal = there ? push.data[(i * W + p) * L + lane] : -1;
        const unsigned here = (unsigned)__cvta_generic_to_shared(&room[0][4 * (goal & 0xffff)]);
        asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(to[p]) : "r"(here), "r"(goal < 0 ? rank : goal >> 16));
        if (goal < 0) to[p] = ~0u;
    }}
    asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
    #pragma unroll
    for (int p = 0; p < W; ++p)
        if (to[p] != ~0u) {{ {store} }}
    const T* at[E];
    T rest[E], stiff[E], R[E][3];
    #pragma unroll
    for (int e = 0; e < E; ++e) {{
        const int entry = i * E * L + lane + e * L;
        const int j = there ? c.other.data[entry] : 0;
        at[e] = &room[0][4 * (there ? slot.data[entry] : 0)];
        rest[e] = there ? c.rest.data[entry] : T(0);
        stiff[e] = there ? c.k.data[entry] : T(0);
        for (int k = 0; k < 3; ++k) R[e][k] = there ? X[3 * j + k] - x0[k] : T(0);
    }}
    T kick = step.kick;
    unsigned from = 0;
    asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
    for (int sub = 0; ; ++sub) {{
        const bool last = sub == step.count;
        if (last && step.close == T(0)) break;
        T f[3] = {{0, 0, 0}};
        #pragma unroll
        for (int e = 0; e < E; ++e) {{
            T p[3];
            {load}
            T a[3];
            for (int k = 0; k < 3; ++k) a[k] = R[e][k] + (p[k] - d0[k]);
            const T square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
            T over = {root}(square);
            over += T(0.5) * over * (T(1) - square * over * over);
            if (!(square > T(0))) over = T(0);
            const T pull = stiff[e] - stiff[e] * rest[e] * over;
            for (int k = 0; k < 3; ++k) f[k] += pull * a[k];
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
        T* next = &room[1 - from][4 * own];
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
        }} else if (there && column >= 0 && step.drift > T(0)) {{
            const T* goal = (const T*)c.target.data + 3 * ((step.row + sub * step.stride) * c.target.shape[1] + column);
            for (int k = 0; k < 3; ++k) {{
                const T d1 = goal[k] - x0[k];
                v0[k] = q[k] = (d1 - d0[k]) / step.h;
                d0[k] = d1;
            }}
        }}
        if (lane == 0 && there)
            for (int k = 0; k < 3; ++k) next[k] = d0[k];
        half = sizeof(T) * 4 * S - half;
        #pragma unroll
        for (int p = 0; p < W; ++p)
            if (to[p] != ~0u) {{ {store} }}
        kick = step.later;
        from = 1 - from;
        asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
    }}
    // nobody leaves while others still read its displacements
    asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");
    if (there && lane == 0)
        for (int k = 0; k < 3; ++k) {{
            const T x1 = x0[k] + d0[k];
            Y[3 * i + k] = x1;
            D[3 * i + k] = (d0[k] - (x1 - x0[k])) + s[k];
            V[3 * i + k] = v0[k];
            C[3 * i + k] = r[k];
        }}
#endif
"""
LOAD = {   # displacement p of the other end, from copy `from`
    "float": "const float4 q4 = *(const float4*)(at[e] + from * 4 * S); p[0] = q4.x; p[1] = q4.y; p[2] = q4.z;",
    "double": "for (int k = 0; k < 3; ++k) p[k] = at[e][from * 4 * S + k];",
}
STORE = {  # own displacement, where another block keeps it
    "float": """asm volatile("st.shared::cluster.v4.f32 [%0], {%1, %2, %3, %3};"
                         :: "r"(to[p] + half), "f"(d0[0]), "f"(d0[1]), "f"(d0[2]) : "memory");""",
    "double": """asm volatile("st.shared::cluster.v2.f64 [%0], {%1, %2};\\nst.shared::cluster.f64 [%0+16], %3;"
                         :: "r"(to[p] + half), "d"(d0[0]), "d"(d0[1]), "d"(d0[2]) : "memory");""",
}
ROOT = {"float": "rsqrtf", "double": "rsqrt"}


@cache
def frame(real, module, plan):
    """Kernel, launched over plan.size * BLOCK threads of blocks of BLOCK: `Step.count` substeps, the last half kick where
    `Step.close` asks for one, and the position x + d with its remainder. r is the remainder of v, (points,).

    plan     `wsim.cluster.Cluster`; the net is padded to plan.lanes * plan.entries a point (see `wsim.gather.Pull.place`)
    slot     where a spring's other end stands in its block's memory, (entries of the net,)
    push     where other blocks keep a point: block << 16 | slot, or -1; (points * plan.pushes * plan.lanes,)
    """
    vec3, Net, Step = types(real).vec3, net(real), steps(real)
    name = "float" if real is wp.float32 else "double"
    code = SNIPPET.format(real=name, root=ROOT[name], lanes=plan.lanes, entries=plan.entries, block=BLOCK, slots=plan.slots,
                          pushes=plan.pushes, load=LOAD[name], store=STORE[name])

    @wp.func_native(code)
    def march(c: Net, slot: wp.array(dtype=int), push: wp.array(dtype=int), x: wp.array(dtype=vec3), step: Step,
              x_out: wp.array(dtype=vec3), e: wp.array(dtype=vec3), v: wp.array(dtype=vec3), carry: wp.array(dtype=vec3)): ...

    def frame(c: Net, slot: wp.array(dtype=int), push: wp.array(dtype=int), x: wp.array(dtype=vec3), step: Step,
              x_out: wp.array(dtype=vec3), e_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3),
              r_out: wp.array(dtype=vec3)):
        march(c, slot, push, x, step, x_out, e_out, v_out, r_out)

    return wp.kernel(frame, module=module, enable_backward=False, grid_stride=False, launch_bounds=BLOCK,
                     cluster_dim=plan.size)
