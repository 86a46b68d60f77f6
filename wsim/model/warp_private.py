"""Undocumented names of Warp that wsim uses, and ("Without") what happens if the installed Warp lacks them.

    build, codegen    modules that compile: patched while a module of ours is compiled, so that a CPU has one variant of each
                      kernel, from rewritten source (`wsim.model.compiler.variants`). Without: Warp compiles as ever, a first
                      frame takes longer
    apic.capture, apic.types, context
                      captures and argument packing, for launches recorded as bytes (`wsim.model.compiler.recorded`).
                      Without: Warp records, and recording gradients takes twice the time and the memory
    Struct, Instance  types of structs and of their values, for the same
    folder_name       folder of a module in the cache: whether it has to be compiled. Without: it is looked up by loading it
    executables       what was loaded of a module: whether it was compiled just now. Without: assumed just compiled
    symbol_address    where a name of a loaded module is, by which launches are shared among cores. Without: one core
    forget_module     makes Warp compile a module anew. Without: what the cache has is loaded once more
    compile_apart     compiles a module without loading it, for several in parallel. Without: one after the other, when loaded
    source_size       characters that a module calls, by `Adjoint`. Without: modules are compiled in the order of the plan

WSIM_PLAIN_WARP=1 leaves Warp's compiling and recording unchanged, to compare or to find a fault.
"""

import importlib
import os
from pathlib import Path
from typing import Any

import warp as wp

PLAIN = os.environ.get("WSIM_PLAIN_WARP", "0") not in ("", "0")


def private_module(name: str) -> Any:
    """A module of Warp's inside; None where it has none of that name, or plain Warp is asked for."""
    try:
        return None if PLAIN else importlib.import_module(f"warp._src.{name}")
    except ImportError:
        return None


build, codegen, context = private_module("build"), private_module("codegen"), private_module("context")
Struct: Any = getattr(codegen, "Struct", ())               # an empty tuple of types: nothing is one
Instance: Any = getattr(codegen, "StructInstance", ())


def folder_name(module: wp.Module, block: int | None) -> str | None:
    """Name of a module's folder in the cache, by its hash; None: unknown."""
    found = getattr(module, "get_module_identifier", None)
    return None if found is None else found(block)


def in_cache(module: wp.Module, block: int | None) -> bool:
    """Whether the cache has a module, as far as that is known before it is loaded."""
    name = folder_name(module, block)
    return name is not None and Path(str(wp.config.kernel_cache_dir), name).exists()


def loaded_executables(module: wp.Module) -> dict | None:
    """What was loaded of a module; None: unknown."""
    found = getattr(module, "execs", None)
    return dict(found) if isinstance(found, dict) else None


def symbol_address(executable: Any, name: str) -> int:
    """Address of a name of a module that was loaded for a CPU; 0: it has none, or that is not known."""
    path, handle = getattr(executable, "binary_path", None), getattr(executable, "handle", None)
    find = getattr(getattr(getattr(context, "runtime", None), "llvm", None), "wp_lookup", None)
    if not path or not isinstance(handle, str) or find is None or name.encode() not in Path(path).read_bytes():
        return 0
    return int(find(handle.encode(), name.encode()))


def forget_module(module: wp.Module) -> None:
    """Makes Warp forget what it knows of a module."""
    getattr(module, "mark_modified", lambda: None)()


def compile_apart(module: wp.Module, device, block: int | None) -> None:
    """Compiles a module into the cache. Raises AttributeError where this Warp cannot."""
    module._compile(device, options=module.resolved_options[block])                # of the hash that is the name of its folder


def source_size(module: wp.Module) -> int:
    """Characters of the source of a module's kernels and of all functions that they call; 0: unknown."""
    try:
        left: list[Any] = [kernel.adj for kernel in module.kernels.values()]
        seen: dict[int, int] = {}
        while left:
            adj = left.pop()
            if id(adj) not in seen:
                seen[id(adj)] = len(adj.source)
                left += [function.adj for function in adj.get_references()[2] if getattr(function, "adj", None) is not None]
        return sum(seen.values())
    except AttributeError:
        return 0
