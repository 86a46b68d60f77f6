"""Marks of kernels: they say of a kernel's threads what others rely on.

    own      of all that changes, a thread touches only what belongs to its own point, and there is one thread a point: several
             such kernels may follow each other without a wait between (wsim/physics/fused/program.py)
    whole    a launch writes every entry of its outputs that is read later: on a tape (wsim/model/tape.py) they need not start
             as copies of what they were
"""


def own(kernel):
    """The kernel, marked: threads touch only what is their own."""
    kernel.own = 1
    return kernel


def whole(kernel):
    """The kernel, marked: launches write all of their outputs."""
    kernel.whole = True
    return kernel
