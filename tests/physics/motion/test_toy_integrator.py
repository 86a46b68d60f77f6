"""An implicit integrator is a row of a table, and a file where no class of wsim steps so: two toys step with no line of wsim
changed, under Newton's method and under XPBD, as their closed forms say.

A mass on a spring along its axis is x'' = -omega^2 x to the bit of the law, so that one linear solve is a step.
"""

import numpy as np
import pytest

from tests.make.rows.two_step import ROW as TWO_STEP
from tests.make.rows.two_step import C
from wsim.physics.solver import newton
from wsim.scene import Scene, SceneError
from wsim.scene.integrator import TABLE, Integrator
from wsim.simulation.simulation import Simulation

PART, OMEGA, START, FRAMES = 0.55, 10.0, 0.2, 12
THETA = Integrator("theta", 1, "every h", g=PART, nodes=(PART,), met=(1e-2, 1e-3), title="the theta method",
                   motion="wsim.physics.motion.points.ProlongedEuler")


@pytest.fixture(params=("implicit", "xpbd"))
def solver(request, monkeypatch):
    monkeypatch.setattr(newton, "TOLERANCE", 1e-13)
    for row in (THETA, TWO_STEP):
        monkeypatch.setitem(TABLE, row.name, row)
    return request.param


def swing(solver: str, integrator: str, substeps: int) -> np.ndarray:
    """Displacement [m] and velocity [m/s] at the end of each frame, (FRAMES + 1, 2)."""
    scene = Scene(solver=solver, integrator=integrator, fps=60.0, substeps=substeps, iterations=3, gravity=(0.0, 0.0, 0.0))
    net = scene.net("/net", [[0.0, 0.0, 0.0], [1.0 + START, 0.0, 0.0]], [[0, 1]], [OMEGA**2], [1.0, 1.0], lengths=[1.0])
    scene.pin("/pin", net, [0])
    sim, found = Simulation(scene, device="cpu", precision="float64"), [(START, 0.0)]
    for _ in range(FRAMES):
        sim.step()
        found.append((sim.positions()[1, 0] - 1.0, sim.velocities()[1, 0]))
    assert sim.plan.integrator == integrator and not sim.warnings
    return np.array(found)


def theta(h: float, steps: int) -> np.ndarray:
    """Displacements by the closed form R^n, R = (1 + (1 - theta) z)/(1 - theta z), z = i omega h."""
    z = 1j * OMEGA * h
    return (START * ((1.0 + (1.0 - PART) * z) / (1.0 - PART * z))**np.arange(steps + 1)).real


def two_step(h: float, steps: int) -> np.ndarray:
    """Displacements by the recursion: V = v + c (v - u) - g omega^2 X, X = x + c s + g V; the first is of backward Euler."""
    x, v, s, u, found = START, 0.0, 0.0, 0.0, [START]
    for step in range(steps):
        c = C if step else 0.0
        g, base, speed = (1.0 - c) * h, x + c * s, v + c * (v - u)
        V = (speed - g * OMEGA**2 * base) / (1.0 + (g * OMEGA)**2)
        s, u, v = base + g * V - x, v, V
        x += s
        found.append(x)
    return np.array(found)


@pytest.mark.parametrize("name, form", [("theta", theta), ("two_step", two_step)])
def test_a_toy_steps_as_its_closed_form_says(solver, name, form):
    substeps = 2
    wanted = form(1.0 / (60.0 * substeps), FRAMES * substeps)[::substeps]
    np.testing.assert_allclose(swing(solver, name, substeps)[:, 0], wanted, atol=1e-10 * START)


@pytest.mark.parametrize("name", ["theta", "two_step"])
def test_the_observed_order_of_a_toy_is_the_declared_one(solver, name):
    exact = START * np.cos(OMEGA * FRAMES / 60.0)
    errors = [abs(swing(solver, name, substeps)[-1, 0] - exact) for substeps in (16, 32, 64)]
    assert -np.polyfit(np.log([1, 2, 4]), np.log(errors), 1)[0] == pytest.approx(TABLE[name].order, abs=0.1)


def test_theta_damps_by_its_factor(solver):
    """|R|^n of the amplitude sqrt(x^2 + (v / omega)^2), of which the midpoint keeps all."""
    z = 1j * OMEGA / 120.0
    factor = abs((1.0 + (1.0 - PART) * z) / (1.0 - PART * z))
    for name, wanted in (("theta", factor), ("implicit_midpoint", 1.0)):
        x, v = swing(solver, name, 2)[-1]
        assert np.hypot(x, v / OMEGA) / START == pytest.approx(wanted**(2 * FRAMES), rel=1e-9)


def test_a_toy_that_misses_its_residual_gives_way(solver, monkeypatch):
    monkeypatch.setitem(TABLE, "theta", Integrator("theta", 1, "", g=PART, nodes=(PART,), met=(-1.0, -1.0), title="the toy",
                                                   motion=THETA.motion))
    scene = Scene(solver=solver, integrator="theta", fps=60.0, substeps=2, iterations=3)
    scene.pin("/pin", scene.net("/net", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0, 1]], [100.0], [1.0, 1.0]), [0])
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.step()
    assert sim.plan.integrator == "backward_euler" and "the residual that the toy needs" in sim.warnings[0]


def test_without_its_row_a_toy_is_no_integrator():
    with pytest.raises(SceneError, match="two_step"):
        Simulation(Scene(solver="implicit", integrator="two_step"), device="cpu")
