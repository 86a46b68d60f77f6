"""What tests/usd/result/test_recorder.py shares with other tests: CLOTH, EPS, SIDE, author, record, world."""

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt

from tests.conftest import grid
from wsim.scene import Scene
from wsim.usd.result.recorder import Recorder

EPS = np.finfo(np.float32).eps
CLOTH = "/World/Frame/cloth"
SIDE = 4


def triangles(side: int = SIDE):
    """Points (n, 3) of a flat square and its triangles as counts and indices."""
    points, _, quads = grid(side)
    quads = quads.reshape(-1, 4)
    return points, np.full(2 * len(quads), 3), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1)


def author(path, *, metres=0.01, fps=30.0, start=1.0, matrices=None, mesh=triangles) -> Scene:
    """A Z-up source of one mesh under a frame, by pxr alone, and the scene that a loader would make of it.

    matrices    {time code or None: Gf.Matrix4d} of the frame, in stage units
    """
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetStartTimeCode(start)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    op = UsdGeom.Xform.Define(stage, "/World/Frame").AddTransformOp()
    for code, matrix in (matrices or {}).items():
        op.Set(matrix, Usd.TimeCode.Default() if code is None else code)
    points, counts, indices = mesh()
    cloth = UsdGeom.Mesh.Define(stage, CLOTH)
    cloth.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points / np.float32(metres)))
    cloth.CreateFaceVertexCountsAttr(counts.tolist())
    cloth.CreateFaceVertexIndicesAttr(indices.tolist())
    cloth.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(cloth.GetPointsAttr().Get()))
    stage.Save()
    scene = Scene(fps=fps, start=start, up="Z", source=str(path))
    scene.cloth(CLOTH, points, counts, indices)
    return scene


def world(n: int = SIDE * SIDE, frame: int = 0, around=(0.0, 0.0, 0.0)) -> tuple[dict, dict]:
    """Positions [m] within a metre of a place, and velocities [m/s], the same for the same frame."""
    rng = np.random.default_rng(frame)
    return {CLOTH: rng.uniform(-1, 1, (n, 3)) + around}, {CLOTH: rng.uniform(-1, 1, (n, 3))}


def record(scene, path, frames=3, **more) -> Recorder:
    with Recorder(scene, str(path), **more) as recorder:
        for f in range(frames):
            recorder.append(recorder.time_code(f), *world(frame=f))
    return recorder


def matrix(linear, translate=(0, 0, 0)) -> Gf.Matrix4d:
    M = np.eye(4)
    M[:3, :3], M[3, :3] = linear, translate
    return Gf.Matrix4d(M)
