"""Going on from a result: what comes back to the bit, what does not and says so, and what the new result holds."""

import numpy as np
import pytest
from pxr import Sdf, Vt

from tests.make.usd.result.recorder import CLOTH, SIDE, author, world
from wsim.scene import SceneError
from wsim.usd.result.kinds import sidecar
from wsim.usd.result.recorder import Recorder
from wsim.usd.result.restart import ResultReader, load_restart

N = SIDE * SIDE


def fields(frame: int) -> dict:
    """What a solver would want back, of several types and shapes."""
    rng = np.random.default_rng(100 + frame)
    return {CLOTH: {"x": rng.random((N, 3)).astype(np.float32), "e": 1e-9 * rng.random((N, 3)), "lam": rng.random(5),
                    "count": np.arange(3, dtype=np.int32), "stretch": np.array(rng.random())}}


def record(scene, path, frames, with_fields=True, first=0, **more) -> Recorder:
    now = [first]
    recorder = Recorder(scene, path, restart_fields=(lambda: fields(now[0])) if with_fields else None, **more)
    with recorder:
        for now[0] in range(first, frames):
            recorder.append(recorder.time_code(now[0]), *world(frame=now[0]))
    return recorder


@pytest.mark.parametrize("large", [sidecar.LARGE, 0])
def test_fields_of_the_last_frame_come_back_to_the_bit(tmp_path, monkeypatch, large):
    """As attributes, and where they are large as a file."""
    monkeypatch.setattr(sidecar, "LARGE", large)
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc", 4)
    restart = load_restart(tmp_path / "out.usdc", scene)
    assert (restart.frame, restart.frame_time_code, restart.exact, restart.notes) == (3, 4.0, True, [])
    wanted = fields(3)[CLOTH]
    assert restart.fields[CLOTH].keys() == wanted.keys()
    for name, value in wanted.items():
        found = restart.fields[CLOTH][name]
        assert found.dtype == value.dtype and found.shape == value.shape and found.tobytes() == value.tobytes()
    assert (tmp_path / "out.files").is_dir() == (large == 0)


def test_points_and_velocities_alone_say_that_they_are_rounded(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc", 4, with_fields=False)
    restart = load_restart(tmp_path / "out.usdc", scene)
    assert not restart.exact and restart.fields == {} and restart.frame == 3
    assert "points and velocities only" in restart.notes[0].text and not restart.notes[0].fatal
    p, v = world(frame=3)
    assert np.abs(restart.positions[CLOTH] - p[CLOTH]).max() < 2 * np.finfo(np.float32).eps      # |p| below 1 m
    assert np.abs(restart.velocities[CLOTH] - v[CLOTH]).max() < 2 * np.finfo(np.float32).eps


def test_a_subframe_at_the_end_is_not_restarted_from(tmp_path):
    scene = author(tmp_path / "s.usda")
    for with_fields in (True, False):
        recorder = Recorder(scene, tmp_path / "out.usdc", restart_fields=(lambda: fields(0)) if with_fields else None)
        with recorder:
            for k, code in enumerate((1.0, 1.5, 2.0, 2.5)):
                recorder.append(code, *world(frame=k))
        restart = load_restart(tmp_path / "out.usdc", scene)
        assert (restart.frame, restart.exact) == (1, with_fields)


@pytest.mark.parametrize("flatten", [False, True])
@pytest.mark.parametrize("name", ["more.usdc", "out.usdc"])
def test_the_result_of_a_restart_is_that_of_a_run_in_one(tmp_path, name, flatten):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "all.usdc", 6)
    record(scene, tmp_path / "out.usdc", 4, flatten=flatten)
    restart = load_restart(tmp_path / "out.usdc", scene)
    record(scene, tmp_path / name, 6, first=restart.frame, continues=restart)     # the restart's own frame comes again
    whole, joined = ResultReader(tmp_path / "all.usdc"), ResultReader(tmp_path / name)
    assert joined.time_codes(CLOTH) == whole.time_codes(CLOTH) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    for code in whole.time_codes(CLOTH):
        assert np.array_equal(joined.positions(CLOTH, code), whole.positions(CLOTH, code))
        assert np.array_equal(joined.velocities(CLOTH, code), whole.velocities(CLOTH, code))
    assert load_restart(tmp_path / name, scene).fields[CLOTH]["e"].tobytes() == fields(5)[CLOTH]["e"].tobytes()
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / name))
    assert list(layer.subLayerPaths) == ["./s.usda"] and (layer.startTimeCode, layer.endTimeCode) == (1.0, 6.0)


def test_a_result_that_cannot_be_gone_on_from_says_why(tmp_path):
    scene = author(tmp_path / "s.usda")
    with pytest.raises(SceneError, match="there is no such file"):
        load_restart(tmp_path / "out.usdc", scene)
    with pytest.raises(SceneError, match=f"{CLOTH}: has no frame in"):
        load_restart(tmp_path / "s.usda", scene)
    record(scene, tmp_path / "out.usdc", 2, with_fields=False, velocities=False)
    with pytest.raises(SceneError, match="has no velocities"):
        load_restart(tmp_path / "out.usdc", scene)
    scene.fps = 24.0
    with pytest.raises(SceneError, match="30 time codes a second, the scene 24"):
        load_restart(tmp_path / "out.usdc", scene)


@pytest.mark.parametrize(("bad", "text"), [
    ({CLOTH: {"a b": np.ones(1)}}, "letters"), ({CLOTH: {"a": [1.0]}}, "is list"),
    ({CLOTH: {"a": np.ones(1, np.float16)}}, "is float16"), ({"/else": {}}, "the bodies are")])
def test_fields_that_cannot_be_stored_are_named(tmp_path, bad, text):
    recorder = Recorder(author(tmp_path / "s.usda"), tmp_path / "out.usdc", restart_fields=lambda: bad)
    with pytest.raises(ValueError, match=text):
        recorder.append(1.0, *world())
    recorder.close()


def test_overwritten_fields_add_at_most_a_quarter_to_the_file(tmp_path):
    scene = author(tmp_path / "s.usda")
    sizes = []
    for with_fields in (False, True):
        big = {CLOTH: {"x": np.zeros(5 * N)}}        # stays the same: each rewrite is one dead copy of 5 * N * 8 bytes
        counter = iter(range(10**6))

        def changing(big=big, counter=counter):
            return {CLOTH: {"x": big[CLOTH]["x"] + next(counter)}}

        with Recorder(scene, tmp_path / "out.usdc", restart_fields=changing if with_fields else None) as recorder:
            recorder.file.due = lambda: True
            for f in range(100):
                recorder.append(1.0 + f, *world(frame=f))
        sizes.append((tmp_path / "out.usdc").stat().st_size)
    samples = 100 * 2 * 12 * (N + 1)
    assert sizes[1] - sizes[0] < samples / 4 + 20_000


@pytest.mark.parametrize("spoil", ["no shape", "another shape", "another type", "no code"])
def test_a_restart_field_that_somebody_spoiled_is_refused_in_a_line(tmp_path, spoil):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc", 2)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usdc"))
    spec = layer.GetAttributeAtPath(f"{CLOTH}.wsim:restart:fields:x")
    if spoil == "no shape":
        spec.ClearInfo("customData")
    elif spoil == "another shape":
        spec.customData["shape"] = Vt.IntArray([7, 7])
    else:
        prim, name, kind, value = (layer.GetPrimAtPath(CLOTH), *(
            ("wsim:restart:timeCode", Sdf.ValueTypeNames.String, "x") if spoil == "no code" else
            (spec.name, Sdf.ValueTypeNames.StringArray, Vt.StringArray(["a"]))))
        del prim.properties[name]
        Sdf.AttributeSpec(prim, name, kind).default = value
    layer.Save()
    with pytest.raises(SceneError, match=f"{CLOTH}: .*restart from another result") as found:
        load_restart(tmp_path / "out.usdc", scene)
    assert len(found.value.problems) == 1
