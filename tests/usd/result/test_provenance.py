"""What a result was made of and how is kept in it, and a run that goes on says what is another now, or refuses."""

import dataclasses

import numpy as np
import pytest
from pxr import Sdf

from tests.conftest import grid
from tests.make.cli.cli import run, samples
from wsim import __version__
from wsim.scene import Scene, SceneError
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.usd import load, save
from wsim.usd.result import provenance
from wsim.usd.result.restart import load_restart


def sheet(**more) -> Scene:
    """4 x 4 points of a cloth, pinned at two corners."""
    scene = Scene(**({"frames": 4, "substeps": 2, "iterations": 2, "solver": "xpbd", "integrator": "backward_euler"} | more))
    scene.pin("/pin", scene.cloth("/cloth", *grid(), material=Fabric(stretch=100.0)), [0, 3])
    return scene


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """(scene file, result of its first 2 frames)"""
    folder = tmp_path_factory.mktemp("half")
    stage, out = str(folder / "scene.usda"), str(folder / "half.usdc")
    save(sheet(), stage)
    assert run(stage, out, "--frames", "2", "--quiet") == 0
    return stage, out


@pytest.mark.parametrize("flatten", [(), ("--flatten",)])
def test_the_same_scene_and_settings_go_on_without_a_word(half, tmp_path, capsys, flatten):
    out, whole = str(tmp_path / "o.usdc"), str(tmp_path / "whole.usdc")
    if flatten:
        assert run(half[0], whole, "--frames", "2", "--quiet", *flatten) == 0
    capsys.readouterr()
    assert run(half[0], out, "--restart", whole if flatten else half[1], "--quiet") == 0
    assert "then" not in (said := capsys.readouterr().err) and "known" not in said and "another" not in said


@pytest.mark.parametrize(("words", "said"), [
    (("--substeps", "3"), "substeps 2 then, 3 now"), (("--iterations", "3"), "iterations 2 then, 3 now"),
    (("--precision", "float64"), "precision float32 then, float64 now"),
    (("--integrator", "bdf2"), "integrator backward_euler then, bdf2 now")])
def test_other_settings_are_said_and_the_restart_is_not_exact(half, tmp_path, capsys, words, said):
    assert run(half[0], str(tmp_path / "o.usdc"), "--restart", half[1], "--quiet", *words) == 0
    assert f"({said})" in (err := capsys.readouterr().err) and "not bit for bit" in err
    assert list(samples(tmp_path / "o.usdc")) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("was", "said"), [
    ({"version": "0.0.0"}, "wsim 0.0.0 then"), ({"settings": {"device": "cuda"}}, "device cuda then, cpu now")])
def test_another_version_or_device_is_said_too(was, said):
    now = {"device": "cpu", "precision": "float32"}
    (found,) = provenance.changed_settings({"version": __version__, "settings": now} | was, now)
    assert found.startswith(said) and provenance.changed_settings({"version": __version__, "settings": now}, now) == []


def changed(scene: Scene, **fields) -> Scene:
    for name, value in fields.items():
        setattr(scene.cloths[0], name, value)
    return scene


@pytest.mark.parametrize(("scene", "said"), [
    (lambda: changed(sheet(), material=Fabric(stretch=101.0)), "/cloth: material"),
    (lambda: sheet(gravity=(0.0, -9.0, 0.0)), "/: gravity"),
    (lambda: dataclasses.replace(sheet(), pins=[]), "/pin: is gone"),
    (lambda: changed(sheet(), rest_points=1.1 * grid()[0]), "/cloth: rest_points"),
])
def test_another_scene_is_said_by_path_and_field(half, scene, said):
    restart = load_restart(half[1], scene())
    assert [said in str(note) and not note.fatal for note in restart.notes] == [True], restart.notes


def test_another_mesh_of_as_many_points_is_refused(half):
    points, counts, indices = grid()
    with pytest.raises(SceneError, match=r"/cloth: has another mesh than in .*half.usdc \(indices\)"):
        load_restart(half[1], changed(sheet(), indices=np.roll(indices.reshape(-1, 4), 1, axis=0).reshape(-1)))
    with pytest.raises(SceneError, match=r"\(counts, indices\)"):
        load_restart(half[1], changed(sheet(), counts=counts[1:], indices=indices[4:]))


@pytest.mark.parametrize("text", [None, "{", "[]", '{"scene": 3}'])
def test_a_result_that_does_not_say_is_told_from_one_that_fits(half, tmp_path, text):
    layer = Sdf.Layer.OpenAsAnonymous(half[1])
    data = dict(layer.customLayerData)
    del data[provenance.KEY]
    layer.customLayerData = data | ({provenance.KEY: text} if text else {})
    layer.subLayerPaths = [half[0]]
    layer.Export(str(tmp_path / "old.usdc"))
    notes = load_restart(tmp_path / "old.usdc", sheet()).notes
    assert len(notes) == 1 and "can't be known" in notes[0].text


def test_where_a_run_begins_and_what_is_only_seen_do_not_count(half):
    scene = load(half[0])
    scene.frames, scene.error = 100, 0.5
    scene.cloths[0].velocities = np.ones((16, 3))
    assert provenance.scene_digests(scene) == provenance.scene_digests(load(half[0]))


def test_a_motion_that_was_asked_where_it_is_has_the_digest_of_one_that_was_not():
    """It keeps rotations of its keys once it was asked."""
    motion = Motion([0.0, 1.0], np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])]))
    before = provenance.content_digest(motion)
    motion.at(0.5)
    assert motion.turned and provenance.content_digest(motion) == before


def test_a_result_from_before_a_field_was_there_fits_a_scene_that_leaves_it_alone(half):
    made = provenance.read_provenance(Sdf.Layer.FindOrOpen(half[1]))
    del made["scene"]["/cloth"]["bends"], made["scene"]["/"]["contact_width"]
    assert provenance.warn_of_scene_changes("old", made, sheet()) == []
    (note,) = provenance.warn_of_scene_changes("old", made, changed(sheet(), bends=np.full(9, 2e-4, np.float32)))
    assert "/cloth: bends" in note.text
