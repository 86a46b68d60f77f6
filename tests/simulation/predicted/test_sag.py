"""The sag of rigid bodies at rest: closed forms, and what runs leave."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.physics.rigid.standing.stacks import dice, floor, moved, piled, tower
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.kernels.rigid import soft_step
from wsim.physics.rigid.joints.filters.groups import FilteredPairs
from wsim.physics.rigid.joints.joint import fixed_joint
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Capsule, Collider, Cylinder, Scene, Surface, shapes
from wsim.scene.curve import Motion
from wsim.simulation.predicted import sag
from wsim.simulation.predicted.sag import need_of_rigid_bodies

G = 9.81


def box(path: str, half, at, turn: float = 0.0, **more) -> Body:
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), turn), at
    return Body(path, [Collider(f"{path}/shape", Box(half))], Motion.still(M), **more)


def test_the_frequency_is_that_of_the_contacts():
    assert sag.TURN == soft_step.TURN


@pytest.mark.parametrize("size", [1e-3, 0.1, 10.0])
@pytest.mark.parametrize("n", [1, 2, 10, 30])
def test_a_column_of_equal_cubes_sinks_by_the_square_of_its_number(n, size):
    found = need_of_rigid_bodies(dice(n, size))
    assert found.path == f"/b{n - 1}" and found.rate == pytest.approx(n * n * G / size, rel=1e-5)
    assert found.size == pytest.approx(size) and not found.falls


@pytest.mark.parametrize("n, size", [(10, 1e-3), (40, 10.0)])
def test_a_column_of_equal_cubes_buckles_at_a_sag_of_0_98_over_its_number(n, size):
    """Greenhill 1881; Dunkerley's rule is 24 % on the safe side for long beams, and the lowest contact is twice as stiff."""
    found = need_of_rigid_bodies(dice(n, size))
    assert 0.98 / n == pytest.approx(found.rate / found.tips, rel=0.25)


def test_masses_count_by_their_ratio():
    """Three cubes of m, 10 m, 100 m from below: each contact bears W and gives way by W (w_a + w_b)."""
    masses = np.array([1.0, 10.0, 100.0])
    borne = G * np.cumsum(masses[::-1])[::-1]
    want = borne @ (1.0 / masses + np.concatenate([[0.0], 1.0 / masses[:-1]]))
    for unit in (1e-3, 1.0, 1e3):
        found = need_of_rigid_bodies(piled([(Box((0.05,) * 3), 0.1)] * 3, list(unit * masses)))
        assert found.rate * 0.1 == pytest.approx(want, rel=1e-5)


def test_three_blocks_a_level_share_their_load():
    """A level bears what is above it by nine contacts, whose A is more than 2 / m, as they lie away from the middle: its blocks
    sink by more than with 9 in the middle, 2 / 3 g a level, and by less than with 3, 2 g."""
    above = np.arange(1, 18).sum()
    assert 18 + 2.0 / 3.0 * above < need_of_rigid_bodies(tower()).rate * 0.015 / G < 18 + 2.0 * above


def test_corners_that_meet_walls_and_what_hangs_bear_nothing():
    """Four columns of ten, side by side: as one alone. A box under a ceiling falls."""
    scene = floor()
    for k in range(40):
        scene.add(box(f"/b{k}", (0.1,) * 3, (0.2 * (k // 10 % 2), 0.2 * (k // 20), 0.1 + 0.2 * (k % 10))))
    assert need_of_rigid_bodies(scene).rate * 0.2 == pytest.approx(100.0 * G, rel=1e-4)
    scene = Scene(up="Z")
    scene.collider("/ceiling", Box((1.0, 1.0, 0.1)), at=(0.0, 0.0, 1.0))
    scene.add(box("/hangs", (0.1,) * 3, (0.0, 0.0, 0.8)))
    assert need_of_rigid_bodies(scene).falls


def test_what_joints_hold_moves_as_one_and_what_they_hold_to_the_world_bears():
    column, held = dice(3, 0.1), dice(3, 0.1)
    column.add(fixed_joint("/joint", *column.things("Body")[:2]))
    held.add(fixed_joint("/joint", None, held.things("Body")[0]))
    assert need_of_rigid_bodies(column).rate * 0.1 == pytest.approx((3 + 2) * G, rel=1e-5)  # 3 on the floor, one with A = 2
    assert need_of_rigid_bodies(held).rate * 0.1 == pytest.approx((2 * 2 + 1 * 2) * G, rel=1e-5)


def test_what_filters_keep_apart_bears_nothing():
    column = dice(3, 0.1)
    column.add(FilteredPairs("/b1", ["/b0"]))                     # falls through it, onto the floor
    assert need_of_rigid_bodies(column).falls and not need_of_rigid_bodies(dice(3, 0.1)).falls


def test_no_gravity_nothing_to_touch_and_free_flight_want_nothing():
    assert need_of_rigid_bodies(dice(gravity=(0.0, 0.0, 0.0))).rate == 0.0
    lone = Scene(up="Z")
    lone.add(box("/b", (0.1,) * 3, (0.0, 0.0, 1.0)))
    assert need_of_rigid_bodies(lone).rate == 0.0


def test_small_bodies_that_fall_take_more_substeps_than_large_ones():
    def rain(size: float) -> Scene:
        scene = floor()
        for k in range(64):
            scene.add(box(f"/b{k}", (0.5 * size,) * 3, (2.0 * size * (k % 8), 2.0 * size * (k // 8), 1.0)))
        return scene
    small, large = need_of_rigid_bodies(rain(0.002)), need_of_rigid_bodies(rain(0.4))
    assert small.falls and small.rate == pytest.approx(2.0 * G * 4.0 / 0.002, rel=1e-3)
    assert small.substeps(24.0) > 10 > large.substeps(24.0)


def wall() -> Scene:
    """Six rows of bricks in a running bond, with half bricks at the ends."""
    scene = floor()
    for row in range(6):
        ends = [-0.4 + 0.2 * k + 0.1 * (row % 2) for k in range(4 + (row % 2 == 0))]
        cuts = sorted({-0.4, 0.4, *(round(e, 6) for e in ends)})
        for k, (a, b) in enumerate(zip(cuts[:-1], cuts[1:], strict=True)):
            scene.add(box(f"/w{row}_{k}", (0.5 * (b - a) - 5e-4, 0.05, 0.035), (0.5 * (a + b), 0.0, 0.07 * (row + 0.5))))
    return scene


def turned() -> Scene:
    scene = floor()
    for k in range(8):
        scene.add(box(f"/b{k}", (0.05,) * 3, (0.0, 0.0, 0.1 * (k + 0.5)), 0.4 * k))
    return scene


def rolls() -> Scene:
    """A plate on three lying capsules, a box and a cylinder on it, on a mesh."""
    scene = Scene(up="Z")
    scene.collider("/ground", Surface(*shapes.box((2.0, 2.0, 0.1))), at=(0.0, 0.0, -0.1), approximation="none")
    for k in range(3):
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = axis_rotation_matrix(np.array([0.0, 1.0, 0.0]), 0.5 * np.pi), (0.0, 0.2 * (k - 1), 0.05)
        scene.add(Body(f"/roll{k}", [Collider(f"/roll{k}/shape", Capsule(0.05, 0.3))], Motion.still(M)))
    scene.add(box("/plate", (0.3, 0.3, 0.02), (0.0, 0.0, 0.12)))
    scene.add(Body("/post", [Collider("/post/shape", Cylinder(0.1, 0.2))], Motion.at_place((0.0, 0.0, 0.34)), mass=100.0))
    return scene


@pytest.mark.parametrize("make, steps, least, most", [
    (lambda n: dice(6, substeps=n), 20, 0.99, 1.02),
    (lambda n: piled([(Box((0.05,) * 3), 0.1)] * 3, [1.0, 30.0, 900.0], substeps=n), 60, 0.99, 1.02),
    (lambda n: replace(wall(), substeps=n), 20, 0.8, 1.25), (lambda n: wall(), 10, 0.75, 1.25),
    (lambda n: turned(), 10, 0.95, 1.4), (lambda n: rolls(), 10, 0.8, 2.0),
], ids=["dice", "masses", "wall", "coarse wall", "turned cubes", "rolls"])
def test_a_run_sinks_as_far_as_is_said(make, steps, least, most):
    """Exactly where patches and normals are those of the run, else within a factor of two, and hardly ever less: 0.77 of what a
    wall sinks in 10 substeps, 0.95 in 20 and in 40."""
    scene = make(steps)
    found = need_of_rigid_bodies(scene)
    sim = moved(scene, 3.0)[2]
    bodies = [b.path for b in scene.things("Body")]
    k = bodies.index(found.path)
    start = scene.things("Body")[k].motion.at(0.0)[2, 3]
    sunk = start - sim.plan.method("rigid").poses()[k, 2, 3]
    assert least < found.part(1.0 / scene.fps / sim.plan.clock.substeps) * found.size / sunk < most


@pytest.mark.parametrize("r, half, least, most", [(0.0125, 0.0003, 12, 20), (0.001, 0.001 / 12.0, 10, 20)])
def test_a_coin_on_its_rim_wants_what_keeps_it_upright(r, half, least, most):
    """Runs of 2 s at 24 fps: it has fallen at `least` substeps, and stands at `most`; Dunkerley's rule is on the safe side."""
    scene, M = floor(), np.eye(4)
    M[:3, :3], M[2, 3] = axis_rotation_matrix(np.array([1.0, 0.0, 0.0]), 0.5 * np.pi), r
    scene.add(Body("/coin", [Collider("/coin/shape", Cylinder(r, half))], Motion.still(M)))
    found = need_of_rigid_bodies(scene)
    assert found.cause == "leans" and least < found.substeps(24.0) <= 1.5 * most
    assert "lean over" in found.warnings(scene, 10)[0]
