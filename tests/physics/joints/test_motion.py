"""Joints against closed forms, conserved quantities and an integration in reduced coordinates."""

import numpy as np
import pytest

from tests.physics.joints.make import G, coordinates, errors, places, rod, start
from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import (
    Drive,
    Joint,
    fixed_joint,
    joint_between,
    locked_limits_except,
    prismatic_joint,
    revolute_joint,
    spherical_joint,
)

ANGLE = np.radians(80.0)


def pendulum(precision: str, substeps: int, inertia: float = 0.02):
    body = rod("/b", (np.sin(ANGLE), -np.cos(ANGLE), 0.0), moments=(0.01, inertia, inertia))
    return start(body, revolute_joint("/j", None, body, axis=(0.0, 0.0, 1.0)), precision=precision, substeps=substeps)


def quarter(modulus: float) -> float:
    """Complete elliptic integral K(k), by the arithmetic-geometric mean."""
    a, b = 1.0, np.sqrt(1.0 - modulus**2)
    while abs(a - b) > 1e-15:
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    return np.pi / (2.0 * a)


def period(sim, seconds: float) -> float:
    """Twice the mean time between passes through the lowest point."""
    angle = []
    for _ in range(int(seconds * 60.0)):
        sim.step()
        x, y, _ = places(sim)[0]
        angle.append(np.arctan2(x, -y))
    t, s = np.arange(1, len(angle) + 1) / 60.0, np.array(angle)
    k = np.flatnonzero(np.sign(s[1:]) != np.sign(s[:-1]))
    zero = t[k] - s[k] * (t[k + 1] - t[k]) / (s[k + 1] - s[k])
    return 2.0 * float(np.mean(np.diff(zero)))


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_pendulum_of_80_degrees_has_the_period_of_its_elliptic_integral(precision):
    exact = 4.0 * quarter(np.sin(0.5 * ANGLE)) / np.sqrt(G / 1.02)
    sim = pendulum(precision, 8)
    assert abs(period(sim, 8.0) / exact - 1.0) < 1e-5
    assert max(errors(sim)) < (1e-12 if precision == "float64" else 1e-9)


def test_a_pendulum_converges_with_order_two():
    ends = []
    for substeps in (2, 4, 8, 64):
        sim = pendulum("float64", substeps)
        sim.run(60)
        ends.append(places(sim)[0])
    off = [np.linalg.norm(p - ends[-1]) for p in ends[:-1]]
    rates = np.log2(np.array(off[:-1]) / off[1:])
    assert np.abs(rates - 2.0).max() < 0.05, (off, rates)


def test_a_conical_pendulum_keeps_its_height_and_turns_at_the_rate_of_its_cone():
    """omega^2 L cos a = g."""
    a, L = np.radians(35.0), 0.8
    omega = np.sqrt(G / (L * np.cos(a)))              # a ball: its spin along the axis of the cone has no torque
    body = rod("/b", (L * np.sin(a), -L * np.cos(a), 0.0), moments=(0.03, 0.03, 0.03), spin=(0.0, omega, 0.0),
               velocity=(0.0, 0.0, -omega * L * np.sin(a)))
    sim = start(body, spherical_joint("/j", None, body))
    sim.run(90)
    x, y, z = places(sim)[0]
    turned = omega * 1.5
    assert abs(y + L * np.cos(a)) < 1e-5
    wanted = L * np.sin(a) * np.array([np.cos(turned), -np.sin(turned)])
    assert np.abs(np.array([x, z]) - wanted).max() < 2e-4 and errors(sim)[0] < 1e-12


def double(t: np.ndarray) -> np.ndarray:
    """Angles from below of two rods of length 1 (mass 1, inertia 0.1 about the middle) that start level, by SciPy."""
    scipy = pytest.importorskip("scipy.integrate")
    c = 0.5

    def rate(_, s):
        a, b, u, v = s
        M = np.array([[1.1 + c * c, c * np.cos(a - b)], [c * np.cos(a - b), 0.1 + c * c]])
        F = np.array([-c * np.sin(a - b) * v * v - 1.5 * G * np.sin(a), c * np.sin(a - b) * u * u - c * G * np.sin(b)])
        return [u, v, *np.linalg.solve(M, F)]
    return scipy.solve_ivp(rate, (0.0, t[-1]), [np.pi / 2, np.pi / 2, 0.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-12).y


def test_a_double_pendulum_is_that_of_reduced_coordinates():
    first, second = (rod(f"/{n}", (x, 0.0, 0.0), moments=(0.01, 0.1, 0.1)) for n, x in (("a", 0.5), ("b", 1.5)))
    off = []
    for substeps in (8, 16):
        axis = {"axis": (0.0, 0.0, 1.0)}
        hinges = revolute_joint("/j", None, first, **axis), revolute_joint("/k", first, second, at=(1.0, 0.0, 0.0), **axis)
        sim = start(first, second, *hinges, substeps=substeps)
        energy = sim.plan.method("rigid").indicators(None, None)["rigid_energy"]
        sim.run(60)
        a, b = double(np.array([0.0, 1.0]))[:2, -1]
        wanted = np.array([np.sin(a) + 0.5 * np.sin(b), -np.cos(a) - 0.5 * np.cos(b)])
        off.append(np.linalg.norm(places(sim)[1][:2] - wanted))
        assert abs(sim.plan.method("rigid").indicators(None, None)["rigid_energy"] - energy) < 1e-4 * 2.0 * G
    assert off[0] < 1e-3 and 3.8 < off[0] / off[1] < 4.2, off


def oscillator(k, c, m, target, speed, force, t) -> np.ndarray:
    """Place and velocity from rest at 0 of m x'' = k (target - x) + c (speed - x') + force."""
    scipy = pytest.importorskip("scipy.linalg")
    flow = scipy.expm(np.array([[0, 1, 0], [-k / m, -c / m, (k * target + c * speed + force) / m], [0, 0, 0]]) * t)
    return flow[:2, 2]


SPRINGS = [(40.0, 1.5), (400.0, 0.0), (4e3, 20.0), (4e4, 100.0), (1e3, 500.0), (0.0, 50.0), (1e5, 10.0)]


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("k, c", SPRINGS)
def test_one_driven_coordinate_is_a_damped_oscillator(k, c, precision):
    """The flow of its equation is known: shifts and turns of 4 substeps a frame have no error but rounding, up to 240 rad/s, of
    any damping."""
    m, small = 2.0, 1e-10 if precision == "float64" else 1e-5
    for turns in (False, True):
        body = rod("/b", (0.0, 0.0, 0.0), mass=m, moments=(m, 3.0, 3.0))
        drive = {"rotX" if turns else "transX": Drive(k, c, 0.1, 0.2)}
        sim = start(body, (revolute_joint if turns else prismatic_joint)("/j", None, body, drives=drive), substeps=4,
                    precision=precision, gravity=(-G, 0.0, 0.0))
        off, size = 0.0, 0.0
        for frame in range(1, 41):
            sim.step()
            exact = oscillator(k, c, m, 0.1, 0.2, 0.0 if turns else -m * G, frame / 60.0)
            off, size = max(off, abs(coordinates(sim)[0, 3 * turns] - exact[0])), max(size, abs(exact[0]))
        now = sim.plan.method("rigid").spins()[0, 0] if turns else sim.plan.method("rigid").velocities()[0, 0]
        assert off < small * size and abs(now - exact[1]) < small * max(size * np.sqrt(k / m), abs(exact[1]), size)


def test_three_springs_along_the_axes_are_three_oscillators():
    """From rest at 0: they share a body, and nothing else."""
    k, c = np.array([300.0, 900.0, 50.0]), np.array([4.0, 1.0, 20.0])
    body = rod("/b", (0.0, 0.0, 0.0), mass=2.0)
    drives = {f"trans{name}": Drive(*each, 0.1) for name, *each in zip("XYZ", k, c, strict=True)}
    joint = joint_between("/j", None, body, limits=locked_limits_except("transX", "transY", "transZ"), drives=drives)
    sim = start(body, joint, substeps=4, gravity=(0.0, 0.0, 0.0))
    sim.run(30)
    exact = [oscillator(*each, 2.0, 0.1, 0.0, 0.0, 0.5)[0] for each in zip(k, c, strict=True)]
    assert np.abs(coordinates(sim)[0, :3] - exact).max() < 1e-12


@pytest.mark.parametrize("damping", [0.0, 1e3, 1e5])
def test_a_drive_too_stiff_for_its_steps_rests_where_its_weight_leaves_it(damping):
    """m g / k below the target: 2 micrometres, of 2 kg on 1e7 N/m. Its 2236 rad/s are 9 times the rate of steps."""
    body = rod("/b", (0.0, 0.0, 0.0), mass=2.0)
    sim = start(body, prismatic_joint("/j", None, body, drives={"transX": Drive(1e7, damping, 0.0)}), substeps=4,
                gravity=(-G, 0, 0))
    sim.run(120)
    assert coordinates(sim)[0, 0] == pytest.approx(-2.0 * G / 1e7, rel=1e-6)


def two_driven(substeps: int):
    """A double pendulum with a spring and damper in both hinges, one of them of an acceleration."""
    first, second = (rod(f"/{n}", (x, 0.0, 0.0), moments=(0.01, 0.1, 0.1)) for n, x in (("a", 0.5), ("b", 1.5)))
    drives = Drive(60.0, 2.0, 0.5, 0.3), Drive(200.0, 6.0, -0.8, acceleration=True)
    hinges = [revolute_joint(f"/{n}", one, other, at=(x, 0.0, 0.0), axis=(0.0, 0.0, 1.0), drives={"rotX": drive})
              for n, one, other, x, drive in (("j", None, first, 0.0, drives[0]), ("k", first, second, 1.0, drives[1]))]
    return start(first, second, *hinges, substeps=substeps)


def test_drives_of_coupled_joints_converge_with_order_two():
    ends = []
    for substeps in (8, 16, 32, 128):
        sim = two_driven(substeps)
        sim.run(30)
        ends.append(coordinates(sim)[:, 3])
    off = [np.abs(q - ends[-1]).max() for q in ends[:-1]]
    rates = np.log2(np.array(off[:-1]) / off[1:])
    assert rates.min() > 1.8 and off[0] < 1e-4, (off, rates)


def test_a_drive_of_an_acceleration_moves_any_inertia_alike():
    """About an axis away from the centre, so that the locked shifts move mass too."""
    ends = []
    for mass, inertia in ((1.0, 0.02), (50.0, 3.0)):
        body = rod("/b", (0.7, 0.0, 0.0), mass=mass, moments=(0.01 * mass, inertia, inertia))
        drive = {"rotX": Drive(20.0, 3.0, 1.0, acceleration=True)}
        sim = start(body, revolute_joint("/j", None, body, axis=(0.0, 0.0, 1.0), drives=drive), gravity=(0.0, 0.0, 0.0),
                    substeps=16)
        sim.run(30)
        ends.append(coordinates(sim)[0, 3])
    w, d, t = np.sqrt(20.0 - 2.25), 1.5, 0.5
    exact = 1.0 - np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t))
    assert abs(ends[0] - exact) < 5e-6 and abs(ends[0] - ends[1]) < 1e-6


def test_a_drive_gives_no_more_than_its_most():
    body = rod("/b", (0.0, 0.0, 0.0), mass=2.0)
    sim = start(body, prismatic_joint("/j", None, body, drives={"transX": Drive(1e6, 1e4, 10.0, most=3.0)}),
                gravity=(0.0, 0.0, 0.0))
    sim.run(60)
    assert abs(places(sim)[0][0] - 0.5 * 1.5 * 1.0) < 1e-9                  # 3 N on 2 kg: a constant force


def test_a_twist_is_counted_on_over_many_turns():
    body = rod("/b", (0.0, 0.0, 0.0))
    sim = start(body, revolute_joint("/j", None, body, drives={"rotX": Drive(5.0, 1.0, 8.0 * np.pi)}))
    sim.run(400)
    assert abs(coordinates(sim)[0, 3] - 8.0 * np.pi) < 1e-3


def test_a_limit_holds_what_falls_and_is_not_passed():
    body = rod("/b", (1.0, 0.0, 0.0))
    sim = start(body, revolute_joint("/j", None, body, axis=(0.0, 0.0, 1.0), low=-0.5, high=0.4))
    lowest = 0.0
    for _ in range(120):
        sim.step()
        lowest = min(lowest, coordinates(sim)[0, 3])
    assert lowest > -0.5 - 1e-6 and abs(coordinates(sim)[0, 3] + 0.5) < 1e-6
    assert np.abs(sim.plan.method("rigid").velocities()).max() < 1e-6


def test_a_cone_holds_a_rod_at_its_angle():
    a = np.radians(30.0)
    body = rod("/b", (0.0, 1.0, 0.0), spin=(0.2, 0.0, 0.1))
    sim = start(body, spherical_joint("/j", None, body, axis=(0.0, 1.0, 0.0), cone=(a, a)))
    steepest = 0.0
    for _ in range(240):
        sim.step()
        steepest = max(steepest, np.arccos(places(sim)[0][1]))
    assert steepest < a + 1e-5 and np.arccos(places(sim)[0][1]) > a - 1e-3


def test_a_distance_is_held_between_its_ends():
    """Of two bodies, one near enough at the start: it falls until its rope is taut."""
    bodies = [rod("/a", (0.5, 0.0, 0.0)), rod("/b", (0.2, 0.0, 0.0))]
    sim = start(*bodies, *(Joint(f"{body.path}j", "", body.path, limits={"distance": (-np.inf, 0.5)}) for body in bodies))
    far = []
    for _ in range(90):
        sim.step()
        far.append(np.linalg.norm(places(sim), axis=1))
    assert np.max(far) < 0.5 + 1e-6 and np.min(far, axis=0)[1] < 0.3 and np.max(far, axis=0)[1] > 0.5 - 1e-5
    assert abs(far[20][0] - 0.5) < 1e-6


def test_momenta_of_a_chain_stay_to_rounding():
    bodies = [rod(f"/b{k}", (0.3 * k, 0.1 * k, 0.0), mass=1.0 + k, velocity=(0.0, 1.0 - k, 0.3), spin=(1.0, 2.0, 0.5 * k))
              for k in range(5)]
    joints = [(fixed_joint, revolute_joint, spherical_joint, prismatic_joint)[k](f"/j{k}", bodies[k], bodies[k + 1],
                                                                                 at=(0.3 * k + 0.2, 0.0, 0.1))
              for k in range(4)]
    sim = start(*bodies, *joints, gravity=(0.0, 0.0, 0.0))
    m = sim.plan.method("rigid")

    def momenta():
        p, x = m.get("p"), places(sim)
        return p.sum(0), (np.cross(x, p) + m.get("L")).sum(0)
    sim.step()
    P, L = momenta()
    sim.run(120)
    Q, K = momenta()
    assert np.abs(Q - P).max() < 1e-11 and np.abs(K - L).max() < 1e-10 * np.abs(L).max()
    assert max(errors(sim)) < 1e-9


def test_a_fixed_pair_is_one_body():
    """Free, against one body with the inertia of both."""
    masses, at = (1.0, 2.0), (np.array([0.0, 0.0, 0.0]), np.array([0.6, 0.2, 0.0]))
    pair = [rod(f"/b{k}", at[k], mass=masses[k], moments=(0.05, 0.06, 0.07)) for k in (0, 1)]
    center = (at[0] + 2.0 * at[1]) / 3.0
    spin = np.array([1.0, 2.0, -1.5])
    inertia = sum(np.diag([0.05, 0.06, 0.07]) + m * (d @ d * np.eye(3) - np.outer(d, d))
                  for m, d in zip(masses, [x - center for x in at], strict=True))
    moments, R = np.linalg.eigh(inertia)
    R[:, 0] *= np.sign(np.linalg.det(R))
    whole = rod("/w", center, mass=3.0, moments=moments, axes=rotation.matrix_quat(R), spin=spin)
    for k, body in enumerate(pair):
        body.spin, body.velocity = spin, np.cross(spin, at[k] - center)
    sim = start(*pair, whole, fixed_joint("/j", *pair, at=(0.3, 0.0, 0.0)), gravity=(0.0, 0.0, 0.0), substeps=16)
    sim.run(60)
    poses = sim.plan.method("rigid").poses()
    assert np.abs(poses[0][:3, :3] - poses[2][:3, :3]).max() < 1e-4 and max(errors(sim)) < 1e-10
