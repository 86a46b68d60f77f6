"""Kernels of the tests are compiled one by one, each once for all modules that hold it.

A plan's module holds what its scene needs, so that hundreds of plans have most kernels in common and no module: an empty cache
took 9,953 of them, of which 1,216 differ. Here a module is loaded as parts, each the executable of one kernel, by its hash and
the options. What modules hold, their names and when they are loaded stays as in a simulation, and so do the bits. Tests that
run `wsim` in a process of its own compile whole modules; tests/physics/compiled/test_alone.py compares both in this one.

Modules that call `wp.grad` stay whole: Warp 1.19 leaves the adjoints of nested functions empty, without a word, where no other
kernel of the module asks for them.
"""

import re
from pathlib import Path
from typing import Any

import warp as wp
from warp._src.context import ModuleExec

from wsim.model import kernel_cache

WHOLE: list[bool] = []                # not empty: modules are compiled whole
MADE: dict[tuple, ModuleExec] = {}    # executables of one kernel each, by hash and options
PARTED: set[str] = set()              # names of modules that were loaded as parts
GRAD = "wp.grad("
OF_SCENE = re.compile("wsim_(?:[0-9a-f]{12}_|report_)")
LOAD, FOLDERS = wp.Module.load, kernel_cache._folders


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
        for function in functions(alone, block_dim):
            function.adj.force_adjoint_codegen = False           # left by a `wp.grad` of another module
        MADE[key] = LOAD(alone, device, block_dim)
    return MADE[key]


def functions(module: wp.Module, block_dim: int) -> list[wp.Function]:
    """What the kernels of a module call."""
    return [each for f in module.hashers[block_dim].function_hashes
            for each in (f, *f.user_overloads.values(), *f.user_templates.values()) if each.adj]


def graded(module: wp.Module, block_dim: int) -> bool:
    """Whether a kernel of a module, or a function that one calls, calls `wp.grad`."""
    kernels = module.hashers[block_dim].unique_kernels.values()
    return any(GRAD in each.adj.source for each in (*kernels, *functions(module, block_dim)))


def load(module: wp.Module, device, block_dim: int | None = None, *files, **more) -> ModuleExec:
    """Instead of Warp's `Module.load`: modules of several kernels that are not Warp's own, and of one that are named after a
    scene, are loaded as parts."""
    device = wp.get_device(device)
    block = module.options["block_dim"] if block_dim is None else block_dim
    single = len(module._live_kernels) < 2 and not OF_SCENE.match(module.name)
    if not device.is_cpu or single or WHOLE or files or more or module.name.startswith("warp"):
        return LOAD(module, device, block_dim, *files, **more)
    made, digest = module.execs.get((None, block)), module.get_module_hash(block)
    if made is None or made.module_hash != digest:
        if graded(module, block):
            return LOAD(module, device, block_dim)
        made = module.execs[None, block] = Parts(module, device, block)
        PARTED.add(module.name)
    return made


def folders(name: str) -> list[Path]:
    """Of a module in the cache, as `wsim.model.kernel_cache` looks for them; none of one that has none: among thousands of
    others that takes milliseconds."""
    return [] if name in PARTED else FOLDERS(name)
