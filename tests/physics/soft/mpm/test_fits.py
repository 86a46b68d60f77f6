"""Fits of material points: stiffness of a jelly and friction angle of sand, from tracks of particles with noise of 1 mm."""

import numpy as np
import pytest

import wsim
from wsim import Box, Plane, Scene, SceneError, Simulation, Track
from wsim.physics.mpm.objects import Granular, Jelly

SIGMA = 1e-3


def falling(young, density=1000.0):
    scene = Scene(fps=60.0, frames=12)
    scene.collider("/floor", Plane("Y"))
    scene.mpm("/body", Box((0.1, 0.1, 0.1)), at=(0, 0.15, 0), cell=0.05, velocity=(0, -1.0, 0),
              material=Jelly(young, density=density))
    return scene


def column(angle):
    scene = Scene(fps=60.0, frames=16)
    scene.collider("/floor", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    scene.mpm("/body", Box((0.1, 0.2, 0.1)), at=(0, 0.2, 0), cell=0.05, material=Granular(young=1e5, friction_angle=angle))
    return scene


def tracked(scene, sigma=SIGMA):
    simulation = Simulation(scene, device="cpu", precision="float64")
    method = simulation.plan.method("mpm")
    seen = np.array([method.read_particles(0)["x"] for _ in simulation.frames()])
    return [Track("/body", range(1, scene.frames + 1), seen + np.random.default_rng(0).normal(0.0, sigma, seen.shape))]


@pytest.mark.parametrize("make, name, true, start", [(falling, "young", 2e4, 5e4), (column, "friction_angle", 0.5, 0.2)])
def test_a_start_two_and_a_half_times_off_finds_the_value_within_its_error_bars(make, name, true, start):
    found = wsim.fit(make(start), tracked(make(true)), name)
    assert found.converged and abs(found.values[name] - true) < 4.0 * found.errors[name] < 0.01 * true
    assert found.sigma == pytest.approx(SIGMA, rel=0.05)


def test_a_falling_body_tells_the_ratio_of_stiffness_to_density_alone():
    found = wsim.fit(falling(3e4, 1200.0), tracked(falling(2e4)), "young,density")
    assert any("only the ratio" in words for words in found.estimate.words) or not np.isfinite(found.errors["density"])


def test_numbers_that_a_law_has_not_are_no_parameters():
    with pytest.raises(SceneError, match="nothing here has friction_angle"):
        wsim.fit(falling(2e4), tracked(falling(2e4)), "friction_angle")
