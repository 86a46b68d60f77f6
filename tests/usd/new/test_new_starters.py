"""`wsim new rigid`, `new hair`, `new smoke`, `new sand`: small scenes that need no mesh, run at once and move."""

import numpy as np
import pytest

from tests.physics.animation.make import ASSETS
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


BUST = "".join(f"v {x} {y} {z}\n" for x in (0, 20) for y in (0, 20) for z in (0, 20)) + (
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n")


def test_hair_grows_on_the_mesh_that_is_given_where_it_is_wanted(tmp_path, monkeypatch, capsys):
    """On a cube of 20 cm, on faces whose middles are in the upper part: strands of half its size, clamped, out of it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "head.obj").write_text(BUST)
    command = ["new", "hair", "--on", "head.obj", "--meters-per-unit", "0.01", "--where", "0.9..1@y", "--strands", "20"]
    assert cli.main([*command, "--ground", "0", "-o", "a.usda"]) == 0
    assert cli.main(["check", "a.usda"]) == 0 and "0 errors, 0 warnings" in capsys.readouterr().out
    scene = load("a.usda")
    (hair,), head = scene.things("Rods"), next(c for c in scene.colliders if c.path.endswith("mesh"))
    x = hair.motion.points(hair.points).reshape(20, 9, 3)
    assert np.allclose(x[:, 0, 1], 0.2, atol=1e-6) and np.allclose(x[:, -1, 1], 0.3, atol=1e-6)
    assert hair.pins[0].target == head.path and len(scene.colliders) == 2
    sim = Simulation(scene, device="cpu")
    sim.run(2)
    assert np.abs(sim.positions(hair.path).reshape(20, 9, 3)[:, :2] - x[:, :2]).max() < 1e-6


def test_hair_on_a_mesh_that_a_skeleton_moves_follows_its_faces(tmp_path):
    from wsim.usd.new.hair import author_hair

    out = tmp_path / "man.usda"
    author_hair(ASSETS / "CesiumMan.usdz", out, where="0.88..1@z", strands=12, length=0.1)
    scene = load(out)
    (hair,) = scene.things("Rods")
    pin = hair.pins[0]
    assert pin.follows is not None and pin.follows.moves and len(pin.follows.faces) == 24
    assert np.abs(pin.follows.over(np.zeros(1))[0] - hair.motion.points(hair.points[pin.points])).max() < 1e-5


@pytest.mark.parametrize(("options", "said"), [
    (["--length", "0.1"], "--length: is of hair on a mesh, and none is given"),
    (["--on", "head.obj", "--where", "top@q"], "--where top@q is no part of its bounds; give one as 0.6..1@y"),
    (["--on", "head.obj", "--where", "1.2..2@x"], "where is true of 0 of 12 triangles"),
    (["--on", "none.obj"], "none.obj: there is no such file")])
def test_hair_that_cannot_grow_is_refused_and_leaves_no_scene(options, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "head.obj").write_text(BUST)
    assert cli.main(["new", "hair", *options, "-o", "a.usda"]) == 1 and said in capsys.readouterr().err
    assert not (tmp_path / "a.usda").exists()
