"""Worlds on a GPU have the bits of one alone, by every solver, launch by launch: how many threads take a launch changes no sum.
Frames of sheets and tets that one world alone takes in one launch (kernels/motion/fused/march.py) differ by rounding, and by
when the air acts; nets have the bits of one alone there, too."""

import numpy as np
import pytest
import warp as wp

from tests.physics.contact.selfcontact.rig import crumple
from wsim.model.launches import KernelLaunches
from wsim.scene import Scene, Sphere, shapes
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
WORLDS = 260           # of 400 points: beyond every size at which launches of points, springs or colours change
HOW = {"xpbd": {"solver": "xpbd", "integrator": "backward_euler", "substeps": 4, "iterations": 3},
       "bdf2": {"solver": "xpbd", "integrator": "bdf2", "substeps": 8, "iterations": 12},
       "newton": {"solver": "implicit", "integrator": "bdf2", "substeps": 2, "iterations": 2},
       "leapfrog": {"solver": "explicit", "integrator": "leapfrog", "substeps": 160},
       "rk4": {"solver": "explicit", "integrator": "rk4", "substeps": 160}}


def sheet(how: str, model: str, n: int = 20, ball: bool = False, **more) -> Scene:
    scene = Scene(**HOW[how])
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, n - 1, n - 1), model=model, material=Fabric(stretch=300.0, **more))
    scene.pin("/pin", cloth, [0, n - 1])
    if ball:
        scene.collider("/ball", Sphere(0.3), at=(0.1, -0.4, 0.05))
    return scene


def blown(how: str, model: str = "membrane") -> Scene:
    """With hinges, damping, drag and wind."""
    scene = sheet(how, model, bend=1e-4, damping=1e-4)
    scene.cloths[0].drag, scene.wind = 1.0, (1.0, 0.0, 0.5)
    return scene


def block(how: str) -> Scene:
    scene = Scene(**HOW[how])
    points, tets = shapes.block((1.0, 1.0, 1.0), (6, 6, 6))
    scene.soft("/block", points, tets, material=Bulk(young=2e4, damping=0.01))
    scene.pin("/wall", scene.softs[0], np.flatnonzero(points[:, 0] < -0.49))
    return scene


def differ(scene: Scene, worlds: int = WORLDS, frames: int = 6, values=("stretch", 150.0, 300.0)) -> float:
    """Largest distance of three worlds, each with a value of its own, from runs alone [m]. By BDF2 all have the same: where one
    leaves a residual, all go on by backward Euler."""
    path = scene.bodies()[0].path
    name, low, high = values
    low = high if scene.integrator == "bdf2" else low
    given = np.linspace(low, high, worlds)
    many = Simulation(scene, device="cuda:0", worlds=worlds)
    many.plan.clock.touching = True
    many.set(path, name, list(given), range(worlds))
    many.run(frames)
    most = 0.0
    for world in (0, worlds // 2, worlds - 1):
        alone = Simulation(scene, device="cuda:0")
        alone.plan.clock.touching = True
        alone.set(path, name, float(given[world]))
        alone.run(frames)
        most = max(most, float(np.abs(alone.positions(path) - many.positions(path, world)).max()))
        assert np.abs(alone.positions(path) - scene.bodies()[0].points).max() > 1e-3
    return most


@pytest.mark.parametrize("how", list(HOW))
@pytest.mark.parametrize("ball", [False, True])
def test_nets(how, ball):
    """By a cluster of blocks a world, by launches, by a block a world, by conjugate gradients; contacts in every frame."""
    assert differ(sheet(how, "springs", bend=0.0, ball=ball)) == 0.0


@pytest.mark.parametrize("how", ["xpbd", "newton", "leapfrog"])
def test_membranes_hinges_damping_and_wind(monkeypatch, how):
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    assert differ(blown(how)) == 0.0


def test_worlds_of_more_points_than_a_cluster_takes():
    scene = sheet("leapfrog", "springs", 100, bend=0.0)
    scene.substeps = 400
    assert differ(scene, 12, 3) == 0.0


@pytest.mark.parametrize("how", ["newton", "leapfrog"])
def test_soft_bodies(monkeypatch, how):
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    assert differ(block(how), values=("young", 1e4, 2e4)) == 0.0


def test_sheets_that_meet_themselves():
    assert differ(crumple(3), 70, values=("density", 0.1, 0.2)) == 0.0


def test_a_choice_that_nobody_named():
    scene = sheet("xpbd", "springs", bend=0.0)
    scene.solver = scene.integrator = "auto"
    assert differ(scene) == 0.0
