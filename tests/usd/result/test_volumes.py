"""Fields on a grid in a result: a UsdVol.Volume in the units and the frame that it stands in, with files beside the layer that
stay with it: flattened, moved, as clips, on a full disk."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, UsdVol

from tests.make.usd.result.kinds import FRAMES, PATH, author, check, files, register, run
from wsim.cli.run import prepare_recorded_run
from wsim.scene import SceneError
from wsim.scene.samples import VOLUME, VolumeSample
from wsim.simulation.simulation import Simulation
from wsim.usd import load
from wsim.usd.result.kinds import vdb_read
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.kinds.rows import sample_attribute_values

LOW, CELL = np.array([1.0, 2.0, 3.0]), 0.5
DENSITY = np.arange(1.0, 25.0, dtype=np.float32).reshape(2, 3, 4)
VELOCITY = np.stack([DENSITY, 2.0 * DENSITY, -DENSITY], -1)
SAMPLE = VolumeSample("/World/box", LOW, CELL, {"density": DENSITY, "velocity": VELOCITY}, {"velocity": "m/s"})


@pytest.fixture(autouse=True)
def row(monkeypatch):
    register(monkeypatch.setattr)


def stage_of(kind: str, metres: float = 1.0) -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.DefinePrim("/World/box", kind)
    return stage


def put(stage: Usd.Stage, tmp_path, sample: VolumeSample = SAMPLE) -> tuple[dict, UsdVol.Volume]:
    """The grids written for a sample, and the volume that names them."""
    for attribute, value in sample_attribute_values(stage, sample, 1.0, SidecarFiles(str(tmp_path / "o.usdc"))):
        attribute.Set(value, 1.0)
    home = next(UsdVol.Volume(p) for p in stage.Traverse() if p.IsA(UsdVol.Volume))
    names = {UsdVol.OpenVDBAsset(stage.GetPrimAtPath(p)).GetFilePathAttr().Get(1.0).path for p in home.GetFieldPaths().values()}
    return vdb_read.read_vdb(tmp_path / names.pop()), home


def test_the_volume_of_a_box_stands_beside_it_in_the_world(tmp_path):
    """Of a cube: nothing stands below a shape, and its scale is not that of the volume. On a stage in centimetres."""
    stage = stage_of("Cube", 0.01)
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTranslateOp().Set(Gf.Vec3d(5.0, 6.0, 7.0))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/box")).AddScaleOp().Set(Gf.Vec3f(50.0, 75.0, 100.0))
    grids, home = put(stage, tmp_path)
    assert home.GetPath() == "/World/box" + VOLUME
    assert np.allclose(home.GetExtentAttr().Get(), [(100, 200, 300), (200, 350, 500)])
    assert home.ComputeLocalToWorldTransform(1.0) == Gf.Matrix4d(1.0)
    density, velocity = grids["density"], grids["velocity"]
    assert np.allclose(density.place, [125, 225, 325]) and np.allclose(density.voxel, 50)
    assert np.array_equal(density.values[:2, :3, :4], DENSITY)
    assert np.allclose(velocity.values[:2, :3, :4], 100.0 * VELOCITY)
    said = {str(p.GetName()): [a.Get() for a in (UsdVol.FieldAsset(p).GetFieldNameAttr(),
                                                 UsdVol.OpenVDBAsset(p).GetFieldClassAttr(),
                                                 UsdVol.FieldAsset(p).GetFieldDataTypeAttr(),
                                                 UsdVol.FieldAsset(p).GetVectorDataRoleHintAttr())]
            for p in home.GetPrim().GetChildren()}
    assert said == {"density": ["density", "fogVolume", "float", "None"],
                    "velocity": ["velocity", "unknown", "float3", "Vector"]}


def test_a_volume_that_is_there_has_the_grids_in_its_own_frame(tmp_path):
    stage = stage_of("Volume")
    home = UsdGeom.Xformable(stage.GetPrimAtPath("/World/box"))
    home.AddTranslateOp().Set(Gf.Vec3d(1.0, 0.0, 0.0))
    home.AddScaleOp().Set(Gf.Vec3f(0.5, 1.0, 0.25))
    grids, found = put(stage, tmp_path, SAMPLE)
    assert found.GetPath() == "/World/box" and len([p for p in stage.Traverse() if p.IsA(UsdVol.Volume)]) == 1
    M = np.array(home.GetLocalTransformation(1.0))
    for grid in grids.values():
        for index in np.ndindex(2, 3, 4):
            local = grid.place + grid.voxel * index
            assert np.allclose(local @ M[:3, :3] + M[3, :3], LOW + CELL * (np.array(index) + 0.5))
    assert np.allclose(grids["velocity"].values[:2, :3, :4] @ M[:3, :3], VELOCITY)


def test_halves_are_stored_as_such(tmp_path):
    sample = VolumeSample("/World/box", LOW, CELL, {"density": DENSITY.astype(np.float16)})
    stage = stage_of("Xform")
    grids, home = put(stage, tmp_path, sample)
    assert grids["density"].values.dtype == np.float16
    assert UsdVol.FieldAsset(home.GetPrim().GetChildren()[0]).GetFieldDataTypeAttr().Get() == "half"


def test_what_cannot_hold_a_grid_is_named(tmp_path):
    stage = stage_of("Volume")
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/box")).AddRotateZOp().Set(30.0)
    with pytest.raises(SceneError, match="/World/box: is turned or mirrored"):
        put(stage, tmp_path)
    stage = stage_of("Xform")
    stage.DefinePrim("/World/box" + VOLUME, "Mesh")
    with pytest.raises(SceneError, match=f"/World/box{VOLUME}: is a Mesh, where the result has the volume of /World/box"):
        put(stage, tmp_path)
    stage = stage_of("Xform")
    for fields in ({}, {"a": DENSITY, "b": DENSITY[:1]}, {"a b": DENSITY}):
        with pytest.raises(ValueError, match="allowed is one shape"):
            put(stage, tmp_path, VolumeSample("/World/box", LOW, CELL, fields))
    assert not files(tmp_path)


def test_files_are_numbered_as_a_sequence_and_go_with_a_folder(tmp_path):
    source = author(tmp_path / "s.usda")
    run(source, tmp_path / "o.usdc")
    assert sorted(p.name for p in (tmp_path / "o.files").rglob("*.vdb")) == [f"Smoke.{k:04d}.vdb" for k in range(FRAMES + 1)]
    layers, assets, lost = UsdUtils.ComputeAllDependencies(str(tmp_path / "o.usdc"))
    assert len(assets) == FRAMES + 1 and not lost and len(layers) == 2
    for kind in (True, False):
        run(source, tmp_path / f"flat{kind}.usdc", flatten=kind)
    shutil.move(tmp_path, (there := tmp_path.with_name(tmp_path.name + "_moved")))
    for name in ("o", "flatTrue", "flatFalse"):
        check(there / f"{name}.usdc")


def test_clips_keep_the_files_of_volumes(tmp_path):
    source = author(tmp_path / "s.usda")
    job = prepare_recorded_run(load(source), str(tmp_path / "o.usdc"), lambda s: Simulation(s, device="cpu"))
    job.recorder.clips = True
    job.frames()
    check(tmp_path / "o.usdc")
    assert (tmp_path / "o.clips").is_dir()


def test_a_restarted_run_names_one_file_a_frame(tmp_path):
    source = author(tmp_path / "s.usda")
    run(source, tmp_path / "half.usdc", 3)
    run(source, tmp_path / "o.usdc", FRAMES, tmp_path / "half.usdc")
    check(tmp_path / "o.usdc")
    assert len(list((tmp_path / "o.files").rglob("*.vdb"))) == FRAMES + 1
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "o.usdc"))
    assert layer.GetPrimAtPath(f"{PATH}/Smoke").typeName == "Volume"


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files there")
def test_a_disk_that_fills_leaves_whole_frames_and_one_line(tmp_path):
    """A limit on the size of files stands for it: the third frame's file is larger."""
    source = author(tmp_path / "s.usda")
    child = subprocess.run([sys.executable, "-c", f"""
import resource, signal, sys
import numpy as np
from tests.make.rows.sparks import method
from tests.make.usd.result import kinds as own
own.register(setattr)
taken = method.Flying.samples
def larger(self, world=0):
    found = taken(self, world)
    if self.part.arrays["frames"].numpy()[0] == 3:
        fields = {{"density": np.ones((64, 64, 64), np.float32)}}
        found = [own_volume(s, fields) if type(s).__name__ == "VolumeSample" else s for s in found]
    return found
own_volume = lambda s, fields: type(s)(s.path, s.low, s.cell, fields)
method.Flying.samples = larger
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))
from wsim.usd.result import partial
partial.SHARE = 1.0
try:
    own.run({source!r}, {str(tmp_path / 'o.usdc')!r})
except OSError as error:
    print(error)
"""], cwd=Path(__file__).parents[3], capture_output=True, text=True)
    told = [line for line in child.stdout.splitlines() if "written" in line]
    assert len(told) == 1 and "Smoke.0003.vdb could not be written: File too large. Free space" in told[0], child.stderr
    kept = tmp_path / "o.partial.usdc"
    assert kept.exists() and not (tmp_path / "o.usdc").exists()
    check(kept, frames=2)
    assert {p.suffix for p in (tmp_path / "o.files").rglob("*.*")} == {".vdb"}
    assert len(list((tmp_path / "o.files").rglob("*.vdb"))) == 3
    job = prepare_recorded_run(load(source), str(tmp_path / "p.usdc"), lambda s: Simulation(s, device="cpu"), restart=str(kept))
    job.frames()
    check(tmp_path / "p.usdc")
