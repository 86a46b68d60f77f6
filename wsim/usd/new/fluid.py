"""A bare closed mesh, shape or cloud of points -> a small scene layer in which it smokes, or is full of liquid.

Smoke: a source that keeps hot smoke inside, in a domain around it with room for the smoke to rise. Liquid: what is full at the
start, in a tank with room to fall and to spread. See mesh.py for what both have in common with cloth and soft bodies.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from pxr import Gf, Usd, UsdGeom

from wsim.geometry.topology import half_edges
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Problem, Scene, SceneError
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.new.colliders import author_colliders
from wsim.usd.new.mesh import BareMesh, NewSceneOptions, find_bare_mesh, new_scene_over_mesh, warn_unlikely_size, world_points
from wsim.usd.new.place import author_ground, author_physics_scene, free_path_below_root, set_default_prim, set_world_transform
from wsim.usd.stage import open_stage

CELLS = 64                         # along the longest edge of the domain
SMOKE, HEAT = 1.0, 100.0           # that are kept inside: dense, and [K] over the air around
WATER = (0.1, 0.32, 0.6)           # colour of its particles
SHAPES = ("Mesh", "Sphere", "Cube", "Capsule", "Cylinder", "Cone", "Points")       # what may smoke or be full of water
MOST = 2000                        # frames whose places are looked at
TALL = 20.0                        # [m]: a mesh beyond is probably in other units than its file says


@dataclass(frozen=True)
class DomainMargins:
    """The domain of a fluid that a mesh begins: its name, schema, and room around the mesh, in parts of its largest extent."""

    name: str
    schema: str
    kind: str                      # its class in the table of attributes
    beside: float
    above: float
    below: float                   # where there is no ground


AIR = DomainMargins("air", names.WSIM_DOMAIN, "Fluid", 0.75, 3.0, 0.25)
TANK = DomainMargins("tank", names.WSIM_LIQUID, "Liquid", 1.0, 0.5, 0.5)


def author_fluid(mesh_file, out, prim: str | None = None, *, cells: int = CELLS, **wanted) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a closed Mesh, a shape or Points of `mesh_file` smokes. Returns
    warnings.

    cells           along the longest edge of the domain
    prim, wanted    ground, meters_per_unit, frames, colliders: see `wsim.usd.new.mesh.NewSceneOptions`

    Raises SceneError: no such file or mesh, a mesh that is open, pins or a material, which smoke has not, a place that cannot
    be written.
    """
    asked, notes = NewSceneOptions(prim, **wanted), []
    with _new_fluid_stage(mesh_file, out, asked, cells, ("smoke", "what smokes", "smoking"), notes) as (stage, bare):
        mesh = stage.OverridePrim(bare.path)
        mesh.AddAppliedSchema(names.WSIM_SOURCE)
        for name, value in (("smoke", SMOKE), ("temperature", HEAT), ("hold", True)):
            author_attribute(mesh, "Source", name, value, bare.units)
        cube = _author_fluid_cube(stage, bare, AIR, cells, asked.ground)
        if asked.ground is not None:
            up = 2 if bare.units.up == "Z" else 1
            author_attribute(cube, "Fluid", "sides", ["closed" if k == 2 * up else "open" for k in range(6)], bare.units)
    return notes


def author_liquid(mesh_file, out, prim: str | None = None, *, cells: int = CELLS, **wanted) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a closed Mesh, a shape or Points of `mesh_file` is full of water
    at the start. Returns warnings.

    cells           along the longest edge of the tank
    prim, wanted    ground, meters_per_unit, frames, colliders: see `wsim.usd.new.mesh.NewSceneOptions`

    Raises SceneError: no such file or mesh, a mesh that is open, pins or a material, which water has not, a place that cannot
    be written.
    """
    asked, notes = NewSceneOptions(prim, **wanted), []
    with _new_fluid_stage(mesh_file, out, asked, cells, ("liquid", "what is full of water", "full of water"), notes) as (stage,
                                                                                                                         bare):
        mesh = stage.OverridePrim(bare.path)
        mesh.AddAppliedSchema(names.WSIM_POUR)
        UsdGeom.Imageable(mesh).CreatePurposeAttr(UsdGeom.Tokens.guide)         # the water is seen, not the shape it had
        cube = _author_fluid_cube(stage, bare, TANK, cells, asked.ground)
        UsdGeom.Points.Define(stage, f"{cube.GetPath()}_drops").CreateDisplayColorAttr([WATER])      # those of the result
    return notes


def swept_over(source: Usd.Stage, bare: BareMesh) -> BareMesh:
    """With the points of all its frames: a source that moves stays in its domain."""
    prim, codes = source.GetPrimAtPath(bare.path), bare.units.start + np.arange(1, min(bare.frames, MOST) + 1)
    moved = [world_points(prim, bare.units, float(code)) for code in codes]
    if all(np.array_equal(points, bare.world) for points in moved):
        return bare
    return replace(bare, world=np.concatenate([bare.world, *moved]))


@contextmanager
def _new_fluid_stage(mesh_file, out, asked: NewSceneOptions, cells: int, words: tuple[str, str, str],
                     notes: list[Problem]) -> Iterator[tuple[Usd.Stage, BareMesh]]:
    """The new stage and its closed mesh; settings, colliders and a ground come last. words: the fluid, the mesh, how it is."""
    fluid, what, how = words
    for option, given in (("pins", asked.pins), ("material", asked.bound)):
        if given:
            raise SceneError(Problem(option, f"{fluid} has none; leave it out"))
    if cells < 8:
        raise SceneError(Problem("cells", f"{cells} along the longest edge; allowed are 8 and more"))
    source = open_stage(mesh_file, notes=notes)
    bare = find_bare_mesh(source, mesh_file, out, SHAPES, asked, fluid)
    notes += warn_unlikely_size(source, bare, asked, TALL, what)
    if bare.kind == "Mesh":
        _refuse_open_mesh(source, bare, fluid)
    if fluid == "smoke":
        bare = swept_over(source, bare)
    del source
    with new_scene_over_mesh(bare, out, f"{os.path.basename(bare.file)} with {bare.path} {how}", notes) as stage:
        bare = set_default_prim(stage, bare)
        yield stage, bare
        author_physics_scene(stage, Scene().substeps, Scene().iterations)
        author_colliders(stage, bare, out, asked.colliders, notes)
        if asked.ground is not None:
            author_ground(stage, bare.units, bare.bounds, asked.ground, notes)


def _refuse_open_mesh(stage: Usd.Stage, bare: BareMesh, fluid: str) -> None:
    """Raises SceneError for a mesh with edges that are not of two faces: it has no inside."""
    prim = stage.GetPrimAtPath(bare.path)
    counts, indices = (read_attribute(prim, "Cloth", name, bare.units) for name in ("counts", "indices"))
    if counts is None or indices is None:
        raise SceneError(Problem(str(bare.path), f"has no faces; {fluid} is inside a closed mesh"))
    key = half_edges(triangulate_polygons(bare.world, counts, indices)[0])[-1]
    loose = int(np.count_nonzero(np.unique(key, return_counts=True)[1] != 2))
    if loose:
        raise SceneError(Problem(str(bare.path), f"is open at {loose} edges, and {fluid} is inside a closed mesh: close its "
                                 "holes, and sew points at one place together"))


def _author_fluid_cube(stage: Usd.Stage, bare: BareMesh, room: DomainMargins, cells: int, ground: float | None) -> Usd.Prim:
    """A Cube of whole cells; on the ground, where there is one."""
    (low, high), up = bare.bounds, 2 if bare.units.up == "Z" else 1
    size = float((high - low).max())
    low, high = low - room.beside * size, high + room.beside * size
    low[up] = bare.bounds[0, up] - room.below * size if ground is None else min(ground, bare.bounds[1, up])
    high[up] = bare.bounds[1, up] + room.above * size
    cell = float(f"{(high - low).max() / cells:.3g}")
    edges = cell * np.maximum(np.ceil((high - low) / cell - 1e-6), 4.0)
    middle = 0.5 * (low + high)
    middle[up] = low[up] + 0.5 * edges[up]
    cube, place = UsdGeom.Cube.Define(stage, free_path_below_root(stage, room.name)), np.eye(4)
    cube.CreatePurposeAttr(UsdGeom.Tokens.guide)
    cube.CreateExtentAttr([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
    place[3, :3] = middle / bare.units.metres
    set_world_transform(cube, place, bare.units)
    cube.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*(0.5 * edges / bare.units.metres).tolist()))
    cube.GetPrim().AddAppliedSchema(room.schema)
    author_attribute(cube.GetPrim(), room.kind, "cell", cell, bare.units)
    return cube.GetPrim()
