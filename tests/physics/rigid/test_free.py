"""Free motion of rigid bodies against SciPy's answers and closed forms."""

from functools import cache

import numpy as np
import pytest

from tests.physics.rigid.pairs import WHERE
from wsim.geometry import rotation
from wsim.physics.rigid.objects import Body
from wsim.scene import Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

MOMENTS = (1.0, 2.0, 3.0)
RACKET = (0.01, 10.0, 0.01)         # [rad/s] about the middle axis, nearly


def body(**more) -> Body:
    return Body("/World/body", **{"mass": 2.0, "center": np.zeros(3), "inertia": MOMENTS} | more)


def simulation(thing: Body, frames_a_second: float, substeps: int, precision: str = "float64", gravity=(0.0, 0.0, 0.0)):
    scene = Scene(gravity=gravity, fps=frames_a_second, substeps=substeps)
    scene.add(thing)
    return Simulation(scene, **WHERE, precision=precision)


@cache
def turned(spin: tuple, moments: tuple, time: float, start=(0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    """Orientation after `time` [s], by SciPy to 1e-12: the quaternion and the body's angular velocity."""
    J = np.array(moments)

    def rates(t, y):
        q, w = y[:4], y[4:]
        return np.concatenate([0.5 * rotation.quat_product(q, np.append(w, 0.0)), -np.cross(w, J * w) / J])
    w = rotation.quat_rotate(rotation.quat_conjugate(np.array(start)), np.array(spin))
    solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
    found = solve_ivp(rates, (0.0, time), np.concatenate([start, w]), method="DOP853", rtol=1e-13, atol=1e-13)
    return rotation.unit_quat(found.y[:4, -1])


def angle(p: np.ndarray, q: np.ndarray) -> float:
    return float(np.linalg.norm(rotation.quaternion_logarithm(rotation.quat_product(rotation.unit_quat(p),
                                                                                    rotation.quat_conjugate(q)))))


@pytest.mark.parametrize("precision, energy, momentum, degrees", [("float32", 1e-4, 1e-5, 1.0), ("float64", 6e-6, 1e-12, 0.2)])
def test_a_tennis_racket_turns_as_it_should_for_ten_seconds(precision, energy, momentum, degrees):
    sim = simulation(body(spin=RACKET), 240.0 / 8.0, 8, precision)
    method = sim.plan.method("rigid")
    L, E = method.get("L")[0], sim.indicators()["rigid_energy"]
    worst = 0.0
    for _ in range(300):
        sim.step()
        worst = max(worst, abs(sim.indicators()["rigid_energy"] / E - 1.0))
    assert worst < energy
    assert np.linalg.norm(method.get("L")[0] - L) < momentum * np.linalg.norm(L)
    assert np.degrees(angle(method.turns()[0], turned(RACKET, MOMENTS, 10.0))) < degrees


def test_rotation_is_of_second_order():
    errors = []
    for n in (16, 32, 64):
        sim = simulation(body(spin=(3.0, 2.0, 1.0)), 1.0, n)
        sim.run(1)
        errors.append(angle(sim.plan.method("rigid").turns()[0], turned((3.0, 2.0, 1.0), MOMENTS, 1.0)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - 2.0) < 0.1)


def test_three_equal_moments_turn_exactly_in_any_step():
    sim = simulation(body(inertia=(2.0, 2.0, 2.0), spin=(1.0, 2.0, 2.0)), 1.0, 1)
    sim.run(2)
    expected = rotation.quaternion_exponential(2.0 * np.array([1.0, 2.0, 2.0]))
    assert angle(sim.plan.method("rigid").turns()[0], expected) < 1e-14


def test_a_symmetric_top_precesses_at_the_rate_of_its_closed_form():
    """Its axis goes around L at |L| / I_1, at a fixed angle to it."""
    spin = np.array([2.0, 0.0, 5.0])
    sim = simulation(body(inertia=(1.0, 1.0, 1.8), spin=spin), 100.0, 4)
    method = sim.plan.method("rigid")
    L = method.get("L")[0]
    sim.run(100)
    axis = method.poses()[0][:3, 2]
    around = rotation.axis_rotation_matrix(L / np.linalg.norm(L), np.linalg.norm(L) / 1.0)
    assert np.abs(axis - around[:, 2]).max() < 2e-4


def test_a_throw_is_a_parabola_and_drag_is_exponential():
    """Half the kick before a step and half behind it: exact for a constant force, in any step."""
    sim = simulation(body(velocity=(1.0, 5.0, 0.0), force=(4.0, 0.0, 0.0)), 10.0, 1, gravity=(0.0, -9.81, 0.0))
    sim.run(10)
    assert np.abs(sim.plan.method("rigid").poses()[0][:3, 3] - (1.0 + 1.0, 5.0 - 0.5 * 9.81, 0.0)).max() < 1e-13
    sim = simulation(body(velocity=(1.0, 0.0, 0.0), drag=2.0, spin=(0.0, 0.0, 3.0), spin_drag=1.0), 10.0, 1)
    sim.run(10)
    method = sim.plan.method("rigid")
    assert abs(method.velocities()[0, 0] - np.exp(-2.0)) < 1e-14 and abs(method.spins()[0, 2] - 3.0 * np.exp(-1.0)) < 1e-13


def test_a_torque_along_a_principal_axis_speeds_up_at_torque_over_moment():
    sim = simulation(body(torque=(0.0, 0.0, 6.0)), 10.0, 3)
    sim.run(10)
    method = sim.plan.method("rigid")
    assert abs(method.spins()[0, 2] - 2.0) < 1e-13
    assert angle(method.turns()[0], rotation.quaternion_exponential(np.array([0.0, 0.0, 1.0]))) < 1e-13


def test_a_body_far_from_the_origin_loses_nothing():
    """Its frame leads to its own centre: float32 is that of the displacement."""
    M = np.eye(4)
    M[:3, 3] = 1.0e5, 3.0, 2.0
    sim = simulation(body(motion=Motion.still(M), velocity=(0.1, 0.0, 0.0), center=(0.5, 0.0, 0.0)), 100.0, 4, "float32")
    sim.run(100)
    assert abs(sim.plan.method("rigid").poses()[0][0, 3] - 1.0e5 - 0.1) < 1e-7


def test_live_values_act_from_the_next_frame_on():
    sim = simulation(body(), 10.0, 2)
    sim.set("/World/body", "velocity", (1.0, 0.0, 0.0))
    sim.set("/World/body", "force", (0.0, 2.0, 0.0))
    sim.run(10)
    assert np.abs(sim.plan.method("rigid").poses()[0][:3, 3] - (1.0, 0.5, 0.0)).max() < 1e-13
