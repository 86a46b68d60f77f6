"""Every kind of sample, and files beside the layer, of a method of one folder and one row (tests/make/sparks): recorded,
restarted, killed, recovered, and read back by USD alone."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdVol

from tests.make.sparks import ROW
from tests.make.sparks.objects import GRAVITY, WIDTH, Sparks
from tests.usd.result.test_partial import run as process
from wsim.cli.run import prepare_recorded_run
from wsim.scene import Scene, SceneError, methods
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save
from wsim.usd.result.kinds import sidecar, vdb_read

PATH, FPS, FRAMES = "/World/sparks", 24.0, 6


@pytest.fixture(autouse=True)
def row(monkeypatch):
    register(monkeypatch.setattr)


def register(put) -> None:
    put(methods, "METHODS", [*methods.METHODS, ROW])
    from wsim.simulation import methods as made
    from wsim.simulation import plan
    for module in (plan, made):
        put(module, "METHODS", methods.METHODS)


def author(path, count: int = 100, **more) -> str:
    scene = Scene(**{"fps": FPS, "frames": FRAMES, "substeps": 2} | more)
    scene.add(Sparks(PATH, count))
    save(scene, path)
    return str(path)


def run(source: str, output, frames: int = FRAMES, restart=None, **more):
    job = prepare_recorded_run(replace(load(source), frames=frames), str(output), lambda s: Simulation(s, device="cpu"),
                               restart=restart and str(restart), **more)
    job.frames()
    return job


def placed(t: float, count: int = 100) -> np.ndarray:
    return Sparks(PATH, count).velocities() * t - 0.5 * GRAVITY * t * t * np.array([0.0, 0.0, 1.0])


def files(folder) -> set[str]:
    return {str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file()}


def check(result, count: int = 100, frames: int = FRAMES) -> None:
    """All that the layer says, by pxr, against the closed form."""
    stage = Usd.Stage.Open(str(result))
    for k in range(frames + 1):
        x = placed(k / FPS, count)
        lit, trace = (UsdGeom.Points(stage.GetPrimAtPath(f"{PATH}/{name}")) for name in ("Lit", "Trace"))
        n = min(10 * k, count)
        assert len(lit.GetPointsAttr().Get(k)) == n and list(lit.GetIdsAttr().Get(k)) == list(range(n))
        assert np.allclose(lit.GetWidthsAttr().Get(k), WIDTH) and len(lit.GetWidthsAttr().Get(k)) == n
        assert np.abs(np.array(lit.GetPointsAttr().Get(k)).reshape(-1, 3) - x[:n]).max(initial=0.0) < 1e-6
        assert np.abs(np.array(trace.GetPointsAttr().Get(k)) - x).max() < 1e-6
        low, high = np.array(trace.GetExtentAttr().Get(k))
        assert np.abs(low - x.min(axis=0)).max() < 1e-6 and np.abs(high - x.max(axis=0)).max() < 1e-6
        M = np.array(UsdGeom.Xformable(stage.GetPrimAtPath(f"{PATH}/Middle")).GetLocalTransformation(k))
        assert np.abs(M[3, :3] - x.mean(axis=0)).max() < 1e-6
        speeds = stage.GetPrimAtPath(PATH).GetAttribute("toy:speeds").Get(k)
        assert np.abs(np.array(speeds) - np.hypot(1.0, 3.0 - GRAVITY * k / FPS)).max() < 1e-5 and len(speeds) == 5
        smoke = stage.GetPrimAtPath(f"{PATH}/Smoke")
        fields = UsdVol.Volume(smoke).GetFieldPaths()
        assert {name: str(path) for name, path in fields.items()} == {n: f"{PATH}/Smoke/{n}" for n in ("density", "speed")}
        assets = [UsdVol.OpenVDBAsset(stage.GetPrimAtPath(path)) for path in fields.values()]
        names = {asset.GetFilePathAttr().Get(k).resolvedPath for asset in assets}
        grids = vdb_read.read_vdb(names.pop())
        assert not names and [grids[asset.GetFieldNameAttr().Get()].values.sum() for asset in assets] == [count, 3 * count]
        assert np.allclose(grids["density"].place, 0.625) and np.allclose(grids["speed"].voxel, 0.25)


def test_every_kind_is_recorded_and_goes_on_to_the_bit(tmp_path):
    source = author(tmp_path / "s.usda")
    one = run(source, tmp_path / "whole.usdc")
    run(source, tmp_path / "half.usdc", 3)
    two = run(source, tmp_path / "rest.usdc", FRAMES, tmp_path / "half.usdc")
    a, b = (job.simulation.state.parts["sparks"].arrays for job in (one, two))
    assert all(np.array_equal(a[name].numpy(), b[name].numpy()) for name in a)
    for result in ("whole.usdc", "rest.usdc"):
        check(tmp_path / result)
    for path in (tmp_path / "half.usdc", *(tmp_path / "half.files").rglob("*.vdb")):
        path.unlink()
    check(tmp_path / "rest.usdc")                              # its files are its own


@pytest.mark.parametrize("ending", [".usda", ".usdc"])
def test_a_flat_or_written_out_result_names_its_files_too(tmp_path, ending):
    source = author(tmp_path / "s.usda")
    run(source, tmp_path / f"o{ending}", flatten=ending == ".usdc")
    check(tmp_path / f"o{ending}")


def test_a_run_over_an_earlier_result_leaves_no_file_of_that(tmp_path):
    source = author(tmp_path / "s.usda")
    run(source, tmp_path / "o.usdc")
    before = files(tmp_path)
    run(source, tmp_path / "o.usdc", FRAMES, run(source, tmp_path / "half.usdc", 2).result)
    check(tmp_path / "o.usdc")
    mine = {name for name in files(tmp_path) if name.startswith("o.files")}
    assert len(mine) == FRAMES + 1 and not mine & before
    with pytest.raises(SceneError, match="holds 6 frames"):
        run(source, tmp_path / "o.usdc", 3, tmp_path / "o.usdc")
    assert mine <= files(tmp_path)


def test_a_run_may_go_on_from_the_result_that_it_replaces(tmp_path):
    source = author(tmp_path / "s.usda")
    run(source, tmp_path / "o.usdc", 3)
    run(source, tmp_path / "o.usdc", FRAMES, tmp_path / "o.usdc")
    check(tmp_path / "o.usdc")
    assert len([name for name in files(tmp_path) if name.startswith("o.files")]) == FRAMES + 1


LARGE = 200_000        # sparks: x, v and frames in float32 are 5.6 MB


def test_large_restart_fields_stand_in_a_file_and_go_on_to_the_bit(tmp_path):
    source = author(tmp_path / "s.usda", LARGE)
    one = run(source, tmp_path / "whole.usdc", 4)
    run(source, tmp_path / "half.usdc", 2)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "half.usdc"))
    names = [spec.name for spec in layer.GetPrimAtPath(PATH).attributes]
    assert sidecar.FILE in names and not any("fields" in name for name in names)
    assert len([name for name in files(tmp_path / "half.files") if name.endswith(".npz")]) == 1     # the last one
    two = run(source, tmp_path / "rest.usdc", 4, tmp_path / "half.usdc")
    a, b = (job.simulation.state.parts["sparks"].arrays for job in (one, two))
    assert all(np.array_equal(a[name].numpy(), b[name].numpy()) for name in a) and not two.simulation.warnings


def test_a_file_of_restart_fields_that_is_not_whole_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(sidecar, "LARGE", 1000)
    source = author(tmp_path / "s.usda")
    run(source, tmp_path / "early.usdc", 1)
    run(source, tmp_path / "o.usdc", 2)
    (early,), (file,) = ((tmp_path / name).rglob("*.npz") for name in ("early.files", "o.files"))
    whole = file.read_bytes()
    for data, said in ((early.read_bytes(), f"which is of {PATH} at time code 1, not 2"), (whole[:-200], "which is damaged"),
                       (whole[:1000] + b"?" + whole[1001:], "which is damaged"), (None, "which is missing")):
        file.unlink()
        if data:
            file.write_bytes(data)
        with pytest.raises(SceneError, match=f"{PATH}: its restart fields are in .*{said}") as found:
            run(source, tmp_path / "rest.usdc", 4, tmp_path / "o.usdc")
        assert len(found.value.problems) == 1
    file.write_bytes(whole)
    run(source, tmp_path / "rest.usdc", 4, tmp_path / "o.usdc")
    check(tmp_path / "rest.usdc", frames=4)


def test_a_killed_run_is_recovered_with_its_files_and_gone_on_from(tmp_path, monkeypatch):
    monkeypatch.setattr(sidecar, "LARGE", 1000)
    source = author(tmp_path / "s.usda")
    child = process("""
        from tests.usd.result import test_kinds as own
        own.register(setattr)
        own.sidecar.LARGE, partial.SHARE = 1000, 1.0
        job = own.prepare_recorded_run(own.load(sys.argv[1]), sys.argv[2], lambda s: own.Simulation(s, device="cpu"))
        def watch(sim):
            if sim.frame == 4:
                print("ready", flush=True)
                signal.pause()
        job.watchers.append(watch)
        job.frames()
        """, source, tmp_path / "o.usdc")
    while (line := child.stdout.readline()) and line != "ready\n":
        pass
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert not (tmp_path / "o.usdc").exists() and files(tmp_path / "o.files")
    empty = prepare_recorded_run(load(source), str(tmp_path / "o.usdc"), lambda s: Simulation(s, device="cpu"))
    kept = tmp_path / "o.recovered.usdc"
    assert kept.exists() and empty.recorder.close() is None and not kept.exists()           # nothing written: put back
    job = run(source, tmp_path / "o.usdc", FRAMES, tmp_path / "o.partial.usdc")
    assert kept.exists() and job.first >= 1 and not job.simulation.warnings
    check(tmp_path / "o.usdc")
    check(kept, frames=4)
    one = run(source, tmp_path / "whole.usdc")
    a, b = (each.simulation.state.parts["sparks"].arrays for each in (one, job))
    assert all(np.array_equal(a[name].numpy(), b[name].numpy()) for name in a)
    assert {Path(name).parts[0] for name in files(tmp_path) if ".files" in name} == {"o.files", "whole.files"}
    assert len(os.listdir(tmp_path / "o.files")) == 2


def test_an_unknown_kind_and_a_prim_of_another_type_are_named(tmp_path):
    source = author(tmp_path / "s.usda")
    job = prepare_recorded_run(load(source), str(tmp_path / "o.usdc"), lambda s: Simulation(s, device="cpu"))
    from wsim.scene.samples import ParticleSample, VolumeSample
    for sample, said in (("smoke", "a method hands a str to the result; there are PointSample, TransformSample"),
                         (ParticleSample(PATH, np.zeros((1, 3)), np.ones(1), np.zeros(1)), f"{PATH}: is a Xform")):
        with pytest.raises(SceneError, match=said):
            smoke = VolumeSample(f"{PATH}/Smoke", np.zeros(3), 1.0, {"density": np.ones((1, 1, 1), np.float32)})
            job.recorder.append(0.0, {}, others=[smoke, sample])
    assert not files(tmp_path / "o.files") and job.recorder.close() is None and not (tmp_path / "o.files").exists()


def test_particles_of_another_number_each_frame_are_drawn_where_they_are(tmp_path):
    """What is not there yet has no area."""
    from wsim.show.prim import triangulate_prim
    run(author(tmp_path / "s.usda", 30), tmp_path / "o.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "o.usdc"))
    drawn = triangulate_prim(stage.GetPrimAtPath(f"{PATH}/Lit"), "plain", 0, 0.0, 1.0)
    for frame, lit in ((0, 0), (1, 10), (2, 20), (FRAMES, 30)):
        p = drawn.points(float(frame))
        X = p[drawn.look.triangles]
        area = 0.5 * np.linalg.norm(np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]), axis=1)
        assert (area > 0.0).sum() == 8 * lit and np.isfinite(p).all()                  # octahedra
        places = p[:6 * lit].reshape(-1, 6, 3).mean(axis=1)
        assert np.abs(places - placed(frame / FPS, 30)[:lit]).max(initial=0.0) < 1e-6
