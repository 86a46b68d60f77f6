"""Kernels of the tests are compiled one by one, each once for all modules that hold it.

A plan's module holds what its scene needs, so that hundreds of plans have most kernels in common and no module: an empty cache
took 9,953 of them, of which 1,216 differ. Here a module is loaded as parts, each the executable of one kernel, by its hash and
the options. What modules hold, their names and when they are loaded stays as in a simulation, and so do the bits. Tests that
run `wsim` in a process of its own compile whole modules; tests/physics/compiled/test_alone.py compares both in this one.

Of a function that is given to `wp.grad`, Warp 1.19 leaves adjoints of nested functions empty, without a word, where no other
kernel of the module asks for them. Here all that it calls is marked before it is compiled, and nothing else: marks stay for the
life of a process.
"""

import re
from pathlib import Path
from typing import Any

import warp as wp
from warp._src.context import ModuleExec

from wsim.kernels.math.marks import OVER_CORES
from wsim.model import kernel_cache
from wsim.model.compiler import core_team

WHOLE: list[bool] = []                # not empty: modules are compiled whole
MADE: dict[tuple, ModuleExec] = {}    # executables of one kernel each, by hash and options
PARTED: set[str] = set()              # names of modules that were loaded as parts
GRAD = re.compile(r"\bwp\.grad\((\w+)\)")
OF_SCENE = re.compile(r"wsim_(?:[0-9a-f]{12}_|report_|\w+_[0-9a-f]{12}$)")
LOAD, FOLDERS = wp.Module.load, kernel_cache._folders_of_module


class Parts(ModuleExec):
    """Executable of a module, as executables of its kernels: by hash."""

    def __init__(self, module: wp.Module, device, block_dim: int):
        super().__init__(None, module.get_module_hash(block_dim), device, {}, block_dim,
                         kernel_hashes=module.hashers[block_dim].kernel_hashes)
        options = str(sorted(module.resolved_options[block_dim].items()))
        self.parts = {kernel.get_mangled_name(kernel_hash=digest): part(kernel, digest, options, module, device, block_dim)
                      for digest, kernel in module.hashers[block_dim].unique_kernels.items()}

    def get_kernel_hooks(self, kernel) -> Any:
        name = self.get_kernel_mangled_name(kernel)
        if name not in self.kernel_hooks:
            self.kernel_hooks[name] = self.parts[name].get_kernel_hooks(kernel)
        return self.kernel_hooks[name]


def part(kernel, digest: bytes, options: str, module: wp.Module, device, block_dim: int) -> ModuleExec:
    """The executable of a kernel."""
    key = digest, options
    if key not in MADE:
        alone = wp.Module(kernel.key, None)
        alone.options, alone.defer_reference_scan = dict(module.options), True
        alone.register_kernel(kernel)
        alone.name = f"{kernel.key}_{alone.get_module_hash(block_dim).hex()[:8]}"        # of no other kernel, for LLVM
        mark_differentiated(alone, block_dim)
        MADE[key] = LOAD(alone, device, block_dim)
        if OVER_CORES in kernel.key:
            core_team.TEAM.join(MADE[key])
    return MADE[key]


def mark_differentiated(module: wp.Module, block_dim: int) -> None:
    """Marks the functions that a module differentiates by `wp.grad`, and those that they call, and no others."""
    hasher = module.hashers[block_dim]
    called = [each for f in hasher.function_hashes for each in variants(f)]
    for each in called:
        each.adj.force_adjoint_codegen = False
    named = [each.adj.resolve_external_reference(name) for each in (*hasher.unique_kernels.values(), *called)
             for name in GRAD.findall(each.adj.source)]
    todo = [each for f in named for each in variants(f)]
    while todo:
        adj = todo.pop().adj
        if not adj.force_adjoint_codegen:
            adj.force_adjoint_codegen = True
            todo += [each for f in adj.get_references()[2] for each in variants(f)]


def variants(function: wp.Function) -> list[wp.Function]:
    """A function with its overloads; nothing of one that is Warp's own."""
    return [each for each in (function, *function.user_overloads.values(), *function.user_templates.values()) if each.adj]


def load(module: wp.Module, device, block_dim: int | None = None, *files, **more) -> ModuleExec:
    """Instead of Warp's `Module.load`: modules of several kernels that are not Warp's own, and of one that are named after a
    scene or after what a scene needs, are loaded as parts: scenes that need different things may have one code."""
    device = wp.get_device(device)
    block = module.options["block_dim"] if block_dim is None else block_dim
    single = len(module._live_kernels) < 2 and not OF_SCENE.match(module.name)
    if not device.is_cpu or single or WHOLE or files or more or module.name.startswith("warp"):
        return LOAD(module, device, block_dim, *files, **more)
    made, digest = module.execs.get((None, block)), module.get_module_hash(block)
    if made is None or made.module_hash != digest:
        made = module.execs[None, block] = Parts(module, device, block)
        PARTED.add(module.name)
    return made


def folders(name: str) -> list[Path]:
    """Of a module in the cache, as `wsim.model.kernel_cache` looks for them; none of one that has none: among thousands of
    others that takes milliseconds."""
    return [] if name in PARTED else FOLDERS(name)
