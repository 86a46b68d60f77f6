"""Lanes of a tree: on a GPU a warp of 32 threads works on one tree, on a CPU one thread does.

A loop over links, dofs or entries runs from `first + tree_lane()` in strides of `tree_lanes()`. A function that writes arrays
ends with `tree_barrier`, so that its caller may read them. All lanes go the same way through what is not such a loop.
"""

from functools import cache

import warp as wp

LANES = 32               # of a tree on a GPU
AT_ONCE = 16             # trees that a multiprocessor of a GPU works on, where there are more than the 8 of all registers


def tree_launch_bounds(trees: int, multiprocessors: int) -> dict:
    """Options of a kernel of so many trees, a warp each. With 128 registers for a thread instead of 255 a multiprocessor of an
    H200 works on 16 trees: 8192 humanoids in the air take 67 ms for 20 substeps, and 86 ms with all registers."""
    return {"launch_bounds": (LANES, AT_ONCE)} if trees > AT_ONCE // 2 * multiprocessors > 0 else {}


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 31;
#else
    return 0;
#endif
""")
def tree_lane() -> int:
    """Number of this lane."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
""")
def tree_lanes() -> int:
    """How many lanes a tree has."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return true;
#else
    return false;
#endif
""")
def has_many_lanes() -> bool:
    """Whether a tree has many lanes: then fewer waits come before fewer operations."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
""")
def tree_barrier():
    """Lanes of a tree wait for each other; what each wrote is seen by all."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int o = 16; o > 0; o /= 2) x += __shfl_xor_sync(0xffffffffu, x, o);
#endif
    return x;
""")
def sum_over_lanes(x: wp.float64) -> wp.float64:
    """Sum of x over the lanes, in one order; every lane gets it."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int o = 16; o > 0; o /= 2) x = fmax(x, __shfl_xor_sync(0xffffffffu, x, o));
#endif
    return x;
""")
def greatest_of_lanes(x: wp.float64) -> wp.float64:
    """Greatest x of the lanes; every lane gets it."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __any_sync(0xffffffffu, flag);
#else
    return flag;
#endif
""")
def any_lane(flag: int) -> int:
    """1 in all lanes if it is not 0 in one."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, flag) & ((1u << (threadIdx.x & 31)) - 1u));
#else
    return 0;
#endif
""")
def lanes_before(flag: int) -> int:
    """How many lanes before this one have a flag that is not 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, flag));
#else
    return flag != 0;
#endif
""")
def count_lanes(flag: int) -> int:
    """How many lanes have a flag that is not 0."""
    ...


@cache
def entry_store_functions(matrix, vector, real):
    """(store_matrix_entry, store_vector_entry): one entry of a matrix or a vector in an array, by one lane. By Warp's own form
    a function writes its struct, which is then copied for each call (wsim/model/compiler/source.py)."""
    @wp.func_native("a.data[i].data[r][c] = value;\n")
    def store_matrix_entry(a: wp.array(dtype=matrix), i: int, r: int, c: int, value: real): ...

    @wp.func_native("a.data[i].c[r] = value;\n")
    def store_vector_entry(a: wp.array(dtype=vector), i: int, r: int, value: real): ...

    return store_matrix_entry, store_vector_entry
