"""Experiments that share some of the parameters, and fits whose copies take turns."""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import grid
from wsim.fitting.fit import Settings, fit
from wsim.fitting.observations.observe import Track
from wsim.scene import Scene, SceneError, Sphere
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

WINDS = (1.0, 3.0)
HOW = {"xpbd": {"integrator": "backward_euler", "substeps": 4, "iterations": 3},
       "implicit": {"integrator": "bdf2", "substeps": 2},
       "explicit": {"integrator": "leapfrog", "substeps": 50}}


def hung(solver: str = "xpbd", wind: float = 0.0, stretch: float = 300.0, **more) -> Scene:
    """A cloth of 16 points that is held at two of them in a wind, beside a ball."""
    scene = Scene(solver=solver, wind=(wind, 0.0, 0.0), **HOW[solver] | more)
    cloth = scene.cloth("/cloth", *grid(), material=Fabric(stretch=stretch, bend=1e-4), model="springs", drag=1.0)
    scene.pin("/pin", cloth, points=[0, 3])
    scene.collider("/ball", Sphere(0.25), at=(0.5, -0.45, 0.5))
    return scene


def seen(scene: Scene, frames=(2, 5, 8)) -> list[Track]:
    found: list[np.ndarray] = []
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.plan.clock.touching = True
    sim.run(max(frames), lambda s: found.append(s.positions()))
    return [Track("/cloth", list(frames), np.array([found[f - 1] for f in frames]), sigma=1e-4)]


def together(shared, solver: str = "xpbd", **more):
    one, other = (seen(hung(solver, wind)) for wind in WINDS)
    begun = hung(solver, stretch=200.0, wind=2.0)
    return fit(begun, one, "stretch,wind_x", also=[(replace(begun), other)],
               settings=Settings(device="cpu", shared=shared, **more))


def test_what_is_shared_and_what_is_of_each_are_found_together():
    """One fabric in two winds."""
    found = together(("stretch",))
    assert found.converged and list(found.values) == ["stretch", "wind_x@1", "wind_x@2"]
    assert found.values["stretch"] == pytest.approx(300.0, rel=1e-3)
    assert [found.values[f"wind_x@{k}"] for k in (1, 2)] == pytest.approx(WINDS, rel=1e-3)
    assert [s.wind[0] for s in found.scenes] == pytest.approx(WINDS, rel=1e-3)
    assert {s.cloths[0].material.stretch for s in found.scenes} == {found.values["stretch"]}
    assert [p.get("experiment") for p in found.as_dict()["parameters"]] == [None, 1, 2]


def test_a_wind_that_two_experiments_are_said_to_share_fits_neither():
    found = together(None)
    assert list(found.values) == ["stretch", "wind_x"] and found.misfit > 10.0


def test_what_two_experiments_know_of_what_they_share_is_more_than_one_does():
    alone = fit(hung(wind=2.0), seen(hung(wind=WINDS[0])), "stretch,wind_x", settings=Settings(device="cpu"))
    assert together(("stretch",)).errors["stretch"] < 0.9 * alone.errors["stretch"]


def test_a_name_that_is_not_fitted_cannot_be_shared():
    with pytest.raises(SceneError, match="bend: is shared and not fitted; fitted are stretch, wind_x"):
        together(("bend",))
    with pytest.raises(SceneError, match="there is one experiment"):
        fit(hung(), seen(hung()), "stretch", settings=Settings(device="cpu", shared=("stretch",)))


@pytest.mark.parametrize("solver", list(HOW))
def test_copies_that_take_turns_give_the_same_fit_to_the_bit(solver):
    """Seven copies of two experiments at once, and three at a time, by contacts in every frame."""
    whole, parts = (together(("stretch",), solver, copies=copies) for copies in (None, 3))
    assert np.array_equal(whole.estimate.theta, parts.estimate.theta)
    assert np.array_equal(whole.estimate.singular, parts.estimate.singular)
    assert (whole.steps, whole.simulations, whole.residuals) == (parts.steps, parts.simulations, parts.residuals)
