"""A bare closed mesh -> a small scene layer in which it smokes: a source that keeps hot smoke inside, in a domain around it
with room for the smoke to rise. See mesh.py for what that has in common with cloth and soft bodies.
"""

import os

import numpy as np
from pxr import Gf, Usd, UsdGeom

from wsim.geometry.topology import half_edges
from wsim.geometry.triangulate import triangulate
from wsim.scene import Problem, Scene, SceneError
from wsim.usd import names
from wsim.usd.attributes import author, read
from wsim.usd.new.colliders import author_colliders
from wsim.usd.new.mesh import Bare, Wanted, bare_mesh, scene_over, size_notes
from wsim.usd.new.place import author_ground, author_settings, put, settle, under
from wsim.usd.stage import open_stage

CELLS = 64                         # along the longest edge of the domain
SMOKE, HEAT = 1.0, 100.0           # that are kept inside: dense, and [K] over the air around
BESIDE, ABOVE, BELOW = 0.75, 3.0, 0.25      # room around the mesh, in parts of its largest extent
TALL = 20.0                        # [m]: a mesh beyond is probably in other units than its file says


def author_fluid(mesh_file, out, prim: str | None = None, *, cells: int = CELLS, **wanted) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a closed Mesh of `mesh_file` smokes. Returns warnings.

    cells           along the longest edge of the domain
    prim, wanted    ground, meters_per_unit, frames, colliders: see `wsim.usd.new.mesh.Wanted`

    Raises SceneError: no such file or mesh, a mesh that is open, pins or a material, which smoke has not, a place that cannot
    be written.
    """
    asked, notes = Wanted(prim, **wanted), []
    for option, given in (("pins", asked.pins), ("material", asked.bound)):
        if given:
            raise SceneError(Problem(option, "smoke has none; leave it out"))
    if cells < 8:
        raise SceneError(Problem("cells", f"{cells} along the longest edge; allowed are 8 and more"))
    source = open_stage(mesh_file, notes=notes)
    bare = bare_mesh(source, mesh_file, out, ("Mesh",), asked, "smoke")
    notes += size_notes(source, bare, asked, TALL, "what smokes")
    _closed(source, bare)
    del source
    with scene_over(bare, out, f"{os.path.basename(bare.file)} with {bare.path} smoking", notes) as stage:
        bare = settle(stage, bare)
        mesh = stage.OverridePrim(bare.path)
        mesh.AddAppliedSchema(names.WSIM_SOURCE)
        for name, value in (("smoke", SMOKE), ("temperature", HEAT), ("hold", True)):
            author(mesh, "Source", name, value, bare.units)
        _author_domain(stage, bare, cells, asked.ground)
        author_settings(stage, Scene().substeps, Scene().iterations)
        author_colliders(stage, bare, out, asked.colliders, notes)
        if asked.ground is not None:
            author_ground(stage, bare.units, bare.bounds, asked.ground)
    return notes


def _closed(stage: Usd.Stage, bare: Bare) -> None:
    """Raises SceneError for a mesh with edges that are not of two faces: it has no inside."""
    prim = stage.GetPrimAtPath(bare.path)
    counts, indices = (read(prim, "Cloth", name, bare.units) for name in ("counts", "indices"))
    if counts is None or indices is None:
        raise SceneError(Problem(str(bare.path), "has no faces; smoke comes from the inside of a closed mesh"))
    key = half_edges(triangulate(bare.world, counts, indices)[0])[-1]
    loose = int(np.count_nonzero(np.unique(key, return_counts=True)[1] != 2))
    if loose:
        raise SceneError(Problem(str(bare.path), f"is open at {loose} edges, and smoke comes from the inside of a closed mesh: "
                                 "close its holes, and sew points at one place together"))


def _author_domain(stage: Usd.Stage, bare: Bare, cells: int, ground: float | None) -> None:
    """A Cube of whole cells; on the ground, where there is one, which is then a wall."""
    (low, high), up = bare.bounds, 2 if bare.units.up == "Z" else 1
    room = float((high - low).max())
    low, high = low - BESIDE * room, high + BESIDE * room
    low[up] += (BESIDE - BELOW) * room
    high[up] += (ABOVE - BESIDE) * room
    if ground is not None:
        low[up] = bare.bounds[0, up] - ground
    cell = float(f"{(high - low).max() / cells:.3g}")
    size = cell * np.maximum(np.ceil((high - low) / cell - 1e-6), 4.0)
    middle = 0.5 * (low + high)
    middle[up] = low[up] + 0.5 * size[up]
    cube, place = UsdGeom.Cube.Define(stage, under(stage, "air")), np.eye(4)
    cube.CreatePurposeAttr(UsdGeom.Tokens.guide)
    cube.CreateExtentAttr([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
    place[3, :3] = middle / bare.units.metres
    put(cube, place, bare.units)
    cube.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*(0.5 * size / bare.units.metres).tolist()))
    cube.GetPrim().AddAppliedSchema(names.WSIM_DOMAIN)
    author(cube.GetPrim(), "Fluid", "cell", cell, bare.units)
    if ground is not None:
        author(cube.GetPrim(), "Fluid", "sides", ["closed" if k == 2 * up else "open" for k in range(6)], bare.units)
