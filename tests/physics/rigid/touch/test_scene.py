"""Bodies and points in one scene: files, restarts, worlds, soft bodies and nets, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.make.physics.rigid.contact import UP, ball, box
from tests.make.physics.rigid.touch.scene import falls
from tests.physics.rigid.touch.touching import Mixed, rim, run, scene
from wsim.cli.run import prepare_recorded_run
from wsim.geometry.tetra.lattice import tet_box as block
from wsim.scene import Plane, Scene, SceneError
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

SCENES = Path(__file__).parents[4] / "scenes"
CPU = {"device": "cpu"}


@pytest.mark.parametrize("way", [("xpbd", "backward_euler", 8), ("xpbd", "bdf2", 8), ("implicit", "backward_euler", 3)])
def test_a_run_goes_on_to_the_bit_and_holds_points_and_transforms(way, tmp_path):
    save(replace(falls(), solver=way[0], integrator=way[1], iterations=way[2]), tmp_path / "s.usda")
    whole, half, rest = (str(tmp_path / f"{name}.usdc") for name in ("whole", "half", "rest"))

    def end(output: str, frames: int, restart: str | None = None) -> Simulation:
        loaded = replace(load(tmp_path / "s.usda"), frames=frames)
        job = prepare_recorded_run(loaded, output, lambda s: Simulation(s, **CPU), restart=restart)
        job.frames()
        return job.simulation
    one = end(whole, 8)
    end(half, 4)
    two = end(rest, 8, half)
    assert not any("bit for bit" in w for w in two.warnings)
    for name, part in one.plan.state.parts.items():
        for field in part.kept:
            assert np.array_equal(part.arrays[field.name].numpy(), two.plan.state.parts[name].arrays[field.name].numpy()), field
    stage = Usd.Stage.Open(whole)
    M = np.array(UsdGeom.XformCache(8.0).GetLocalToWorldTransform(stage.GetPrimAtPath("/ball"))).T
    assert np.abs(M - one.plan.method("rigid").poses()[0]).max() < 1e-6
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/sheet")).GetPointsAttr().Get(8.0))
    assert np.abs(points - one.positions("/sheet")).max() < 1e-6 and points[:, 1].min() < -0.01


def test_the_example_loads_as_such():
    found = load(SCENES / "ball_into_cloth.usda")
    assert len(found.things("Body")) == 3 and len(found.cloths) == 1 and not found.notes
    assert not [p for p in check_scene(found) if "rigid" in p.text]


def test_worlds_are_copies():
    sim = run(falls(), worlds=2)
    sim.run(6)
    method, x = sim.plan.method("rigid"), sim.plan.state.x.numpy()
    assert np.array_equal(x[:len(x) // 2], x[len(x) // 2:])
    half = len(method.bodies) // 2
    assert np.array_equal(method.get("p")[:half], method.get("p")[half:]) and abs(method.get("p")[0, 1] + 0.8) > 0.1


@pytest.mark.parametrize("density", [100.0, 600.0])
def test_a_soft_cube_on_a_box_on_a_plane_rests(density):
    """Of 6 and of 38 kg, on 5 kg; the plane bears both."""
    points, tets = block((0.4, 0.4, 0.4), (4, 4, 4))
    found = Scene(fps=60.0, substeps=10)
    gel = Bulk(young=1e5, density=density, damping=5e-3)
    found.soft("/cube", points - points.mean(0) + (0.0, 0.52, 0.0), tets, material=gel)
    found.collider("/ground", Plane(), motion=Motion.still(UP))
    found.add(box("/box", (0.0, 0.15, 0.0), (0.3, 0.15, 0.3), mass=5.0))
    found.air_drag = 2.0
    sim = Simulation(found, **CPU)
    sim.run(360)
    seen = Mixed(sim)
    assert seen.fastest < 1e-3
    assert abs(seen.x[0, 1] - 0.15) < 1e-3 and sim.positions("/cube")[:, 1].min() > 0.298
    assert sim.indicators()["rigid_overlap"] < 1e-3


def test_a_box_on_a_trampoline_net_rests():
    """It sinks by about what springs say, and stays level."""
    n = 13
    side = np.linspace(-1.0, 1.0, n)
    points = np.array([(x, 0.5, z) for z in side for x in side])
    k = np.arange(n * n).reshape(n, n)
    edges = np.concatenate([np.stack([k[:, :-1].ravel(), k[:, 1:].ravel()], 1), np.stack([k[:-1].ravel(), k[1:].ravel()], 1)])
    found = Scene(fps=60.0, substeps=10)
    net = found.net("/net", points, edges, np.array([2e3]), np.array([0.05]), damping=5e-3)
    found.pin("/pin", net, rim(n))
    found.add(box("/box", (0.0, 0.9, 0.0), (0.35, 0.15, 0.35), mass=5.0, drag=3.0, spin_drag=3.0))
    found.air_drag = 3.0
    sim = Simulation(found, **CPU)
    sim.run(480)
    seen = Mixed(sim)
    assert seen.fastest < 1e-3 and np.abs(sim.plan.method("rigid").poses()[0][1, :3] - (0.0, 1.0, 0.0)).max() < 1e-3
    assert 0.2 < seen.x[0, 1] < 0.6


def test_newtons_method_repeats_what_it_has_not_foreseen():
    """A light ball at 20 m/s into a sheet that is stiff for its steps: energy is lost, not gained, and it comes back."""
    sim = run(scene(ball("/ball", (0.01, 0.3, 0.02), 0.1, velocity=(0.0, -20.0, 0.0), mass=0.1), pinned=True, n=17, stretch=1e4,
                    solver="implicit", integrator="backward_euler", iterations=2))
    sim.run(4)
    seen = Mixed(sim)
    assert any("than Newton steps had foreseen" in why for why in sim.repeats)
    assert seen.x[0, 1] < 0.4 and seen.fastest < 25.0 and sim.indicators()["touch_residual"] < 0.25


@pytest.mark.parametrize("change, other, said", [
    ({"contact_width": 1e-3}, {}, "all contacts of this scene are hard"),
    ({"integrator": "implicit_midpoint"}, {"integrator": "bdf2"}, "bdf2 takes its place"),
    ({"solver": "implicit", "iterations": 3, "integrator": "sdirk3"}, {"integrator": "bdf2"}, "bdf2 takes its place")])
def test_what_cannot_be_gives_way_and_says_so(change, other, said):
    """To the bits of what takes its place."""
    one, two = run(replace(falls(), **change)), run(replace(falls(), **change | {"contact_width": 0.0} | other))
    assert any(said in w for w in one.warnings) and not any(said in w for w in two.warnings)
    assert "integrator" not in other or "rebounds from rigid bodies" in one.plan.choice.why
    for sim in (one, two):
        sim.run(3)
    assert np.array_equal(one.positions("/sheet"), two.positions("/sheet"))
    assert np.array_equal(one.plan.method("rigid").poses(), two.plan.method("rigid").poses())


def test_the_plan_says_that_bodies_beside_points_never_sleep():
    said = "none sleeps, as points never do"
    assert said in run(falls(sleep_speed=0.05)).plan.describe() and said not in run(falls()).plan.describe()


def test_gradients_are_refused_by_the_body():
    with pytest.raises(SceneError, match="/ball"):
        run(falls(), gradients=True)
