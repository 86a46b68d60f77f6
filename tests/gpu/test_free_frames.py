"""Frames without contacts on a GPU: nets that a cluster of blocks takes in one launch, and larger ones by launches."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.gpu.free_frames import net
from wsim.scene import Box, Plane, Sphere, Surface, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("n", [32, 100])
def test_a_far_collider_leaves_the_bits(n, precision):
    alone, far = (Simulation(net(n, shape), device="cuda:0", precision=precision) for shape in (None, Sphere(0.5)))
    for sim in (alone, far):
        sim.run(10)
    assert far.forms == {"free": 10, "met": 0, "repeated": 0}
    for name in ("x", "e", "v", "r"):
        assert np.array_equal(getattr(alone.state, name).numpy(), getattr(far.state, name).numpy()), name


def swelling(size: float, more: float) -> Surface:
    points, counts, corners = shapes.sphere(size, 8)
    grown = np.array([points * (1.0 + more / size * (k % 2)) for k in range(4)])
    return Surface(points, counts, corners, Curve(0.5 * np.arange(4), grown))


def ways(kind: str, low: float, high: float) -> Motion:
    """To and fro between two heights [m] in a second, turning, or by a name with no bound of its own."""
    turns = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.6, 0.0, 0.8], [0.0, 0.0, 0.6, 0.8]])
    how = {"easing": "bounce-out"} if kind == "eased" else {}
    return Motion.through(0.5 * np.arange(3), [(0.0, 0.0, z) for z in (low, high, low)], turns, kind, **how)


MOVING = [("linear", Box((0.3, 0.3, 0.4))), ("catmull_rom", Surface(*shapes.sphere(0.3, 8))), ("eased", Sphere(0.3)),
          ("linear", swelling(0.2, 0.1))]


@pytest.mark.parametrize("solver", ["explicit", "xpbd"])
@pytest.mark.parametrize(("kind", "shape"), MOVING)
def test_a_collider_that_moves_far_away_leaves_the_bits_and_is_outlined_as_on_a_cpu(kind, shape, solver):
    scene, more = net(32, shape, motion=ways(kind, -9.0, -8.0), solver=solver), {"precision": "float64"}
    alone, far = (Simulation(s, device="cuda:0", **more) for s in (net(32, solver=solver), scene))
    host = Simulation(scene, device="cpu", **more)
    for _ in range(10):
        for sim in (alone, far, host):
            sim.step()
        here, there = (sim.plan.method("contact").clearance for sim in (host, far))
        assert np.array_equal(here.outline.now.numpy(), there.outline.now.numpy())
        np.testing.assert_allclose(there.room.numpy(), here.room.numpy(), atol=1e-9)
    assert far.forms == {"free": 10, "met": 0, "repeated": 0} and np.array_equal(alone.positions(), far.positions())


@pytest.mark.parametrize(("kind", "shape"), MOVING)
def test_a_collider_that_comes_near_is_met_as_on_a_cpu(kind, shape):
    scene = net(32, shape, motion=ways(kind, -3.0, -0.3), gravity=(0.0, 0.0, 0.0))
    cpu, gpu = (Simulation(scene, device=device, precision="float64") for device in ("cpu", "cuda:0"))
    while cpu.forms["met"] < 4:                          # what touches for longer makes more of a rounding
        cpu.step()
        gpu.step()
    assert gpu.forms == cpu.forms and gpu.forms["free"] > 3
    assert np.abs(gpu.positions() - cpu.positions()).max() < 1e-9


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
