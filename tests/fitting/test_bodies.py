"""Fits of rigid bodies: how they were thrown, from where markers on them were seen."""

import numpy as np
import pytest

import wsim
from wsim.fitting import Markers, Track
from wsim.physics.rigid.objects import Body
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation

VELOCITY, SPIN = np.array([2.0, -0.5, 4.0]), np.array([1.0, 6.0, 0.5])


def thrown(velocity=VELOCITY, spin=SPIN, drag: float = 0.2) -> Scene:
    scene = Scene(gravity=(0.0, 0.0, -9.81), fps=60.0, frames=20, substeps=4)
    scene.add(Body("/racket", mass=0.4, center=(0.1, 0.0, 0.0), inertia=(0.5, 1.0, 1.4), velocity=velocity, spin=spin,
                   drag=drag, spin_drag=0.1))
    return scene


def seen(noise: float = 0.0) -> Markers:
    sim, poses, frames = Simulation(thrown(), device="cpu", precision="float64"), [], np.arange(2, 21, 2)
    for frame in range(1, 21):
        sim.step()
        if frame in frames:
            poses.append(sim.plan.ports.bodies.placed("/racket")[0])
    found = Markers.of("/racket", frames, np.array(poses), size=0.3)
    found.positions += noise * np.random.default_rng(4).normal(size=found.positions.shape)
    return found


def test_a_throw_is_found_from_markers_with_error_bars():
    """Noise of a millimetre, four markers, ten frames: truths lie within four error bars, and those are small."""
    result = wsim.fit(thrown(0.7 * VELOCITY, 0.8 * SPIN, 0.1), [seen(1e-3)], "velocity,spin,drag")
    truth = {**{f"velocity_{a}": v for a, v in zip("xyz", VELOCITY, strict=True)},
             **{f"spin_{a}": w for a, w in zip("xyz", SPIN, strict=True)}, "drag": 0.2}
    assert result.converged and result.values.keys() == truth.keys()
    for name, value in truth.items():
        assert abs(result.values[name] - value) < 4.0 * result.errors[name]
        assert result.errors[name] < (0.1 if name == "drag" else 0.02)
    assert result.sigma == pytest.approx(1e-3, rel=0.2)
    (body,) = result.scene.things("Body")
    assert body.velocity[0] == result.values["velocity_x"] and body.drag == result.values["drag"]


def test_without_noise_a_throw_is_found_exactly():
    result = wsim.fit(thrown(0.7 * VELOCITY, 0.8 * SPIN), [seen()], "velocity,spin")
    found = np.array(list(result.values.values()))
    assert np.abs(found - [*VELOCITY, *SPIN]).max() < 1e-6


def test_markers_of_what_is_no_rigid_body_are_refused():
    for wrong in (Markers("/other", [3], np.zeros((1, 1, 3))), Markers("/racket", [3], np.zeros((1, 2, 3))),
                  Track("/racket", [3], np.zeros((1, 1, 3)))):
        with pytest.raises(SceneError, match=wrong.path):
            wsim.fit(thrown(), [wrong], "velocity")
