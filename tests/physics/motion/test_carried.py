"""Pins and colliders carried by splines with one key a second: what they carry converges with the order of the integrator."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.motion.carried import FPS, FRAMES, LENGTH, OMEGA, PLACES, TIMES, carried
from wsim.scene import Box, Scene, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}


def exact(damping: float, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Place and velocity of the free point at the end, from key to key by SciPy."""
    integrate = pytest.importorskip("scipy.integrate")
    path, g = Curve(TIMES, PLACES, kind), np.array([0.0, -9.81, 0.0])
    state, end = np.array([0.0, -0.6, 0, 0, 0, 0]), FRAMES / FPS
    for a, b in zip(TIMES[:-1], np.minimum(TIMES[1:], end), strict=True):
        def rate(t: float, y: np.ndarray, a=a, b=b) -> np.ndarray:
            d, inside = y[:3] - path.at(t), min(max(t, a + 1e-12), b - 1e-12)       # velocities may jump at keys
            n = d / np.linalg.norm(d)
            pull = (d - LENGTH * n) + damping * np.dot(n, y[3:] - path.rate(inside)[0]) * n
            return np.concatenate([y[3:], g - OMEGA**2 * pull])
        state = integrate.solve_ivp(rate, (a, b), state, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    return state[:3], state[3:]


@pytest.mark.parametrize(("integrator", "solver", "order", "least", "damping", "kind"), first_and_slow([
    ("rk4", "explicit", 4, 8, 0.0, "catmull_rom"), ("rk4", "explicit", 4, 8, 0.0, "linear"),
    ("midpoint", "explicit", 2, 8, 0.02, "catmull_rom"), ("leapfrog", "explicit", 2, 8, 0.0, "catmull_rom"),
    ("backward_euler", "xpbd", 1, 64, 0.0, "catmull_rom"), ("bdf2", "implicit", 2, 16, 0.02, "catmull_rom"),
    ("implicit_midpoint", "implicit", 2, 8, 0.02, "catmull_rom"),
    ("sdirk3", "implicit", 3, 8, 0.0, "catmull_rom")]))
def test_what_hangs_on_a_spline_converges_with_the_order_of_the_integrator(integrator, solver, order, least, damping, kind):
    x, v = exact(damping, kind)
    errors = []
    for substeps in (least, 2 * least, 4 * least):
        sim = Simulation(carried(substeps, integrator, solver, damping, kind), **DOUBLE)
        sim.run(FRAMES)
        errors.append((np.abs(sim.positions("/net")[1] - x).max(), np.abs(sim.velocities("/net")[1] - v).max()))
    seen = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert seen[-1].min() > order - 0.25, (errors, seen)
    path, at = Motion.through(TIMES, PLACES, kind=kind), FRAMES / FPS
    np.testing.assert_allclose(sim.velocities("/net")[0], path.velocities(at)[0][0], atol=1e-12)       # of the pinned point
    np.testing.assert_allclose(sim.positions("/net")[0], path.at(at)[:3, 3], atol=1e-12)


def table(substeps: int, integrator: str, solver: str, way: np.ndarray) -> Simulation:
    """A point that lies on a rough table, carried along `way`."""
    scene = Scene(fps=FPS, frames=FRAMES, substeps=substeps, integrator=integrator, solver=solver)
    scene.net("/net", [[0.0, 0.5, 0], [0.5, 0.5, 0]], [[0, 1]], [1e-9], [1.0], static_friction=2.0, dynamic_friction=2.0)
    scene.collider("/table", Box((5.0, 0.5, 5.0)), motion=Motion.through(TIMES, way), static_friction=2.0, dynamic_friction=2.0,
                   thickness=0.0)
    return Simulation(scene, **DOUBLE)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "solver", "order"), [("leapfrog", "explicit", 2), ("backward_euler", "xpbd", 1),
                                                            ("bdf2", "xpbd", 1)])
@pytest.mark.parametrize("axis", [0, 1], ids=["along", "up"])
def test_velocities_and_impulses_of_a_carried_table_converge_to_those_of_its_curve(integrator, solver, order, axis):
    """The impulse that the point has got is m (v + g t): along by friction, up by the contact itself."""
    way = np.zeros((4, 3))
    way[:, axis] = 0.0, 0.4, -0.3, 0.5                         # at most 6.8 m/s^2 in between: it stays on the table
    curve, errors = Motion.through(TIMES, way), []
    for substeps in (8, 16, 32):
        sim = table(substeps, integrator, solver, way)
        off = []
        for frame in range(FRAMES):
            sim.step()
            if frame not in (9, 10, 19, 20):                   # where the curve's acceleration jumps
                off.append(np.abs(sim.velocities("/net")[0] - curve.velocities(sim.time)[0][0]).max())
        errors.append(max(off))
    seen = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert errors[-1] < 0.05 and seen.min() > order - 0.2, (errors, seen)


@pytest.mark.parametrize("turns", [False, True])
def test_targets_of_many_times_are_those_of_one_after_the_other_to_the_bit(turns):
    M = np.tile(np.eye(4), (3, 1, 1))
    M[:, :3, 3] = [[0.0, 0.0, 0.0], [0.3, 0.1, 0.0], [0.0, 0.5, 0.2]]
    if turns:
        M[1, :3, :3], M[2, :3, :3] = ([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]],
                                      [[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, -0.6, 0.8]])
    scene = Scene()
    cloth = scene.cloth("/cloth", *shapes.sheet(0.4, 0.3, 5, 4))
    scene.pin("/hand", cloth, range(7), motion=Motion([0.0, 0.3, 1.0], M))
    (pin,) = Simulation(scene, device="cpu").plan.ports.pins.groups["hard"]
    times = np.linspace(-0.1, 1.1, 61)
    assert np.array_equal(pin.table(times), np.stack([pin.targets(t) for t in times])) and np.ptp(pin.table(times)[:, 0]) > 0.1
