"""A mesh -> a small scene layer in which hair grows on it. See mesh.py for what that has in common with other bodies.

The mesh collides; strands are clamped to it, and go with its animation or its skeleton.
"""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from wsim.scene import Collider, Problem, Scene, SceneError
from wsim.scene.methods import method_file
from wsim.usd import names
from wsim.usd.new.colliders import author_colliders
from wsim.usd.new.mesh import BareMesh, NewSceneOptions, find_bare_mesh, new_scene_over_mesh, warn_unlikely_size
from wsim.usd.new.pins import parse_bounds_band
from wsim.usd.new.place import author_ground, author_physics_scene, free_path_below_root, set_default_prim
from wsim.usd.new.starters import BROWN
from wsim.usd.prims.colliders import load_collider
from wsim.usd.prims.skeletons import skeleton_bindings
from wsim.usd.stage import StageReading, open_stage

TALL = 4.0                         # [m]: a head or a creature beyond is probably in other units than its file says
STRANDS, SHARE = 400, 0.5          # strands; their length over the longest edge of the bounds of the mesh
ROUNDED = 1e-6                     # of the bounds: points of a file are float32
STRAND: dict[str, Any] = {"diameters": 0.001, "young": 2e7, "density": 1300.0, "damping": 0.002, "static_friction": 0.3,
          "dynamic_friction": 0.3}           # [m], [Pa], [kg/m^3], [s]: bends as a hair of 70 um and 4 GPa does


def author_hair(mesh_file, out, prim: str | None = None, *, strands: int = STRANDS, length: float | None = None,
                where: str | None = None, **wanted) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which hair grows on a mesh of `mesh_file`. Returns warnings.

    strands         how many, spread evenly
    length          of a strand [m]; None: half of the mesh's size
    where           part of the mesh's bounds that has hair, such as "0.6..1@y"; None: all of it
    prim, wanted    ground, meters_per_unit, frames, colliders: see `wsim.usd.new.mesh.NewSceneOptions`

    Raises SceneError: no such file or mesh, a part without a triangle, points that are animated without a skeleton, a place
    that cannot be written.
    """
    asked, notes = NewSceneOptions(prim, **wanted), []
    source = open_stage(mesh_file, notes=notes)
    bare = find_bare_mesh(source, mesh_file, out, ("Mesh",), asked, "something that has hair")
    notes += warn_unlikely_size(source, bare, asked, TALL, "what has hair")
    del source
    chosen = _triangles_with_hair(where, bare)
    with new_scene_over_mesh(bare, out, f"{os.path.basename(bare.file)} with hair on {bare.path}", notes) as stage:
        bare = set_default_prim(stage, bare)
        mesh = stage.OverridePrim(bare.path)
        for schema in (names.COLLISION, names.MESH_COLLISION):
            mesh.AddAppliedSchema(schema)
        author_physics_scene(stage, Scene().substeps, Scene().iterations)
        size = length or float(f"{SHARE * (bare.bounds[1] - bare.bounds[0]).max():.2g}")
        scene = Scene(up=bare.units.up)
        hair = scene.hair(free_path_below_root(stage, "hair"), _read_collider(stage, bare), strands, size, chosen, **STRAND)
        method_file("Rods", "usd").author(stage, hair, bare.units)
        primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(hair.path))
        primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray).Set([Gf.Vec3f(*BROWN)])
        author_colliders(stage, bare, out, asked.colliders, notes)
        if asked.ground is not None:
            author_ground(stage, bare.units, bare.bounds, asked.ground, notes)
    return notes


def _triangles_with_hair(where: str | None, bare: BareMesh) -> Callable | None:
    """Which triangles have hair, by their middles in the world, as `Scene.hair` asks it."""
    if where is None:
        return None
    band = parse_bounds_band(where, bare)
    if band is None:
        raise SceneError(Problem(str(bare.path), f"--where {where} is no part of its bounds; give one as 0.6..1@y, or "
                                 "leave it out: hair on all of it"))
    axis, low, high = band
    bottom, top = bare.bounds[:, axis]
    least, most = bottom + np.array([low - ROUNDED, high + ROUNDED]) * (top - bottom)
    return lambda x: (x[:, axis] >= least) & (x[:, axis] <= most)


def _read_collider(stage: Usd.Stage, bare: BareMesh) -> Collider:
    """The mesh as it collides, with what moves it."""
    reading = StageReading(stage, bare.units, bare.frames)
    reading.skinned = skeleton_bindings([each for each in stage.Traverse() if each.IsA(UsdSkel.Root)])
    collider = load_collider(reading, stage.GetPrimAtPath(bare.path))
    if collider is None or any(problem.fatal for problem in reading.problems):
        raise SceneError([problem for problem in reading.problems if problem.fatal])
    return collider
