"""What tests/usd/result/test_kinds.py shares with other tests: FRAMES, PATH, author, check, files, register, run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdVol

from tests.make.rows.sparks import ROW
from tests.make.rows.sparks.objects import GRAVITY, WIDTH, Sparks
from wsim.cli.run import prepare_recorded_run
from wsim.scene import Scene, methods
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save
from wsim.usd.result.kinds import vdb_read

PATH, FPS, FRAMES = "/World/sparks", 24.0, 6


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
