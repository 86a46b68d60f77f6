"""Fluids in results: their fields as volumes, read back as the state has them; restarts to the bit; a stage in centimetres."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdVol

from wsim.cli.run import prepare_recorded_run
from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene import Scene, Sphere
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation
from wsim.usd import load, names, save
from wsim.usd.result.kinds import sidecar, vdb_read

FRAMES, SHAPE = 4, (8, 12, 8)


def scene_of() -> Scene:
    """A box of 0.8 x 1.2 x 0.8 m with a hot source."""
    scene = Scene(fps=24.0, frames=FRAMES, solver="auto")
    scene.add(Fluid("/World/air", (-0.4, 0.0, -0.4), (0.4, 1.2, 0.4), 0.1, ("closed",) * 6))
    place = np.eye(4)
    place[:3, 3] = (0.05, 0.3, 0.0)
    scene.add(Source("/World/burner", Sphere(0.2), Motion.still(place), smoke=1.0, temperature=100.0, hold=True))
    return scene


def run(source, output, frames: int = FRAMES, restart=None):
    job = prepare_recorded_run(replace(load(str(source)), frames=frames), str(output), lambda s: Simulation(s, device="cpu"),
                               restart=restart and str(restart))
    job.frames()
    return job


def grids(result, path: str, code: float) -> dict[str, np.ndarray]:
    """Dense values of each field, as the layer's own asset names them."""
    stage, found = Usd.Stage.Open(str(result)), {}
    for name, field in UsdVol.Volume(stage.GetPrimAtPath(path)).GetFieldPaths().items():
        asset = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(field))
        grid = vdb_read.read_vdb(asset.GetFilePathAttr().Get(code).resolvedPath, (asset.GetFieldNameAttr().Get(),))[name]
        whole = np.zeros((*(-(-np.array(SHAPE) // 8) * 8), *grid.values.shape[3:]), np.float32)
        whole[tuple(slice(a, a + n) for a, n in zip(grid.first, grid.values.shape, strict=False))] = grid.values
        found[name] = whole[:SHAPE[0], :SHAPE[1], :SHAPE[2]]
    return found


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fluid")
    save(scene_of(), str(folder / "s.usda"))
    return folder, run(folder / "s.usda", folder / "o.usdc")


def test_a_result_has_the_fields_of_the_state(whole):
    folder, job = whole
    found = grids(folder / "o.usdc", "/World/air_volume", FRAMES)
    sample = job.simulation.samples()[0]
    assert set(found) == set(sample.fields) == {"density", "temperature", "velocity"}
    for name, values in sample.fields.items():
        assert np.array_equal(found[name], values), name
    assert found["density"].max() > 0.9 and np.abs(found["velocity"]).max() > 0.05 and found["temperature"].max() > 90.0
    start = grids(folder / "o.usdc", "/World/air_volume", 0)
    assert not start["density"].any() and not start["velocity"].any()


@pytest.mark.parametrize("large", [False, True])
def test_a_restart_goes_on_to_the_bit(whole, tmp_path, monkeypatch, large):
    """Its fields stand in a file beside the layer where they are large."""
    if large:
        monkeypatch.setattr(sidecar, "LARGE", 1000)
    folder, one = whole
    run(folder / "s.usda", tmp_path / "half.usdc", 2)
    assert len(list((tmp_path / "half.files").rglob("*.npz"))) == int(large)
    two = run(folder / "s.usda", tmp_path / "rest.usdc", FRAMES, tmp_path / "half.usdc")
    assert not two.simulation.warnings
    for code in range(FRAMES + 1):
        a, b = (grids(path, "/World/air_volume", code) for path in (folder / "o.usdc", tmp_path / "rest.usdc"))
        assert all(np.array_equal(a[name], b[name]) for name in a)
    for name, part in one.simulation.state.parts.items():
        other = two.simulation.state.parts[name].arrays
        assert all(np.array_equal(part.arrays[f.name].numpy(), other[f.name].numpy()) for f in part.kept), name


def test_a_stage_in_centimetres_has_the_same_smoke_and_speeds_of_its_own(whole, tmp_path):
    """The same box: smoke to the rounding of its sizes, speeds a hundred times as large."""
    folder, _ = whole
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetTimeCodesPerSecond(24.0)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(FRAMES)
    box = UsdGeom.Cube.Define(stage, "/World/air")
    box.AddTranslateOp().Set(Gf.Vec3d(0.0, 60.0, 0.0))
    box.AddScaleOp().Set(Gf.Vec3f(40.0, 60.0, 40.0))
    ball = UsdGeom.Sphere.Define(stage, "/World/burner")
    ball.AddTranslateOp().Set(Gf.Vec3d(5.0, 30.0, 0.0))
    ball.CreateRadiusAttr(20.0)
    for prim, api, values in ((box, names.WSIM_DOMAIN, {"cellSize": 10.0, "sides": ["closed"] * 6}),
                              (ball, names.WSIM_SOURCE, {"smoke": 1.0, "temperature": 100.0, "hold": True})):
        prim.GetPrim().AddAppliedSchema(api)
        for name, value in values.items():
            prim.GetPrim().GetAttribute(f"wsim:fluid:{name}").Set(value)
    stage.GetRootLayer().Save()
    run(tmp_path / "s.usda", tmp_path / "o.usdc")
    a, b = (grids(path, "/World/air_volume", FRAMES) for path in (folder / "o.usdc", tmp_path / "o.usdc"))
    assert np.abs(a["density"] - b["density"]).max() < 1e-4
    assert np.abs(100.0 * a["velocity"] - b["velocity"]).max() < 1e-3 * np.abs(b["velocity"]).max()
    result = Usd.Stage.Open(str(tmp_path / "o.usdc"))
    volume = UsdVol.Volume(result.GetPrimAtPath("/World/air_volume"))
    assert np.allclose(volume.GetExtentAttr().Get(), [(-40, 0, -40), (40, 120, 40)], atol=1e-4)
