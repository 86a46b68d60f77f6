"""Meetings of the blocks of kernels/motion/fused/sheet.py, and places that they send each other, in CUDA (sm_90 and up).

    a cluster  stores into another block's shared memory, which count on its barrier (st.async, mbarrier: PTX ISA 8.1): a block
               waits for its threads and its neighbours, 0.25 us instead of the 0.8 that a barrier of 16 blocks takes (H100).
               What arrives stands in its own shared memory: it acquires as a block does, which spares the cache of first level
    a grid     stores into global memory, 16 bytes at once (b128: PTX ISA 8.3), of which the last four say the substep: whoever
               waits for a place reads it until it is there. No fence, which would empty the cache of first level
"""

MEETS = 'asm volatile("barrier.cluster.arrive.release.aligned;\\nbarrier.cluster.wait.acquire.aligned;" ::: "memory");'
# of CUDA. What others send counts on a barrier, as in kernels/motion/fast_paths/cluster.py; two in turn, as one may be ahead
WORDS = {
    "THREAD": "threadIdx.x", "BLOCK_MEETS": "__syncthreads();", "INT_AS_FLOAT": "__int_as_float", "RANK": "(int)blockIdx.x",
    "FLOAT_AS_INT": "__float_as_int", "RSQRT": "reciprocal_root", "RECIPROCAL": "reciprocal", "CLUSTER_ENDS": MEETS,
    "SUM_LANES": """for (int o = LANES / 2; o > 0; o >>= 1) {
            for (int k = 0; k < 3; ++k) f[k] += __shfl_xor_sync(0xffffffffu, f[k], o, LANES);
            for (int k = 0; k < 3 && AIR; ++k) blow[k] += __shfl_xor_sync(0xffffffffu, blow[k], o, LANES);
            if (AIR) damp += __shfl_xor_sync(0xffffffffu, damp, o, LANES);
        }""",
    "CLUSTER_BEGINS": f"""
        if (t == 0) {{
            for (int b = 0; b < 2; ++b)
                asm volatile("mbarrier.init.shared::cta.b64 [%0], %1;" :: "r"(gates + 8 * b), "r"(THREADS / 32) : "memory");
            asm volatile("fence.mbarrier_init.release.cluster;" ::: "memory");
        }}
        {MEETS}""",
    "CLUSTER_WAITS": "attend(gates + 8 * (sub & 1), sizeof(float4) * (RATES ? 2 : 1) * (there - owned), (sub >> 1) & 1);",
}
BEFORE = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    extern __shared__ __align__(128) float sheet_room[];
    const unsigned gates = (unsigned)__cvta_generic_to_shared(sheet_room);    // two barriers of eight bytes
    auto reciprocal = [](float a) { float r; asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(a)); return r; };
    auto reciprocal_root = [](float a) { float r; asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(a)); return r; };
    auto send = [=](int block, const float4* place, float4 a, unsigned gate) {    // to the same place in another block's memory
        unsigned to, by;
        asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(to) : "r"((unsigned)__cvta_generic_to_shared(place)), "r"(block));
        asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(by) : "r"(gate), "r"(block));
        asm volatile("st.async.shared::cluster.mbarrier::complete_tx::bytes.v4.f32 [%0], {%1, %2, %3, %4}, [%5];"
                     :: "r"(to), "f"(a.x), "f"(a.y), "f"(a.z), "f"(a.w), "r"(by) : "memory");
    };
    auto attend = [](unsigned gate, unsigned bytes, unsigned phase) {         // all threads of the block, and so many bytes
        __syncwarp();
        if (threadIdx.x == 0)
            asm volatile("{.reg .b64 a; mbarrier.arrive.expect_tx.release.cta.shared::cta.b64 a, [%0], %1;}"
                         :: "r"(gate), "r"(bytes) : "memory");
        else if (threadIdx.x % 32 == 0)
            asm volatile("{.reg .b64 a; mbarrier.arrive.release.cta.shared::cta.b64 a, [%0];}" :: "r"(gate) : "memory");
        for (unsigned done = 0; !done; )
            asm volatile("{.reg .pred p; mbarrier.try_wait.parity.acquire.cta.shared::cta.b64 p, [%1], %2;"
                         "selp.u32 %0, 1, 0, p;}" : "=r"(done) : "r"(gate), "r"(phase) : "memory");
    };
    auto post = [](float4* place, float4 a, int turn) {     // 16 bytes at once
        asm volatile("{.reg .b64 a, b; .reg .b128 v; mov.b64 a, {%1, %2}; mov.b64 b, {%3, %4}; mov.b128 v, {a, b};"
                     "st.relaxed.gpu.global.b128 [%0], v;}"
                     :: "l"(place), "f"(a.x), "f"(a.y), "f"(a.z), "r"(turn) : "memory");
    };
    auto fetch = [](const float4* place, int turn) {
        float4 a;
        for (int now = ~turn; now != turn; )
            asm volatile("{.reg .b64 a, b; .reg .b128 v; ld.relaxed.gpu.global.b128 v, [%4]; mov.b128 {a, b}, v;"
                         "mov.b64 {%0, %1}, a; mov.b64 {%2, %3}, b;}"
                         : "=f"(a.x), "=f"(a.y), "=f"(a.z), "=r"(now) : "l"(place) : "memory");
        a.w = 0.f;
        return a;
    };
"""
