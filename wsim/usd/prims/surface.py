"""The surface of a TetMesh as a Mesh, for tools that show no TetMesh: the same points, renumbered without those inside."""

import numpy as np
from pxr import Usd, UsdGeom, UsdShade, Vt

from wsim.geometry.tetra.tets import surface


def faces(tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(points of the surface in the numbers of the TetMesh, (k,); triangles of the surface in numbers of those, (m, 3)) of tets
    (t, 4) of positive volume."""
    triangles = surface(tets)
    own, corners = np.unique(triangles, return_inverse=True)
    return own, corners.reshape(-1, 3).astype(np.int32)


def author_surface(stage: Usd.Stage, mesh: UsdGeom.TetMesh, tets: np.ndarray, path: str, start: float) -> np.ndarray:
    """Defines the Mesh beside a TetMesh, with its transform, orientation and looks; the TetMesh becomes a guide, so that it is
    not seen twice. tets: of positive volume in the world. Returns the numbers of its points in the TetMesh, (k,)."""
    prim = mesh.GetPrim()
    own, triangles = faces(tets)
    shown = UsdGeom.Mesh.Define(stage, path)
    shown.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    frame = np.array(UsdGeom.XformCache(Usd.TimeCode(start)).GetLocalToWorldTransform(prim))
    mirrored = np.linalg.det(frame[:3, :3]) < 0
    shown.CreateOrientationAttr(UsdGeom.Tokens.leftHanded if mirrored else UsdGeom.Tokens.rightHanded)
    shown.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    shown.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(triangles.ravel(), np.int32)))
    points = mesh.GetPointsAttr().Get()
    points = mesh.GetPointsAttr().Get(Usd.TimeCode(start)) if points is None else points
    shown.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.array(points)[own]))
    shown.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(shown.GetPointsAttr().Get()))
    for attribute in (op.GetAttr() for op in mesh.GetOrderedXformOps()):
        copy = shown.GetPrim().CreateAttribute(attribute.GetName(), attribute.GetTypeName(), False)
        if attribute.Get() is not None:
            copy.Set(attribute.Get())
        for code in attribute.GetTimeSamples():
            copy.Set(attribute.Get(code), code)
    order = mesh.GetXformOpOrderAttr().Get()
    if order:
        shown.CreateXformOpOrderAttr(order)
    looks = UsdShade.MaterialBindingAPI(prim).GetDirectBinding().GetMaterial()
    if looks:
        UsdShade.MaterialBindingAPI.Apply(shown.GetPrim()).Bind(looks)
    color = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
    if color is not None and len(color) == 1:
        shown.CreateDisplayColorAttr(color)
    mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    return own
