"""How Warp is asked to compile kernels: on the CPU each once and in parts, on a GPU as ever.

Warp 1.19 compiles a second variant of most CPU kernels, for arrays without gaps: a third of the time to compile a scene, the
same bits, 0 to 5 % of run time. Its configuration has no word for it, so its question whether a kernel may have one is answered
here, while a module of ours is loaded. Where Warp has no such question, nothing is changed.

Functions that stand by themselves, `wp.func(inline=False)`, are long ones that are called seldom: those of a pair of bodies,
once a frame, and passes over islands of joints. Put into what calls them, as Warp has all functions, they make kernels of such
a size that LLVM takes up to half as long again. The bits are the same. A call copies the structs that it gives (4 kB of a Rig,
0.1 us): what a contact calls in each sweep does not stand by itself. On a GPU, where a call spills what registers hold, none
does: the word is left out there.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from warp._src import build, codegen

from wsim.model.compiler import source

QUESTION = "cpu_linear_contiguous_specialization_candidate"
WORDS, APART = "_INLINE_ATTRS", "noinline"


@contextmanager
def single(cpu: bool = True) -> Iterator[None]:
    """Modules that are compiled inside have one variant of each kernel; functions stand by themselves on a CPU alone."""
    answer, words = getattr(codegen, QUESTION, None), getattr(codegen, WORDS, None)
    compiled = build.build_cpu
    if answer is not None:
        setattr(codegen, QUESTION, lambda adj, block_dim: False)
    if words is not None and not cpu:
        setattr(codegen, WORDS, {word: code for word, code in words.items() if word != APART})
    build.build_cpu = partial(_rewritten, compiled)
    try:
        yield
    finally:
        build.build_cpu = compiled
        if answer is not None:
            setattr(codegen, QUESTION, answer)
        if words is not None:
            setattr(codegen, WORDS, words)


def _rewritten(compiled, obj_path, cpp_path, *args, **more) -> None:
    """Compiles the source that `wsim.model.compiler.source` makes of that of a module, and leaves it in its place."""
    with open(cpp_path, encoding="utf-8") as file:
        given = file.read()
    with open(cpp_path, "w", encoding="utf-8") as file:
        file.write(source.shorter(given))
    compiled(obj_path, cpp_path, *args, **more)
