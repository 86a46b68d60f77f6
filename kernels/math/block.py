"""What kernels need and Warp lacks: reads past the caches, and a meeting of a block's threads.

Tables that a sweep meets once are read past the caches of a GPU, so that the points stay in them: on an H200 the sweep over
4M springs took 75 us so and 84 us with plain reads, in one run. On a CPU they are plain reads. The streamed ones have no
adjoint: a kernel with gradients asks for plain ones.
"""

from functools import cache
from typing import Any

import warp as wp

BLOCK = 512            # threads of the one block that sweeps; registers are kept so that it fits, in float64 too
CLUSTERS = 90          # compute capability that has clusters
SNIPPET = """
#if defined(__CUDA_ARCH__)
    {cuda}
#else
    return a.data[i];
#endif
"""
CUDA = {
    "scalar": "return __ldcs(a.data + i);",
    2: "int2 v = __ldcs(reinterpret_cast<const int2*>(a.data) + i); return wp::vec_t<2, int>(v.x, v.y);",
    4: "int4 v = __ldcs(reinterpret_cast<const int4*>(a.data) + i); return wp::vec_t<4, int>(v.x, v.y, v.z, v.w);",
}


@cache
def _streaming_read_func(dtype, cuda: str):
    """Function (array of dtype, i) -> entry i. Warp wants to see the decorator in the source to know that it returns."""

    @wp.func_native(SNIPPET.format(cuda=cuda))
    def streaming_read(a: wp.array(dtype=dtype), i: int) -> dtype: ...

    return streaming_read


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return false;
#else
    return true;
#endif
""")
def runs_on_cpu() -> bool:
    """Whether a kernel runs on a CPU."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def block_barrier():
    """All threads of a block wait for each other; what each wrote to global memory is seen by all. Every thread must come."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("barrier.cluster.arrive.release;\\nbarrier.cluster.wait.acquire;" ::: "memory");
#endif
""")
def cluster_barrier():
    """As `block_barrier`, of all threads of a cluster of blocks (sm_90 and up)."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
    if (threadIdx.x == 0) {
        unsigned* count = (unsigned*)word.data;
        const unsigned all = (unsigned)turn * gridDim.x;
        __threadfence();
        atomicAdd(count, 1u);
        unsigned seen;
        do {
            asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(seen) : "l"(count) : "memory");
        } while (seen < all);
        __threadfence();
    }
    __syncthreads();
#endif
""")
def grid_barrier(word: wp.array(dtype=int), turn: int):
    """A meeting, like `block_barrier`, of all threads of a launch whose blocks run at once. word: one number, 0 before the
    launch; turn: of the meeting, from 1 on."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
""")
def warp_barrier():
    """As `block_barrier`, of the 32 threads of a warp."""
    ...


@wp.func
def no_barrier():
    """As `block_barrier`, of one thread."""
    return


@wp.func
def plain_entry_read(a: wp.array(dtype=Any), i: int):
    """Entry i, by a plain read."""
    return a[i]


def table_read_functions(points: int, rest, *, plain: bool = False):
    """Two functions: the points of constraint i (a vector of ints), and its rest value of type `rest`."""
    ids = _streaming_read_func(wp.types.vector(points, int), CUDA[points]) if points in CUDA else plain_entry_read
    value = _streaming_read_func(rest, CUDA["scalar"]) if rest in (wp.float32, wp.float64) else plain_entry_read
    return (plain_entry_read, plain_entry_read) if plain else (ids, value)

