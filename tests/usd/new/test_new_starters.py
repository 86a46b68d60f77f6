"""`wsim new rigid`, `new hair`, `new smoke`, `new sand`: small scenes that need no mesh, run at once and move."""

import numpy as np
import pytest

from wsim import cli
from wsim.simulation.simulation import Simulation
from wsim.usd import load
from wsim.usd.new.starters import STARTERS


@pytest.mark.parametrize("kind", STARTERS)
def test_a_starter_is_a_scene_without_a_warning(kind, tmp_path, capsys):
    out = str(tmp_path / "a.usda")
    assert cli.main(["new", kind, "-o", out, "--frames", "7"]) == 0 and f"wsim run {out}" in capsys.readouterr().out
    assert cli.main(["check", out]) == 0 and "0 errors, 0 warnings" in capsys.readouterr().out
    assert load(out).frames == 7 and "displayColor" in (tmp_path / "a.usda").read_text()
    assert cli.main(["new", kind, "-o", out]) == 1 and "is there already; give --force" in capsys.readouterr().err
    assert cli.main(["new", kind, "-o", out, "--force"]) == 0 and load(out).frames > 48


def test_the_ball_rolls_to_the_wall_and_the_wall_stands_until_then():
    """The ball rolls without slip, so that friction takes nothing: 3 frames at 3.5 m/s. A brick that nothing holds falls by
    g t^2 / 2 = 77 mm meanwhile; those of the wall settle by less than 5 mm."""
    scene, _ = STARTERS["rigid"]()
    sim = Simulation(scene, device="cpu")
    begin = sim.poses()
    sim.run(3)
    now = sim.poses()
    assert now["/World/ball"][2, 3] == pytest.approx(1.0 - 3.5 * 3.0 / scene.fps, abs=2e-3)
    bricks = [path for path in now if "brick" in path]
    assert len(bricks) == 24 and max(np.abs(now[path][:3, 3] - begin[path][:3, 3]).max() for path in bricks) < 5e-3


def test_the_hair_goes_with_the_head_that_turns():
    """Roots are held: they turn by the head's angle about the vertical."""
    scene, _ = STARTERS["hair"]()
    (hair,), (head,) = scene.things("Rods"), scene.colliders
    sim = Simulation(scene, device="cpu")
    sim.run(4)
    roots = hair.pins[0].points
    expected = head.motion.at(4.0 / scene.fps) @ np.linalg.inv(head.motion.at(0.0))
    places = hair.points[roots] @ expected[:3, :3].T + expected[:3, 3]
    assert np.abs(expected[:3, :3] - np.eye(3)).max() > 0.1 and np.abs(sim.positions(hair.path)[roots] - places).max() < 1e-5


def test_smoke_rises_from_the_burner_on_its_way():
    scene, _ = STARTERS["smoke"]()
    (air,) = scene.things("Fluid")
    air.cell *= 2.0
    sim = Simulation(scene, device="cpu")
    sim.run(8)
    smoke = sim.fields(air.path)["smoke"].reshape(air.shape)
    x, y, _ = (smoke[..., None] * air.centers()).sum(axis=(0, 1, 2)) / smoke.sum()
    assert y > 0.2 + 0.02 and 0.0 < x < scene.things("Source")[0].motion.at(8.0 / scene.fps)[0, 3]


def test_sand_pours_at_its_rate_onto_the_floor():
    """6 kg/s, to half a particle, and none through the floor."""
    scene, _ = STARTERS["sand"]()
    sim = Simulation(scene, device="cpu")
    sim.run(8)
    mass = 1600.0 * 0.015**3
    assert abs(sim.indicators()["mpm_poured_mass"] - 6.0 * 8 / scene.fps) <= 0.501 * mass
    assert sim.samples()[0].positions[:, 1].min() > 0.0
