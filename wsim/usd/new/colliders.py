"""Colliders of a scene that `wsim new` makes: prims of the mesh's file, or another file that is referred to.

    /World/table, table     a prim by path or name: it and every shape below it collides
    ball.usda               a file: its default prim, below the new scene's `colliders`, with its animation; other units and
                            another up axis are turned into those of the mesh
"""

import os
import re

import numpy as np
from pxr import Gf, Usd, UsdGeom

from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.new.mesh import BareMesh, relative_asset_path
from wsim.usd.new.place import free_path_below_root, set_world_transform
from wsim.usd.stage import SUFFIXES, open_stage

SHAPES = ("Mesh", "Plane", "Sphere", "Cube", "Capsule", "Capsule_1", "Cylinder", "Cylinder_1", "Cone")


def is_collider_file(given: str) -> bool:
    """True if a collider is given as a file."""
    return given.lower().endswith((*SUFFIXES, ".usdz")) or os.path.isfile(given)


def author_colliders(stage: Usd.Stage, bare: BareMesh, out, given: tuple[str, ...], notes: list[Problem]) -> None:
    """Makes what is given collide. Raises SceneError where it is not there, or holds no shape."""
    for each in given:
        prim = _reference_collider_file(stage, bare, out, each,
                                        notes) if is_collider_file(each) else _find_collider_prim(stage, bare, each)
        _enable_collision(prim, bare, each)
        root = stage.GetDefaultPrim().GetPath()
        if not prim.GetPath().HasPrefix(root):
            notes.append(Problem(str(prim.GetPath()), f"collides, and stands outside of the default prim {root}: a stage that "
                                 "refers to this scene lacks it; move it below", fatal=False))


def _find_collider_prim(stage: Usd.Stage, bare: BareMesh, given: str) -> Usd.Prim:
    """The prim of that path or name."""
    prims = [p for p in stage.Traverse() if given in (str(p.GetPath()), p.GetName())]
    if len(prims) == 1:
        return prims[0]
    there = [str(p.GetPath()) for p in stage.Traverse() if str(p.GetTypeName()) in SHAPES and p.GetPath() != bare.path]
    what = f"names {len(prims)} prims; give the path of one" if prims else "is no file and no prim of the mesh's file"
    raise SceneError(Problem(given, f"{what}; its shapes: {', '.join(there[:8]) or 'none besides the mesh'} (--collider)"))


def _reference_collider_file(stage: Usd.Stage, bare: BareMesh, out, file: str, notes: list[Problem]) -> Usd.Prim:
    """A prim that refers to a file, scaled and turned to the units of the stage."""
    other = open_stage(file, notes=notes)
    start = other.GetDefaultPrim() or next(iter(other.GetPseudoRoot().GetChildren()), None)
    if not start:
        raise SceneError(Problem(file, "has no prim that could collide (--collider)"))
    UsdGeom.Scope.Define(stage, f"{stage.GetDefaultPrim().GetPath()}/colliders")
    name = re.sub(r"\W", "_", os.path.splitext(os.path.basename(file))[0])
    path = free_path_below_root(stage, f"colliders/{name if not name[:1].isdigit() else f'_{name}'}")
    around = UsdGeom.Xform.Define(stage, path)
    set_world_transform(around, _stage_conversion_matrix(other, bare), bare.units)
    prim = stage.DefinePrim(f"{path}/{start.GetName()}")
    prim.GetReferences().AddReference(relative_asset_path(file, out), start.GetPath())
    return prim


def _stage_conversion_matrix(other: Usd.Stage, bare: BareMesh) -> np.ndarray:
    """Matrix (4, 4), row vectors, from the units and axes of another stage to those of the mesh's."""
    M = np.eye(4) * (UsdGeom.GetStageMetersPerUnit(other) / bare.units.metres)
    M[3, 3] = 1.0
    up = str(UsdGeom.GetStageUpAxis(other))
    if up == bare.units.up:
        return M
    quarter = Gf.Matrix4d().SetRotate(Gf.Rotation((1, 0, 0), -90.0 if up == "Z" else 90.0))
    return np.round(np.array(quarter), 15) @ M


def _enable_collision(prim: Usd.Prim, bare: BareMesh, given: str) -> None:
    """Gives it and every shape below an API to collide; instances among them become prims of their own."""
    stage, found = prim.GetStage(), 0
    for instance in [p for p in Usd.PrimRange(prim) if p.IsInstance()]:
        instance.SetInstanceable(False)
    for shape in list(Usd.PrimRange(prim)):
        if str(shape.GetTypeName()) in SHAPES and shape.GetPath() != bare.path:
            over = stage.OverridePrim(shape.GetPath())
            over.AddAppliedSchema(names.COLLISION)
            if shape.IsA(UsdGeom.Mesh):
                over.AddAppliedSchema(names.MESH_COLLISION)
            found += 1
    if not found:
        raise SceneError(Problem(given, f"holds no shape that could collide; allowed is {', '.join(SHAPES)} (--collider)"))
