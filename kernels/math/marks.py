"""Marks of kernels: properties that other code relies on.

    own      there is one thread a point, and of the arrays that change it reads and writes only the entries of its own point.
             Several such kernels may follow each other without a barrier (wsim/physics/fused/program.py)
    whole    a launch writes every entry of its outputs that is read later. On a tape (wsim/model/tape.py) the outputs need not
             start as copies of their old values
"""


def own(kernel):
    """Marks a kernel: a thread touches only the entries of its own point."""
    kernel.own = 1
    return kernel


def whole(kernel):
    """Marks a kernel: a launch writes all of its outputs."""
    kernel.whole = True
    return kernel
