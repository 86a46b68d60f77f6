"""How Warp is asked to compile kernels: from rewritten source, on the CPU each once and in parts.

Warp 1.19 compiles a second variant of most CPU kernels, for arrays without gaps: a third of the time to compile a scene, the
same bits, 0 to 5 % of run time. Its configuration has no word for it, so its question whether a kernel may have one is answered
here, while a module of ours is loaded. Where Warp has no such question, or compiles by other names, nothing is changed
(`wsim.model.warp_private`).

Functions that stand by themselves, `wp.func(inline=False)`, are long ones: those of a pair of bodies and of a contact of
rigid bodies, and passes over islands of joints. Put into what calls them, as Warp has all functions, they make kernels of such
a size that LLVM takes up to twice as long: it simplifies what is called at three levels once for each. The bits are the same,
and since structs go by reference (`wsim.model.compiler.source`) a call costs no copy. On a GPU, where a call spills what
registers hold, those alone do that are marked `called` (wsim/kernels/math/marks.py): the word is left out for others.
"""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import warp as wp

from wsim.model.compiler import header, source
from wsim.model.warp_private import PLAIN, build, codegen

QUESTION = "cpu_linear_contiguous_specialization_candidate"
WORDS, APART, CALLED = "_INLINE_ATTRS", "noinline", "called"
BUILD, BUILD_CUDA = "build_cpu", "build_cuda"
IN_PLACE = 70                    # compute capability from which a kernel may read its arguments where they are given
TOLD: list[str] = []             # not empty: this process has been told that its Warp is not as known here


@contextmanager
def single_variant(cpu: bool = True) -> Iterator[None]:
    """Modules that are compiled inside have one variant of each kernel; functions stand by themselves on a CPU alone."""
    answer, words = getattr(codegen, QUESTION, None), getattr(codegen, WORDS, None)
    compiled, for_cuda = getattr(build, BUILD, None), getattr(build, BUILD_CUDA, None)
    known = ((QUESTION, answer), (WORDS, words), (BUILD, compiled), (BUILD_CUDA, for_cuda))
    lacking = [name for name, has in known if has is None]
    if lacking and not PLAIN:
        warn_once(f"lacks {', '.join(lacking)}")
    if answer is not None:
        setattr(codegen, QUESTION, lambda adj, block_dim: False)
    if words is not None and APART in words:
        setattr(codegen, WORDS, {w: code for w, code in words.items() if cpu or w != APART} | {CALLED: words[APART]})
    if compiled is not None:
        setattr(build, BUILD, partial(compile_rewritten, compiled))
    if for_cuda is not None:
        setattr(build, BUILD_CUDA, partial(compile_rewritten_cuda, for_cuda))
    try:
        yield
    finally:
        if for_cuda is not None:
            setattr(build, BUILD_CUDA, for_cuda)
        if compiled is not None:
            setattr(build, BUILD, compiled)
        if answer is not None:
            setattr(codegen, QUESTION, answer)
        if words is not None:
            setattr(codegen, WORDS, words)


def compile_rewritten(compiled, obj_path, cpp_path, *args, **more) -> None:
    """Compiles what `wsim.model.compiler.source` makes of a module's source; the source itself, where that does not compile."""
    given, short = Path(cpp_path), Path(f"{cpp_path}.{os.getpid()}.cpp")
    text = given.read_text(encoding="utf-8")
    if header.INCLUDES not in text or not source.HEAD.search(text):
        warn_once("writes the source of kernels in another form")
    try:
        code = source.rewrite_functions(text)
        how: dict[str, Any] = {}
        if not header.CALLED.search(text):
            kept = more.get("pch_dir") if header.KEPT and more.get("use_precompiled_headers") else None
            code, how = header.with_precompiled_header(code, more.get("extra_flags", ""), kept)
        short.write_text(code, encoding="utf-8")
        compiled(obj_path, str(short), *args, **more | how)
    except OSError:
        raise
    except Exception:
        compiled(obj_path, cpp_path, *args, **more)
        warn_once(f"does not compile {given.stem} as wsim rewrites it")
    finally:
        short.unlink(missing_ok=True)


def compile_rewritten_cuda(compiled, cu_path, arch, output_path, **more) -> None:
    """As `compile_rewritten`, for a GPU of compute capability `arch`; a header has no part in that."""
    given, short = Path(cu_path), Path(f"{cu_path}.{os.getpid()}.cu")
    if arch < IN_PLACE:
        return compiled(cu_path, arch, output_path, **more)
    try:
        short.write_text(source.rewrite_functions(given.read_text(encoding="utf-8")), encoding="utf-8")
        compiled(str(short), arch, output_path, **more)
    except OSError:
        raise
    except Exception:
        compiled(cu_path, arch, output_path, **more)
        warn_once(f"does not compile {given.stem} for a GPU as wsim rewrites it")
    finally:
        short.unlink(missing_ok=True)


def warn_once(why: str) -> None:
    """Warns that kernels are compiled as Warp writes them: the first time in a process. why: what this Warp does otherwise."""
    if not TOLD:
        TOLD.append(why)
        warnings.warn_explicit(f"Warp {wp.__version__} {why}: first frames take longer, results are the same; install "
                               "warp-lang==1.19.*, or set WSIM_PLAIN_WARP=1 to rewrite nothing", RuntimeWarning, "wsim", 1)
