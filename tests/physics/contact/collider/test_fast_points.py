"""Points of 100 m/s, which go 17 cm a substep, against walls of 1 mm: none ends behind one."""

import numpy as np
import pytest

from tests.make.gradient.gradients import Run
from wsim import Scene, Simulation
from wsim.scene import Box, Motion, Surface, shapes

HALF = (1.5, 1.5, 0.0005)
FPS, COUNT = 60.0, 60


def thin_wall(kind: str):
    points, counts, indices = shapes.box(HALF)
    return Box(HALF) if kind == "box" else Surface(np.array(points, np.float32), counts, indices)


def wall_motion(R: np.ndarray) -> Motion:
    """Goes towards the points by 20 m/s and turns by 10 rad/s about an axis in its plane."""
    times = np.linspace(0.0, 0.2, 97)
    M = np.tile(np.eye(4), (len(times), 1, 1))
    c, s = np.cos(10.0 * times), np.sin(10.0 * times)
    M[:, 1, 1], M[:, 2, 2], M[:, 1, 2], M[:, 2, 1], M[:, 2, 3] = c, c, -s, s, 20.0 * times
    M[:, :3] = R @ M[:, :3]
    return Motion(times, M)


@pytest.mark.parametrize("kind, solver, integrator", [("mesh", "explicit", "leapfrog"), ("mesh", "xpbd", "backward_euler"),
                                                      ("box", "xpbd", "backward_euler")])
def test_no_fast_point_passes_a_thin_wall_that_moves_off_the_axes(kind, solver, integrator):
    """Points go on after they touch, along the wall and against it, from where rounding has left them."""
    rng = np.random.default_rng(5)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.linalg.det(R)
    start = rng.uniform((-0.5, -0.5, 0.35), (0.5, 0.5, 0.6), (COUNT, 3))
    way = rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (COUNT, 3)) - start
    v = 100.0 * way / np.linalg.norm(way, axis=1)[:, None]
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=FPS, substeps=10, solver=solver, integrator=integrator)
    scene.net("/net", np.concatenate([start, start + [0.01, 0.0, 0.0]]) @ R.T, np.arange(2 * COUNT).reshape(2, -1).T,
              np.full(COUNT, 1e-3), np.full(2 * COUNT, 1e-3), velocities=np.concatenate([v, v]) @ R.T)
    scene.collider("/wall", thin_wall(kind), motion=wall_motion(R))
    sim, met = Simulation(scene, device="cpu"), 0
    for frame in range(1, 3):
        sim.step()
        M = scene.colliders[0].motion.at(frame / FPS)
        q = (sim.positions() - M[:3, 3]) @ M[:3, :3]
        over = np.hypot(q[:, 0], q[:, 1]) < 1.3                                  # some slide off its rim
        assert (q[over, 2] > 0.0005 - 1e-6).all()
        met += (q[over, 2] < 0.001).sum()
    assert met > 100


def open_bowl(radius: float, n: int) -> Surface:
    """Half a sphere, its rim up: n rings of 2 n facets, and a fan about its pole."""
    theta, phi = np.meshgrid(np.linspace(0.02, 0.5 * np.pi, n + 1), np.linspace(0.0, 2.0 * np.pi, 2 * n, endpoint=False),
                             indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), -np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(theta.shape)
    inner, outer = number[:-1], number[1:]
    quads = np.stack([inner, outer, np.roll(outer, -1, 1), np.roll(inner, -1, 1)], -1).reshape(-1, 4)
    fan = np.stack([number[0], np.roll(number[0], -1), np.full(2 * n, len(points))], -1)
    points = radius * np.concatenate([points, [[0.0, -1.0, 0.0]]])
    return Surface(points.astype(np.float32), [4] * len(quads) + [3] * len(fan), np.concatenate([quads.ravel(), fan.ravel()]))


@pytest.mark.parametrize("solver, integrator, substeps", [("xpbd", "backward_euler", 10), ("explicit", "leapfrog", 80)])
def test_points_that_slide_in_an_open_bowl_stay_in_it(solver, integrator, substeps):
    """Without friction, over several facets a substep. They keep 2e-6 of its radius, and an open mesh has no inside. Their
    energy takes them 2 cm above where they begin, which is 3 cm below the rim; facets bulge by up to 0.1 % of the radius."""
    rng, R = np.random.default_rng(0), 0.2
    turn, away = rng.uniform(0.0, 2.0 * np.pi, COUNT), rng.uniform(0.0, 0.5 * R, COUNT)
    start = np.stack([away * np.cos(turn), np.full(COUNT, -0.05), away * np.sin(turn)], 1)
    v = rng.normal(size=start.shape)
    v *= 0.6 / np.linalg.norm(v, axis=1)[:, None]
    v[:, 1] = -np.abs(v[:, 1])
    scene = Scene(fps=24.0, substeps=substeps, solver=solver, integrator=integrator)
    scene.net("/net", np.concatenate([start, start + [0.002, 0.0, 0.0]]), np.arange(2 * COUNT).reshape(2, -1).T,
              np.full(COUNT, 1e-3), np.full(2 * COUNT, 1e-3), velocities=np.concatenate([v, v]), static_friction=0.0,
              dynamic_friction=0.0)
    scene.collider("/bowl", open_bowl(R, 24), static_friction=0.0, dynamic_friction=0.0)
    sim = Simulation(scene, device="cpu")
    for _ in range(12):
        sim.step()
        assert np.linalg.norm(sim.positions(), axis=1).max() < R


@pytest.mark.slow
def test_gradients_go_through_a_way_along_two_faces():
    """By the initial positions: points of 3 m/s slide down one side of an open valley and up the other, by 12 mm a substep."""
    up = np.tan(np.radians(20.0))
    points = np.array([[-1, up, -1], [-1, up, 1], [0, 0, -1], [0, 0, 1], [1, up, -1], [1, up, 1]], np.float32)
    scene = Scene(fps=FPS, frames=3, substeps=4, iterations=2, solver="xpbd", integrator="backward_euler")
    net = scene.net("/net", [[-0.05, 0.05, 0.0], [-0.06, 0.06, 0.02]], [[0, 1]], [20.0], [1e-3, 1e-3],
                    velocities=np.tile([3.0, -1.0, 0.2], (2, 1)), static_friction=0.2, dynamic_friction=0.2)
    scene.collider("/valley", Surface(points, [4, 4], [0, 1, 3, 2, 2, 3, 5, 4]), static_friction=0.2, dynamic_friction=0.2)
    found = Run(scene)
    start = found.recording.positions(0, net.path)
    way = np.random.default_rng(6).normal(size=start.shape)
    found.check((found.gradient.positions(net.path) * way).sum(), lambda s: (net.path, "positions", start + s * way), 1e-8,
                within=1e-7)
