"""The greatest, and the sum, of what threads of a warp have: the same in each of them. A thread of a CPU is alone."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (unsigned k = 16; k > 0; k >>= 1) v = max(v, __shfl_xor_sync(0xffffffffu, v, k));
#endif
    return v;
""")
def greatest(v: wp.float64) -> wp.float64:
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
