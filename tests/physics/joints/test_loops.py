"""Closed loops of joints that pass through places where their bars lie in line: both ways on are right, energy is kept."""

import numpy as np
import pytest

from tests.physics.joints.make import start
from wsim.physics.rigid.joints.joint import prismatic_joint, revolute_joint, spherical_joint
from wsim.physics.rigid.objects import Body
from wsim.scene.curve import Motion

G, Y = 9.81, (0.0, 1.0, 0.0)


def bar(path: str, a, b, mass: float) -> Body:
    """A thin uniform bar from a to b."""
    a, b = np.array(a, float), np.array(b, float)
    length = np.linalg.norm(b - a)
    x = (b - a) / length
    side = np.eye(3)[np.argmin(np.abs(x))]
    y = np.cross(side, x) / np.linalg.norm(np.cross(side, x))
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = np.stack([x, y, np.cross(x, y)], 1), 0.5 * (a + b)
    moment = mass * length**2 / 12.0
    return Body(path, [], Motion.still(M), mass=mass, center=(0, 0, 0), inertia=(1e-3 * moment, moment, moment))


def loop(points, masses=(1.0, 2.0, 1.0), kinds=(revolute_joint,) * 4, axes=(Y,) * 4, size=1.0, place=(0, 0, 0), **more):
    """Three bars between four points, the first and last of which the world holds."""
    points = [size * np.array(p, float) + place for p in points]
    bars = [bar(f"/b{k}", points[k], points[k + 1], m) for k, m in enumerate(masses)]
    sides = [None, *bars, None]
    joints = [kind(f"/j{k}", sides[k], sides[k + 1], at=points[k], axis=axes[k]) for k, kind in enumerate(kinds)]
    return start(*bars, *joints, gravity=(0.0, 0.0, -size * G), **more)


def parallel(degrees: float) -> list:
    """Cranks of 1 m, so far from upright, and a coupler of 2 m: at 90 degrees all lie in line."""
    t = np.radians(degrees)
    crank = np.array([np.sin(t), 0.0, np.cos(t)])
    return [(0, 0, 0), crank, crank + (2, 0, 0), (2, 0, 0)]


def watched(sim, frames: int) -> tuple[float, float, list]:
    """(largest change of energy of the largest kinetic energy, largest error at the line [m], errors elsewhere)."""
    m = sim.plan.method("rigid")
    first, mass = m.indicators(None, None)["rigid_energy"], np.array([one.mass for one in m.masses])
    change = top = 0.0
    line, else_where = 0.0, [0.0]
    for _ in range(frames):
        sim.step()
        found = m.indicators(None, None)
        kinetic = 0.5 * (mass[:, None] * m.velocities() ** 2).sum() + 0.5 * (m.read("L") * m.spins()).sum()
        top, change = max(top, kinetic), max(change, abs(found["rigid_energy"] - first))
        R = m.poses()[:, :3, 0]
        if np.abs(R @ R[0]).min() > np.cos(np.radians(5.0)):
            line = max(line, found["joint_error"])
        else:
            else_where.append(found["joint_error"])
    return change / top, line, else_where


@pytest.mark.parametrize("degrees", [10, 30, 60, 80, 120])
def test_a_parallel_four_bar_keeps_its_energy_through_the_line(degrees):
    for substeps in (8, 10, 16, 20):
        change, line, others = watched(loop(parallel(degrees), substeps=substeps, precision="float32"), 180)
        assert change < 1e-2 and line < 1e-4 and max(others) < 1e-6, substeps


def kite() -> list:
    """Bars of 1, 2, 2 m over a base of 1 m: they lie in line once more than those of the parallel one."""
    t = np.radians(40.0)
    p, q = np.array([np.sin(t), np.cos(t)]), np.array([1.0, 0.0])
    to = q - p
    d = np.linalg.norm(to)
    r = p + 0.5 * to + np.sqrt(4.0 - 0.25 * d * d) / d * np.array([-to[1], to[0]])
    return [(0, 0, 0), (p[0], 0, p[1]), (r[0], 0, r[1]), (1, 0, 0)]


def crossed() -> dict:
    """Bennett's loop of skew hinges: links of 1 and 0.7 m, whose twists have sines of the same ratio. It moves, though its
    hinges lock 20 of 18 coordinates."""
    long, short, a = 1.0, 0.7, np.radians(30.0)
    b = np.arcsin(short * np.sin(a))
    t = np.radians(100.0)
    u = 2.0 * np.arctan(np.sin(0.5 * (b + a)) / np.sin(0.5 * (b - a)) / np.tan(0.5 * t))
    T, points, axes = np.eye(4), [], []
    for turn, length, twist in ((t, long, a), (u, short, b), (-t, long, a), (-u, short, b)):
        points.append(T[:3, 3])
        axes.append(T[:3, 2])
        c, s, cc, ss = np.cos(turn), np.sin(turn), np.cos(twist), np.sin(twist)
        T = T @ [[c, -s * cc, s * ss, length * c], [s, c * cc, -c * ss, length * s], [0, ss, cc, 0], [0, 0, 0, 1]]
    return {"points": points, "axes": axes, "masses": (1.0, 1.0, 1.0)}


@pytest.mark.parametrize("size, place, more", [
    (1.0, (0, 0, 0), {"points": kite()}),
    (1.0, (0, 0, 0), crossed()),
    (0.01, (0, 0, 0), {"points": parallel(60)}),
    (100.0, (1e3, -3e3, 2e3), {"points": parallel(60)}),
    (1.0, (0, 0, 0), {"points": parallel(60), "masses": (100.0, 0.1, 130.0)}),
    (1.0, (0, 0, 0), {"points": parallel(60), "kinds": (revolute_joint, spherical_joint, revolute_joint, revolute_joint)}),
], ids=["kite", "bennett", "1 cm", "100 m", "masses", "spherical"])
def test_other_loops_keep_theirs(size, place, more):
    change, line, others = watched(loop(size=size, place=place, substeps=10, precision="float32", **more), 120)
    assert change < 1e-2 and line < 1e-4 * size and max(others) < 1e-6 * size


def test_a_crank_and_slider_pass_their_dead_centre():
    """Crank and rod of 1 m: where the slider is on the crank's axis, both lie in line and either may turn."""
    t = np.radians(60.0)
    p, q = np.array([np.sin(t), 0.0, np.cos(t)]), np.array([2.0 * np.sin(t), 0.0, 0.0])
    crank, rod, block = bar("/a", (0, 0, 0), p, 1.0), bar("/b", p, q, 1.0), bar("/c", q - (0, 0, 0.1), q + (0, 0, 0.1), 0.5)
    hinges = [revolute_joint(path, a, b, at=at, axis=Y)
              for path, a, b, at in (("/j", None, crank, (0, 0, 0)), ("/k", crank, rod, p), ("/l", rod, block, q))]
    slide = prismatic_joint("/m", None, block, at=q, axis=(1.0, 0.0, 0.0))
    sim = start(crank, rod, block, *hinges, slide, gravity=(0.0, 0.0, -G), substeps=10, precision="float32")
    change, line, others = watched(sim, 120)
    assert change < 1e-2 and line < 1e-4 and max(others) < 1e-6
