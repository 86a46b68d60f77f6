"""Kinematic colliders that grip, sweep and stir material points: nothing passes them, at any scale and frame rate."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly

from ..test_method import find_method

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
RUB = {"static_friction": 0.9, "dynamic_friction": 0.8}


def solid(half, mesh):
    return wsim.Surface(CORNERS * half, [4] * 6, FACES) if mesh else wsim.Box(half)


def places(simulation):
    return find_method(simulation).read_particles(0)["x"]


@pytest.mark.parametrize(("size", "fps"), [(1.0, 24), (1e-3, 60), (1e3, 60)])
def test_two_boxes_lift_a_jelly_cube(size, fps):
    """They squeeze it by a tenth, and friction bears three times its weight; stiffness and time go with the size."""
    scene, pace = wsim.Scene(fps=fps / size**0.5), size**0.5
    scene.collider("/floor", wsim.Box((size, 0.1 * size, size)), at=(0, -0.1 * size, 0), **RUB)
    for k, side in enumerate((-1, 1)):
        way = [(side * x * size, y * size, 0) for x, y in ((0.18, 0.1), (0.135, 0.1), (0.135, 0.1), (0.135, 0.5))]
        scene.collider(f"/jaw{k}", wsim.Box((0.05 * size, 0.08 * size, 0.1 * size)), **RUB,
                       motion=wsim.Motion.through(np.array([0, 0.25, 0.5, 1.5]) * pace, way, kind="linear"))
    scene.mpm("/jelly", wsim.Box((0.1 * size,) * 3), at=(0, 0.1 * size, 0), cell=0.05 * size,
              material=Jelly(4e4 * size, viscosity=40.0 * size * pace))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(round(1.5 * fps))
    x = places(simulation) / size
    assert abs(x[:, 1].mean() - 0.5) < 0.02 and np.abs(x[:, 0]).max() < 0.0885
    assert simulation.indicators()["mpm_penetration"] == 0.0


@pytest.mark.parametrize("mesh", [False, True])
@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_sand_does_not_pass_a_wall_of_a_quarter_cell_that_sweeps_through_it(integrator, mesh):
    cell, fps, friction = 0.05, 24, {"static_friction": 0.3, "dynamic_friction": 0.3}
    scene = wsim.Scene(fps=fps)
    scene.collider("/floor", wsim.Box((2, 0.5, 2)), at=(0, -0.5, 0), **friction)
    motion = wsim.Motion.through([0, 0.5], [(-0.3, 0.4, 0), (0.2, 0.4, 0)], kind="linear")
    scene.collider("/wall", solid(np.array([0.125 * cell, 0.4, 0.3]), mesh), motion=motion, **friction)
    scene.mpm("/sand", wsim.Box((0.15, 0.15, 0.15)), at=(0, 0.15, 0), cell=cell, material=Granular(), integrator=integrator,
              velocity=(-3.0, 0, 0))
    simulation = wsim.Simulation(scene, device="cpu")
    for _ in range(12):
        simulation.step()
        x, wall = places(simulation), motion.at(simulation.time)[0, 3]
        beside = (np.abs(x[:, 1] - 0.4) < 0.4) & (np.abs(x[:, 2]) < 0.3) & (np.abs(x[:, 0] - wall) < 0.15)
        assert not (beside & (x[:, 0] < wall)).any() and x[:, 1].min() > 0.0 and np.isfinite(x).all()


@pytest.mark.parametrize(("integrator", "mesh"), [("explicit", False), ("explicit", True), ("implicit", True)])
def test_blade_stirs_sand_in_a_closed_drum_and_none_is_within_it(integrator, mesh):
    """Implicit steps are as long as a frame, in which it turns by 24 degrees: a way is straight in the frame of the blade."""
    friction = {"static_friction": 0.2, "dynamic_friction": 0.2}
    scene = wsim.Scene(fps=24)
    for k, (x, y, z) in enumerate(np.vstack([np.eye(3), -np.eye(3)]) * 0.85):
        scene.collider(f"/wall{k}", wsim.Box((0.6, 0.6, 0.6)), at=(x, y, z), **friction)
    half, times = np.array([0.2, 0.02, 0.2]), np.linspace(0.0, 0.5, 9)
    turns = [(0, 0, np.sin(5.0 * t), np.cos(5.0 * t)) for t in times]                  # 10 rad/s
    motion = wsim.Motion.through(times, [(0, 0, 0)] * 9, turns)
    scene.collider("/blade", solid(half, mesh), motion=motion, **friction)
    scene.mpm("/sand", wsim.Box((0.24, 0.1, 0.24)), at=(0, -0.13, 0), cell=0.05, material=Granular(), integrator=integrator)
    simulation = wsim.Simulation(scene, device="cpu")
    for _ in range(12):
        simulation.step()
        x, M = places(simulation), motion.at(simulation.time)
        inside = (half - np.abs((x - M[:3, 3]) @ M[:3, :3])).min(axis=1)
        assert inside.max() < 1e-6 and np.abs(x).max() < 0.25 and np.isfinite(x).all()
