"""Normal drag of fabrics and contacts of a cloth's edges, on a GPU: the motion of a CPU, and bits that repeat. Skipped where
there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Motion, Scene, shapes
from wsim.scene.fabric import fabric
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
SOLVERS = {"leapfrog": dict(solver="explicit"), "xpbd": dict(solver="xpbd", substeps=20),
           "newton": dict(solver="implicit", substeps=10, iterations=3)}


def hung(solver: str) -> Scene:
    """A cotton sheet that swings down from two corners, in its own drag of the air."""
    scene = Scene(**SOLVERS[solver])
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 16, 16, horizontal=True), material=fabric("cotton"))
    scene.pin("/pin", "/cloth", [0, 16])
    return scene


def laid(solver: str, body: bool) -> Scene:
    """A cotton sheet that falls on a box whose edges lie between its points; body: the box is a rigid body on another box."""
    scene = Scene(**SOLVERS[solver])
    scene.cloth("/cloth", *shapes.sheet(0.6, 0.6, 12, 12, horizontal=True, at=(0.0, 0.12, 0.0)), material=fabric("cotton"))
    box = Box((0.17, 0.1, 0.17))
    if body:
        scene.collider("/floor", Box((1.0, 0.1, 1.0)), at=(0.0, -0.2, 0.0))
        scene.add(Body("/box", [Collider("/box/shape", box)], Motion.still(np.eye(4)), mass=5.0))
    else:
        scene.collider("/box", box)
    return scene


def compared(scene: Scene, frames: int) -> float:
    """Largest distance [m] from the run of a CPU; twice the same bits."""
    found = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        sim = Simulation(scene, device=device)
        sim.run(frames)
        found.append(sim.positions("/cloth"))
    assert np.array_equal(found[1], found[2]) and np.isfinite(found[1]).all()
    return float(np.abs(found[0] - found[1]).max())


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_cloth_in_its_own_drag_goes_as_on_a_cpu(solver):
    assert compared(hung(solver), 4) < 1e-4


@pytest.mark.parametrize("solver", ["leapfrog", "xpbd"])
def test_edges_of_a_cloth_meet_a_box_as_on_a_cpu(solver):
    """Half a frame behind the first contact: on a CPU float32 and float64 part by 0.01 mm there (leapfrog) and 0.15 (XPBD)."""
    assert compared(laid(solver, body=False), 2) < 3e-4


def test_a_rigid_box_does_not_stand_out_of_a_cloth():
    """Points and rounding part soon; by points alone 14 mm and more stand out."""
    sim = Simulation(laid("leapfrog", body=True), device="cuda:0")
    sim.run(12)
    assert sim.report(profile=False)["error"]["penetration"] < 1e-3
