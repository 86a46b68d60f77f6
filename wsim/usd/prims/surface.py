"""The surface of a TetMesh as a Mesh, for tools that show no TetMesh: the same points, renumbered without those inside.

`wsim new softbody` authors one, which follows as a skin; a result gets one for each soft body that has no skin.
"""

from collections.abc import Mapping

import numpy as np
from pxr import Usd, UsdGeom, UsdShade, Vt

from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.scene import Scene, Soft

OF = "wsim:surfaceOf"              # custom data of the Mesh: path of its TetMesh


def tet_surface_mesh(tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(points of the surface in the numbers of the TetMesh, (k,); triangles of the surface in numbers of those, (m, 3)) of tets
    (t, 4) of positive volume."""
    triangles = tet_surface_triangles(tets)
    own, corners = np.unique(triangles, return_inverse=True)
    return own, corners.reshape(-1, 3).astype(np.int32)


def author_surface(stage: Usd.Stage, mesh: UsdGeom.TetMesh, tets: np.ndarray, path: str, start: float) -> np.ndarray:
    """Defines the Mesh beside a TetMesh, with its transform, orientation and looks; the TetMesh becomes a guide, so that it is
    not seen twice. tets: of positive volume in the world. Returns the numbers of its points in the TetMesh, (k,)."""
    prim = mesh.GetPrim()
    own, triangles = tet_surface_mesh(tets)
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
    if prim != stage.GetDefaultPrim():                          # else who refers to it would see nothing
        mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    shown.GetPrim().SetCustomDataByKey(OF, str(prim.GetPath()))
    return own


class SurfaceOver:
    """The Mesh of a soft body without skins in a result: what is written of the TetMesh, at the points of its surface."""

    def __init__(self, prim: Usd.Prim, soft: Soft, start: float, codes: list[float]):
        """codes: time codes that the TetMesh has samples of already."""
        stage, self.path = prim.GetStage(), free_prim_path(prim.GetStage(), f"{prim.GetPath()}_surface")
        self.own = author_surface(stage, UsdGeom.TetMesh(prim), soft.tets, self.path, start)
        self.prim = stage.GetPrimAtPath(self.path)
        for code in codes:
            for attribute, value in self.of([(a, a.Get(code)) for a in prim.GetAttributes() if self._is_surface_attribute(a)]):
                attribute.Set(value, code)

    def _is_surface_attribute(self, attribute: Usd.Attribute) -> bool:
        name = attribute.GetName()
        return name in ("points", "velocities") or name.startswith("primvars:") and attribute.GetNumTimeSamples() > 0

    def of(self, samples: list) -> list:
        """(attribute, value) of the Mesh for those of the TetMesh."""
        found: list = []
        for attribute, value in samples:
            name = attribute.GetName()
            if value is None or name != "points" and name != "velocities" and not name.startswith("primvars:"):
                continue
            own = type(value).FromNumpy(np.ascontiguousarray(np.array(value)[self.own]))
            if name == "points":
                found.append((UsdGeom.Boundable(self.prim).CreateExtentAttr(), UsdGeom.PointBased.ComputeExtent(own)))
            mine = self.prim.GetAttribute(name)
            if not mine:
                mine = self.prim.CreateAttribute(name, attribute.GetTypeName(), False)
                if name.startswith("primvars:"):
                    UsdGeom.Primvar(mine).SetInterpolation(UsdGeom.Tokens.vertex)
            found.append((mine, own))
        return found


def soft_body_surfaces(scene: Scene, bodies: Mapping[str, tuple[Usd.Prim, int]], codes: list[float]) -> dict[str, SurfaceOver]:
    """Surfaces of the soft bodies without skins, by path. bodies: prim and count by path; codes as `SurfaceOver` has them."""
    return {s.path: SurfaceOver(bodies[s.path][0], s, scene.start, codes) for s in scene.things("Soft") if not s.skins}


def free_prim_path(stage: Usd.Stage, path: str) -> str:
    """path, or path_1, path_2 ... where no prim is yet."""
    candidate, i = path, 0
    while stage.GetPrimAtPath(candidate):
        i += 1
        candidate = f"{path}_{i}"
    return candidate
