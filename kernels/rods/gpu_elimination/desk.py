"""Blocks that the LANES threads of a strand hand each other, and numbers under way from memory to them (CUDA, sm_80 and up)."""

import warp as wp

from wsim.kernels.rods.gpu_elimination.parts import BENT, EDGE, MORE, SIZES, STEPS


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ double room[4 * 32];
    const int t = threadIdx.x, first = t & ~3;
    const unsigned group = 0xfu << first;
    __syncwarp(group);
    for (int r = 0; r < 4; ++r) room[32 * r + t] = own[r];
    __syncwarp(group);
    wp::mat_t<4, 4, double> m;
    for (int r = 0; r < 4; ++r)
        for (int c = 0; c < 4; ++c) m.data[r][c] = room[32 * r + first + c];
    return m;
#else
    return wp::mat_t<4, 4, double>();
#endif
""")
def whole_lane_block(own: wp.vec4d) -> wp.mat44d:
    """Block whose columns the lanes of a strand have."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned group = 0xfu << (threadIdx.x & 28);
    return wp::vec_t<4, double>(__shfl_sync(group, own, 0, 4), __shfl_sync(group, own, 1, 4), __shfl_sync(group, own, 2, 4),
                                __shfl_sync(group, own, 3, 4));
#else
    return wp::vec_t<4, double>();
#endif
""")
def whole_lane_vector(own: wp.float64) -> wp.vec4d:
    """Vector whose numbers the lanes of a strand have."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp(0xfu << (threadIdx.x & 28));
#endif
""")
def strand_lane_barrier():
    """The lanes of a strand wait for each other; what each wrote is seen by all."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
""")
def warp_memory_barrier():
    """All threads of a warp wait for each other; what each wrote is seen by all."""
    ...


@wp.func_native("".join(f"""
#if defined(__CUDA_ARCH__)
    if (numbers == {each}) {{
        __shared__ double room[8 * {STEPS} * {each}];
        return (int)__cvta_generic_to_shared(room) + 8 * (threadIdx.x >> 2);
    }}
#endif
""" for each in SIZES) + "return 0;")
def shared_memory_address(numbers: int) -> int:
    """Address in shared memory where so many numbers (one of SIZES, known at compile time: the others' memory is dropped) of a
    strand's points are put, STEPS points in turn."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    for (int c = threadIdx.x & 3; c < count; c += 4) {{
        const int row = max(i + (ahead ? c < {EDGE} ? 2 : c < {BENT} || c >= {MORE} ? 0 : 1 : 0), 0);
        const char* from = (const char*)a.data + (size_t)a.strides[0] * c + (size_t)a.strides[1] * row + 8 * (size_t)k;
        asm volatile("cp.async.ca.shared.global [%0], [%1], 8;" :: "r"(to + 64 * c), "l"(from) : "memory");
    }}
#endif
""")
def fetch_point_numbers(a: wp.array3d(dtype=wp.float64), count: int, i: int, k: int, to: int, ahead: bool):
    """Sends for numbers of point i. ahead: those of a point itself are of the next but one, those of a bend of the next. Before
    the first point there is none to read."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("cp.async.commit_group;" ::: "memory");
#endif
""")
def commit_fetch_group():
    """Ends a group of what was sent for."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    asm volatile("cp.async.wait_group {STEPS - 1};" ::: "memory");
    __syncwarp(0xfu << (threadIdx.x & 28));
#endif
""")
def wait_fetch_group():
    """The lanes of a strand wait for all groups but the last STEPS - 1."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return *(const double*)__cvta_shared_to_generic(at + 64 * c);
#else
    return 0.0;
#endif
""")
def shared_number(at: int, c: int) -> wp.float64:
    """Number c of what was put at an address."""
    ...


@wp.func
def shared_vector(at: int, c: int):
    return wp.vec3d(shared_number(at, c), shared_number(at, c + 1), shared_number(at, c + 2))
