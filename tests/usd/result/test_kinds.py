"""Every kind of sample, and files beside the layer, of a method of one folder and one row (tests/make/rows/sparks): recorded,
restarted, killed, recovered, and read back by USD alone."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.make.usd.result.kinds import FPS, FRAMES, PATH, author, check, files, placed, register, run
from tests.make.usd.result.partial import run as process
from wsim.cli.run import prepare_recorded_run
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation
from wsim.usd import load
from wsim.usd.result.kinds import sidecar


@pytest.fixture(autouse=True)
def row(monkeypatch):
    register(monkeypatch.setattr)


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
        from tests.make.usd.result import kinds as own
        from wsim.usd.result.kinds import sidecar
        own.register(setattr)
        sidecar.LARGE, partial.SHARE = 1000, 1.0
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
    """Balls of as many as there are."""
    from wsim.show.prim import triangulate_prim
    run(author(tmp_path / "s.usda", 30), tmp_path / "o.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "o.usdc"))
    drawn = triangulate_prim(stage.GetPrimAtPath(f"{PATH}/Lit"), "plain", 0, 0.0, 1.0)
    for frame, lit in ((0, 0), (1, 10), (2, 20), (FRAMES, 30)):
        balls = drawn.balls(float(frame))
        assert balls.centers.shape == balls.colors.shape == (lit, 3) and balls.radii.shape == (lit,)
        assert (balls.radii > 0.0).all() and np.isfinite(balls.radii).all()
        assert np.abs(balls.centers - placed(frame / FPS, 30)[:lit]).max(initial=0.0) < 1e-6
