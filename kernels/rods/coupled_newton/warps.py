"""The greatest, and the sum, of what threads of a warp have: the same in each of them. A thread of a CPU is alone."""

import warp as wp

# Native code: `sum` over the threads of a block, the same in each. It takes the thread's number `lane`, the number of `warps`,
# and `part`: two arrays in shared memory of a number for each warp. `turn` says which of the two is next.
BLOCK_SUM = """
    auto sum = [&](double a) {
#if defined(__CUDA_ARCH__)
        for (int o = 16; o > 0; o >>= 1) a += __shfl_xor_sync(0xffffffffu, a, o);
        if (lane % 32 == 0) part[turn][lane / 32] = a;
        __syncthreads();
        a = 0.0;
        for (int k = 0; k < warps; ++k) a += part[turn][k];
        turn = 1 - turn;                                         // two in turn: the next sum needs no meeting before it
#endif
        return a;
    };
"""[1:]


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (unsigned k = 16; k > 0; k >>= 1) v = max(v, __shfl_xor_sync(0xffffffffu, v, k));
#endif
    return v;
""")
def warp_greatest(v: wp.float64) -> wp.float64:
    """The greatest of the threads of a warp, the same in each."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (unsigned k = 16; k > 0; k >>= 1)
        for (int c = 0; c < 3; ++c) v[c] += __shfl_xor_sync(0xffffffffu, v[c], k);
#endif
    return v;
""")
def warp_sum(v: wp.vec3d) -> wp.vec3d:
    """Sum over the threads of a warp, the same in each."""
    ...
