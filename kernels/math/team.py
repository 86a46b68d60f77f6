"""Sums over teams of threads of a block: warps in a row, a power of two of them, that go their own way between meetings. Each
sum is made in one order, and every thread of the team gets it. On a CPU one thread is a team.

A warp halves what it has to add up at each step: of 32 values a thread sends 16 to another and adds the 16 that it gets, then
8, 4, 2, 1 (a reduce-scatter); lane l is left with the sum of value l. 43 values take 47 exchanges in place of 215.
"""

from functools import cache

import warp as wp

WARPS = 8              # of a block, at most


def _warp_sum_snippet(count: int) -> str:
    """CUDA: the sums of a warp of values 0 .. count - 1 of `x` into room[warp]; 32 at a time."""
    text = ""
    for begin in range(0, count, 32):
        left = min(32, count - begin)
        width = 1 << (left - 1).bit_length()
        values = ", ".join(f"x[{begin + i}]" if i < left else "0.0" for i in range(width))
        text += f"{{ double v[{width}] = {{ {values} }};\n"
        half = width // 2
        while half:
            text += f"""
            {{ const bool up = lane & {half};
            #pragma unroll
            for (int i = 0; i < {half}; ++i) {{
                const double gives = up ? v[i] : v[i + {half}], keeps = up ? v[i + {half}] : v[i];
                v[i] = keeps + __shfl_xor_sync(0xffffffffu, gives, {half});
            }} }}"""
            half //= 2
        other = width
        while other < 32:
            text += f"\n            v[0] += __shfl_xor_sync(0xffffffffu, v[0], {other});"
            other *= 2
        text += f"\n            if (lane < {left}) room[warp][{begin} + lane] = v[0]; }}\n"
    return text


@cache
def team_sum_func(count: int):
    """Function (x, warps, team): the sum of vectors of so many float64 over the threads of a team. warps: of each team; team:
    its number in the block."""
    vector = wp.types.vector(count, wp.float64)
    snippet = f"""
#if defined(__CUDA_ARCH__)
    __shared__ double room[{WARPS}][{count}], whole[{WARPS}][{count}];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, first = team * warps;
    auto meet = [=]() {{
        if (warps == 1) __syncwarp();
        else asm volatile("barrier.sync %0, %1;" :: "r"(1 + team), "r"(32 * warps) : "memory");
    }};
    {_warp_sum_snippet(count)}
    meet();
    for (int i = lane; i < {count}; i += 32) {{
        double a = room[first][i];
        for (int w = 1; w < warps; ++w) a += room[first + w][i];
        whole[warp][i] = a;
    }}
    meet();                                                      // the next sum may write what this one has read
    #pragma unroll
    for (int i = 0; i < {count}; ++i) x[i] = whole[warp][i];
#endif
    return x;
"""

    @wp.func_native(snippet)
    def sum_over_team(x: vector, warps: int, team: int) -> vector: ...

    return sum_over_team


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    if (warps == 1) __syncwarp();
    else asm volatile("barrier.sync %0, %1;" :: "r"(1 + team), "r"(32 * warps) : "memory");
#endif
""")
def team_barrier(warps: int, team: int):
    """All threads of a team wait for each other; what each wrote is seen by all."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __syncthreads_or(flag);
#else
    return flag;
#endif
""")
def any_of(flag: int) -> int:
    """1 in all threads of a block if it is in one; they meet."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ int sums[32];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    int up = count;
    for (int o = 1; o < 32; o *= 2) {
        const int other = __shfl_up_sync(0xffffffffu, up, o);
        if (lane >= o) up += other;
    }
    if (lane == 31) sums[warp] = up;
    __syncthreads();
    int before = up - count, all = 0;
    for (int w = 0; w < warps; ++w) {
        if (w < warp) before += sums[w];
        all += sums[w];
    }
    __syncthreads();
    return wp::vec_t<2, int>(before, all);
#else
    return wp::vec_t<2, int>(0, count);
#endif
""")
def block_prefix_count(count: int) -> wp.vec2i:
    """How many the threads of a block before this one have, and all of them (an exclusive prefix sum); they meet."""
    ...


@wp.func
def split_into_teams(threads: int, wanted: int):
    """(warps of a team, teams) for so many tasks of a block of `threads`."""
    warps = threads // 32
    if warps < 1:
        return 1, 1
    each = warps
    while each > 1 and warps // each < wanted:
        each = each // 2
    return each, warps // each
