"""Everyday objects that stand where nobody named the substeps, and what is said where somebody named too few."""

from pathlib import Path

import numpy as np
import pytest

from tests.make.physics.rigid.standing.stacks import dice, floor, moved, piled, tower
from tests.make.physics.rigid.standing.statics import frame, stone
from tests.physics.rigid.pairs import WHERE
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Cylinder, Scene, Sphere
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

UPRIGHT = axis_rotation_matrix(np.array([1.0, 0.0, 0.0]), 0.5 * np.pi)  # y to z
STEPS = 33             # of ten dice: sqrt(10^2 9.81 / 0.016 / 0.04) / (pi / 2) / 24
SUNK, TILT = 0.05, 1.0                                                 # of the smallest body; [degrees]


def arch(thickness: float, stones: int = 17) -> Scene:
    scene, angle = floor(0.8), np.pi / stones
    for k in range(stones):
        R = UPRIGHT @ axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), 0.5 * np.pi - (k + 0.5) * angle)
        shape = Collider(f"/b{k}/shape", stone(thickness, angle), static_friction=0.8, dynamic_friction=0.8)
        scene.add(Body(f"/b{k}", [shape], frame(R, R @ (0.0, 1.0, 0.0))))
    return scene


@pytest.mark.parametrize("make, size", [
    (dice, 0.016),
    (lambda: piled([(Cylinder(0.01, 0.001), 0.002)] * 10), 0.002),
    (tower, 0.015),
    (lambda: arch(0.12), 0.12),
    (lambda: piled([(Box((0.05,) * 3), 0.1), (Box((1.0,) * 3), 2.0)], [1.0, 1e4]), 0.1),
    (lambda: dice(20, 0.004), 0.004),
], ids=["dice", "coins", "tower", "arch", "ten tonnes on a kilogram", "twenty cubes of four millimetres"])
def test_everyday_objects_stand_at_the_defaults_of_a_stage(make, size):
    sunk, tilt, sim = moved(make())
    assert 0.0 < sunk <= SUNK * size and tilt < TILT
    assert not sim.report(False)["warnings"] and "substeps for rigid bodies" in sim.report(False)["raised"]


def test_dice_that_fall_onto_each_other_stand():
    """Ten, 5 mm apart: they land one by one, and are those that touch then."""
    scene = floor()
    for k in range(10):
        shape = Collider(f"/b{k}/shape", Box((0.008,) * 3))
        scene.add(Body(f"/b{k}", [shape], Motion.at_place((0.0, 0.0, 0.008 + 0.021 * k))))
    sim = Simulation(scene, **WHERE)
    sim.run(72)
    assert sim.plan.clock.substeps == STEPS
    assert np.abs(sim.plan.method("rigid").poses()[:, 2, 3] - 0.016 * (np.arange(10) + 0.5)).max() < SUNK * 0.016


def test_a_stack_that_buckles_in_twenty_seconds_is_given_more_substeps_than_its_sag_takes():
    """Ten tonnes on a kilogram sink by 4 % of it by 186 substeps, and lean over slowly up to 220: Euler's load."""
    scene = piled([(Box((0.05,) * 3), 0.1), (Box((1.0,) * 3), 2.0)], [1.0, 1e4])
    sunk, tilt, _ = moved(scene, 20.0)
    assert sunk < 0.02 * 0.1 and tilt < 1e-3
    said = Simulation(piled([(Box((0.05,) * 3), 0.1), (Box((1.0,) * 3), 2.0)], [1.0, 1e4], substeps=186), **WHERE).warnings
    assert len(said) == 1 and "lean over" in said[0]


def test_an_arch_that_is_too_thin_falls_at_the_defaults_of_a_stage():
    """t / R = .09, where .1075 stands (Milankovitch 1907)."""
    assert moved(arch(0.09), 2.0)[0] > 0.5


def test_named_substeps_stay_and_a_warning_names_the_body_the_sag_and_what_helps():
    """Ten cubes sink by n^2 g (h / (h w))^2, h w = pi / 2: 6.90 mm by 10 substeps."""
    sim = Simulation(dice(substeps=10), **WHERE)
    (said,) = [w for w in sim.warnings if "substeps" in w]
    assert sim.plan.clock.substeps == 10 and "/b9" in said and "6.9 mm" in said
    better = int(said.split("--substeps ")[1].split(",")[0])
    sunk, _, sim = moved(dice(substeps=better), 3.0)
    assert sim.plan.clock.substeps == better and sunk < SUNK * 0.016 and not sim.warnings


def test_one_ball_and_boxes_of_a_metre_keep_ten_substeps():
    for scene in (piled([(Sphere(0.1), 0.2)]), dice(10, 1.0), dice(1, 0.016)):
        assert Simulation(scene, **WHERE).plan.clock.substeps == 10


def test_what_a_stage_does_not_say_is_chosen_and_what_it_says_is_kept(tmp_path):
    path = str(tmp_path / "dice.usda")
    for scene, said, steps in ((dice(), False, STEPS), (dice(substeps=12), True, 12)):
        save(scene, path)
        assert ("wsim:substeps" in Path(path).read_text()) == said
        assert load(path).substeps == scene.substeps and Simulation(load(path), **WHERE).plan.clock.substeps == steps


def test_worlds_a_reset_and_a_restart_have_the_chosen_substeps():
    scene = dice(4, 0.008)
    sim = Simulation(scene, worlds=2, **WHERE)
    steps = sim.plan.clock.substeps
    assert steps == Simulation(scene, **WHERE).plan.clock.substeps > 10 and scene.substeps == 10
    sim = Simulation(scene, **WHERE)
    sim.run(2)
    kept = {body.path: sim.fields(body.path) for body in scene.things("Body")}
    sim.run(2)
    again = Simulation(scene, **WHERE)
    again.restart(2, kept)
    again.run(2)
    assert again.plan.clock.substeps == steps
    assert all(np.array_equal(a, again.fields(body.path)[name]) for body in scene.things("Body")
               for name, a in sim.fields(body.path).items())
    sim.reset()
    assert sim.plan.clock.substeps == steps
