"""Points of no face or tet stay where they are, and what has faces moves as it does without them, whatever solves it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.gradient.gradients import bar
from wsim.gradient.recording import Recording
from wsim.scene import Scene, shapes
from wsim.scene.check import scene as check
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

FIRST, OTHER = 0, 9                              # points that no face has, where there are some
WAYS = (("implicit", "backward_euler", "membrane"), ("implicit", "bdf2", "springs"), ("xpbd", "backward_euler", "membrane"),
        ("explicit", "auto", "membrane"), ("explicit", "auto", "springs"), ("auto", "auto", "membrane"))


def sheet(loose: bool, solver: str, integrator: str, model: str, **more) -> tuple[Scene, np.ndarray]:
    """A sheet that hangs by two corners; its points among those of no face."""
    points, counts, indices = shapes.sheet(0.5, 0.5, 4, 4, horizontal=True)
    own = np.arange(len(points))
    if loose:
        points = np.insert(points, [FIRST, OTHER - 1], [[0.1, 0.3, 0.1], [7.0, 0.2, 0.0]], axis=0)
        own = np.setdiff1d(np.arange(len(points)), (FIRST, OTHER))
        indices = own[indices]
    scene = Scene(fps=24, frames=2, solver=solver, integrator=integrator, substeps=8, iterations=4)
    cloth = scene.cloth("/c", points, counts, indices, model=model, material=Fabric(stretch=50.0, shear=20.0), **more)
    scene.pin("/p", cloth, own[[0, 4]])
    return scene, own


@pytest.mark.parametrize("solver, integrator, model", WAYS)
def test_points_of_no_face_stay_and_change_nothing(solver, integrator, model):
    ends, energies = [], []
    for loose in (False, True):
        scene, own = sheet(loose, solver, integrator, model)
        scene.cloths[0].velocities = np.tile(np.float32([0.0, 0.0, 0.4]), (len(scene.cloths[0].points), 1))
        sim = Simulation(scene, device="cpu")
        placed = np.delete(sim.positions(), own, axis=0)
        sim.run(2)
        ends.append(sim.positions()[own])
        energies.append(sim.indicators()["kinetic_energy"])
    said = [str(p) for p in check.check_scene(scene)]
    start = scene.cloths[0].points
    assert [s for s in said if "2 points (first: 0) are in no face" in s] == said
    assert np.array_equal(np.delete(sim.positions(), own, axis=0), placed)
    assert np.abs(ends[0] - ends[1]).max() < 1e-6 < np.abs(ends[0] - start[own]).max()
    assert energies[0] == pytest.approx(energies[1], rel=1e-4)


def test_gradients_with_points_of_no_face():
    grads = []
    for loose in (False, True):
        scene, own = sheet(loose, "implicit", "backward_euler", "membrane")
        recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 1)
        seed = np.ones((len(scene.cloths[0].points), 3)) * [[0.3, 1.0, -0.5]]
        found = recording.backward({1: seed})
        grads.append([found.positions(), found.velocities(), found.masses()])
    for name, without, all_ in zip(("positions", "velocities", "masses"), *grads, strict=True):
        assert all_[own] == pytest.approx(without, rel=1e-5, abs=1e-7 * np.abs(without).max()), name
        assert np.isfinite(all_).all()


@pytest.mark.parametrize("solver", ["implicit", "explicit"])
def test_a_point_of_no_tet_that_has_a_velocity(solver):
    scene = bar("corotational", solver=solver, integrator="auto")
    soft = scene.softs[0]
    points = np.concatenate([soft.points, [[0.1, 0.4, 0.2]]]).astype(np.float32)
    scene.softs[0] = replace(soft, points=points, velocities=np.ones_like(points))
    sim = Simulation(scene, device="cpu")
    sim.run(2)
    assert np.array_equal(sim.positions()[-1], points[-1].astype(float))
    assert np.isfinite(sim.positions()).all() and np.abs(sim.positions()[:-1] - points[:-1]).max() > 0.01
