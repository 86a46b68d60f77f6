"""An OBJ file -> a USD file of its mesh, from which `wsim new` goes on. OBJ files have no unit and no up axis: numbers are
taken as metres, unless a unit is given, and y as up."""

import os
from pathlib import Path

import numpy as np
from pxr import UsdGeom, Vt

from wsim.scene import Problem, SceneError, shapes
from wsim.usd.stage import StageUnits
from wsim.usd.write import author_units, new_stage

OBJ = ".obj"


def is_obj(file) -> bool:
    """True of the name of an OBJ file."""
    return os.fspath(file).lower().endswith(OBJ)


def convert_obj(file, out, meters_per_unit: float | None, replaces: bool, notes: list[Problem]) -> str:
    """Writes the mesh of `file` beside the scene `out`, as NAME_mesh.usdc, and returns its path. replaces: one that is there.

    Raises SceneError: no such file, a line that is wrong, a file in the way, a place that cannot be written."""
    file = os.fspath(file)
    target = Path(os.fspath(out)).with_name(f"{Path(file).stem}_mesh.usdc")
    if not os.path.isfile(file):
        raise SceneError(Problem(file, "there is no such file; give the path of an OBJ or USD file"))
    if target.exists() and not replaces:
        raise SceneError(Problem(str(target), f"is there already, and would hold the mesh of {file}; give --force to "
                                 "replace it"))
    try:
        points, counts, indices = shapes.read_obj(file)
    except (ValueError, OSError) as error:
        raise SceneError(Problem(file, str(error).removeprefix(f"{file}: "))) from None
    with new_stage(target) as stage:
        author_units(stage, StageUnits(meters_per_unit or 1.0, 1.0, "Y", 24.0, 0.0), 0)
        stage.ClearMetadata("startTimeCode")
        stage.ClearMetadata("endTimeCode")
        mesh = UsdGeom.Mesh.Define(stage, "/mesh")
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
        stage.SetDefaultPrim(mesh.GetPrim())
    if meters_per_unit is None:
        size = float(np.ptp(points, axis=0).max())
        notes.append(Problem(file, f"has no unit: its numbers are taken as metres, so that it is {size:.3g} m large; give "
                             "--meters-per-unit if that is not meant", fatal=False))
    return str(target)
