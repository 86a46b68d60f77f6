"""What several test files share: a small cloth as arrays, a scene that holds one; how kernels are compiled."""

import gc
import os
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from tests.make.suite import alone, every_shape, hashes
from tests.make.suite.slow import SLOW
from wsim.kernels.rigid.lists import collide, collide_mesh
from wsim.model import kernel_cache
from wsim.model.compiler import core_team, header
from wsim.model.model import Model
from wsim.scene import Scene

FEW = 6               # files: below, one process is enough


def pytest_xdist_auto_num_workers(config):
    """Of `-n auto`, which pyproject.toml asks for: one process for a few files, else one for each core."""
    named = {str(word).partition("::")[0] for word in config.args}
    if config.args_source != pytest.Config.ArgsSource.TESTPATHS and all(n.endswith(".py") for n in named) and len(named) < FEW:
        return 0
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Reading 300 files, pytest rewrites their assertions: trees without garbage, and looking for it takes a third of that.
    What is there then stays, and kernels are trees too: Python looks less often."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(5_000, 10, 20)
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Marks what a table of measured times names, before `-m` chooses."""
    here = Path(__file__).parent
    for item in items:
        test, _, row = item.name.partition("[")
        rows = SLOW.get(item.path.relative_to(here).as_posix(), {}).get(test)
        if rows is not None and (not rows or row[:-1] in rows):
            item.add_marker(pytest.mark.slow)


def first_and_slow(rows) -> list:
    """Rows of a parametrised test of which every run takes the first, and `pytest -m slow` the others."""
    first, *others = (row if hasattr(row, "values") and not isinstance(row, dict) else
                      pytest.param(*(row if isinstance(row, tuple) else (row,))) for row in rows)
    return [first, *(pytest.param(*row.values, marks=pytest.mark.slow, id=row.id) for row in others)]


@pytest.fixture(scope="session", autouse=True)
def compiling(pytestconfig):
    """A process of the tests makes hundreds of modules, so that they are compiled as is soonest done. Kernels land under other
    hashes than those of a simulation, and do the same to the last bit.

    header    Warp's precompiled header, of modules with a backward pass: each after the first is 1.5 s cheaper. Others have a
              header of their own (`wsim.model.compiler.header`), precompiled likewise: 0.3 s. A simulation does without: for
              the few modules of a user's process it costs more than it saves.
    strides   Warp compiles most kernels for a CPU twice, the second time for arrays without gaps. `wsim.model.variants` leaves
              that out of the modules of a simulation, and this of those that tests make.
    alone     Each kernel is compiled once for all modules that hold it, see `tests.make.suite.alone`. The cache then has no
              folder of a simulation's module, and is asked each time whether it takes 8 MB: here it is asked for a page.
    hashes    Functions that modules have in common are hashed once, see `tests.make.suite.hashes`.
    every_shape   Rigid contacts are compiled for all kinds of shapes at once, see `tests.make.suite.every_shape`.
    """
    load = Model.load

    def with_header(model: Model) -> None:
        wp.config.use_precompiled_headers = True               # Simulation.load puts back what it found
        load(model)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Model, "load", with_header)
        patch.setattr(wp.Module, "load", alone.load)
        patch.setattr(hashes.ModuleHasher, "hash_adjoint", hashes.hash_adjoint)
        patch.setattr(header, "KEPT", True)
        patch.setattr(kernel_cache, "PROBE", 4096)
        if os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1") != "1":            # they share the cores
            patch.setattr(core_team, "MOST", 1)
        patch.setattr(kernel_cache, "_folders_of_module", alone.folders)
        if pytestconfig.option.markexpr == "not slow" and not wp.is_cuda_available():     # one for all is dearer there
            patch.setattr(collide, "pair_manifold_kernel", every_shape.collide_all)
            patch.setattr(collide_mesh, "collide_mesh", every_shape.collide_mesh_all)
        patch.setattr("warp._src.codegen.cpu_linear_contiguous_specialization_candidate", lambda adj, block_dim: False,
                      raising=False)
        yield


def grid(side: int = 4, size: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """side x side points on a square of `size` [m] in the x-z plane, with counts and indices of its quads."""
    s = np.linspace(0.0, size, side, dtype=np.float32)
    points = np.stack([np.repeat(s, side), np.zeros(side * side, np.float32), np.tile(s, side)], axis=1)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1)
    indices = np.stack([corner, corner + 1, corner + side + 1, corner + side], axis=1).reshape(-1)
    return points, np.full(len(corner), 4, np.int32), indices.astype(np.int32)


@pytest.fixture
def scene() -> Scene:
    """A cloth of 4 x 4 points, 1 m wide, pinned at two corners."""
    scene = Scene(frames=2, substeps=2, iterations=2)
    cloth = scene.cloth("/cloth", *grid())
    scene.pin("/pin", cloth, points=[0, 3])
    return scene
