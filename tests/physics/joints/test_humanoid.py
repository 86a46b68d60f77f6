"""The humanoid of scenes/assets: it falls, joints stay closed, a run goes on to the bit; other assets with joints."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wsim.cli.run import prepare_recorded_run
from wsim.scene import Plane
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save
from wsim.usd.result.restart import ResultReader

ASSETS = Path(__file__).parents[3] / "scenes" / "assets"
CPU = {"device": "cpu"}


def humanoid():
    """Over a plane on which it falls."""
    scene = replace(load(ASSETS / "humanoid.usda"), up="Z", frames=20)
    scene.collider("/floor", Plane(), at=(0.0, 0.0, -1.6))
    return scene


def test_the_humanoid_falls_and_its_joints_stay_closed_to_a_millimetre():
    """At its own 24 frames a second and ten substeps, for ten seconds; it comes to rest."""
    sim = Simulation(humanoid(), **CPU)
    m, worst = sim.plan.method("rigid"), 0.0
    for _ in range(240):
        sim.step()
        worst = max(worst, m.joints.error()[0])
    assert worst < 1e-3 and np.isfinite(m.poses()).all()
    assert np.abs(m.velocities()).max() < 0.02 and m.indicators(None, None)["rigid_overlap"] < 5e-3
    assert m.poses()[:, 2, 3].max() < -0.5                        # it lies


def test_bodies_of_the_humanoid_move_together_as_if_nothing_held_them_in_free_fall():
    scene = load(ASSETS / "humanoid.usda")
    scene.things("Body")[5].spin = np.array([3.0, -2.0, 1.0])
    sim = Simulation(scene, **CPU, precision="float64")
    m = sim.plan.method("rigid")
    mass, before = np.array([one.mass for one in m.masses])[:, None], m.get("L").sum(0)
    sim.run(24)
    fallen = (mass * m.get("x")).sum(0) / mass.sum()
    center = (mass * (m.origin + m.get("x"))).sum(0) / mass.sum()
    L = (np.cross(m.origin + m.get("x") - center, m.get("p")) + m.get("L")).sum(0)
    assert np.abs(fallen - (0.0, 0.0, -0.5 * 9.81)).max() < 1e-12 and np.abs(m.get("p").sum(0) / mass.sum())[:2].max() < 1e-12
    assert np.abs(L - before).max() < 1e-11 and max(m.joints.error()) < 1e-7
    assert np.linalg.norm(m.get("L"), axis=1).argmax() != 5         # it has gone to others


def test_a_run_of_joints_goes_on_to_the_bit(tmp_path):
    """And what is written is a transform for each body, at each frame."""
    save(humanoid(), tmp_path / "s.usda")
    whole, half, rest = (str(tmp_path / f"{name}.usdc") for name in ("whole", "half", "rest"))

    def run(output: str, frames: int, restart: str | None = None):
        scene = replace(load(tmp_path / "s.usda"), frames=frames)
        job = prepare_recorded_run(scene, output, lambda s: Simulation(s, **CPU), restart=restart)
        job.frames()
        return job.simulation
    one = run(whole, 20)
    run(half, 10)
    two = run(rest, 20, half)
    assert not any("bit for bit" in w for w in two.warnings)
    for name in ("x", "e", "q", "o", "p", "L"):
        assert np.array_equal(one.plan.method("rigid").get(name), two.plan.method("rigid").get(name)), name
    stage = ResultReader(whole).stage
    for body in one.scene.things("Body"):
        assert stage.GetPrimAtPath(body.path).GetAttribute("xformOp:transform").GetNumTimeSamples() == 21


def test_worlds_of_joints_are_alike():
    scene = load(ASSETS / "humanoid.usda")
    one, two = Simulation(scene, **CPU), Simulation(scene, **CPU, worlds=2)
    one.run(6)
    two.run(6)
    x, y = one.plan.method("rigid").get("x"), two.plan.method("rigid").get("x").reshape(2, 16, 3)
    assert np.array_equal(x, y[0]) and np.array_equal(x, y[1])


def test_a_hinge_with_a_strong_damper_hardly_moves():
    """In centimetres; 10 kg, of which nothing but its hinge holds it."""
    scene = load(ASSETS / "revolute_joint_scene.usda")
    (body,) = scene.things("Body")
    assert abs(body.mass - 10.0) < 1e-5 and abs(np.linalg.norm(scene.gravity) - 9.81) < 1e-6
    sim = Simulation(scene, **CPU)
    m = sim.plan.method("rigid")
    before = m.poses()
    sim.run(120)
    assert m.joints.error()[0] < 1e-9 and 0.0 < np.abs(m.poses() - before).max() < 1e-5


@pytest.mark.slow
def test_eleven_boxes_of_the_default_density_fall_and_rest():
    scene = load(ASSETS / "boxes_falling_on_groundplane.usda", frames=600)
    assert len(scene.things("Body")) == 11 and abs(sum(b.mass for b in scene.things("Body")) - 11000.0) < 1e-2
    sim = Simulation(scene, **CPU)
    sim.run(int(10.0 * scene.fps))
    assert np.abs(sim.plan.method("rigid").velocities()).max() < 1e-3
