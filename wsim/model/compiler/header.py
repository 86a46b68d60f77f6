"""Warp's header without adjoints, for modules that call none.

Clang reads 45,000 lines of header for each module, and most of its time (0.9 CPU-s) goes into adjoints that macros make for
each type: `adj_smoothstep` alone resolves hundreds of overloads. Without them it takes 0.3. What is left out is found in the
text of the installed Warp: functions whose name begins with `adj_`, but for those of atomics, which others use. A process that
compiles dozens of modules precompiles the header once (KEPT, 0.5 s), which saves 0.3 s a module. For a few modules that does
not pay.
"""

import re
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

NATIVE = Path(wp.__file__).parent / "native"
INCLUDES = '#include "builtin.h"\n#include "deterministic.h"\n'
CALLED = re.compile(r"\bwp::adj_(?!atomic)")             # by a backward pass, or by the adjoint of a function for `wp.grad`
KEPT = False             # whether this process keeps it precompiled
INCLUDE = re.compile(r'\s*#\s*include\s+"([^"]+)"')
ADJOINT = re.compile(r"(?:template\s*<[^{};()]*>[\s\\]*)?"
           r"(?:(?:inline|static|CUDA_CALLABLE|CUDA_CALLABLE_DEVICE|WP_NOINLINE)[\s\\]+)+void[\s\\]+adj_(?!atomic)\w+[\s\\]*\(")
NEXT = re.compile(r"[\s\\]*(.)", re.S)
PAIRS = {"(": re.compile(r"[()]"), "{": re.compile(r"[{}]")}


def with_lean_header(text: str) -> str:
    """The source of a module with the header put in where it is included; as it is, where it is included otherwise."""
    return text.replace(INCLUDES, lean_header_text(), 1)


def with_precompiled_header(text: str, flags: str, place: str | None) -> tuple[str, dict[str, Any]]:
    """The source of a module without the header, and what Warp's compiler is to be told so that it finds that precompiled, or
    leaves it so, in a place of this process; the source alone, where the header is included otherwise. flags: of the compiler.
    """
    folder = Path(place or "", "lean")
    if not place or INCLUDES not in text or re.search(r"\s", str(folder)):            # flags are parted at blanks
        return with_lean_header(text), {"use_precompiled_headers": False}
    if not (folder / "builtin.h").exists():
        folder.mkdir(exist_ok=True)
        (folder / "builtin.h").write_text(lean_header_text(), encoding="utf-8")        # Warp precompiles what has this name
    return text.replace(INCLUDES, "", 1), {"extra_flags": f"{flags} -iquote {folder}", "pch_dir": str(folder)}


@cache
def lean_header_text() -> str:
    """Text of Warp's header and of all that it includes, without adjoints."""
    lines: list[str] = []
    _inline_included_headers(INCLUDES.splitlines(), set(), lines)
    return without_adjoints("\n".join(lines)) + "\n"


def _inline_included_headers(given: list[str], seen: set[str], lines: list[str]) -> None:
    """Lines with each header in the place where it is first included."""
    for line in given:
        found = INCLUDE.match(line)
        if found and (NATIVE / found[1]).is_file():
            if found[1] not in seen:
                seen.add(found[1])
                _inline_included_headers((NATIVE / found[1]).read_text(encoding="utf-8").splitlines(), seen, lines)
        elif line.strip() != "#pragma once":
            lines.append(line)


def without_adjoints(text: str) -> str:
    """C++ without the functions that are adjoints, also those in macros."""
    parts, at = [], 0
    for head in ADJOINT.finditer(text):
        if head.start() < at:
            continue
        end = _closing_bracket(text, head.end(), "(")
        after = NEXT.match(text, end) if end else None
        end = after.end() if after and after[1] == ";" else _closing_bracket(text, after.end(),
                                                                             "{") if after and after[1] == "{" else 0
        if end:
            parts.append(text[at:head.start()])
            at = end
    return "".join([*parts, text[at:]])


def _closing_bracket(text: str, at: int, opened: str) -> int:
    """Place behind the bracket that closes one that was opened before `at`; 0: there is none."""
    depth = 1
    for found in PAIRS[opened].finditer(text, at):
        depth += 1 if found[0] == opened else -1
        if not depth:
            return found.end()
    return 0
