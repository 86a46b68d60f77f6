"""The command line from outside: exit codes, messages, files. Runs are real, on the CPU, of a cloth of 16 points."""

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.make.cli.cli import ROOT, run, samples, wsim
from wsim import cli
from wsim.cli.run import delay_interrupts
from wsim.simulation import report
from wsim.usd import load, save


@pytest.fixture
def swept(scene, tmp_path):
    """The scene with XPBD as a file: it takes the substeps that it is told, and no more."""
    scene.frames, scene.solver = 4, "xpbd"
    path = str(tmp_path / "swept.usda")
    save(scene, path)
    return path


def printed(code: str) -> str:
    """Last line that a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


# before anything runs

def test_help_imports_what_words_are_made_of_and_nothing_heavy():
    """All modules but Python's own: --help takes 0.1 s of CPU by that (a time is no test: it hangs on the machine)."""
    code = ("import sys\nbefore = set(sys.modules)\nfrom wsim import cli\ntry: cli.main(['--help'])\nexcept SystemExit: pass\n"
            "print(*sorted(m for m in set(sys.modules) - before if m.split('.')[0] not in sys.stdlib_module_names))")
    assert printed(code).split() == [
        "wsim", "wsim.cli", "wsim.cli.arguments", "wsim.cli.new_options", "wsim.cli.sweep_options", "wsim.scene",
        "wsim.scene.integrator", "wsim.scene.solid", "wsim.scene.values", "wsim.scene.values.table", "wsim.scene.values.value",
        "wsim.simulation", "wsim.simulation.interrupt"]


@pytest.mark.parametrize("arguments", [
    [], ["dance"], ["run"], ["run", "a.usda", "-o", ""], ["run", "a.usda", "-o", "b.usdc", "--substeps", "0"],
    ["run", "a.usda", "-o", "b.usdc", "--frames", "-1"], ["run", "a.usda", "-o", "b.usdc", "--integrator", "rk5"],
    ["run", "a.usda", "-o", "b.usdc", "--variant", "shirt"], ["run", "a.usda", "-o", "b.usdc", "--png", "b.jpg"],
    ["run", "a.usda", "-o", "b.usdc", "--png", "no/such/folder/b.png"],
    ["picture", "a.usda", "-o", "b.png", "--size", "big"],
    ["run", "a.usda", "-o", "b.usdc", "--restart", "c.usdc", "--preroll", "3"],
    ["new", "cloth", "a.usd", "-o", "b.usda", "--weld", "-1"], ["new", "cloth", "a.usd", "-o", "b.usda", "--ground", "1e300"],
    ["run", "a.usda", "-o", "b.usdc", "--frames", "99999999999"], ["run", "a.usda", "-o", "b.usdc", "--preroll", "1000001"],
    ["run", "a.usda", "-o", "b.usdc", "--restart", ""], ["bench", "a.usda", "--frames", "99999999999"],
    ["fit", "a.usda", "--to", "b.usda", "--parameters", "stretch", "-o", " "],
    ["fit", "a.usda", "--to", "b.usda", "--parameters", "stretch", "--noise", "1e300"],
    ["fit", "a.usda", "--to", "b.usda", "--parameters", "stretch", "--restart", "no/such/folder/b"],
])
def test_a_wrong_question_exits_with_2(arguments, capsys):
    assert wsim(*arguments) == 2
    assert "usage: wsim" in capsys.readouterr().err


def test_version(capsys):
    from wsim import __version__

    assert wsim("--version") == 0
    assert capsys.readouterr().out == f"wsim {__version__}\n"


# failures in words

def test_a_missing_file_is_one_message(tmp_path, capsys):
    assert wsim("check", tmp_path / "no.usda") == 1
    assert "no.usda: there is no such file" in capsys.readouterr().out
    assert run(tmp_path / "no.usda", tmp_path / "out.usdc") == 1
    assert re.fullmatch(r"error: .*no\.usda: there is no such file.*\n", capsys.readouterr().err)


def test_what_is_no_usd_is_one_message(tmp_path, out, capsys):
    path = tmp_path / "scene.usda"
    path.write_text("this is a poem\n")
    assert run(path, out) == 1
    message = capsys.readouterr().err
    assert message.startswith("error: ") and "scene.usda" in message and "Traceback" not in message


@pytest.mark.parametrize(("error", "words"), [
    (OSError(errno.ENOSPC, "No space left on device", "out.usdc"), "the disk is full (out.usdc)"),
    (PermissionError(errno.EACCES, "Permission denied", "out.usdc"), "error: out.usdc: Permission denied"),
    (RuntimeError("Failed to allocate 8 bytes on device 'cuda:0': out of memory"), "smaller scene"),
    (ZeroDivisionError("division by zero"), "unexpected ZeroDivisionError: division by zero; please report"),
])
def test_every_failure_has_its_line(error, words):
    text = cli.explain_error(error)
    assert words in text and text.startswith("error: ") and "\n" not in text


def test_a_traceback_comes_only_with_debug(stage, out, monkeypatch, capsys):
    monkeypatch.setattr("wsim.cli.commands._load_scene_of_command", lambda args: 1 / 0)
    assert run(stage, out) == 1
    assert "Traceback" not in capsys.readouterr().err
    assert run(stage, out, "--debug") == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "words"), [
    ("folder/out.usdc", "folder"), ("out.txt", "usdc"), ("scene.usda", "the scene itself"), ("", "")])
def test_an_output_that_cannot_be_is_refused_before_the_run(stage, tmp_path, name, words, capsys):
    before = Path(stage).read_bytes()
    files = sorted(os.listdir(tmp_path))
    assert run(stage, tmp_path / name) == 1
    message = capsys.readouterr().err
    assert message.startswith("error: ") and words in message and "unexpected" not in message
    assert sorted(os.listdir(tmp_path)) == files and Path(stage).read_bytes() == before


def test_a_device_that_is_not_there_is_named_with_those_that_are(stage, out, capsys):
    assert wsim("run", stage, "-o", out, "--device", "cuda:77") == 1
    message = capsys.readouterr().err
    assert "cuda:77" in message and "cpu" in message and "unexpected" not in message
    assert not os.path.exists(out)


def test_a_live_view_without_rerun_says_what_to_install_and_leaves_nothing(stage, out, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)              # as if it were not installed
    assert run(stage, out, "--view") == 1
    assert ".[view]" in capsys.readouterr().err
    assert os.listdir(tmp_path) == [os.path.basename(stage)]


# commands

def test_check_passes_a_sound_scene(stage, capsys):
    assert wsim("check", stage) == 0
    assert "0 errors, 0 warnings; 1 cloth, 1 pin; 16 points" in capsys.readouterr().out


def test_check_says_everything_and_fails(stage, capsys):
    text = Path(stage).read_text()
    for good, bad in (("11, 15, 14]", "11, 15, 99]"), ("wsim:substeps = 2", "wsim:substeps = 0")):
        assert text.count(good) == 1
        text = text.replace(good, bad)
    Path(stage).write_text(text)
    assert wsim("check", stage) == 1
    said = capsys.readouterr().out
    assert "error: /cloth: " in said and "point 99" in said and "substeps" in said and "2 errors" in said
    assert wsim("check", stage, "--json") == 1
    data = json.loads(capsys.readouterr().out)
    assert data["errors"] == 2 and "/cloth" in [p["path"] for p in data["problems"] if p["fatal"]]


def test_check_does_not_start_warp(stage):
    code = f"import sys\nfrom wsim import cli\ncli.main(['check', {stage!r}])\nprint('warp' in sys.modules)"
    assert printed(code) == "False"


def test_new_makes_a_scene_of_a_bare_mesh(tmp_path, capsys):
    from pxr import Usd, UsdGeom

    from tests.conftest import grid

    bare = Usd.Stage.CreateNew(str(tmp_path / "bare.usda"))
    UsdGeom.SetStageMetersPerUnit(bare, 1.0)
    mesh = UsdGeom.Mesh.Define(bare, "/sheet")
    for attribute, value in zip((mesh.CreatePointsAttr(), mesh.CreateFaceVertexCountsAttr(),
                                 mesh.CreateFaceVertexIndicesAttr()), grid(), strict=True):
        attribute.Set(value)
    bare.Save()
    made = tmp_path / "made.usda"
    words = ["new", "cloth", tmp_path / "bare.usda", "-o", made, "--fabric", "silk", "--ground", "-0.5"]
    assert wsim(*words) == 0
    assert f"wsim run {made}" in capsys.readouterr().out
    scene = load(str(made))
    assert not scene.cloths[0].self_collision
    made.unlink()
    assert wsim(*words, "--self-collision") == 0 and load(str(made)).cloths[0].self_collision
    assert [c.path for c in scene.cloths] == ["/sheet_body/sheet"] and len(scene.colliders) == 1
    assert wsim("check", made) == 0


def test_an_unknown_fabric_is_named_with_the_known(tmp_path, stage, capsys):
    assert wsim("new", "cloth", stage, "-o", tmp_path / "b.usda", "--fabric", "tin") == 1
    assert "'tin'" in (message := capsys.readouterr().err) and "denim" in message and "unexpected" not in message


def test_plan_shows_stages_and_what_is_left_out(stage, capsys):
    assert wsim("plan", stage, "--device", "cpu") == 0
    assert "left out: contact: there is no collider" in capsys.readouterr().out
    assert wsim("plan", stage, "--device", "cpu", "--json") == 0
    assert {"stages", "skipped"} == set(json.loads(capsys.readouterr().out))


def test_run_writes_every_frame_and_reports(stage, out, capsys):
    assert run(stage, out) == 0
    codes = samples(out)
    assert list(codes) == [0, 1, 2, 3, 4]
    assert np.array_equal(codes[0], load(stage).cloths[0].points)
    assert codes[4][:, 1].min() < codes[1][:, 1].min() < 0.0          # it falls
    printed = capsys.readouterr()
    assert "4 frames of 16 points" in printed.out and "left out" not in printed.out
    assert "a frame, " in printed.err.splitlines()[0] and printed.err.startswith("about ")       # what it will cost, first
    assert "\r" not in printed.err                                     # no terminal, no bar


def test_json_is_all_that_is_printed_and_holds_the_promised_keys(swept, out, capsys):
    assert run(swept, out, "--json", "--frames", "2", "--substeps", "3", "--precision", "float64") == 0
    data = json.loads(capsys.readouterr().out)
    assert {"device", "precision", "frames", "ms_per_frame", "error", "stages", "skipped", "warnings"} <= set(data)
    assert {"import", "load", "build", "compile", "capture", "first_frame", "total"} <= set(data["seconds"])
    assert (data["device"], data["precision"], data["frames"], data["substeps"]) == ("cpu", "float64", 2, 3)
    assert "max_strain" in data["error"]


def test_quiet_says_nothing(stage, out, capfd):
    assert run(stage, out, "--quiet", "--frames", "1") == 0
    assert capfd.readouterr().out == ""


def test_ctrl_c_from_outside_ends_a_run_with_130(stage, out, heard):
    """Whenever it comes once the result has begun: the partial file holds the frames so far."""
    options = ["--device", "cpu", "--frames", "100000", "--quiet"]
    command = [sys.executable, "-m", "wsim", "run", stage, "-o", out, *options]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        give_up = time.monotonic() + 60.0
        while not os.path.exists(out.replace(".usdc", ".partial.usdc")) and time.monotonic() < give_up:
            time.sleep(0.01)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        message = process.communicate(timeout=60.0)[1]
    assert process.returncode == 130 and "so far" in message and "Traceback" not in message
    assert list(samples(out.replace(".usdc", ".partial.usdc")))[0] == 0


def test_an_ignored_ctrl_c_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with delay_interrupts():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_waits_for_what_is_being_written(heard):
    done = []
    with pytest.raises(KeyboardInterrupt), delay_interrupts():
        os.kill(os.getpid(), signal.SIGINT)
        done.append("written")
    assert done == ["written"]


def test_a_restart_with_nothing_left_says_so(stage, out, tmp_path, capsys):
    assert run(stage, out) == 0
    assert run(stage, tmp_path / "more.usdc", "--restart", out) == 1
    assert "4 frames, 4 are asked for" in capsys.readouterr().err


def test_preroll_settles_before_the_first_frame(stage, tmp_path):
    """Nothing moves by itself here, so that frame f after 2 frames of preroll is frame f + 2 without."""
    plain, settled = str(tmp_path / "plain.usdc"), str(tmp_path / "settled.usdc")
    assert run(stage, plain) == 0
    assert run(stage, settled, "--preroll", "2", "--frames", "2") == 0
    expected, found = samples(plain), samples(settled)
    assert list(found) == [0, 1, 2]
    assert all(np.array_equal(found[code], expected[code + 2]) for code in found)


def test_flatten_gives_one_file(stage, out, tmp_path):
    assert run(stage, out, "--flatten", "--frames", "1") == 0
    os.remove(stage)
    assert list(samples(out)) == [0, 1]


@pytest.mark.slow
def test_run_draws_a_picture(stage, out, tmp_path):
    png = tmp_path / "out.png"
    assert run(stage, out, "--png", png, "--frames", "1", "--quiet") == 0
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


# how a run bends time

def test_the_report_of_a_scene_without_constraints_is_whole():
    assert "2 frames of 3 points and 0 constraints" in report.report_text(
        {"device": "cpu", "precision": "float32", "frames": 2, "points": 3, "constraints": 0, "ms_per_frame": 1.0})


def test_a_viewer_that_was_closed_takes_nothing_from_the_result(stage, out, monkeypatch, capsys):
    import wsim.show.viewer
    from wsim.scene import Problem, SceneError

    class Gone:
        closed = 0

        def __init__(self, scene):
            self.frames = 0

        def log(self, simulation):
            self.frames += 1

        def close(self):
            Gone.closed += 1
            raise SceneError(Problem("view", "the rerun viewer is gone"))

    monkeypatch.setattr(wsim.show.viewer, "Viewer", Gone)
    assert run(stage, out, "--view") == 0 and Gone.closed == 1
    said = capsys.readouterr()
    assert "warning: view: the rerun viewer is gone" in said.err and "4 frames" in said.out and os.path.exists(out)


@pytest.mark.parametrize(("arguments", "words"), [
    (["run", "{stage}", "-o", "/proc/o.usdc", "--device", "cpu"], "/proc/"),
    (["new", "cloth", "{stage}", "-o", "/proc/o.usda"], "/proc/o.usda: cannot be written"),
    (["picture", "{stage}", "-o", "/proc/o.png", "--device", "cpu", "--size", "32x32"], "/proc/o.png: not written")])
def test_a_folder_that_takes_no_file_is_named_without_the_names_of_functions(stage, arguments, words, capsys):
    if not os.path.isdir("/proc/self"):
        pytest.skip("only Linux has a folder that nobody can write to")
    assert wsim(*(a.format(stage=stage) for a in arguments)) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("error: ") and words in said and "pxrInternal" not in said and ".cpp" not in said


def test_a_picture_is_one_of_still_sheet_and_animation(stage, tmp_path, capsys):
    assert wsim("picture", stage, "-o", tmp_path / "a.png", "--sheet", "3", "--animate") == 2
    assert "not allowed with" in capsys.readouterr().err and not (tmp_path / "a.png").exists()


def test_view_takes_its_output_as_the_other_commands_do():
    arguments = [cli.build_argument_parser().parse_args(["view", "a.usdc", option, "b.rrd"])
                 for option in ("-o", "--output", "--save")]
    assert [a.save for a in arguments] == ["b.rrd"] * 3


def test_the_command_that_new_proposes_can_be_pasted(tmp_path, stage, capsys):
    folder = tmp_path / "a b é"
    folder.mkdir()
    assert wsim("new", "cloth", stage, "-o", folder / "my shirt.usda") == 0
    proposed = shlex.split(capsys.readouterr().out.split("with: ")[1])
    assert proposed == ["wsim", "run", f"{folder}/my shirt.usda"]
