"""How far a time step shifts what is fitted, which a fit tells beside its error bars."""

import json

import numpy as np
import pytest

import wsim
from wsim import Scene
from wsim.fitting import Settings, Track

K, MASS, TAU, FRAMES = 90.0, 1.0, 0.02, 40
W2 = K / MASS


def spring(substeps: int, integrator: str = "backward_euler") -> Scene:
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60, frames=FRAMES, solver="implicit", integrator=integrator, substeps=substeps,
                  iterations=3)
    net = scene.net("/net", np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), [[0, 1]], [K], [MASS, MASS], damping=TAU,
                    velocities=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    scene.pin("/pin", net, [0])
    return scene


def oscillator(noise: float) -> Track:
    """x = 1 + v e^(-c t) sin(f t) / f with c = w^2 tau / 2 and f^2 = w^2 - c^2."""
    t, c = np.arange(1, FRAMES + 1) / 60.0, 0.5 * W2 * TAU
    f, x = np.sqrt(W2 - c * c), np.zeros((FRAMES, 1, 3))
    x[:, 0, 0] = 1.0 + np.exp(-c * t) * np.sin(f * t) / f
    return Track("/net", np.arange(1, FRAMES + 1), x + noise * np.random.default_rng(2).normal(size=x.shape), np.array([1]))


def fitted(scene: Scene, noise: float = 1e-4):
    return wsim.fit(scene, [oscillator(noise)], "stiffness,damping", settings=Settings(device="cpu"))


def test_backward_euler_takes_its_step_from_the_damping_and_half_of_it_is_told():
    """A step of h damps an oscillator by w^2 h / 2 a second, as a damping of h does: the fit finds tau - h, and half the step
    gives h / 2 back, to first order: Gauss-Newton's step of 6 % of the damping errs by as much of itself."""
    h = 1.0 / 480.0
    found = fitted(spring(8))
    assert found.converged and found.values["damping"] == pytest.approx(TAU - h, abs=0.1 * h)
    assert found.half_step.values[1] == pytest.approx(0.5 * h, rel=0.1)
    text, said = found.text(), json.loads(json.dumps(found.as_dict()))
    assert "converged for this time step alone" in text and "half the time step shifts" in text and "damping by +" in text
    assert said["parameters"][1]["half_time_step_shift"] == found.half_step.values[1]


def test_what_is_told_is_what_a_fit_with_half_the_time_step_finds():
    """To first order in the shift, 7 % here."""
    coarse, fine = fitted(spring(8)), fitted(spring(16))
    assert coarse.half_step.values == pytest.approx(fine.estimate.values - coarse.estimate.values, rel=0.1)


def test_a_step_that_shifts_less_than_the_noise_is_no_reason_to_warn():
    found = fitted(spring(16, "bdf2"), noise=2e-3)
    text = found.text()
    assert (np.abs(found.half_step.bars) < 0.5).all() and "\nconverged after" in text and "warning: half" not in text


@pytest.mark.slow
def test_a_number_beside_a_field_is_shifted_alike():
    """The damping of the oscillator, with its stiffness as a field of one spring."""
    h = 1.0 / 480.0
    seen = oscillator(1e-4)
    seen.sigma = 1e-4
    found = wsim.fit(spring(8), [seen], "damping,stiffness[free]", settings=Settings(device="cpu"))
    bar = found.bars["damping"]
    assert found.converged and found.values["damping"][0] == pytest.approx(TAU - h, abs=0.1 * h)
    assert bar.half_time_step_shift == pytest.approx(0.5 * h, rel=0.1)
    assert found.half_step.rms > 0.5 * bar.half_time_step_shift / bar.error
    text = found.text()
    assert "converged for this time step alone" in text and "half the time step shifts it by +0.001" in text
    assert json.loads(json.dumps(found.as_dict()))["half_time_step_shift_in_error_bars"] == found.half_step.rms
