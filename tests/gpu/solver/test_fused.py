"""Many substeps in one launch of a cluster or a grid of blocks: the bits of launch by launch, twice the same, and the motion of
the CPU. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.motion.fused.kernel_fusion import SCENES
from wsim.model.launches import KernelLaunches
from wsim.physics.motion.fused import domain_decomposition, kernel_fusion
from wsim.physics.motion.fused.source import CLUSTER, GRID, LaunchShape

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
SHAPES = {"cluster": LaunchShape(CLUSTER, 8, 256), "grid": LaunchShape(GRID, 24, 128)}


def end(name: str, precision: str, frames: int = 4):
    sim = wsim.Simulation(SCENES[name](), device="cuda:0", precision=precision)
    for _ in range(frames):
        sim.step()
    return sim.state.x.numpy(), sim.model.fuser


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", SCENES)
def test_one_launch_leaves_the_bits(name, shape, precision, monkeypatch):
    monkeypatch.setattr(KernelLaunches, "fuses", True)
    # sheets in float32 have a march: test_sheets.py
    monkeypatch.setattr(domain_decomposition, "shared_elements", lambda *_: None)
    monkeypatch.setattr(kernel_fusion, "shape_of", lambda device, widest: SHAPES[shape])
    x, fused = end(name, precision)
    assert fused.launched > 0, fused.why
    again, _ = end(name, precision)
    assert np.array_equal(x, again)
    monkeypatch.setattr(kernel_fusion.Fuser, "kernel", lambda self, steps: None)          # the same plan, launch by launch
    apart, fused = end(name, precision)
    rounding = 1e-16 if precision == "float64" and name in ("cube", "jelly") else 0.0   # sums of tets are contracted otherwise
    assert fused.launched == 0 and np.abs(x - apart).max() <= rounding
    sim = wsim.Simulation(SCENES[name](), device="cpu", precision=precision)
    for _ in range(4):
        sim.step()
    near = 1e-7 if name == "mesh" else 1e-9         # Warp looks for the nearest face in float32, in which devices round apart
    assert np.abs(x - sim.state.x.numpy()).max() < (2e-5 if precision == "float32" else near)
