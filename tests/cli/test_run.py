"""Runs in parts of frames and with a delay: what the simulated scene becomes."""

import json
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

import wsim
from tests.make.cli.cli import run, samples
from wsim import cli
from wsim.cli.run import delay_scene_curves, subdivide_frames
from wsim.physics.particles.pouring import Pour
from wsim.scene import Scene, Surface
from wsim.scene.curve import Curve, Motion
from wsim.simulation import duration
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save


def test_later_moves_every_curve():
    scene = Scene()
    motion = Motion([0.0, 1.0], np.stack([np.eye(4), np.diag([1.0, 1.0, 1.0, 1.0])]))
    motion.values[1, 0, 3] = 1.0
    poses = Curve([0.0, 1.0], np.arange(18.0).reshape(2, 3, 3))
    scene.collider("/a", Surface(np.zeros((3, 3)), [3], [0, 1, 2], poses=poses), motion=motion)
    scene.pin("/p", "/cloth", [0], motion=motion)
    moved = delay_scene_curves(scene, 0.5)
    for t in (0.0, 0.3, 1.0):
        assert np.allclose(moved.colliders[0].motion.at(t + 0.5), motion.at(t), atol=1e-15)
        assert np.allclose(moved.colliders[0].shape.poses.at(t + 0.5), poses.at(t), atol=1e-14)
        assert np.allclose(moved.pins[0].motion.at(t + 0.5), motion.at(t), atol=1e-15)
    assert scene.colliders[0].motion.times[0] == 0.0                   # the scene that is written stays


def test_later_moves_pours_sinks_and_smoke_sources_and_gives_frames_for_them():
    scene = Scene(fps=20.0, frames=10)
    motion = Motion([0.0, 1.0], np.stack([np.eye(4), np.eye(4)]))
    motion.values[1, 0, 3] = 1.0
    for name, make in (("particles", scene.particles), ("mpm", scene.mpm)):
        more = {"radius": 0.01} if name == "particles" else {"cell": 0.02}
        make(f"/{name}", wsim.Sphere(0.03), velocity=(0, -1, 0), pour=Pour(-0.25, 2.0), motion=motion, **more)
    scene.sink("/drain", wsim.Sphere(0.1), motion=motion)
    air = scene.smoke("/air", (0, 0, 0), (1, 1, 1), cell=0.1)
    scene.smoke_source("/source", air, wsim.Sphere(0.1), motion=motion, strength=Curve([0.0, 1.0], np.array([0.0, 2.0])))
    moved = delay_scene_curves(scene, 0.5)
    assert moved.frames == 20 and scene.frames == 10
    for kind in ("Particles", "MaterialPoints"):
        assert moved.things(kind)[0].pour == Pour(0.25, 2.5)
    for kind in ("Particles", "MaterialPoints", "MaterialSink", "Source"):
        assert np.isclose(moved.things(kind)[0].motion.at(1.25)[0, 3], 0.75)
    assert np.isclose(moved.things("Source")[0].strength.at(1.0), 1.0)


@pytest.mark.parametrize(("substeps", "count", "each"), [(10, 2, 5), (10, 3, 4), (2, 4, 1)])
def test_finer_keeps_the_substep_or_makes_it_shorter(substeps, count, each):
    scene = subdivide_frames(Scene(substeps=substeps, fps=24.0, frames=10), count)
    assert (scene.substeps, scene.fps, scene.frames) == (each, 24.0 * count, 10 * count)


@pytest.fixture(params=["xpbd", "explicit"])
def solved(request, scene, tmp_path):
    """The scene as a file, once with each: 2 substeps of XPBD, 32 of leapfrog."""
    scene.frames, scene.solver = 4, request.param
    scene.integrator, scene.substeps = ("backward_euler", 2) if request.param == "xpbd" else ("leapfrog", 32)
    path = str(tmp_path / "scene.usda")
    save(scene, path)
    return path


def test_a_restart_goes_on_bit_for_bit(solved, tmp_path):
    half, rest, all_ = (str(tmp_path / f"{name}.usdc") for name in ("half", "rest", "all"))
    assert run(solved, half, "--frames", "2") == 0
    assert run(solved, rest, "--restart", half) == 0
    assert run(solved, all_) == 0
    rest_samples, all_samples = samples(rest), samples(all_)
    assert list(rest_samples) == list(all_samples) == [0, 1, 2, 3, 4]
    assert all(np.array_equal(rest_samples[code], all_samples[code]) for code in all_samples)


def test_subframe_samples_are_the_substeps_between(solved, tmp_path):
    """An even number of substeps a frame, two samples a frame: whole frames are the same, and there is one between."""
    plain, blurred = str(tmp_path / "plain.usdc"), str(tmp_path / "blurred.usdc")
    assert run(solved, plain, "--frames", "2") == 0
    assert run(solved, blurred, "--frames", "2", "--samples", "2") == 0
    expected, found = samples(plain), samples(blurred)
    assert list(found) == [0, 0.5, 1, 1.5, 2]
    assert all(np.allclose(found[code], expected[code], rtol=0.0, atol=2e-7) for code in expected)


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt, 130), (ValueError("lost"), 1)])
def test_a_run_that_does_not_end_keeps_its_frames_and_an_old_result(solved, tmp_path, monkeypatch, capsys, error, code):
    out, step = str(tmp_path / "out.usdc"), Simulation.step
    assert run(solved, out) == 0
    earlier = Path(out).read_bytes()

    def third_interrupted(self):
        if self.frame == 2:
            raise error
        step(self)

    with monkeypatch.context() as change:
        change.setattr(Simulation, "step", third_interrupted)
        assert run(solved, out) == code
    kept = out.replace(".usdc", ".partial.usdc")
    said = capsys.readouterr().err
    assert f"{kept} holds the 2 frames so far (go on with --restart {kept}); {out} is as it was before" in said
    assert list(samples(kept)) == [0, 1, 2] and Path(out).read_bytes() == earlier
    with monkeypatch.context() as change:                       # no frame more: the file has its name back
        change.setattr(Simulation, "step", third_interrupted)
        assert run(solved, out, "--restart", kept) == code
    assert list(samples(kept)) == [0, 1, 2] and f"no frame was written; {kept} holds those" in capsys.readouterr().err
    assert run(solved, out, "--restart", kept) == 0
    whole = samples(out)
    run(solved, tmp_path / "one.usdc")
    assert all(np.array_equal(points, whole[k]) for k, points in samples(tmp_path / "one.usdc").items())


def test_run_has_a_default_output_beside_the_scene_and_tells_of_its_making(scene, tmp_path, capsys):
    """SCENE.sim.usdc; version, command, scene, hash of the scene and settings stand in the layer for people to read."""
    stage = str(tmp_path / "scene.usda")
    save(scene, stage)
    before = Path(stage).read_bytes()
    assert cli.main(["run", stage, "--device", "cpu", "--frames", "1", "--verbose"]) == 0
    assert "left out  contact: there is no collider" in capsys.readouterr().out
    out = Path(stage).with_suffix("").with_suffix(".sim.usdc")
    told = dict(Sdf.Layer.FindOrOpen(str(out)).customLayerData["wsim"])
    assert Path(stage).read_bytes() == before and out.exists()
    assert told["version"] == wsim.__version__ and told["scene"] == "scene.usda"
    assert told["solver"] in ("xpbd", "implicit", "explicit")
    assert len(told["sceneHash"]) == 32 and told["precision"] == "float32" and told["command"]
    hashes = {told["sceneHash"]}
    for frames, gravity in ((2, -9.81), (1, -1.62)):                 # the length of a run is no other scene, its gravity is
        scene = load(stage)
        scene.gravity = (0.0, gravity, 0.0)
        again = wsim.Simulation(scene, device="cpu")
        with again.record(out):
            again.run(frames)
        hashes.add(Sdf.Layer.FindOrOpen(str(out)).customLayerData["wsim"]["sceneHash"])
    assert len(hashes) == 2


def test_a_run_that_will_take_long_says_so_before_it_starts_and_its_report_counts_itself(scene, tmp_path, capsys, monkeypatch):
    stage = str(tmp_path / "scene.usda")
    save(scene, stage)
    monkeypatch.setattr(duration, "SLOW", 1e-9)
    assert cli.main(["run", stage, "-o", str(tmp_path / "a.usdc"), "--device", "cpu", "--frames", "2", "--json"]) == 0
    said = capsys.readouterr()
    first = said.err.splitlines()[0]
    assert first.startswith("warning: /: a frame takes about") and "--substeps, a coarser mesh or a GPU" in first
    spent = json.loads(said.out)["seconds"]
    parts = ("import", "load", "build", "simulate", "write", "report")
    assert 0.0 < spent["report"] < spent["total"] and sum(spent[name] for name in parts) <= spent["total"]


def test_examples_are_listed_and_run_in_the_current_folder(tmp_path, monkeypatch, capsys):
    """Every shipped scene has a line that says what it shows; a wrong name is told the nearest one."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["examples"]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines() if ".md" not in line and line]
    assert len(lines) >= 37 and all(len(line) == 2 and len(line[1]) > 20 for line in lines)
    assert cli.main(["examples", "hanging_clot"]) == 1
    assert "did you mean hanging_cloth?" in capsys.readouterr().err
    assert cli.main(["examples", "hanging_cloth", "--frames", "1", "--device", "cpu"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"hanging_cloth.usdc", "hanging_cloth.png"}
