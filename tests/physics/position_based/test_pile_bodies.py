"""Rigid bodies and colliders among grains: what rests on a pile, what holds one, and what a pile pours through."""

import numpy as np
import pytest

import wsim
from tests.make.physics.piles import R, filled_box
from wsim import Motion, Plane, Scene, Surface
from wsim.physics.position_based.objects import Grains


@pytest.mark.parametrize(("ratio", "buried"), [(0.1, False), (100, False), (1, True), (100, True)])
def test_a_box_rests_on_grains_and_among_them(ratio, buried):
    """From 2 (on them) and 21 to 2100 kg/m^3 it neither floats up nor sinks by more than the pile settles, and stops."""
    scene, height = filled_box(ratio, buried)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(45)
    before = simulation.poses()["/box"][1, 3]
    simulation.run(15)
    pose = simulation.poses()["/box"]
    assert abs(pose[1, 3] - before) < 0.01 * R and abs(pose[1, 3] - height) < 0.8 * R and pose[1, 1] > 0.999
    assert np.abs(simulation.velocities("/grains")).max() < 0.05


@pytest.mark.parametrize(("ratio", "steps"), [(1e-3, (8, 4)), (1e-2, (32, 4)), (1e-2, (16, 2)), (1e3, (8, 4)),
                                              (0.1, (8, 4, 0.3))])
def test_no_box_is_thrown_by_the_grains_that_bury_it(ratio, steps):
    """Six layers with gaps of 0.05 R fall by 0.3 R at most: nothing is faster than sqrt(2 g 0.3 R), and all ends."""
    scene, height = filled_box(ratio, True, *steps)
    simulation = wsim.Simulation(scene, device="cpu")
    before = np.array([0.0, height, 0.0])
    for _ in range(40):
        simulation.step()
        now = simulation.poses()["/box"][:3, 3].astype(float)
        assert np.linalg.norm(now - before) * 60.0 < np.sqrt(2.0 * 9.81 * 0.3 * R)
        before = now
    assert abs(now[1] - height) < 0.3 * R and np.abs(simulation.velocities("/grains")).max() < 0.15


def surface_of_profile(radii, heights):
    """A closed surface: a profile that is turned about y."""
    angle, m = np.arange(24) / 24.0 * 2.0 * np.pi, len(radii)
    points = np.stack([np.outer(radii, np.cos(angle)), np.repeat(np.array(heights)[:, None], 24, 1),
                       np.outer(radii, np.sin(angle))], axis=-1).reshape(-1, 3)
    faces = [[k * 24 + j, (k + 1) % m * 24 + j, (k + 1) % m * 24 + (j + 1) % 24, k * 24 + (j + 1) % 24]
             for k in range(m) for j in range(24)]
    return Surface(points, np.full(len(faces), 4), np.array(faces).ravel())


def test_a_hopper_of_a_thin_wall_pours_through_its_hole_alone():
    """Wall of 2 mm, grains of 6 mm, 8 x 4: those that leave are below the hole, none is behind the wall."""
    scene, r, hole = Scene(fps=60, substeps=8, iterations=4), 0.006, 0.035
    surface = surface_of_profile([0.12, hole, hole, hole + 0.002, hole + 0.002, 0.122], [0.3, 0.16, 0.12, 0.12, 0.16, 0.3])
    scene.collider("/hopper", surface, static_friction=0.3, dynamic_friction=0.3)
    scene.collider("/floor", Plane(), static_friction=0.5, dynamic_friction=0.5)
    points = 2.1 * r * (np.indices((9, 9, 9)).reshape(3, -1).T - [4, 0, 4]) + [0, 0.25, 0]
    points = points[np.hypot(points[:, 0], points[:, 2]) < 0.1 - r - 0.6 * np.maximum(0.3 - points[:, 1], 0.0)]
    scene.particles("/grains", points=points, radius=r, material=Grains(static_friction=0.3, dynamic_friction=0.3))
    simulation = wsim.Simulation(scene, device="cpu")
    for _ in range(36):
        simulation.step()
        x = simulation.positions("/grains").astype(float)
        inner = np.interp(x[:, 1], [0.12, 0.16, 0.3], [hole, hole, 0.12])
        assert not np.any((x[:, 1] > 0.125) & (x[:, 1] < 0.3) & (np.hypot(x[:, 0], x[:, 2]) > inner))
    assert np.count_nonzero(x[:, 1] < 0.12) > 50


def test_a_bucket_that_turns_over_keeps_its_grains_until_then():
    """A mesh collider of a thin wall turns by 2.6 rad in half a second: none leaks before, all are on the floor at the end."""
    scene, r, frames, wall = Scene(fps=60, substeps=8, iterations=4), 0.008, 72, 0.006
    time = np.arange(frames + 1) / 60.0
    angle, poses = np.clip((time - 0.4) / 0.5, 0.0, 1.0) * 2.6, np.tile(np.eye(4), (frames + 1, 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angle)
    poses[:, 0, 1], poses[:, 1, 0] = -np.sin(angle), np.sin(angle)
    surface = surface_of_profile([0.08, 0.06, 0.001, 0.001, 0.06 + wall, 0.08 + wall], [0.12, 0, 0, -wall, -wall, 0.12])
    scene.collider("/bucket", surface, motion=Motion(time, poses), static_friction=0.4, dynamic_friction=0.4)
    scene.collider("/floor", Plane(), at=(0, -0.3, 0), static_friction=0.5, dynamic_friction=0.5)
    points = 2.1 * r * (np.indices((7, 6, 7)).reshape(3, -1).T - [3, 0, 3]) + [0, 1.3 * r, 0]
    points = points[np.hypot(points[:, 0], points[:, 2]) < 0.05]
    scene.particles("/grains", points=points, radius=r, material=Grains(static_friction=0.4, dynamic_friction=0.4))
    simulation = wsim.Simulation(scene, device="cpu")
    for _ in range(24):
        simulation.step()
        x = simulation.positions("/grains").astype(float)
        assert x[:, 1].min() > 0.0 and np.all(np.hypot(x[:, 0], x[:, 2]) < np.interp(x[:, 1], [0.0, 0.12], [0.06, 0.08]))
    simulation.run(frames - 24)
    assert simulation.positions("/grains")[:, 1].max() < -0.2
