"""Compilation in parallel of modules that the cache lacks: Clang and NVRTC run without Python's lock, so that a first frame of
several modules waits for the longest of them. They are loaded afterwards, one by one, by
`wsim.model.kernel_cache.load_kernel_module`, which records them in the cache, and says what was wrong with one that did not
compile. The longest come first: Python writes their sources one after another, 3 s of them for a humanoid, and a GPU's compiler
takes longest for them. (`wp.force_load` has threads too, for modules of one number of threads a block; those of a plan have
several on a GPU.)

Clang takes 2.1 s for the own module of a cape and 1.8 s for the four modules of its report, which later scenes share. With a
second free core the first frame comes up to 1.5 times sooner (5.4 CPU-s in all). Dominoes on an H200 gained nothing (21.5 s in
parallel, 20.7 s one after the other).
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import warp as wp

from wsim.model import kernel_cache, warp_private
from wsim.model.compiler import variants


def compile_all(modules: Mapping[str, int | None], device) -> None:
    """Compiles modules for a device, if there are several that the cache lacks. modules: threads of a block of each, by name,
    which a CPU does not ask for. Raises SceneError where the cache takes nothing."""
    with kernel_cache.GATE.alone():
        blocks = {wp.get_module(name): 1 if device.is_cpu else block for name, block in modules.items()}
        lacking = {module: block for module, block in blocks.items() if not warp_private.in_cache(module, block)}
        if len(lacking) < 2 or wp.config.use_precompiled_headers:            # of which each thread would make its own
            return
        kernel_cache.probe_cache_folder()
        with variants.single_variant(device.is_cpu), ThreadPoolExecutor(min(len(lacking), os.cpu_count() or 1)) as threads:
            for module in sorted(lacking, key=warp_private.source_size, reverse=True):
                threads.submit(_compile_one_module, module, device, lacking[module])


def _compile_one_module(module, device, block: int | None) -> None:
    with suppress(Exception):
        warp_private.compile_apart(module, device, block)
