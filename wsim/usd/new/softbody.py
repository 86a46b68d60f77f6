"""A bare mesh -> a small scene layer in which it is a soft body. See mesh.py for what that has in common with other bodies.

    TetMesh     is simulated, with its own tets; what is wrong with them and can be repaired is repaired over it. Its surface is
                a Mesh beside it, for tools that show no TetMesh
    Mesh        is seen, and follows a cage of tets around it (`wsim.geometry.tetra.cage`): a TetMesh beside it

Both stand below one prim, the body. That is what is above the mesh where nothing else is seen below it, else a new prim that
the mesh moves to (by an internal reference; the original is deactivated).

The cage is larger than the mesh, by about half a cell on each side, and it is what collides; its tets weigh as much as the part
of them that is inside of the mesh.
"""

import os
from dataclasses import dataclass, fields, replace
from math import inf

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.geometry import topology
from wsim.geometry.tetra.cage import filled_fraction, tet_cage
from wsim.geometry.tetra.repair import FLAT, repair_tets
from wsim.geometry.tetra.tets import signed_tet_volumes, tet_surface_triangles, volumes_and_squared_edges
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Problem, SceneError
from wsim.scene.solid import Bulk
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.new.colliders import author_colliders
from wsim.usd.new.material import bind_material
from wsim.usd.new.mesh import BareMesh, NewSceneOptions, find_bare_mesh, new_scene_over_mesh, warn_unlikely_size
from wsim.usd.new.pins import author_pins
from wsim.usd.new.place import (
    author_ground,
    author_physics_scene,
    enclose_in_xform,
    free_path_below_root,
    local_to_world_matrix,
    set_default_prim,
)
from wsim.usd.prims.solid import author_bulk
from wsim.usd.prims.surface import author_surface, free_prim_path
from wsim.usd.stage import applied_schemas, open_stage

CELLS = 10                         # of a cage along the longest side: bodies bend as they should from 4 cells across
SUBSTEPS, ITERATIONS = 4, 2        # implicit steps of 1/96 s, two Newton steps each
THIN = 0.1                         # part of a cage that is body, below which its cells are coarse for what they hold


@dataclass(frozen=True)
class TetMeshData:
    """A mesh of tets in the world: points [m] (n, 3), tets (t, 4) of positive volume, and the part of each that is body."""

    points: np.ndarray
    tets: np.ndarray
    filled: np.ndarray | None = None


def author_softbody(mesh_file, out, material: Bulk | None = None, prim: str | None = None, *, cells: int = CELLS,
                    **wanted) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a TetMesh of `mesh_file`, or a closed Mesh, is a soft body. Returns
    warnings.

    material        a Bulk (taken to seven digits); None: the physics material that the mesh is bound to, else its defaults
    cells           of the cage of a Mesh, along the longest side of its bounds; a TetMesh has its own
    prim, wanted    ground, meters_per_unit, frames, pins, colliders, bound: see `wsim.usd.new.mesh.NewSceneOptions`; without
    prim
                    the TetMesh counts where there are both

    Raises SceneError: no such file or mesh, a mesh that encloses nothing or cannot be simulated, a place that cannot be
    written.
    """
    bulk, asked, notes = _round_material(material or Bulk()), NewSceneOptions(prim, **wanted), []
    source = open_stage(mesh_file, notes=notes)
    bare = find_bare_mesh(source, mesh_file, out, ("TetMesh", "Mesh"), asked, "a soft body")
    notes += warn_unlikely_size(source, bare, asked, inf, "a soft body")
    mesh, caged = source.GetPrimAtPath(bare.path), bare.kind == "Mesh"
    found = _make_cage(mesh, bare, cells, notes) if caged else _repair_tet_mesh(mesh, bare, notes)
    del source, mesh
    what = f"in a cage of {len(found.tets)} tets, as" if caged else "as"
    with new_scene_over_mesh(bare, out, f"{os.path.basename(bare.file)} with {bare.path} {what} soft body", notes) as stage:
        bare = set_default_prim(stage, bare)
        body, bare = _make_body_prim(stage, bare, apart=bool(asked.colliders))
        tets = (_author_cage if caged else _author_tets)(stage, bare, body, found)
        bind_material(stage, bare, tets, asked, material is not None,
                      lambda: author_bulk(stage, free_path_below_root(stage, "materials/soft"), bulk, bare.units))
        author_physics_scene(stage, SUBSTEPS, ITERATIONS)
        author_pins(stage, bare, tets, asked.pins, *(found.points, found.tets) if caged else ())
        author_colliders(stage, bare, out, asked.colliders, notes)
        if asked.ground is not None:
            bounds = found.points.min(axis=0), found.points.max(axis=0)
            author_ground(stage, bare.units, bounds, asked.ground, notes)
    return notes


def _round_material(material: Bulk) -> Bulk:
    """To seven digits, which a file holds."""
    numbers = {f.name: getattr(material, f.name) for f in fields(Bulk) if f.name != "model"}
    return Bulk(model=material.model, **{name: float(f"{value:.7g}") for name, value in numbers.items()})


# From a surface

def _make_cage(mesh: Usd.Prim, bare: BareMesh, cells: int, notes: list[Problem]) -> TetMeshData:
    """The cage of a Mesh. Raises SceneError where none can be made, or where the mesh encloses nothing."""
    path, time = str(bare.path), Usd.TimeCode(bare.units.start)
    counts, indices = (read_attribute(mesh, "Cloth", field, bare.units, time) for field in ("counts", "indices"))
    if counts is None or indices is None:
        raise SceneError(Problem(path, "has no faces (is a payload or reference missing?)"))
    try:
        triangles, _ = triangulate_polygons(bare.world, counts, indices)
        points, tets = tet_cage(bare.world, triangles, cells)
        part = filled_fraction(bare.world, triangles, points, tets)
    except ValueError as error:
        raise SceneError(Problem(path, f"no cage of tets can be made around it: {error}")) from None
    volume = signed_tet_volumes(points, tets)
    share = float(part @ volume / volume.sum())
    if share == 0.0:
        raise SceneError(Problem(path, "encloses nothing; a soft body needs a closed surface. Close its holes, or make it "
                                       "cloth (wsim new cloth)"))
    loose = _open_edges(bare.world, triangles)
    if loose:
        notes.append(Problem(path, f"is open at {loose} edges: what is inside is guessed there; close its holes to be sure",
                             fatal=False))
    if share < THIN:
        notes.append(Problem(path, f"fills {share:.1%} of its cage: cells are coarse for so thin a body; give more than "
                             f"{cells} (--cells)", fatal=False))
    return TetMeshData(points, tets, part)


def _open_edges(points: np.ndarray, triangles: np.ndarray) -> int:
    """How many edges belong to an odd number of triangles; points at equal places count as one."""
    corners = topology.distinct_rows(points)[1][triangles]
    ends = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    uses = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0, return_counts=True)[1]
    return int((uses % 2).sum())


def _author_cage(stage: Usd.Stage, bare: BareMesh, body: Usd.Prim, found: TetMeshData) -> Usd.Prim:
    """The cage beside the mesh in the body; returns the prim of the cage."""
    _remove_mesh_collision(stage.GetPrimAtPath(bare.path))
    above = local_to_world_matrix(body, bare.units)
    local = (found.points / bare.units.metres - above[3, :3]) @ np.linalg.inv(above[:3, :3])
    centre = np.round(local.mean(axis=0))                        # float32 points lose nothing far from the origin
    mesh = UsdGeom.TetMesh.Define(stage, free_prim_path(stage, f"{body.GetPath()}/tets"))
    mesh.AddTranslateOp().Set(tuple(centre))
    mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim = mesh.GetPrim()
    author_attribute(prim, "Soft", "points", local - centre)
    author_attribute(prim, "Soft", "filled", found.filled)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    _author_topology(prim, found.tets, bool(np.linalg.det(above[:3, :3]) < 0))
    return _apply_soft_schemas(prim)


def _make_body_prim(stage: Usd.Stage, bare: BareMesh, apart: bool) -> tuple[Usd.Prim, BareMesh]:
    """The prim that becomes the deformable body around a mesh, which may have to move there, and where the mesh is then. A body
    takes in every mesh below it; apart: it is none that others are put below."""
    mesh = stage.GetPrimAtPath(bare.path)
    body = mesh.GetParent()
    others = [p for p in Usd.PrimRange(body) if p.IsA(UsdGeom.Boundable) and p != mesh]
    alone = body.IsA(UsdGeom.Imageable) and not body.IsA(UsdGeom.Gprim) and not others
    if not alone or apart and body == stage.GetDefaultPrim():
        bare = replace(bare, path=enclose_in_xform(stage, mesh).GetPath())
        body = stage.GetPrimAtPath(bare.path).GetParent()
    body.AddAppliedSchema(names.BODY)
    return body, bare


def _remove_mesh_collision(mesh: Usd.Prim) -> None:
    """A skin does not collide: its cage does."""
    if names.COLLISION in applied_schemas(mesh):
        mesh.CreateAttribute("physics:collisionEnabled", Sdf.ValueTypeNames.Bool, False).Set(False)


# From tets

def _oriented_tets(mesh: Usd.Prim, bare: BareMesh) -> tuple[np.ndarray, bool]:
    """The tets of a TetMesh, (t, 4), wound as they should be in the world by its orientation; and whether its frame mirrors."""
    time = Usd.TimeCode(bare.units.start)
    rows = read_attribute(mesh, "Soft", "tets", bare.units, time)
    if rows is None:
        raise SceneError(Problem(str(bare.path), "has no tetVertexIndices (is a payload or reference missing?)"))
    mirrored = bool(np.linalg.det(np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(mesh))[:3, :3]) < 0)
    left = read_attribute(mesh, "Soft", "orientation") == UsdGeom.Tokens.leftHanded
    return rows[:, [0, 1, 3, 2]] if left != mirrored else rows, mirrored


def _repair_tet_mesh(mesh: Usd.Prim, bare: BareMesh, notes: list[Problem]) -> TetMeshData:
    """The tets of a TetMesh, mended where they can be: turned, or left out where they are flat or a copy.

    Raises SceneError for what cannot be mended."""
    path, rows = str(bare.path), _oriented_tets(mesh, bare)[0]
    tets, turned, flaws = repair_tets(bare.world, rows)
    if any(flaw.fatal for flaw in flaws):
        tets = _drop_degenerate_tets(bare.world, tets)
        lost = len(rows) - len(tets)
        flaws = repair_tets(bare.world, tets)[2] if lost and not _has_subsets(mesh) else flaws
        if any(flaw.fatal for flaw in flaws):
            raise SceneError([Problem(path, flaw.text) for flaw in flaws if flaw.fatal])
        notes.append(Problem(path, f"{lost} of its {len(rows)} tets are flat or given twice; they are left out", fatal=False))
    if len(turned):
        notes.append(Problem(path, f"{len(turned)} of its {len(rows)} tets are wound against its orientation (first: tet "
                             f"{turned[0]}); they are turned", fatal=False))
    return TetMeshData(bare.world, tets)


def _has_subsets(mesh: Usd.Prim) -> bool:
    """Whether parts of a mesh are named by the numbers of its elements, which therefore may not change."""
    return any(child.IsA(UsdGeom.Subset) for child in mesh.GetChildren())


def _drop_degenerate_tets(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Tets that have a volume, each once; all of them where indices or points are at fault, which nothing mends."""
    if tets.size == 0 or tets.min() < 0 or tets.max() >= len(points) or not np.isfinite(points[tets]).all():
        return tets
    volume, squares = volumes_and_squared_edges(points, tets)
    tets = tets[volume > FLAT * squares.max(axis=0) ** 1.5]
    return tets[np.sort(np.unique(np.sort(tets, axis=1), axis=0, return_index=True)[1])]


def _author_tets(stage: Usd.Stage, bare: BareMesh, body: Usd.Prim, found: TetMeshData) -> Usd.Prim:
    """What makes the TetMesh the simulated one of its body: its tets only where they were mended, and its surface as a Mesh."""
    prim = stage.OverridePrim(bare.path)
    rows, mirrored = _oriented_tets(prim, bare)
    if not np.array_equal(rows, found.tets):
        _author_topology(prim, found.tets, mirrored)
    author_surface(stage, UsdGeom.TetMesh(prim), found.tets, free_prim_path(stage, f"{body.GetPath()}/surface"),
                   bare.units.start)
    return _apply_soft_schemas(prim)


# Both

def _author_topology(prim: Usd.Prim, tets: np.ndarray, mirrored: bool) -> None:
    """Tets of positive volume in the world, and their surface; mirrored: the prim's frame is."""
    author_attribute(prim, "Soft", "orientation", UsdGeom.Tokens.leftHanded if mirrored else UsdGeom.Tokens.rightHanded)
    author_attribute(prim, "Soft", "tets", tets)
    author_attribute(prim, "Soft", "surface", tet_surface_triangles(tets))


def _apply_soft_schemas(prim: Usd.Prim) -> Usd.Prim:
    for schema in (names.VOLUME_SIM, names.COLLISION, names.WSIM_SOFT):
        prim.AddAppliedSchema(schema)
    return prim
