"""`wsim check` and `wsim run` agree: a table of stages, each with one fault, and one of stages that are sound."""

import re
from pathlib import Path

import pytest

from tests.make.cli.check import AIR, HEAD, WATER, instances, stage
from wsim import cli, load
from wsim.scene import SceneError
from wsim.usd.result.recorder import Recorder


@pytest.mark.parametrize(("text", "path", "said"), [
    (AIR + 'def Mesh "Air_volume" {}\n', "/Air_volume", "is a Mesh, and the result of /Air writes a Volume of that name"),
    (AIR + 'def Volume "Air_volume" { double xformOp:rotateZ = 30; uniform token[] xformOpOrder = ["xformOp:rotateZ"] }',
     "/Air_volume", "is turned or mirrored"),
    (WATER + 'def Xform "Water_drops" {}\n', "/Water_drops", "is a Xform, and the result of /Water writes a Points"),
    ('def Scope "Body" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) { def Cube "C" (prepend apiSchemas = '
     '["PhysicsCollisionAPI"]) {}\n }', "/Body", "is a Scope; the result needs a Xformable there")])
def test_a_prim_in_the_way_of_the_result_is_refused_by_check_as_by_a_run(tmp_path, capsys, text, path, said):
    source = stage(tmp_path, text)
    assert cli.main(["check", source]) == 1
    assert f"error: {path}: {said}" in capsys.readouterr().out
    with pytest.raises(SceneError, match=f"{path}: {said}"):
        Recorder(load(source), tmp_path / "o.usdc")
    assert sorted(p.name for p in Path(tmp_path).iterdir()) == ["s.usda"]


@pytest.mark.parametrize(("ends", "frames", "said"), [
    ("    endTimeCode = 6\n", 6, ""), ("    startTimeCode = 3\n    endTimeCode = 7\n", 4, ""),
    ("    startTimeCode = 3\n", 96, "has no endTimeCode: 96 frames are simulated"),
    ("", 96, "has no startTimeCode and endTimeCode"),
    ("    endTimeCode = 1000000\n", None, "endTimeCode is 1e+06: 1e+06 frames; allowed is a number up to 100000"),
    ("    endTimeCode = inf\n", None, "endTimeCode is inf"), ("    endTimeCode = nan\n", None, "endTimeCode is nan"),
    ("    startTimeCode = nan\n    endTimeCode = 3\n", None, "startTimeCode is nan; allowed is a number from -1e+09"),
    ("    startTimeCode = 1e16\n    endTimeCode = 1e16\n", None, "startTimeCode is 1e+16; allowed is a number from -1e+09"),
    ("    startTimeCode = -inf\n", None, "startTimeCode is -inf; allowed is a number from -1e+09")])
def test_frames_are_those_that_a_stage_names(tmp_path, ends, frames, said):
    """Where these are too many, --frames says how many are meant."""
    head = HEAD.replace("    startTimeCode = 0\n    endTimeCode = 4\n", ends)
    source = stage(tmp_path, AIR, head)
    if frames is None:
        with pytest.raises(SceneError, match=re.escape(said)) as found:
            load(source)
        assert len(found.value.problems) == 1
        if "endTimeCode is" in said:
            assert "give --frames" in str(found.value) and load(source, frames=7).frames == 7
    else:
        scene = load(source)
        notes = [note.text for note in scene.notes if "TimeCode" in note.text]
        assert scene.frames == frames and len(notes) == bool(said) and all(said in note for note in notes)


@pytest.mark.parametrize(("text", "said"), [
    (instances("0, 0, 3"), "protoIndices[2] is 3; allowed is 0 to 0"),
    (instances("0, 0, -1"), "protoIndices[2] is -1; allowed is 0 to 0"),
    (instances("0, 0"), "protoIndices has 2 entries, and positions 3"),
    (instances(places="(0, 0, 1), (2, 0, nan), (4, 0, 1)"), "positions[1] is (2.0, 0.0, nan); allowed are finite numbers"),
    (instances(more="int64[] ids = [5, 6, 5]"), "ids has 5 2 times; allowed is each once"),
    (instances(more="int64[] ids = [5, 6]"), "ids has 2 entries, and positions 3"),
    (instances(more="float3[] scales = [(1, 1, 1)]"), "scales has 1 entries, and positions 3"),
    (instances(more="float3[] scales = [(1, 1, 1), (0, 0, 0), (1, 1, 1)]"), "instance 1: "),
    (instances(more="vector3f[] velocities = [(1, 1, 1)]"), "velocities has 1 entries, and positions 3"),
    (instances(more="vector3f[] angularVelocities = [(1, 1, 1), (0, 0, inf), (0, 0, 0)]"), "angularVelocities[1] is "),
    (instances(more="quath[] orientations = [(1, 0, 0, 0), (0, 0, 0, 0), (1, 0, 0, 0)]"), "orientations[1] is a quaternion of "
     "length 0; allowed is 1"),
    (instances(more="quatf[] orientationsf = [(1, 0, 0, 0), (3, 0, 0, 0), (1, 0, 0, 0)]"), "orientationsf[1] is a quaternion"),
    (instances(more="quath[] orientations = [(1, 0, 0, 0)]"), "orientations has 1 entries, and positions 3"),
    (instances().replace("rel prototypes = </Rocks/Rock>", "rel prototypes = [</Rocks/Rock>, </Lost>]"),
     "its prototype /Lost is no prim")])
def test_an_instancer_is_examined_as_a_mesh_is(tmp_path, text, said):
    with pytest.raises(SceneError) as found:
        load(stage(tmp_path, text))
    (problem,) = found.value.problems
    assert problem.path == "/Rocks" and problem.text.startswith(said)


def test_sound_instancers_load(tmp_path):
    for more in ("", "int64[] ids = [7, 8, 9]", "float3[] scales = [(2, 2, 2), (1, 1, 1), (0.5, 0.5, 0.5)]",
                 "quath[] orientations = [(1, 0, 0, 0), (0.707, 0.707, 0, 0), (1, 0, 0, 0)]"):
        assert len(load(stage(tmp_path, instances(more=more))).things("Body")) == 3


def test_a_name_with_a_line_break_is_refused_in_one_line(tmp_path, capsys):
    source = stage(tmp_path, AIR)
    broken = str(tmp_path / "a\nb.usda")
    Path(source).rename(broken)
    for command, out in ((["check", broken], "out"), (["run", broken, "-o", str(tmp_path / "o.usdc"), "--frames", "1"], "err")):
        assert cli.main(command) == 1
        said = [line for line in getattr(capsys.readouterr(), out).splitlines() if line.startswith("error: ")]
        assert len(said) == 1 and "a\\nb.usda" in said[0] and "has the control character '\\n'" in said[0]
    assert [p.name for p in tmp_path.iterdir()] == ["a\nb.usda"]
