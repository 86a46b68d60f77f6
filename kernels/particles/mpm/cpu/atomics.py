"""Counters that threads of a CPU share, by Clang's atomics: Warp's are none on a CPU. Outside of a CPU they do nothing."""

from functools import cache
from types import SimpleNamespace

import warp as wp

RAISE = """
#if !defined(__CUDA_ARCH__)
    typedef {real} R;
    R* at = array.data + i;
    R now = *at;
    while (now < value && !__atomic_compare_exchange(at, &now, &value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED));
#endif
"""


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    return __atomic_fetch_add(array.data + i, value, __ATOMIC_RELAXED);
#else
    return 0;
#endif
""")
def shared_add(array: wp.array(dtype=int), i: int, value: int) -> int:
    """Adds to an entry; returns what it was."""
    ...


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __atomic_compare_exchange_n(array.data + i, &old, value, false, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED);
    return old;
#else
    return 0;
#endif
""")
def shared_swap(array: wp.array(dtype=wp.int64), i: int, old: wp.int64, value: wp.int64) -> wp.int64:
    """Writes an entry if it is `old`; returns what it was."""
    ...


@wp.func_native(RAISE.format(real="int"))
def shared_raise(array: wp.array(dtype=int), i: int, value: int):
    """Makes an entry at least `value`."""
    ...


@cache
def real_raise(real):
    """Function (array, i, value) of floating-point numbers, as `shared_raise`."""
    @wp.func_native(RAISE.format(real="float" if real is wp.float32 else "double"))
    def shared_raise_real(array: wp.array(dtype=real), i: int, value: real): ...

    return shared_raise_real


SHARED = SimpleNamespace(add=shared_add, swap=shared_swap, raise_int=shared_raise)
