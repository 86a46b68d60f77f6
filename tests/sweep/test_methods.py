"""Sweeps of rigid bodies, joints, rods and fluids in one state: a world is its run alone to the bit, whatever the others do."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.sweep.sweep import lasting
from tools.bench.fitting.methods_in_worlds import SCENES, fields_of_world, largest_difference
from wsim.scene import Box, Plane, Scene, SceneError, Sphere
from wsim.simulation.simulation import Simulation
from wsim.sweep.job import Settings
from wsim.sweep.sweep import Sweep

CPU = {"device": "cpu"}
FRAMES = {"smoke": 3, "liquid": 4}
VARY = [("rigid", "dynamic_friction=list(0.1,0.5,0.9)"), ("rigid", "/box9:velocity_x=list(0,0.5,1)"),
        ("rigid", "/floor:static_friction=list(0.1,0.5)"), ("rigid", "/box9:force_x=list(0,0.5)"),
        ("tree", "gravity_z=list(-9.81,-5)"), ("tree", "stiffness=list(0,5,20)"), ("rods", "gravity_y=list(-9.81,-5,-12)"),
        ("smoke", "/hot:temperature=list(50,100)"), ("smoke", "lift=list(1,2)"), ("liquid", "gravity_y=list(-9.81,-5)")]




def thrown() -> Scene:
    """Six balls that jump on a floor and on each other."""
    scene = Scene(substeps=10)
    for k in range(6):
        scene.body(f"/ball{k}", Sphere(0.05), at=(0.02 * k, 0.2 + 0.15 * k, 0.01 * k), restitution=0.6)
    scene.collider("/floor", Plane(), restitution=0.5)
    return scene


def cast_boxes() -> Scene:
    return replace(SCENES["rigid"](), substeps=10)


@pytest.mark.parametrize("kind, vary", VARY)
def test_each_world_of_a_sweep_is_its_run_alone(kind, vary, tmp_path):
    """Errors, warnings and the digest of the state: of rows by themselves, and of one state of all."""
    scene = replace(SCENES[kind](), frames=FRAMES.get(kind, 8))
    alone, together = (list(wsim.sweep(scene, vary, tmp_path / str(most), settings=Settings(**CPU, worlds=most)))
                       for most in (1, 8))
    assert {row["worlds"] for row in alone} == {1} and {row["worlds"] for row in together} == {len(together)}
    assert lasting(alone) == lasting(together) and len({row["state"] for row in together}) == len(together)


@pytest.mark.parametrize("make, path, speed", [(cast_boxes, "/box9", (0.0, -30.0, 0.0)),
                                               (thrown, "/ball5", (1.0, -8.0, 0.0))])
def test_a_fast_body_changes_no_bit_of_other_worlds(make, path, speed):
    """It goes farther than its list of pairs allows for, and strikes others: lists and blows of other worlds stay."""
    sim, calm, one = Simulation(make(), worlds=3, **CPU), Simulation(make(), worlds=3, **CPU), Simulation(make(), **CPU)
    for each in (sim, one):
        each.set(path, "velocity", speed, world=None if each is one else 1)
    for each in (sim, calm, one):
        each.run(20)
    for world in (0, 2):
        assert largest_difference(fields_of_world(calm, world), fields_of_world(sim, world)) == 0.0
    assert largest_difference(fields_of_world(one, 0), fields_of_world(sim, 1)) == 0.0
    assert largest_difference(fields_of_world(calm, 1), fields_of_world(sim, 1)) > 1e-2


def test_gravity_of_a_world_is_that_of_a_scene():
    """The speed at which contacts push apart follows from it."""
    down = (0.5, -4.0, 0.0)
    sim = Simulation(cast_boxes(), worlds=2, **CPU)
    sim.set("/", "gravity", down, world=1)
    built = Simulation(replace(cast_boxes(), gravity=down), **CPU)
    for each in (sim, built):
        each.run(20)
    assert largest_difference(fields_of_world(built, 0), fields_of_world(sim, 1)) == 0.0


@pytest.mark.parametrize("kind", ["rigid", "tree", "rods", "smoke", "liquid"])
def test_a_world_begins_again_as_a_run_does_and_leaves_the_others(kind):
    before, behind = (2, 2) if kind in FRAMES else (8, 6)
    sim, whole, fresh = (Simulation(SCENES[kind](), worlds=n, **CPU) for n in (2, 2, 1))
    sim.run(before)
    sim.reset(world=1)
    for each, frames in ((sim, behind), (whole, before + behind), (fresh, behind)):
        each.run(frames)
    assert largest_difference(fields_of_world(whole, 0), fields_of_world(sim, 0)) == 0.0
    assert largest_difference(fields_of_world(fresh, 0), fields_of_world(sim, 1)) == 0.0


@pytest.mark.parametrize("kind, path", [("rigid", "/box9"), ("tree", "/World/Humanoid/torso")])
def test_a_world_of_bodies_that_breaks_is_taken_out(kind, path):
    """Thrown beyond float32's numbers; the others go on to the bit, and a reset brings it back."""
    scene = SCENES[kind]()
    sim, calm = (Simulation(scene, worlds=3, **CPU) for _ in range(2))
    for each in (sim, calm):
        each.run(2)
    sim.set(path, "velocity", (3e38, 3e38, 0.0), world=1)
    for each in (sim, calm):
        each.run(4)
    assert list(sim.lost) == [1] and sim.plan.clock.substeps == calm.plan.clock.substeps
    assert any("world 1 stopped being a number" in text for text in sim.warnings)
    for world in (0, 2):
        assert largest_difference(fields_of_world(calm, world), fields_of_world(sim, world)) == 0.0
    assert np.isfinite(sim.plan.method("rigid").poses()).all()
    sim.reset(world=1)
    sim.run(3)
    fresh = Simulation(scene, **CPU)
    fresh.run(3)
    assert sim.lost == {} and largest_difference(fields_of_world(fresh, 0), fields_of_world(sim, 1)) == 0.0


def test_a_warning_is_that_of_its_own_world(tmp_path):
    """Hot air that goes farther in a frame than its steps may; a calm plume beside it needs one step."""
    scene = Scene(frames=3)
    air = scene.smoke("/air", (0.0, 0.0, 0.0), (0.5, 0.5, 0.5), 1.0 / 16.0, most_steps=2)
    scene.smoke_source("/hot", air, Sphere(0.1), at=(0.25, 0.1, 0.25), smoke=1.0, temperature=10.0)
    rows = list(wsim.sweep(scene, "/air:lift=list(0.01,100,0.02)", tmp_path / "out", settings=Settings(**CPU)))
    assert [row["worlds"] for row in rows] == [3, 3, 3] and [bool(row["warnings"]) for row in rows] == [False, True, False]
    assert "/air: a frame needed" in rows[1]["warnings"] and "world" not in rows[1]["warnings"]


def test_why_runs_go_one_after_another_is_said(tmp_path):
    scenes = {"material points of all worlds": SCENES["mpm"](),
              "contact_tolerance ends": replace(cast_boxes(), contact_tolerance=1e-4),
              "bodies that may sleep": replace(cast_boxes(), sleep_speed=0.01)}
    for why, scene in scenes.items():
        sweep = Sweep.prepare_sweep(replace(scene, frames=1), "gravity_y=list(-9,-8)", tmp_path / why[:5],
                                    settings=Settings(**CPU))
        said: list[str] = []
        sweep.said = said.append
        assert {row["worlds"] for row in sweep.rows()} == {1} and len(said) == 1 and why in said[0]
    scene = SCENES["rods"]()
    wind = "wind=list(0 0 0,1 0 0)"
    sweep = Sweep.prepare_sweep(replace(scene, frames=1), wind, tmp_path / "built", settings=Settings(**CPU))
    assert "each value of wind is built into a scene of its own" in sweep.why_one_after_another(list(enumerate(sweep.draws)))


def test_rods_that_touch_themselves_are_not_reset_alone():
    scene = Scene()
    scene.rods("/rope", [[0.05 * k, 0.3, 0.0] for k in range(8)], [8], young=1e6, self_collision=True)
    scene.body("/box", Box((0.1, 0.1, 0.1)), at=(3.0, 0.0, 0.0))
    sim = Simulation(scene, worlds=2, **CPU)
    sim.run(2)
    before = fields_of_world(sim, 1)
    with pytest.raises(SceneError, match="remember pairs of all worlds, so that no world is reset alone; fix: reset all"):
        sim.reset(world=1)
    assert largest_difference(before, fields_of_world(sim, 1)) == 0.0
