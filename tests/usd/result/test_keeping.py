"""A run, a copy and an interruption take no file from another result: of volumes, restart fields, clips and scenes."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdUtils

from tests.conftest import grid
from tests.make.usd.result.clips import record
from tests.make.usd.result.kinds import FRAMES, author, check, files, register, run
from tests.make.usd.result.recorder import author as cloth
from wsim.cli import main
from wsim.cli.run import prepare_recorded_run
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation
from wsim.usd import load
from wsim.usd.result.kinds import sidecar
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.kinds.duplicate import copy_result
from wsim.usd.result.kinds.siblings import KEY, is_referenced_by_sibling
from wsim.usd.result.recorder import Recorder
from wsim.usd.result.restart import load_restart


@pytest.fixture(autouse=True)
def row(monkeypatch):
    register(monkeypatch.setattr)
    monkeypatch.setattr(sidecar, "LARGE", 1000)


def intact(path) -> None:
    """All files that a result names are there, and its samples are those of the closed form."""
    assert UsdUtils.ComputeAllDependencies(str(path))[2] == []
    check(path, frames=2)
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if prim.HasAttribute(sidecar.FILE):
            assert (Path(path).parent / prim.GetAttribute(sidecar.FILE).Get()).is_file()


def plain(tmp_path, name):
    shutil.copyfile(tmp_path / "a.usdc", tmp_path / name)


def linked(tmp_path, name):
    os.link(tmp_path / "a.usdc", tmp_path / name)


def renamed(tmp_path, name):
    os.rename(tmp_path / "a.usdc", tmp_path / name)


def text(tmp_path, name):
    Sdf.Layer.FindOrOpen(str(tmp_path / "a.usdc")).Export(str(tmp_path / name))


def flat(tmp_path, name):
    """As `usdcat --flatten` makes it: nothing in it says that a run made it."""
    layer = Usd.Stage.Open(str(tmp_path / "a.usdc")).Flatten()
    layer.customLayerData = {}
    layer.Export(str(tmp_path / name))


@pytest.mark.parametrize("name", ["best.usdc", "z.usd"])
@pytest.mark.parametrize("keep", [plain, linked, renamed, text, flat])
def test_what_was_kept_of_a_result_keeps_its_files_in_both_directions(tmp_path, keep, name):
    """A run to the first name, then one to the name of the copy: neither takes a file of the other."""
    source = author(tmp_path / "s.usda", frames=2)
    run(source, tmp_path / "a.usdc", 2)
    keep(tmp_path, name)
    run(source, tmp_path / "a.usdc", 2)
    intact(tmp_path / name)
    run(source, tmp_path / name, 2)
    intact(tmp_path / "a.usdc")
    intact(tmp_path / name)


def test_a_folder_goes_when_nothing_refers_to_it_any_more(tmp_path):
    source = author(tmp_path / "s.usda", frames=2)
    run(source, tmp_path / "a.usdc", 2)
    shutil.copyfile(tmp_path / "a.usdc", tmp_path / "best.usdc")
    run(source, tmp_path / "a.usdc", 2)
    assert len(os.listdir(tmp_path / "a.files")) == 2
    (tmp_path / "best.usdc").unlink()
    run(source, tmp_path / "a.usdc", 2)
    assert len(os.listdir(tmp_path / "a.files")) == 2         # of the first run, whose layer is gone, and of the last
    intact(tmp_path / "a.usdc")


def test_a_link_to_a_result_in_another_folder_is_replaced_and_not_followed(tmp_path):
    source = author(tmp_path / "s.usda", frames=2)
    (tmp_path / "kept").mkdir()
    run(source, tmp_path / "kept/a.usdc", 2)
    os.symlink(tmp_path / "kept/a.usdc", tmp_path / "a.usdc")
    os.symlink(tmp_path / "kept/a.files", tmp_path / "a.files")
    before = files(tmp_path / "kept")
    run(source, tmp_path / "a.usdc", 2)
    assert before <= files(tmp_path / "kept") and not (tmp_path / "a.usdc").is_symlink()
    intact(tmp_path / "kept/a.usdc")
    intact(tmp_path / "a.usdc")


@pytest.mark.parametrize("ending", [".usdc", ".usda", ".usd"])
def test_restarts_and_interrupted_runs_leave_copies_alone(tmp_path, ending):
    source, out, best = author(tmp_path / "s.usda", frames=2), tmp_path / f"a{ending}", tmp_path / f"best{ending}"
    run(source, out, 2)
    shutil.copyfile(out, best)
    run(source, out, FRAMES, out)                             # goes on from the result that it replaces
    check(out)
    run(source, out, FRAMES, best)
    check(out)
    intact(best)
    recorder = stopped(source, out)
    shutil.copyfile(recorder.kept, tmp_path / "snap.usdc")
    run(source, out, 2)
    run(source, out, 2)
    intact(out)
    intact(best)
    for name in ("snap.usdc", "a.recovered.usdc"):
        check(tmp_path / name, frames=3)
        assert load_restart(tmp_path / name, load(source)).exact


def stopped(source, out):
    """A run that ends by Ctrl-C after three frames."""
    job = prepare_recorded_run(replace(load(source), frames=FRAMES), str(out), lambda s: Simulation(s, device="cpu"))

    def stop(sim):
        if sim.frame == 3:
            raise KeyboardInterrupt
    job.watchers.append(stop)
    with pytest.raises(KeyboardInterrupt):
        job.frames()
    return job.recorder


@pytest.mark.parametrize("flatten", [False, True])
def test_a_result_without_files_names_no_folder(tmp_path, flatten):
    scene = cloth(tmp_path / "s.usda")
    record(scene, tmp_path / "o.usdc", clip=False, flatten=flatten)
    assert KEY not in Sdf.Layer.FindOrOpen(str(tmp_path / "o.usdc")).customLayerData
    source = author(tmp_path / "v.usda", frames=2)
    run(source, tmp_path / "v.usdc", 2, flatten=flatten)
    folder = Sdf.Layer.FindOrOpen(str(tmp_path / "v.usdc")).customLayerData[KEY]
    assert (tmp_path / folder).is_dir()


@pytest.mark.parametrize("keep", [plain, renamed, text])
def test_a_copy_of_a_result_keeps_its_clips(tmp_path, keep):
    scene = cloth(tmp_path / "s.usda")
    record(scene, tmp_path / "a.usdc")
    keep(tmp_path, "best.usdc")
    record(scene, tmp_path / "a.usdc")
    record(scene, tmp_path / "best.usdc", clip=False)
    assert UsdUtils.ComputeAllDependencies(str(tmp_path / "a.usdc"))[2] == []
    keep(tmp_path, "best.usdc")
    record(scene, tmp_path / "a.usdc", clip=False)
    assert UsdUtils.ComputeAllDependencies(str(tmp_path / "best.usdc"))[2] == []


def test_a_copy_of_a_result_keeps_the_scene_that_was_made_in_python(tmp_path):
    for size in (3, 4):
        scene = Scene()
        scene.cloth("/cloth", *grid(size))
        with Recorder(scene, tmp_path / "a.usdc") as recorder:
            recorder.append(recorder.time_code(0), {"/cloth": scene.cloths[0].points})
        if size == 3:
            shutil.copyfile(tmp_path / "a.usdc", tmp_path / "best.usdc")
    stages = [Usd.Stage.Open(str(tmp_path / name)) for name in ("best.usdc", "a.usdc")]
    faces = [len(UsdGeom.Mesh(stage.GetPrimAtPath("/cloth")).GetFaceVertexCountsAttr().Get()) for stage in stages]
    assert 0 < faces[0] < faces[1]


@pytest.mark.parametrize("ending", [".usdc", ".usda"])
def test_copy_takes_all_files_along(tmp_path, ending, capsys):
    source, there = author(tmp_path / "s.usda", frames=2), tmp_path / "there"
    there.mkdir()
    run(source, tmp_path / "a.usdc", 2)
    copy = there / f"b{ending}"
    for _ in range(2):                                        # the second replaces the first, and its files
        assert main(["copy", str(tmp_path / "a.usdc"), str(copy)]) == 0
    assert "with files of its own" in capsys.readouterr().out and len(os.listdir(there / "b.files")) == 1
    shutil.rmtree(tmp_path / "a.files")
    (tmp_path / "a.usdc").unlink()
    intact(copy)
    run(source, tmp_path / "rest.usdc", FRAMES, copy)
    check(tmp_path / "rest.usdc")
    with pytest.raises(SceneError, match="a.usdc: is no file"):
        copy_result(tmp_path / "a.usdc", tmp_path / "c.usdc")
    with pytest.raises(SceneError, match="s.usda: is no result"):
        copy_result(source, tmp_path / "c.usdc")
    with pytest.raises(SceneError, match="b.usd[ac]: is the result itself; give the copy another name"):
        copy_result(copy, copy)
    next((there / "b.files").rglob("*.vdb")).unlink()
    before = files(tmp_path)
    with pytest.raises(SceneError, match="which is missing; put it back"):
        copy_result(copy, tmp_path / "c.usdc")
    assert files(tmp_path) == before


def test_copy_takes_clips_and_a_scene_made_in_python_along(tmp_path):
    scene = Scene(frames=2)
    scene.cloth("/cloth", *grid(3))
    (tmp_path / "there").mkdir()
    with Recorder(scene, tmp_path / "a.usdc") as recorder:
        recorder.clips = True
        for k in range(3):
            recorder.append(recorder.time_code(k), {"/cloth": scene.cloths[0].points + k})
    copy_result(tmp_path / "a.usdc", tmp_path / "there/b.usdc")
    copy_result(tmp_path / "there/b.usdc", tmp_path / "c.usdc")
    for name in ("a.usdc", "a_scene.usda", "a.clips", "there"):
        shutil.rmtree(tmp_path / name) if (tmp_path / name).is_dir() else (tmp_path / name).unlink()
    assert sorted(os.listdir(tmp_path)) == ["c.clips", "c.usdc", "c_scene.usda"]
    assert UsdUtils.ComputeAllDependencies(str(tmp_path / "c.usdc"))[2] == []
    stage = Usd.Stage.Open(str(tmp_path / "c.usdc"))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/cloth")).GetPointsAttr()
    assert np.allclose(np.array(points.Get(2)) - np.array(points.Get(0)), 2.0)


def test_a_layer_that_cannot_be_read_counts_as_one_that_refers(tmp_path):
    (tmp_path / "bad.usdc").write_bytes(b"PXR-USDC" + bytes(200))
    assert is_referenced_by_sibling(str(tmp_path), "a.files/01234567")
    (tmp_path / "bad.usdc").write_bytes(b"")
    assert not is_referenced_by_sibling(str(tmp_path), "a.files/01234567")
    (tmp_path / "user.usda").write_text('#usda 1.0\ndef Xform "a" { asset f = @a.files/01234567/x.vdb@ }')
    assert is_referenced_by_sibling(str(tmp_path), "a.files/01234567") and not is_referenced_by_sibling(str(tmp_path),
                                                                                                        "a.files/76543210")


def test_volumes_are_numbered_by_frame_after_a_restart_too(tmp_path):
    """By the time code, and by a part of it between two frames; of two volumes of one name each by itself."""
    source = author(tmp_path / "s.usda", start=7.0, frames=4)
    run(source, tmp_path / "half.usdc", 2)
    run(source, tmp_path / "rest.usdc", 4, tmp_path / "half.usdc")
    run(source, tmp_path / "blur.usdc", 2, samples=4)
    names = {name: sorted(p.name for p in (tmp_path / f"{name}.files").rglob("*.vdb")) for name in ("half", "rest", "blur")}
    assert names["half"] == [f"Smoke.{k:04d}.vdb" for k in (7, 8, 9)]
    assert names["rest"] == [f"Smoke.{k:04d}.vdb" for k in (7, 8, 9, 10, 11)]
    assert names["blur"] == sorted(f"Smoke.{k:04d}{rest}.vdb" for k in (7, 8) for rest in ("", ".25", ".5", ".75")) + [
        "Smoke.0009.vdb"]
    beside = SidecarFiles(str(tmp_path / "o.usdc"))
    found = [os.path.basename(beside.write_frame(path, code, ".vdb", lambda file: None)) for path in ("/a/Air", "/b/Air")
             for code in (-3.0, 11.9999999)]
    assert found == ["Air.-003.vdb", "Air.0012.vdb", "Air~2.-003.vdb", "Air~2.0012.vdb"]
