"""Marks of kernels and functions: properties that other code relies on.

    own      there is one thread a point, and of the arrays that change it reads and writes only the entries of its own point.
             Several such kernels may follow each other without a barrier (wsim/physics/motion/fused/persistent_kernel.py)
    whole    a launch writes every entry of its outputs that is read later. On a tape (wsim/model/tape.py) the outputs need not
             start as copies of their old values
    over cores   a thread writes what no other thread of the launch reads or writes, but for sums and extremes of integers, of
             which it does not use the result; no tiles. Several cores of a CPU may then share the launch, with the same bits
             (wsim/model/compiler/core_sharing.py)
    called   a function that stands by itself on a GPU, too (wsim/model/compiler/variants.py): a long one with few bytes given.
             Compilers put functions in wherever they are called, and again where they cut a loop in two. With hulls,
             rigid_collide takes NVRTC 41 CPU-s so, and 20 where the manifold of a pair is called

`scratch(shape=..., dtype=...)` is `wp.zeros` of a thread without the zeros: every entry is written before it is read. A box
on a box wrote 14 KB of zeros, three times over (`wsim.model.compiler.source`).
"""

import warp as wp

scratch = wp.zeros
OVER_CORES = "_over_cores"      # in the names of kernels, which are part of what the cache of kernels goes by


def owns_points(kernel):
    """Marks a kernel: a thread touches only the entries of its own point."""
    kernel.own = 1
    return kernel


def writes_all(kernel):
    """Marks a kernel: a launch writes all of its outputs."""
    kernel.whole = True
    return kernel


def kernel_over_cores(function, name: str, module) -> wp.Kernel:
    """A kernel without adjoint, marked: several cores of a CPU may share a launch."""
    return wp.kernel(function, name=name + OVER_CORES, module=module, enable_backward=False)


def standalone_function(function):
    """Marks a function of Warp: it stands by itself, on every device."""
    function.inline_hint = "called"
    return function
