"""Fields on a grid as a UsdVol.Volume: an OpenVDB file a frame with all of them, and an OpenVDBAsset for each.

    Volume        field:NAME -> NAME            extent
    OpenVDBAsset  filePath, sampled             fieldName, fieldClass, fieldDataType, vectorDataRoleHint

The grids stand in the frame and the units of the Volume, which may be scaled and moved and not turned; one that is made here
has the world's frame, whatever is above it.
"""

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdVol, Vt

from wsim.scene import Problem, SceneError
from wsim.scene.samples import VOLUME, VolumeSample
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.kinds.vdb import VdbGrid, write_vdb
from wsim.usd.result.samples import PrimFrame
from wsim.usd.stage import StageUnits

TURNED = 1e-6                 # of the scale that may stand beside the diagonal of a transform
TYPES = {(np.dtype(np.float32), 3): "float", (np.dtype(np.float32), 4): "float3",
         (np.dtype(np.float16), 3): "half", (np.dtype(np.float16), 4): "half3"}


def volume_attribute_values(prim: Usd.Prim, sample: VolumeSample, code: float,
                            beside: SidecarFiles) -> list[tuple[Usd.Attribute, Any]]:
    """(attribute, value) of a sample; its file is written. Raises SceneError where the prim cannot take it, ValueError for
    fields that no file can hold, OSError where the disk does not."""
    shapes = {np.shape(values)[:3] for values in sample.fields.values()}
    if len(shapes) != 1 or not all(Sdf.Path.IsValidIdentifier(name) for name in sample.fields):
        raise ValueError(f"fields of {sample.path} have shapes {sorted(shapes)} and names {list(sample.fields)}; allowed is "
                         "one shape, and names of letters, digits and _")
    home = _find_volume_prim(prim)
    frame = axis_aligned_frame(home.GetPrim(), code)
    voxel = sample.cell / (frame.unit * np.diag(frame.L))
    low = frame.points(np.asarray(sample.low, np.float64))
    if not home.GetExtentAttr().HasAuthoredValue():
        corners = np.array([low, low + voxel * np.array(shapes.pop())])
        home.CreateExtentAttr(Vt.Vec3fArray([Gf.Vec3f(*row) for row in corners.tolist()]))
    units = StageUnits.of(prim.GetStage())
    grids = [_grid_in_volume_frame(name, values, units.factor(sample.units.get(name, "1")), np.diag(frame.L), low + 0.5 * voxel,
                                   voxel)
             for name, values in sample.fields.items()]
    file = Sdf.AssetPath(beside.write_frame(str(home.GetPath()), code, ".vdb", lambda target: write_vdb(target, grids)))
    return [(_define_vdb_asset(home, grid).GetFilePathAttr(), file) for grid in grids]


def axis_aligned_frame(prim: Usd.Prim, code: float) -> PrimFrame:
    """Frame of a volume, which is scaled and moved. Raises SceneError where it is turned or mirrored."""
    frame = PrimFrame.of(prim, code)
    if np.abs(frame.L - np.diag(np.diag(frame.L))).max() > TURNED * np.abs(frame.L).max() or np.diag(frame.L).min() <= 0.0:
        raise SceneError(Problem(str(prim.GetPath()), "is turned or mirrored, and holds fields on a grid along the world's "
                                 "axes; take the rotation out of its transform and of what is above it"))
    return frame


def _find_volume_prim(prim: Usd.Prim) -> UsdVol.Volume:
    """The prim itself where it is a volume, else the one beside it."""
    if prim.IsA(UsdVol.Volume):
        return UsdVol.Volume(prim)
    stage, path = prim.GetStage(), prim.GetPath().ReplaceName(prim.GetName() + VOLUME)
    found = stage.GetPrimAtPath(path)
    if found and not found.IsA(UsdVol.Volume):
        raise SceneError(Problem(str(path), f"is a {found.GetTypeName() or 'prim without type'}, where the result has the "
                                 f"volume of {prim.GetPath()}; give it another name"))
    home = UsdVol.Volume.Define(stage, path)
    if not UsdGeom.Xformable(home).GetXformOpOrderAttr().HasAuthoredValue():
        UsdGeom.Xformable(home).SetXformOpOrder([], True)
    return home


def _grid_in_volume_frame(name: str, values: np.ndarray, unit: float, scale: np.ndarray, place: np.ndarray,
                          voxel: np.ndarray) -> VdbGrid:
    """A field [SI, world] in the frame of its volume, of that scale, and in stage units of `unit` each."""
    vector = values.ndim == 4
    divisor = scale * unit if vector else np.array([unit])
    if (divisor != 1.0).any():
        values = (values / divisor).astype(values.dtype)
    values = np.ascontiguousarray(values)
    if vector:
        return VdbGrid(name, values, place, voxel, kind="unknown", metadata={"vector_type": "contravariant relative"})
    return VdbGrid(name, values, place, voxel)


def _define_vdb_asset(home: UsdVol.Volume, grid: VdbGrid) -> UsdVol.OpenVDBAsset:
    """The field prim below a volume, said once."""
    stage, path = home.GetPrim().GetStage(), home.GetPath().AppendChild(grid.name)
    asset = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(path))
    if asset and home.GetFieldPath(grid.name) == path and asset.GetFieldNameAttr().Get() == grid.name:
        return asset
    asset = UsdVol.OpenVDBAsset.Define(stage, path)
    asset.CreateFieldNameAttr(grid.name)
    asset.CreateFieldClassAttr("fogVolume" if grid.components == 1 else "unknown")
    asset.CreateFieldDataTypeAttr(TYPES[grid.values.dtype, grid.values.ndim])
    if grid.components == 3:
        asset.CreateVectorDataRoleHintAttr("Vector")
    home.CreateFieldRelationship(grid.name, path)
    return asset
