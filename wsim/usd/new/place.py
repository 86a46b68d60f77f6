"""Where what `wsim new` makes stands: below the default prim, so that another stage that refers to the new file gets all of it.

The default prim is that of the mesh's file, or what the mesh stands below; where that is the mesh itself, an Xform of its own,
to which the mesh moves (by an internal reference; the original is deactivated), since a shape holds no others in USD.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pxr import Gf, Usd, UsdGeom

from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.attributes import author_attribute
from wsim.usd.new.mesh import BareMesh
from wsim.usd.prims.surface import free_prim_path
from wsim.usd.stage import StageUnits

SUNK = 1e-4                        # share of a mesh's size that may lie below the ground unnoticed: rounding of its file


def set_default_prim(stage: Usd.Stage, bare: BareMesh) -> BareMesh:
    """Makes the root the default prim; returns where root and mesh stand now."""
    root = stage.GetPrimAtPath(bare.root)
    if root.IsA(UsdGeom.Gprim):
        moved = enclose_in_xform(stage, root)
        bare = replace(bare, path=bare.path.ReplacePrefix(root.GetPath(), moved.GetPath()),
                       root=str(moved.GetPath().GetParentPath()))
        root = moved.GetParent()
    stage.SetDefaultPrim(root)
    return bare


def enclose_in_xform(stage: Usd.Stage, mesh: Usd.Prim) -> Usd.Prim:
    """The mesh again, alone in an Xform beside it; the original is deactivated."""
    around = UsdGeom.Xform.Define(stage, free_prim_path(stage, f"{mesh.GetPath()}_body")).GetPrim()
    moved = stage.DefinePrim(around.GetPath().AppendChild(mesh.GetName()))
    moved.GetReferences().AddInternalReference(mesh.GetPath())
    moved.SetActive(True)
    mesh.SetActive(False)
    return moved


def free_path_below_root(stage: Usd.Stage, name: str) -> str:
    """A free path below the default prim: name may be of several parts."""
    return free_prim_path(stage, f"{stage.GetDefaultPrim().GetPath()}/{name}")


def local_to_world_matrix(prim: Usd.Prim, units: StageUnits) -> np.ndarray:
    """Local-to-world matrix of a prim at the start, (4, 4), of row vectors, in stage units."""
    return np.array(UsdGeom.XformCache(Usd.TimeCode(units.start)).GetLocalToWorldTransform(prim))


def set_world_transform(xformable: UsdGeom.Xformable, world: np.ndarray, units: StageUnits) -> None:
    """Transforms a prim so that `world` (4, 4), row vectors [stage units], is its local-to-world matrix at the start."""
    local = world @ np.linalg.inv(local_to_world_matrix(xformable.GetPrim().GetParent(), units))
    if np.allclose(local[:3, :3], np.eye(3), rtol=0.0, atol=1e-12):
        xformable.AddTranslateOp().Set(tuple(local[3, :3]))
    else:
        xformable.AddTransformOp().Set(Gf.Matrix4d(local))


def author_physics_scene(stage: Usd.Stage, substeps: int, iterations: int) -> None:
    """A PhysicsScene, unless there is one; its gravity stays the standard's: 9.81 m/s^2 downwards."""
    if any(prim.GetTypeName() == names.PHYSICS_SCENE for prim in stage.Traverse()):
        return
    settings = stage.DefinePrim(free_path_below_root(stage, "physicsScene"), names.PHYSICS_SCENE)
    settings.AddAppliedSchema(names.WSIM_SCENE)
    author_attribute(settings, "Scene", "substeps", substeps)
    author_attribute(settings, "Scene", "iterations", iterations)


def author_ground(stage: Usd.Stage, units: StageUnits, bounds: Sequence | np.ndarray, height: float,
                  notes: list[Problem]) -> None:
    """A plane at `height` [m] along the up axis, seen four times as wide as `bounds` (2, 3) [m] are large.

    Warns of a part of the bounds below it. Raises SceneError if all of them lie below."""
    bounds, up = np.asarray(bounds), 2 if units.up == "Z" else 1
    low, high = bounds[:, up]
    if high < height:
        raise SceneError(Problem("ground", f"is at {height:g} m, and the mesh lies below: it reaches from {low:.4g} to "
                                 f"{high:.4g} m; give a height up to {low:.4g} (--ground)"))
    if low < height - SUNK * float((bounds[1] - bounds[0]).max()):
        notes.append(Problem("ground", f"is at {height:g} m, and the mesh reaches {height - low:.3g} m below it; give a height "
                             f"up to {low:.4g} (--ground), or raise the mesh", fatal=False))
    place = np.eye(4)
    place[3, :3] = bounds.mean(axis=0) / units.metres
    place[3, up] = height / units.metres
    plane = UsdGeom.Plane.Define(stage, free_path_below_root(stage, "ground"))
    plane.CreateAxisAttr(units.up)
    width = 4.0 * float((bounds[1] - bounds[0]).max()) / units.metres
    plane.CreateWidthAttr(width)
    plane.CreateLengthAttr(width)
    plane.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(plane, Usd.TimeCode.Default()))
    set_world_transform(plane, place, units)
    plane.GetPrim().AddAppliedSchema(names.COLLISION)
