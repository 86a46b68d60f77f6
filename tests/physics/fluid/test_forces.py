"""Accelerations of the air that an author gives: flows with a closed form, in files, set while they run."""

import numpy as np
import pytest

from tests.physics.fluid.flows import PERIODIC, TURN, box, method
from wsim.scene import SceneError
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

N, A, NU = 32, 0.7, 0.3


def rows(n: int = N) -> np.ndarray:
    """Kolmogorov's force, A sin y along x, at the cells' centres."""
    y = TURN / n * (np.arange(n) + 0.5)
    f = np.zeros((n, n, 1, 3))
    f[..., 0] = A * np.sin(y)[None, :, None]
    return f


def moved(**more) -> Simulation:
    sim = Simulation(box((N, N), seconds=1.0, frames=4, sides=more.pop("sides", PERIODIC), steps=4, **more), device="cpu")
    sim.run()
    return sim


@pytest.mark.parametrize("scheme", ["reflection", "cubic", "maccormack"])
def test_kolmogorovs_flow_is_driven_to_its_speed(scheme):
    """u = A / nu (1 - exp(-nu t)) sin y: it carries itself along its own rows. Backward steps of 1/16 s: nu dt / 2 off."""
    sim = moved(acceleration=rows(), viscosity=NU, advection=scheme)
    u = method(sim).arrays(0)["u"][..., 0]
    y = TURN / N * (np.arange(N) + 0.5)
    expected = A / NU * (1.0 - np.exp(-NU)) * np.sin(y)
    assert np.abs(u - expected).max() <= NU / 32.0 * np.abs(expected).max()
    assert np.abs(method(sim).arrays(0)["v"]).max() < 1e-6


@pytest.mark.parametrize("more", [{}, {"vorticity": 0.1}, {"smoke": np.ones((N, N, 1)), "weight": 0.5}])
def test_all_of_a_periodic_box_falls_and_what_is_closed_stands(more):
    sim = moved(acceleration=(0.3, -0.2, 5.0), **more)
    now = method(sim).arrays(0)
    assert now["u"] == pytest.approx(0.3, rel=1e-5) and now["v"] == pytest.approx(-0.2, rel=1e-5)
    still = moved(acceleration=(0.3, -0.2, 5.0), sides=("closed",) * 6, **more)
    assert max(np.abs(method(still).arrays(0)[name]).max() for name in "uv") < 1e-5


def test_a_force_is_set_while_it_runs():
    sim = Simulation(box((N, N), seconds=1.0, frames=4, sides=PERIODIC, steps=1, acceleration=(0.0, 0.0, 0.0)), device="cpu")
    sim.step()
    sim.set("/fluid", "acceleration", rows())
    sim.step()
    sim.set("/fluid", "acceleration", np.zeros(3))
    sim.step()
    y = TURN / N * (np.arange(N) + 0.5)
    assert method(sim).arrays(0)["u"][3, :, 0] == pytest.approx(0.25 * A * np.sin(y), abs=1e-5)
    with pytest.raises(SceneError, match=r"/fluid: acceleration has shape \(2,\); allowed are finite numbers \(3,\) or"):
        sim.set("/fluid", "acceleration", np.zeros(2))
    with pytest.raises(SceneError, match="acceleration"):
        Simulation(box((N, N), sides=PERIODIC), device="cpu").set("/fluid", "acceleration", np.zeros(3))


@pytest.mark.parametrize("given", [(0.5, 0.25, -1.0), rows()])
def test_a_file_keeps_it(given, tmp_path):
    scene = box((N, N), sides=PERIODIC, acceleration=given)
    save(scene, tmp_path / "s.usda")
    (back,) = load(tmp_path / "s.usda").things("Fluid")
    assert np.shape(back.acceleration) == np.shape(given) and np.allclose(back.acceleration, given, rtol=1e-6)


@pytest.mark.parametrize(("more", "said"), [
    ({"acceleration": np.zeros((N, N, 3))}, "acceleration has shape"),
    ({"acceleration": np.full(3, np.nan)}, "acceleration holds NaN"),
    ({"acceleration": np.ones(3), "margin": 0.5, "sides": ("open",) * 6}, "all of it is accelerated")])
def test_what_cannot_push_is_said(more, said):
    assert any(said in str(problem) for problem in check_scene(box((N, N), **{"sides": PERIODIC} | more)))
