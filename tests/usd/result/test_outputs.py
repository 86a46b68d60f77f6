"""No command and no reader overwrites, moves or removes a file that is not its own."""

import errno
import json
import os
import socket
import struct
import subprocess
import sys
from zlib import crc32

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.make.cli.cli import wsim
from tests.make.usd.result.partial import run
from tests.make.usd.result.recorder import CLOTH, author, record, world
from wsim.scene import SceneError
from wsim.show.visible import read_visible_stage
from wsim.usd import save
from wsim.usd.new.cloth import author_cloth
from wsim.usd.result import crate, lock
from wsim.usd.result.dependencies import stage_dependencies
from wsim.usd.result.fitted import check_target
from wsim.usd.result.lock import OutputLock
from wsim.usd.result.recorder import Recorder
from wsim.usd.result.restart import ResultReader, load_restart


def contents(folder) -> dict:
    """Each file of a folder with its bytes; links by what they point to."""
    return {p.name: os.readlink(p) if p.is_symlink() else p.read_bytes() for p in folder.iterdir() if not p.is_dir()}


# Reading

BOOTSTRAP = b"PXR-USDC" + bytes(80)
PLANTED = {"what an older version wrote": struct.pack("<q", 100) + BOOTSTRAP + b"gone", "another text": b"some notes of mine",
           "a checksum that is wrong": crate.MAGIC + struct.pack(crate.FORMAT, 88, 4, 1, 2) + BOOTSTRAP + b"gone",
           "values of another file": crate.MAGIC + struct.pack(crate.FORMAT, 88, 4, crc32(BOOTSTRAP + b"gone"), 2) + BOOTSTRAP
           + b"gone"}


@pytest.mark.parametrize("text", PLANTED.values(), ids=PLANTED)
@pytest.mark.parametrize("link", [False, True])
def test_a_planted_index_is_written_to_nothing(tmp_path, text, link):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "seen.usdc")
    (tmp_path / "seen.usdc").rename(tmp_path / "a.partial.usdc")
    index = tmp_path / "a.partial.usdc.index"
    (tmp_path / "planted").write_bytes(text)
    index.symlink_to("planted") if link else index.write_bytes(text)
    before = contents(tmp_path)
    assert load_restart(tmp_path / "a.partial.usdc", scene).frame == 2
    assert read_visible_stage(tmp_path / "a.partial.usdc").times == [1.0, 2.0, 3.0]
    with pytest.raises(FileExistsError, match=r"a\.partial\.usdc\.index is in the way"):
        Recorder(scene, tmp_path / "a.usdc")
    assert contents(tmp_path) == before


def test_no_link_is_written_through(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "of_another.usdc")
    for plant in (os.symlink, os.link):
        for name in ("a.partial.usdc", "a.partial.usdc.lock"):
            plant(tmp_path / "of_another.usdc", tmp_path / name)
            before = contents(tmp_path)
            with pytest.raises(FileExistsError, match="is in the way"):
                Recorder(scene, tmp_path / "a.usdc")
            assert contents(tmp_path) == before
            (tmp_path / name).unlink()


def test_a_result_is_read_while_it_is_written(tmp_path):
    """By this process and by the one that writes; neither changes a file, and the run ends as if nobody had looked."""
    process = run("""
        partial.SHARE = 1.0
        path = sys.argv[1] + "/out.usdc"
        with Recorder(author(sys.argv[1] + "/s.usda"), path) as recorder:
            for f in range(10**6):
                recorder.append(1.0 + f, *world(frame=f))
                if f == 3:
                    print(*ResultReader(path.replace(".usdc", ".partial.usdc")).time_codes(CLOTH), flush=True)
                if os.path.exists(sys.argv[1] + "/stop"):
                    break
        print(f, flush=True)
        """, tmp_path)
    seen = 0.0
    assert process.stdout.readline() == "1.0 2.0 3.0 4.0\n"
    (tmp_path / "link.usdc").symlink_to("out.partial.usdc")
    for k in range(30):
        result = ResultReader(tmp_path / ("out.partial.usdc", "link.usdc")[k % 2])
        code = result.time_codes(CLOTH)[-1]
        assert code >= seen and np.abs(result.positions(CLOTH, code) - world(frame=int(code) - 1)[0][CLOTH]).max() < 1e-6
        seen = code
    (tmp_path / "link.usdc").unlink()
    (tmp_path / "stop").touch()
    told, failed = process.communicate()
    assert process.returncode == 0, failed
    assert ResultReader(tmp_path / "out.usdc").time_codes(CLOTH) == [1.0 + f for f in range(int(told) + 1)]
    assert sorted(os.listdir(tmp_path)) == ["out.usdc", "s.usda", "stop"]


def test_a_save_that_comes_while_a_file_is_read_is_waited_for(tmp_path, monkeypatch):
    recorder = Recorder(author(tmp_path / "s.usda"), tmp_path / "out.usdc")
    recorder.file.due = lambda: True
    recorder.append(1.0, *world())
    of = crate.CrateIndex.of

    def saved_meanwhile(file):
        found = of(file)
        monkeypatch.setattr(crate.CrateIndex, "of", staticmethod(of))
        recorder.append(2.0, *world(frame=1))
        return found

    monkeypatch.setattr(crate.CrateIndex, "of", staticmethod(saved_meanwhile))
    assert ResultReader(recorder.file.path).time_codes(CLOTH) == [1.0, 2.0]
    recorder.close()


# Names that a run needs

@pytest.mark.parametrize("name", ["y.whole.usda", "y.partial.usdc", "y.partial.usda"])
def test_a_scene_under_a_name_like_those_of_a_run_stays(tmp_path, name):
    scene = author(tmp_path / name)
    before = contents(tmp_path)
    if name == "y.partial.usdc":
        with pytest.raises(ValueError, match="is the scene itself"):
            Recorder(scene, tmp_path / "y.usda")
        other = author(tmp_path / "other.usda")
        with pytest.raises(FileExistsError, match="y.partial.usdc is in the way.*wsim did not make it"):
            Recorder(other, tmp_path / "y.usda")
    else:
        record(scene, tmp_path / "y.usda")
        assert len(os.listdir(tmp_path)) == 2
    assert before.items() <= contents(tmp_path).items()
    with pytest.raises(ValueError, match="names in .partial.usdc are kept"):
        Recorder(scene, tmp_path / "z.partial.usdc")


def test_scenes_made_in_python_stay_with_the_results_that_lie_over_them(tmp_path, scene):
    p = {"/cloth": scene.cloths[0].motion.points(scene.cloths[0].points)}

    def recorded(end=None):
        with Recorder(scene, tmp_path / "out.usdc") as recorder:
            if end is not None:
                recorder.append(0.0, p, p)
            if end:
                raise end

    recorded(0)
    before = contents(tmp_path)
    scene.wind = (1.0, 0.0, 0.0)
    recorded()                                                      # no frame
    assert contents(tmp_path) == before
    with pytest.raises(KeyboardInterrupt):
        recorded(KeyboardInterrupt())
    assert before.items() <= contents(tmp_path).items()
    layers = [Sdf.Layer.OpenAsAnonymous(str(tmp_path / f"out{k}.usdc")) for k in ("", ".partial")]
    assert [list(layer.subLayerPaths) for layer in layers] == [["./out_scene.usda"], ["./out_scene2.usda"]]
    recorded(0)                                                     # over the same scene as what is left of the last one
    assert sorted(os.listdir(tmp_path)) == ["out.recovered.usdc", "out.usdc", "out_scene2.usda"]
    assert "./out_scene2.usda" in Sdf.Layer.OpenAsAnonymous(str(tmp_path / "out.usdc")).ExportToString()


# Two runs

def test_the_second_of_two_runs_says_who_has_the_output(tmp_path):
    scene = author(tmp_path / "s.usda")
    process = run("""
        recorder = Recorder(author(sys.argv[1] + "/t.usda"), sys.argv[1] + "/out.usdc")
        recorder.append(1.0, *world())
        print("ready", flush=True)
        signal.pause()
        """, tmp_path)
    assert process.stdout.readline() == "ready\n"
    before = contents(tmp_path)
    for name in ("out.usdc", "out.usda"):
        with pytest.raises(BlockingIOError) as said:
            Recorder(scene, tmp_path / name)
        assert f"process {process.pid} on {socket.gethostname()}, since 20" in str(said.value)
        assert f"{tmp_path / name} is being written" in str(said.value)
    assert contents(tmp_path) == before
    process.kill()
    process.wait()
    assert "out.partial.usdc.lock" in os.listdir(tmp_path)
    (tmp_path / ".out.partial.usdc.0a1b2c3d.wsim-part.usda").touch()             # of a killed run of this name
    (tmp_path / ".out.usda.0a1b2c3d.wsim-part.usda").touch()                     # of somebody who may still write it
    first = Recorder(scene, tmp_path / "out.usda")                  # the lock of a dead process does not count
    with pytest.raises(BlockingIOError, match="this process: close its Recorder"):
        Recorder(scene, tmp_path / "out.usdc")
    first.append(1.0, *world())
    assert first.close() and sorted(os.listdir(tmp_path)) == [".out.usda.0a1b2c3d.wsim-part.usda", "out.recovered.usdc",
                                                             "out.usda", "s.usda", "t.usda"]


def test_without_locks_of_the_system_a_living_process_counts(tmp_path, monkeypatch):
    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lock, "_system_lock", none)
    path, output = tmp_path / "out.lock", str(tmp_path / "out.usdc")
    held = OutputLock(str(path), output)
    with pytest.raises(BlockingIOError, match=f"process {os.getpid()} on"):
        OutputLock(str(path), output)
    said = json.loads(path.read_text())
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    path.write_text(json.dumps(said | {"pid": process.pid}))
    OutputLock(str(path), output).release()
    path.write_text(json.dumps(said | {"pid": process.pid, "host": "elsewhere"}))
    with pytest.raises(BlockingIOError, match=f"on elsewhere, since .*remove {path}"):
        OutputLock(str(path), output)
    held.release()


# Inputs

@pytest.fixture
def rich(tmp_path, scene):
    """A scene with a sublayer, a payload in a variant that is not chosen, and textures there and here; a result of it."""
    save(scene, tmp_path / "below.usda")
    (tmp_path / "kept.usda").write_text('#usda 1.0\ndef "B" {\n    asset file = @./inside.png@\n}\n')
    for name in ("inside.png", "outside.png", "tile.1001.png"):
        (tmp_path / name).write_bytes(b"mine")
    (tmp_path / "s.usda").write_text("""#usda 1.0
        (
            subLayers = [@./below.usda@]
        )
        def "other" (
            variants = { string v = "none" }
            prepend variantSets = "v"
        ) {
            asset a.timeSamples = { 0: @./outside.png@ }
            asset b = @./tile.<UDIM>.png@
            variantSet "v" = {
                "none" { }
                "some" ( payload = @./kept.usda@</B> ) { }
            }
        }""")
    stage = Usd.Stage.CreateNew(str(tmp_path / "seen.usdc"))
    stage.GetRootLayer().subLayerPaths.append("./s.usda")
    points = stage.OverridePrim("/cloth").GetAttribute("points")
    for code in (0.0, 1.0, 2.0):
        points.Set(points.Get(), code)
    stage.Save()
    return tmp_path


NAMES = ["s.usda", "below.usda", "kept.usda", "inside.png", "outside.png", "tile.1001.png"]


def test_the_files_of_a_scene_are_those_of_every_variant(rich):
    assert stage_dependencies(rich / "s.usda") == {str(rich / name) for name in NAMES}
    (rich / "below.usda").write_text("#usda 1.0\n def {{{")          # named all the same
    assert stage_dependencies(rich / "s.usda") == {str(rich / name) for name in NAMES}


@pytest.mark.parametrize("command", [
    "run s.usda -o s.usda", "run s.usda -o below.usda", "run s.usda -o kept.usda", "run s.usda -o new.usdc --png inside.png",
    "run s.usda -o new.usdc --png outside.png", "fit s.usda --to seen.usdc --parameters stretch -o seen.usdc",
    "fit s.usda --to seen.usdc --parameters stretch -o kept.usda", "fit s.usda --to seen.usdc --parameters stretch -o s.usda",
    "fit s.usda --to seen.usdc --parameters stretch --restart seen.usdc",
    "fit s.usda --to seen.usdc --parameters stretch --restart state.json -o ./state.json",
    "bench s.usda --plot tile.1001.png", "picture seen.usdc -o inside.png", "picture seen.usdc -o outside.png",
    "new cloth s.usda -o seen.usdc", "new cloth s.usda -o kept.usda --force", "new cloth s.usda -o s.usda --force"])
def test_no_command_overwrites_what_it_reads(rich, command, monkeypatch, capsys):
    monkeypatch.chdir(rich)
    before = contents(rich)
    assert wsim(*command.split()) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("error: ") and any(words in said for words in (
        "itself", "depends on", "is there already; give --force", "ending", "a file that the mesh is made of"))
    assert contents(rich) == before


def test_new_replaces_a_scene_only_by_force(rich, monkeypatch):
    monkeypatch.chdir(rich)
    assert wsim("new", "cloth", "below.usda", "-o", "mine.usda") == 0
    first = (rich / "mine.usda").read_bytes()
    assert wsim("new", "cloth", "below.usda", "-o", "mine.usda", "--fabric", "silk") == 1
    assert (rich / "mine.usda").read_bytes() == first
    assert wsim("new", "cloth", "below.usda", "-o", "mine.usda", "--fabric", "silk", "--force") == 0
    assert (rich / "mine.usda").read_bytes() != first


def test_functions_refuse_what_commands_refuse(rich, scene):
    scene.source = str(rich / "s.usda")
    with pytest.raises(SceneError, match="a file that the scene depends on"):
        check_target(scene, str(rich / "kept.usda"))
    with pytest.raises(SceneError, match="a file that the mesh is made of"):
        author_cloth(rich / "s.usda", rich / "kept.usda")
    with pytest.raises(SceneError, match="names in .partial.usdc are kept"):
        save(scene, rich / "a.partial.usdc")
