"""Results as value clips: the same values as in one layer, at any time; what is left by failures and earlier runs; restarts."""

import os

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdUtils

from tests.make.usd.result.clips import record
from tests.make.usd.result.recorder import CLOTH, author, world
from tests.make.usd.validate import validate
from wsim.cli import main
from wsim.usd import clips
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.recorder import Recorder
from wsim.usd.result.restart import ResultReader, copy_samples, load_restart


def values(path) -> dict:
    """Every attribute of the result at whole and half time codes."""
    stage, found = Usd.Stage.Open(str(path)), {}
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            for code in (0.5, 1.0, 1.5, 2.0, 2.25, 3.0, 4.0):
                found[str(attribute.GetPath()), code] = np.asarray(attribute.Get(code))
    return found


def test_clips_hold_at_any_time_what_one_layer_holds(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "one.usdc", clip=False)
    record(scene, tmp_path / "many.usdc")
    one, many = values(tmp_path / "one.usdc"), values(tmp_path / "many.usdc")
    assert one.keys() == many.keys() and len(one) > 20
    for key in one:
        assert np.array_equal(one[key], many[key]), key


def test_a_frame_is_a_file_and_the_layer_has_no_sample(tmp_path):
    record(author(tmp_path / "s.usda"), tmp_path / "out.usda")
    assert sorted(os.listdir(tmp_path)) == ["out.clips", "out.usda", "s.usda"]
    assert sorted(os.listdir(tmp_path / "out.clips")) == [*(f"frame.{k:04d}.usdc" for k in (1, 2, 3)), "manifest.usda"]
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    assert layer.ListAllTimeSamples() == [] and layer.startTimeCode == 1.0 and layer.endTimeCode == 3.0
    clip = Sdf.Layer.FindOrOpen(str(tmp_path / "out.clips/frame.0002.usdc"))
    assert clip.ListAllTimeSamples() == [2.0]


def test_the_validators_find_nothing_and_usd_finds_every_file(tmp_path):
    record(author(tmp_path / "s.usda"), tmp_path / "out.usdc")
    assert validate(tmp_path / "out.usdc") == []
    layers = UsdUtils.ComputeAllDependencies(str(tmp_path / "out.usdc"))[0]
    assert {os.path.basename(layer.realPath) for layer in layers} >= {"s.usda", "manifest.usda", "frame.0003.usdc"}


def test_samples_between_frames_are_in_the_file_of_their_frame(tmp_path):
    scene = author(tmp_path / "s.usda")
    recorder = Recorder(scene, tmp_path / "out.usdc")
    recorder.clips = True
    for k in (0.0, 0.5, 1.0, 1.5):
        recorder.append(recorder.time_code(k), *world(frame=int(2 * k)))
    recorder.close()
    assert len(os.listdir(tmp_path / "out.clips")) == 3
    assert ResultReader(tmp_path / "out.usdc").time_codes(CLOTH) == [1.0, 1.5, 2.0, 2.5]


def test_a_new_result_has_a_folder_of_its_own_until_the_old_one_goes(tmp_path):
    scene = author(tmp_path / "s.usda")
    for clip, folders in ((True, ["out.clips"]), (True, ["out.clips2"]), (True, ["out.clips"]), (False, [])):
        record(scene, tmp_path / "out.usdc", clip=clip)
        assert [name for name in sorted(os.listdir(tmp_path)) if "clips" in name] == folders
        assert ResultReader(tmp_path / "out.usdc").time_codes(CLOTH) == [1.0, 2.0, 3.0]


def test_files_of_others_are_not_removed(tmp_path):
    scene = author(tmp_path / "s.usda")
    (tmp_path / "out.clips").mkdir()
    (tmp_path / "out.clips" / "frame.0001.usdc").write_bytes(b"mine")
    record(scene, tmp_path / "out.usdc")
    (tmp_path / "out.clips2" / "notes.txt").write_text("keep")
    record(scene, tmp_path / "out.usdc")
    assert (tmp_path / "out.clips" / "frame.0001.usdc").read_bytes() == b"mine"
    assert os.listdir(tmp_path / "out.clips2") == ["notes.txt"]


def test_an_interrupted_run_leaves_one_partial_file_and_the_result_before(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc")
    record(scene, tmp_path / "out.usdc", frames=2, interrupted=True)
    assert sorted(os.listdir(tmp_path)) == ["out.clips", "out.partial.usdc", "out.usdc", "s.usda"]
    assert ResultReader(tmp_path / "out.usdc").time_codes(CLOTH) == [1.0, 2.0, 3.0]
    record(scene, tmp_path / "out.usdc")
    assert "out.recovered.usdc" in os.listdir(tmp_path)


def test_a_disk_that_takes_no_clips_leaves_the_partial_file(tmp_path, monkeypatch):
    def full(layer, path):
        raise OSError("No space left on device")
    scene = author(tmp_path / "s.usda")
    monkeypatch.setattr(clips, "_export_layer", full)
    with pytest.raises(OSError, match="No space left"):
        record(scene, tmp_path / "out.usdc")
    assert sorted(os.listdir(tmp_path)) == ["out.partial.usdc", "s.usda"]
    assert ResultReader(tmp_path / "out.partial.usdc").time_codes(CLOTH) == [1.0, 2.0, 3.0]


def test_a_run_goes_on_from_clips_with_their_samples(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc")
    restart = load_restart(tmp_path / "out.usdc", scene)
    assert restart.frame == 2
    stage, beside = Usd.Stage.CreateInMemory(), SidecarFiles(str(tmp_path / "next.usdc"))
    stage.DefinePrim(CLOTH, "Mesh")
    assert copy_samples(restart, stage, scene, beside) == [1.0, 2.0, 3.0]
    os.remove(tmp_path / "out.clips/frame.0002.usdc")
    with pytest.raises(Exception, match="cannot be read any more"):
        copy_samples(restart, stage, scene, beside)


def test_the_command_writes_clips_and_takes_one_form_only(tmp_path, capsys):
    from tests.make.usda import Reader, cloth
    Reader(tmp_path)(cloth())
    out = tmp_path / "out.usdc"
    args = ["run", str(tmp_path / "scene.usda"), "-o", str(out), "--frames", "2", "--device", "cpu", "--quiet", "--clips"]
    assert main(args) == 0
    assert len(os.listdir(tmp_path / "out.clips")) == 4 and ResultReader(out).time_codes("/cloth") == [0.0, 1.0, 2.0]
    with pytest.raises(SystemExit):
        main([*args, "--flatten"])
    assert "give one of them" in capsys.readouterr().err
