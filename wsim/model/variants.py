"""Kernels of the CPU, each compiled once.

Warp 1.19 compiles a second variant of most, for arrays without gaps: a third of the time to compile a scene, the same bits,
0 to 5 % of run time. Its configuration has no word for it, so its question whether a kernel may have one is answered here,
while a module of ours is loaded. Where Warp has no such question, nothing is changed.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from warp._src import codegen

QUESTION = "cpu_linear_contiguous_specialization_candidate"


@contextmanager
def single() -> Iterator[None]:
    """Modules that are compiled inside have one variant of each kernel."""
    answer = getattr(codegen, QUESTION, None)
    if answer is None:
        yield
        return
    setattr(codegen, QUESTION, lambda adj, block_dim: False)
    try:
        yield
    finally:
        setattr(codegen, QUESTION, answer)
