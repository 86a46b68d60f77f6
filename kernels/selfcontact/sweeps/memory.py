"""Memory of sweeps on a GPU: what a block alone keeps of points in its shared memory, and pairs beyond a thread's first.

Blocks that meet twice a sweep wait for global memory each time: on an H200 10 sweeps of some 500 pairs of `worn_shirt` took
127 us, of which their formulas are a fraction. So few pairs are one block's, until it is asked anew what takes part:
displacements and sums of the points that they move stand in its shared memory by their number among them, and its threads meet
in 0.1 us. Sums are whole numbers, so that bits are those of all blocks.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import pairs
from wsim.kernels.selfcontact.couple import holding

ROOM = {wp.float32: 1280, wp.float64: 960}       # points of a block: 36 and 48 bytes of 48 KB
PLACE = """
#if defined(__CUDA_ARCH__)
    __shared__ __align__(16) char own[{size}];
#else
    alignas(16) static char own[{size}];
#endif
    return (wp::uint64)own;
"""
ADD = """
#if defined(__CUDA_ARCH__)
    if (__isShared(move.data)) {         // by halves, whose sums carry alike in any order: adds of 64 bits are loops there
        const unsigned at = (unsigned)__cvta_generic_to_shared(move.data + i);
        const unsigned low = (unsigned)value;
        unsigned high = (unsigned)((unsigned long long)value >> 32), old;
        asm volatile("atom.shared.add.u32 %0, [%1], %2;" : "=r"(old) : "r"(at), "r"(low) : "memory");
        high += old + low < old ? 1u : 0u;
        asm volatile("red.shared.add.u32 [%0], %1;" :: "r"(at + 4), "r"(high) : "memory");
    } else {
        atomicAdd((unsigned long long*)(move.data + i), (unsigned long long)value);
    }
#else
    move.data[i] += value;
#endif
"""
PUT = """
    const unsigned* from = (const unsigned*)&held;
    const int words = sizeof(held) / 4;
#pragma unroll
    for (int i = FIRST; i < words; ++i)
        pool.data[i * (pool.shape[0] / words) + j] = from[i];
"""
TAKE = """
    TYPE found;
    unsigned* into = (unsigned*)&found;
    const int words = sizeof(found) / 4;
#pragma unroll
    for (int i = 0; i < words; ++i)
        into[i] = pool.data[(FIRST + i) * (pool.shape[0] / ALL) + j];
    return found;
"""
REALS = 52             # of a pair, behind the numbers of its points, in the order of `couple.holding`


@cache
def places(real):
    """Functions () -> address of displacements, of sums: of the points of a block, in its shared memory."""
    size, room = 12 if real is wp.float32 else 24, ROOM[real]

    @wp.func_native(PLACE.format(size=room * size))
    def place_moves() -> wp.uint64: ...

    @wp.func_native(PLACE.format(size=room * 24))
    def place_sums() -> wp.uint64: ...

    return place_moves, place_sums


@wp.func_native(ADD)
def add_whole(move: wp.array(dtype=wp.int64), i: int, value: wp.int64):
    """Adds to a whole number, in global memory or in that of a block; in any order."""
    ...


@cache
def adding_whole(real):
    """Function: as `pairs.fixed`, also in the memory of a block."""
    vec3, Sums = types(real).vec3, pairs.sums(real)

    @wp.func
    def add_move(to: Sums, k: int, move: vec3):
        scale = real(pairs.SCALE)
        for c in range(3):
            add_whole(to.move, 3 * k + c, wp.int64(scale * move[c]))

    return add_move


@cache
def pooling(real):
    """Functions (pool, j, held): write pair j, and what sweeps change of it; (pool, j) -> pair j. pool: words of pairs, word by
    word, so that threads side by side read side by side."""
    t, Held = types(real), holding(real)[0]
    each = 1 if real is wp.float32 else 2                   # words of a number
    values = wp.types.vector(REALS, real)
    name = "float" if real is wp.float32 else "double"

    def reading(of: str, first: int) -> str:
        return TAKE.replace("TYPE", of).replace("FIRST", str(first)).replace("ALL", str(4 + each * REALS))

    @wp.func_native(PUT.replace("FIRST", "0"))
    def put_pair(pool: wp.array(dtype=int), j: int, held: Held): ...

    @wp.func_native(PUT.replace("FIRST", f"words - {6 * each}"))          # push and prior stand last
    def put_push(pool: wp.array(dtype=int), j: int, held: Held): ...

    @wp.func_native(reading("wp::vec_t<4, int>", 0))
    def take_ids(pool: wp.array(dtype=int), j: int) -> wp.vec4i: ...

    @wp.func_native(reading(f"wp::vec_t<{REALS}, {name}>", 4))
    def take_values(pool: wp.array(dtype=int), j: int) -> values: ...

    @wp.func
    def three(v: values, i: int):
        return t.vec3(v[i], v[i + 1], v[i + 2])

    @wp.func
    def take_pair(pool: wp.array(dtype=int), j: int):
        v = take_values(pool, j)
        h = Held()
        h.ids = take_ids(pool, j)
        h.b = t.vec4(v[0], v[1], v[2], v[3])
        h.w = t.vec4(v[4], v[5], v[6], v[7])
        h.n = three(v, 8)
        h.gap = v[11]
        h.keep = v[12]
        h.W = v[13]
        h.mu = t.vec2(v[14], v[15])
        h.anchor = three(v, 16)
        for k in range(4):
            h.r[k] = three(v, 19 + 3 * k)
        h.D = three(v, 31)
        h.K = wp.matrix_from_rows(three(v, 34), three(v, 37), three(v, 40))
        h.moment = three(v, 43)
        h.push = three(v, 46)
        h.prior = three(v, 49)
        return h

    return put_pair, put_push, take_pair
