"""One prim of a stage as triangles in world space [m] over time: points, colours, shared normals. Reads by pxr."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from wsim.geometry import primitives
from wsim.geometry.tetra.tets import checked_tet_arrays, signed_tet_volumes, tet_surface_triangles
from wsim.geometry.triangulate import index_fault, triangulate_polygons
from wsim.scene import Problem, SceneError
from wsim.scene.methods import claiming_method
from wsim.scene.solids import claiming_shape_row
from wsim.show.image.texture import corner_colors
from wsim.show.shading import CREASE, MeshLook, palette_colour, smoothing_groups
from wsim.usd.stage import applied_schemas

SIDES = 64                    # of round shapes


@dataclass
class DrawnPrim:
    """A prim with triangles. `points(time code)` gives world positions [m], (n, 3) float64, as many at every time."""

    look: MeshLook
    kind: str                                             # "cloth", "springs", "soft", "collider" or "plain"
    points: Callable[[float], np.ndarray]
    moves: bool = True                                    # False: the same points at all times
    colors: Callable[[float], np.ndarray] | None = None   # of `look` at a time code, where they change: as many as there
    balls: Callable[[float], "Balls"] | None = None       # of particles, as many at each time as `points` gives: no triangles


@dataclass(frozen=True)
class Balls:
    """Particles: world centres [m] (n, 3), radii [m] (n,), linear colours (n, 3)."""

    centers: np.ndarray
    radii: np.ndarray
    colors: np.ndarray

    def corners(self) -> np.ndarray:
        """Low and high corners of boxes about them (2 n, 3) [m]."""
        return np.concatenate([self.centers - self.radii[:, None], self.centers + self.radii[:, None]])


def prim_to_world_matrix(prim: Usd.Prim, time: float) -> np.ndarray:
    """Local to world for columns, (4, 4), stage units."""
    return np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time)).T


def triangulate_prim(prim: Usd.Prim, kind: str, number: int, time: float, meters: float) -> DrawnPrim | None:
    """The prim as triangles, or as balls; None if it has none (an empty mesh)."""
    if prim.IsA(UsdGeom.Points) and not drawn_by(prim):
        return _particles_of_points(prim, kind, number, meters)
    corners: np.ndarray | None = None
    polygon: np.ndarray | None = None
    if prim.IsA(UsdGeom.Mesh):
        triangles, corners, polygon = _mesh_triangles(prim, time)
    else:
        triangles = _outward_tet_surface(prim, time) if prim.IsA(UsdGeom.TetMesh) else _outline_of_shape(prim, time)[1]
    if len(triangles) == 0:
        return None
    path, start = str(prim.GetPath()), prim_to_world_matrix(prim, time)
    left = prim.IsA(UsdGeom.Gprim) and str(UsdGeom.Gprim(prim).GetOrientationAttr().Get()) == "leftHanded"
    flipped = left and corners is not None
    if flipped != (np.linalg.det(start[:3, :3]) < 0):
        triangles = triangles[:, ::-1]
        corners = None if corners is None else corners[:, ::-1]

    def world_points_at(t: float) -> np.ndarray:
        local = _points_in_prim_frame(prim, t)
        if local.shape != first.shape or not np.isfinite(local).all():
            bad = np.flatnonzero(~np.isfinite(local).all(axis=1))
            found = f"point {bad[0]} is not finite" if len(bad) else f"{len(local)} points, {len(first)} at the start"
            raise SceneError(Problem(path, f"at time code {t:g}: {found}; draw earlier frames (frames=...), or "
                                           "simulate again with more substeps"))
        M = prim_to_world_matrix(prim, t)
        return meters * (local @ M[:3, :3].T + M[:3, 3])

    first = _points_in_prim_frame(prim, time)
    round_ = _is_round(prim, kind)
    groups = smoothing_groups(world_points_at(time), triangles, np.pi if round_ else CREASE)
    colors, color_of = _authored_display_colours(prim, time, triangles, corners, polygon)
    if colors is None:
        colors = np.array([palette_colour(kind, number)])
    if color_of is None:
        color_of = np.zeros_like(triangles)
    drawn = DrawnPrim(MeshLook(triangles, colors, color_of, groups, path), kind, world_points_at, shape_is_animated(prim))
    colour = UsdGeom.PrimvarsAPI(prim).GetPrimvar("displayColor")
    if colour and colour.ValueMightBeTimeVarying():
        count = len(colors)

        def display_colours_at(t: float) -> np.ndarray:
            found = _authored_display_colours(prim, t, triangles, corners, polygon)[0]
            return found if found is not None and len(found) == count else colors
        drawn.colors = display_colours_at
    return drawn


def _particles_of_points(prim: Usd.Prim, kind: str, number: int, meters: float) -> DrawnPrim | None:
    """Points as balls of their widths; None where there are none at any time."""
    attribute, path = UsdGeom.Points(prim).GetPointsAttr(), str(prim.GetPath())
    if not any(len(attribute.Get(code) or ()) for code in (attribute.GetTimeSamples() or [Usd.TimeCode.Default()])):
        return None
    plain = np.array([palette_colour(kind, number)])

    def centers_at(t: float) -> np.ndarray:
        local, M = _authored_points(prim, t), prim_to_world_matrix(prim, t)
        bad = np.flatnonzero(~np.isfinite(local).all(axis=1))
        if len(bad):
            raise SceneError(Problem(path, f"at time code {t:g}: point {bad[0]} is not finite; draw earlier frames "
                                           "(frames=...), or simulate again with more substeps"))
        return meters * (local @ M[:3, :3].T + M[:3, 3])

    def balls_at(t: float) -> Balls:
        centers = centers_at(t)
        scale = meters * np.cbrt(abs(np.linalg.det(prim_to_world_matrix(prim, t)[:3, :3])))
        widths = _point_widths(prim, t, centers / scale)
        return Balls(centers, 0.5 * scale * widths, _point_colours(prim, t, len(centers), plain))
    return DrawnPrim(MeshLook(np.zeros((0, 3)), plain, path=path), kind, centers_at, shape_is_animated(prim), balls=balls_at)


def _point_colours(prim: Usd.Prim, time: float, count: int, plain: np.ndarray) -> np.ndarray:
    """Linear colour of each of `count` particles: displayColor of each or of all, else of the material, else the plain one."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    found = primvar.ComputeFlattened(time) if primvar and primvar.HasValue() else None
    values = np.asarray(found or [], float).reshape(-1, 3)
    if len(values) == 0:
        color = _diffuse_material_colour(prim)
        values = plain if color is None else color[None]
    return values if len(values) == count else np.broadcast_to(values.mean(axis=0), (count, 3))


def drawn_by(prim: Usd.Prim):
    """The `show` of the method that reads such prims (`wsim.scene.methods`), or None."""
    row = claiming_method((*applied_schemas(prim), str(prim.GetTypeName())))
    return row.role("show") if row else None


def shape_is_animated(prim: Usd.Prim) -> bool:
    """True if a prim's shape, or its transform or one above it, has samples over time."""
    shape = ("points", "radius", "height", "size", "width", "length")
    if any(prim.GetAttribute(name).ValueMightBeTimeVarying() for name in shape if prim.HasAttribute(name)):
        return True
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).TransformMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False


def _is_round(prim: Usd.Prim, kind: str) -> bool:
    """Whether a prim is shaded without creases: tubes, and cloth that moves."""
    if prim.IsA(UsdGeom.Curves):
        return True
    return kind == "cloth" and prim.IsA(UsdGeom.Mesh) and UsdGeom.Mesh(prim).GetPointsAttr().ValueMightBeTimeVarying()


def _mesh_triangles(prim: Usd.Prim, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (t, 3), the corner of the file that each of their corners is, (t, 3), and the polygon of each, (t,)."""
    mesh = UsdGeom.Mesh(prim)
    points = _points_in_prim_frame(prim, time)
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get(time) or [], np.int64)
    indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(time) or [], np.int64)
    fault = index_fault(len(points), counts, indices)
    if fault:
        raise SceneError(Problem(str(prim.GetPath()), fault))
    triangles, polygon = triangulate_polygons(points, counts, indices)
    keys = np.repeat(np.arange(len(counts)), counts) * len(points) + indices
    order = np.argsort(keys, kind="stable")
    wanted = (np.asarray(polygon, np.int64)[:, None] * len(points) + triangles).reshape(-1, 3)
    corners = order[np.searchsorted(keys[order], wanted)] if len(triangles) else triangles
    return triangles, corners, polygon


def _outward_tet_surface(prim: Usd.Prim, time: float) -> np.ndarray:
    """Surface triangles (t, 3) of a TetMesh, counter-clockwise from outside.

    The sign of each tet's volume decides, which is what `orientation` should say: by the default points, where no tet is
    turned inside out by a simulation, as far as there are any."""
    points, rest = _authored_points(prim, time), _authored_points(prim, Usd.TimeCode.Default())
    rows = np.asarray(UsdGeom.TetMesh(prim).GetTetVertexIndicesAttr().Get(time) or [], np.int64).reshape(-1, 4)
    try:
        points, rows = checked_tet_arrays(rest if len(rest) == len(points) else points, rows)
    except ValueError as error:
        raise SceneError(Problem(str(prim.GetPath()), f"its tetVertexIndices are wrong: {error}")) from None
    turned = signed_tet_volumes(points, rows) < 0
    return tet_surface_triangles(np.where(turned[:, None], rows[:, [0, 1, 3, 2]], rows))


def _points_in_prim_frame(prim: Usd.Prim, time: float) -> np.ndarray:
    """Points of the drawn triangles in the prim's own frame, (n, 3) float64, stage units."""
    if prim.IsA(UsdGeom.Mesh) or prim.IsA(UsdGeom.TetMesh):
        return _authored_points(prim, time)
    return _outline_of_shape(prim, time)[0]


def _authored_points(prim: Usd.Prim, time: float | Usd.TimeCode) -> np.ndarray:
    return np.asarray(UsdGeom.PointBased(prim).GetPointsAttr().Get(time) or np.zeros((0, 3)), np.float64).reshape(-1, 3)


def _number_attribute(prim: Usd.Prim, name: str, time: float) -> float:
    return float(prim.GetAttribute(name).Get(time))


def _outline_of_shape(prim: Usd.Prim, time: float) -> primitives.Outline:
    """Points and triangles of anything that is not a mesh."""
    if role := drawn_by(prim):
        return role.triangles(prim)
    name, number = str(prim.GetTypeName()), lambda field: _number_attribute(prim, field, time)
    if name == "BasisCurves":
        return _tubes_along_curves(prim, time)
    axis = str(prim.GetAttribute("axis").Get() or "Z")
    if name == "Plane":
        sides = 0.5 * number("width"), 0.5 * number("length")
        points, triangles = primitives.plate_outline(*(sides if axis == "Z" else sides[::-1]))
        return primitives.turn_to_axis(axis, points), triangles
    if found := claiming_shape_row((*applied_schemas(prim), name)):
        solid, key = found
        points, triangles = solid.outline(solid.read(*map(number, solid.usd[key])), SIDES)
        return primitives.turn_to_axis(axis, points), triangles
    return np.zeros((0, 3)), np.zeros((0, 3), np.int32)


def _point_widths(prim: Usd.Prim, time: float, points: np.ndarray) -> np.ndarray:
    """Width of each point, stage units: authored, else the deformable thickness, else a share of the size."""
    for name in ("primvars:widths", "widths", "physics:thicknesses"):
        attribute = prim.GetAttribute(name)
        widths = np.asarray(attribute.Get(time) or [], float) if attribute else np.zeros(0)
        if len(widths) in (1, len(points)):
            return np.broadcast_to(widths, (len(points),))
    size = np.linalg.norm(np.ptp(points, axis=0)) if len(points) else 0.0
    return np.full(len(points), 0.006 * size)


def _tubes_along_curves(prim: Usd.Prim, time: float) -> primitives.Outline:
    """Tubes along the control polygons, a bead at each point."""
    points = _authored_points(prim, time)
    counts = np.asarray(UsdGeom.BasisCurves(prim).GetCurveVertexCountsAttr().Get(time) or [], np.int64)
    if counts.sum() > len(points) or (counts < 0).any():
        raise SceneError(Problem(str(prim.GetPath()), f"curveVertexCounts sum to {counts.sum()}, points are "
                                                      f"{len(points)}; they must agree"))
    ends = np.cumsum(counts)
    first = np.setdiff1d(np.arange(counts.sum()), ends - 1)                 # every point but the last of a curve
    segments = np.stack([first, first + 1], axis=1)
    if str(UsdGeom.BasisCurves(prim).GetWrapAttr().Get()) == "periodic":
        segments = np.concatenate([segments, np.stack([ends - 1, ends - counts], axis=1)[counts > 1]])
    radii = 0.5 * _point_widths(prim, time, points)
    tube, faces = primitives.rod_outlines(points, segments, radii)
    ball, more = primitives.bead_outlines(points, radii)
    return np.concatenate([tube, ball]), np.concatenate([faces, more + len(tube)]).astype(np.int32)


def _authored_display_colours(prim, time, triangles, corners, polygon) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Linear colours (k, 3) and the colour of each corner (t, 3) or None for one colour; (None, None): not authored."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    values = primvar.ComputeFlattened(time) if primvar and primvar.HasValue() else None
    measured = primvar and primvar.ValueMightBeTimeVarying()                      # strain, say, which a run has written
    textured = None if measured else corner_colors(prim, time, triangles, corners)
    if textured is not None:
        return textured.reshape(-1, 3), np.arange(textured.size // 3, dtype=np.int32).reshape(-1, 3)
    if values is None or len(values) == 0:
        color = _diffuse_material_colour(prim)
        return (None, None) if color is None else (color[None], None)
    values = np.asarray(values, np.float64).reshape(-1, 3)
    by = {"uniform": None if polygon is None else np.repeat(polygon[:, None], 3, axis=1), "faceVarying": corners}.get(
        str(primvar.GetInterpolation()), triangles if corners is not None or prim.IsA(UsdGeom.TetMesh) else None)
    if len(values) == 1 or by is None or int(by.max()) >= len(values) or str(primvar.GetInterpolation()) == "constant":
        return values.mean(axis=0, keepdims=True), None
    return values, np.asarray(by, np.int32)


def _diffuse_material_colour(prim: Usd.Prim) -> np.ndarray | None:
    """Diffuse colour of the bound preview material, if it is a plain value."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    channel = shader.GetInput("diffuseColor") if shader else None
    value = channel.Get() if channel and not channel.HasConnectedSource() else None
    return None if value is None else np.asarray(value, np.float64)
