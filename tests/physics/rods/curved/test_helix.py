"""A helix that hangs under its weight, against Kirchhoff's equations, solved as a boundary-value problem by SciPy.

    r' = (1 + n . d3 / (E A)) d3,   d_i' = u x d_i,   n' = -rho A g,   m' = -r' x n
    m = B (u1 - u1*) d1 + B (u2 - u2*) d2 + C (u3 - u3*) d3

r and the frame are those of the shape at rest at the upper end, n = m = 0 at the lower one; u* = (0, curvature, torsion). The
force n is known: the weight below. Unknown is the moment at the upper end, found by shooting.
"""

import numpy as np
import pytest

from tests.physics.rods.rig import simulated
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene

solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
root = pytest.importorskip("scipy.optimize").root

RADIUS, RISE, TURNS, THICK, YOUNG, DENSITY, GRAVITY = 0.05, 0.03, 2.5, 0.004, 1e8, 1000.0, 9.81
AREA, SECOND = np.pi * THICK**2 / 4.0, np.pi * THICK**4 / 64.0
BEND, TWIST = YOUNG * SECOND, YOUNG / 2.6 * 2.0 * SECOND           # Poisson's ratio 0.3
SLOPE = RISE / (2.0 * np.pi)
SPEED = np.hypot(RADIUS, SLOPE)                                     # length for a radian
LENGTH = 2.0 * np.pi * TURNS * SPEED


def helix(s: np.ndarray) -> np.ndarray:
    """Places at lengths s [m] along the helix at rest, which winds down from s = 0."""
    a = np.asarray(s) / SPEED
    return np.stack([RADIUS * np.cos(a), -SLOPE * a, RADIUS * np.sin(a)], axis=-1)


def slope(s: float, y: np.ndarray, weight: float) -> np.ndarray:
    D, m = y[3:12].reshape(3, 3), y[12:]                            # rows: d1, d2, d3
    n = np.array([0.0, -weight * DENSITY * AREA * GRAVITY * (LENGTH - s), 0.0])
    u = np.array([0.0, RADIUS, SLOPE]) / SPEED**2 + (D @ m) / (BEND, BEND, TWIST)
    way = (1.0 + n @ D[2] / (YOUNG * AREA)) * D[2]
    return np.concatenate([way, np.cross(u @ D, D).ravel(), -np.cross(way, n)])


def kirchhoff(weight: float) -> np.ndarray:
    """Place of the lower end [m] under so much of the weight."""
    t, normal = np.array([0.0, -SLOPE, RADIUS]) / SPEED, np.array([-1.0, 0.0, 0.0])       # at s = 0
    start = np.concatenate([helix(0.0), normal, np.cross(t, normal), t])

    def end(m: np.ndarray, part: float) -> np.ndarray:
        y = np.concatenate([start, m])
        return solve_ivp(slope, (0.0, LENGTH), y, method="DOP853", args=(part,), rtol=1e-8, atol=1e-11).y[:, -1]
    m = np.zeros(3)
    for part in np.linspace(0.0, weight, 4)[1:] if weight else ():
        m = root(lambda m, part=part: 1e3 * end(m, part)[12:], m, tol=1e-10).x
    found = end(m, weight)
    assert np.abs(found[12:]).max() < 1e-9
    return found[:3]


def hung(n: int) -> np.ndarray:
    """The lower end of a rod of n points, settled by long steps."""
    scene = Scene(gravity=(0.0, -GRAVITY, 0.0), fps=2.0, substeps=1)
    rods = scene.add(Rods("/helix", helix(LENGTH / (n - 1) * (np.arange(n + 1) - 1.0)), [n + 1], THICK, YOUNG, density=DENSITY))
    rods.pin("/clamp", [0, 1])
    simulation, method = simulated(scene)
    method.shortest = method.substeps = 1
    simulation.run(30)
    x, v = method.points(0)
    assert np.abs(v).max() < 1e-6
    return x[-1]


def test_a_helix_without_weight_is_as_it_is_at_rest():
    assert kirchhoff(0.0) == pytest.approx(helix(LENGTH), abs=1e-8)


def test_a_helix_under_its_weight_converges_with_order_two_to_kirchhoffs():
    """It hangs down to 2.2 times its height at rest."""
    wanted = kirchhoff(1.0)
    assert wanted[1] < 2.0 * helix(LENGTH)[1]
    errors = np.array([np.linalg.norm(hung(n) - wanted) for n in (17, 33, 65)])
    assert errors[2] < 0.025 * abs(wanted[1])
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.2)
