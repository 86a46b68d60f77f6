"""Points of 100 m/s, which go 17 cm a substep, against walls of 1 mm: none ends behind one."""

import numpy as np
import pytest

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
