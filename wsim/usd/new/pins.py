"""Which points `wsim new --pin` holds.

    top, bottom        within 1 % of the height from the highest, the lowest point
    0.9..1@x           between two parts of the bounds along an axis of the world: here the last tenth along x
    0,5,20..25         points by number, both ends of a range included
    collar             a GeomSubset of the mesh, by name or path: its points, or the points of its faces, edges or tets

A cage has points of its own: those of tets that hold a named point are held.
"""

import re

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.geometry.tetra.embed import embed_in_tets
from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.attributes import author_attribute
from wsim.usd.new.mesh import BareMesh
from wsim.usd.new.place import free_path_below_root, local_to_world_matrix
from wsim.usd.prims.pins import DERIVED

ENDS = {"top": (0.99, 1.0), "bottom": (0.0, 0.01)}
BAND = re.compile(r"([0-9.eE+-]+?)\.\.([0-9.eE+-]+)@([xyzXYZ])")
NUMBERS = re.compile(r"\d+(\.\.\d+)?(,\d+(\.\.\d+)?)*")
LIKE = "top, bottom, a band as 0.9..1@z, point numbers as 0,5,20..25, or a GeomSubset of the mesh"


def author_pins(stage: Usd.Stage, bare: BareMesh, body: Usd.Prim, given: tuple[str, ...], points=None, tets=None) -> None:
    """An attachment for each that is given, to an Xform that can be animated.

    body              the prim that is simulated
    points, tets      of a cage, in the world [m]; None: the points of the mesh are simulated
    Raises SceneError where a spec holds no point, or names none.
    """
    simulated = bare.world if points is None else points
    for spec in given:
        band = parse_bounds_band(spec, bare)
        if band is not None:
            chosen = np.flatnonzero(_in_bounds_band(simulated, *band))
        else:
            chosen = _named_pin_points(stage, bare, spec)
            if points is not None:
                chosen = np.unique(tets[embed_in_tets(points, tets, bare.world[chosen])[0]])
        if not len(chosen):
            raise SceneError(Problem(str(bare.path),
                                     f"--pin {spec} holds no point{_flat_mesh_hint(simulated, band)}; give {LIKE}"))
        _author_pin_attachment(stage, bare, body, chosen, simulated)


def parse_bounds_band(spec: str, bare: BareMesh) -> tuple[int, float, float] | None:
    """(axis, from, to) of a spec that means a band of the bounds; None of another."""
    if spec in ENDS:
        return (2 if bare.units.up == "Z" else 1), *ENDS[spec]
    match = BAND.fullmatch(spec)
    try:
        return ("xyz".index(match[3].lower()), float(match[1]), float(match[2])) if match else None
    except ValueError:
        return None


def _flat_mesh_hint(points: np.ndarray, band: tuple[int, float, float] | None) -> str:
    """Why a band of a mesh without extent along its axis holds nothing, and one of the longest axis; "" of others."""
    extent = np.ptp(points, axis=0)
    if band is None or extent[band[0]] > 1e-6 * extent.max(initial=0.0):
        return ""
    return f" (the mesh is flat along {'xyz'[band[0]]}; one end of it is 0..0.01@{'xyz'[int(extent.argmax())]})"


def _in_bounds_band(points: np.ndarray, axis: int, low: float, high: float) -> np.ndarray:
    """Whether points (n, 3) lie in a part of their bounds; in float32 at least, so that an end is inside."""
    x = points[:, axis]
    extent = float(np.ptp(x))
    part = (x - x.min()) / extent if extent > 0.0 else np.zeros(len(x))
    return (part >= low - 1e-6) & (part <= high + 1e-6)


def _named_pin_points(stage: Usd.Stage, bare: BareMesh, spec: str) -> np.ndarray:
    """Points of the mesh by number, or of a subset."""
    count = len(bare.world)
    if NUMBERS.fullmatch(spec):
        ends = [[int(k) for k in part.split("..")] for part in spec.split(",")]
        if max(max(e) for e in ends) >= count:
            raise SceneError(Problem(str(bare.path), f"--pin {spec} names point {max(max(e) for e in ends)}; allowed is 0 to "
                                     f"{count - 1}"))
        return np.unique(np.concatenate([np.arange(e[0], e[-1] + 1) for e in ends]))
    subsets = [p for p in stage.GetPrimAtPath(bare.path).GetChildren() if p.IsA(UsdGeom.Subset)]
    subset = next((p for p in subsets if spec in (p.GetName(), str(p.GetPath()))), None)
    if subset is None:
        known = ", ".join(p.GetName() for p in subsets) or "none"
        raise SceneError(Problem(str(bare.path), f"--pin {spec} is no {LIKE} (its subsets: {known})"))
    return _points_of_subset(stage.GetPrimAtPath(bare.path), UsdGeom.Subset(subset), bare)


def _points_of_subset(mesh: Usd.Prim, subset: UsdGeom.Subset, bare: BareMesh) -> np.ndarray:
    """Points of a subset's elements."""
    time = Usd.TimeCode(bare.units.start)
    indices, kind = np.array(subset.GetIndicesAttr().Get(time) or [], np.int64), subset.GetElementTypeAttr().Get()
    if kind == "point" or not len(indices):
        return np.unique(indices)
    if kind == "edge":
        return np.unique(indices)
    if kind == "tetrahedron":
        return np.unique(np.array(UsdGeom.TetMesh(mesh).GetTetVertexIndicesAttr().Get(time))[indices])
    if kind == "face" and mesh.IsA(UsdGeom.Mesh):
        counts = np.array(UsdGeom.Mesh(mesh).GetFaceVertexCountsAttr().Get(time))
        corners = np.array(UsdGeom.Mesh(mesh).GetFaceVertexIndicesAttr().Get(time))
        return np.unique(corners[np.isin(np.repeat(np.arange(len(counts)), counts), indices)])
    if kind == "face":
        faces = np.array(UsdGeom.TetMesh(mesh).GetSurfaceFaceVertexIndicesAttr().Get(time))
        return np.unique(faces[indices])
    raise SceneError(Problem(str(subset.GetPath()), f"is of {kind!r} elements; allowed is point, face, edge or tetrahedron"))


def _author_pin_attachment(stage: Usd.Stage, bare: BareMesh, body: Usd.Prim, points: np.ndarray, simulated: np.ndarray) -> None:
    """An attachment of points to an Xform below it, at rest in the frame of the default prim."""
    prim = stage.DefinePrim(free_path_below_root(stage, "pin"), names.ATTACHMENT)
    target = UsdGeom.Xform.Define(stage, f"{prim.GetPath()}/frame").GetPrim()
    prim.CreateRelationship(names.SRC0, False).SetTargets([body.GetPath()])
    prim.CreateRelationship(names.SRC1, False).SetTargets([Sdf.Path(str(target.GetPath()))])
    author_attribute(prim, "Pin", "type0", "point")
    author_attribute(prim, "Pin", "type1", "xform")
    author_attribute(prim, "Pin", "points", points)
    M = local_to_world_matrix(target, bare.units)
    local = (simulated[points] / bare.units.metres - M[3, :3]) @ np.linalg.inv(M[:3, :3]) * bare.units.metres
    author_attribute(prim, "Pin", "places", local, bare.units).SetCustomDataByKey(DERIVED, True)
