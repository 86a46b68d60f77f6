"""Frames without contacts on a GPU: nets that a cluster of blocks takes in one launch, and larger ones by launches."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from wsim.scene import Box, Plane, Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def net(n: int, shape=None, *, at=(0.0, 0.0, -9.0), height=0.0, velocity=(0.0, 0.0, 0.0), pinned=True) -> Scene:
    scene = Scene(fps=60.0, solver="explicit", gravity=(0.0, 0.0, -9.81), up="Z")
    body = scene.net("/net", *shapes.spring_sheet(1.0, n, up="Z"), velocities=[velocity] * n**2,
                     motion=Motion.at_place((0.0, 0.0, height)))
    if pinned:
        scene.pin("/pin", body, range(n))
    if shape is not None:
        scene.collider("/wall", shape, at=at)
    return scene


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("n", [32, 100])
def test_a_far_collider_leaves_the_bits(n, precision):
    alone, far = (Simulation(net(n, shape), device="cuda:0", precision=precision) for shape in (None, Sphere(0.5)))
    for sim in (alone, far):
        sim.run(10)
    assert far.forms == {"free": 10, "met": 0, "repeated": 0}
    for name in ("x", "e", "v", "r"):
        assert np.array_equal(getattr(alone.state, name).numpy(), getattr(far.state, name).numpy()), name


@pytest.mark.parametrize("n", [32, 100])
def test_a_thin_wall_within_a_frame_is_met(n):
    scene = net(n, Box((5.0, 5.0, 1e-3)), at=(0.0, 0.0, -0.9), velocity=(0.0, 0.0, -100.0), pinned=False)
    sim = Simulation(scene, device="cuda:0")
    sim.step()
    assert sim.forms == {"free": 0, "met": 1, "repeated": 1} and sim.positions()[:, 2].min() > -0.9


@pytest.mark.parametrize("n", [32, 100])
def test_a_net_falls_on_a_floor_as_on_a_cpu_and_a_restart_goes_on_to_the_bit(n):
    scene = replace(net(n, Plane(), at=(0.0, 0.0, 0.0), height=0.1, pinned=False), frames=14)
    cpu, gpu = (Simulation(scene, device=device, precision="float64") for device in ("cpu", "cuda:0"))
    kept = []
    for _ in range(14):
        cpu.step()
        gpu.step()
        kept.append({"/net": gpu.fields("/net")})
    assert gpu.forms == cpu.forms and gpu.forms["free"] > 3 and gpu.forms["met"] > 3
    assert np.abs(gpu.positions() - cpu.positions()).max() < 1e-9
    for frame in (2, gpu.forms["free"], 12):
        again = Simulation(scene, device="cuda:0", precision="float64")
        again.restart(frame, kept[frame - 1])
        again.run(14 - frame)
        assert np.array_equal(again.positions(), gpu.positions())
