"""Prims with PhysicsCollisionAPI <-> `Collider`.

A collider's motion is rigid: M(t) = R(t) S, and S goes into the sizes. A shape becomes a mesh if it cannot take S (a sphere
scaled along one axis, shear), or if S changes in time. Shapes lie along their own z; the prim's axis X or Y is turned there.
"""

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.scene import Collider, Shape, Surface
from wsim.scene.curve import Curve, Motion
from wsim.scene.solids import APPROXIMATIONS, SAME, ShapeRow, claiming_shape_row, shape_row
from wsim.usd import attributes, names
from wsim.usd.load_varying import check_topology, note_varying_values, value_attributes_of_prim
from wsim.usd.prims.fabric import author_friction, author_softness, bind_physics_material, bound_physics_material, load_contact
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import Placement, author_motion, read_placement, split_rotation_scale

TURN = {"X": [1, 2, 0], "Y": [2, 0, 1], "Z": [0, 1, 2]}      # columns of the prim's frame as own x, y, z
APPROXIMATION = "physics:approximation"                        # of meshes, for rigid bodies
AROUND = 32                                                    # points on a circle of a shape that becomes a mesh


@dataclass
class AuthoredShape:
    """A primitive as its prim says it: its row, the parameters of that [m]."""

    solid: ShapeRow
    parameters: tuple[float, ...]

    @property
    def endless(self) -> bool:
        return not self.parameters                              # a plane, which any scale leaves as it is


def load_collider(reading: StageReading, prim: Usd.Prim) -> Collider | None:
    """The collider of a prim; None if its kind cannot collide yet or it is broken (both are reported)."""
    path, kind = str(prim.GetPath()), prim.GetTypeName()
    if not has_shape(prim):
        reading.warn(path, f"is a {kind or 'prim without a type'} with {names.COLLISION}; such a collider is left out "
                     "(read are Plane, Sphere, Cube, Capsule, Cylinder, Cone, Mesh and TetMesh)")
        return None
    found = load_shape(reading, prim)
    if found is None:
        return None
    watched = [prim.GetAttribute(names.attribute_entry("Collider", "thickness").attribute),
               *value_attributes_of_prim(bound_physics_material(reading, prim))]
    note_varying_values(reading, path, Collider, watched, lambda at: load_contact(at, prim))
    return Collider(path, *found, approximation=_read_approximation(reading, prim, found[0]), **load_contact(reading, prim))


def has_shape(prim: Usd.Prim) -> bool:
    kind = str(prim.GetTypeName())
    return kind in ("Mesh", "TetMesh") or claiming_shape_row((*applied_schemas(prim), kind)) is not None


def load_shape(reading: StageReading, prim: Usd.Prim) -> tuple[Shape, Motion] | None:
    """Shape and motion of a prim that has one; None if it is broken (reported)."""
    path, sizes = str(prim.GetPath()), _read_primitive(reading, prim)
    if _shape_axis(prim) not in TURN:
        reading.fail(path, f"axis is {_shape_axis(prim)!r}; allowed is X, Y or Z")
    if _shape_axis(prim) not in TURN or sizes and not np.isfinite(sizes.parameters).all():
        return None
    authored = read_placement(reading, prim)
    try:
        place, S = _split_rigid_placement(authored, TURN[_shape_axis(prim)] if sizes else TURN["Z"], sizes)
    except ValueError as error:
        reading.fail(path, str(error))
        return None
    shape = _read_mesh_collider(reading, prim, place, S) if sizes is None else _scaled_primitive(reading, path, sizes, place, S)
    if isinstance(shape, Surface) and hasattr(shape.poses, "skeleton"):
        return shape, shape.poses.skeleton.motion
    return None if shape is None else (shape, authored.follow(place.frame))


def _read_approximation(reading: StageReading, prim: Usd.Prim, shape: Shape) -> str:
    attribute = prim.GetAttribute(APPROXIMATION)
    said = str(attribute.Get() or "none") if attribute and isinstance(shape, Surface) else "none"
    if said not in APPROXIMATIONS:
        reading.warn(attribute.GetPath(), f"is {said}; read are {', '.join(APPROXIMATIONS)}, and it is taken as none")
        return "none"
    if said != "none" and reading.points:
        reading.warn(prim.GetPath(), f"{APPROXIMATION} = {said} is not used: points meet the mesh itself")
    return said


def _shape_axis(prim: Usd.Prim) -> str:
    attribute = prim.GetAttribute("axis")
    return str(attribute.Get()) if attribute else "Z"


def _read_primitive(reading: StageReading, prim: Usd.Prim) -> AuthoredShape | None:
    """What the prim's own attributes say at the start; None if it is no primitive."""
    def read_primitive_size(name: str) -> float:
        attribute = prim.GetAttribute(name)
        if attribute.ValueMightBeTimeVarying():
            reading.warn(attribute.GetPath(), "is animated; its value at startTimeCode is held")
        if not np.isfinite(found := attributes.read_unlisted_number(attribute, reading.start)):
            reading.fail(prim.GetPath(), f"{name} is {found:g}; allowed: a finite number > 0; fix: author another {name}")
        return found * reading.units.metres

    found = claiming_shape_row((*applied_schemas(prim), str(prim.GetTypeName())))
    return found and AuthoredShape(found[0], found[0].read(*map(read_primitive_size, found[0].usd[found[1]])))


def _split_rigid_placement(place: Placement, turned: list[int], sizes: AuthoredShape | None) -> tuple[Placement, np.ndarray]:
    """The rigid part, (k, 4, 4) with scale 1, and S of each key, (k, 3, 3), in the shape's own frame."""
    if sizes is not None and sizes.endless:
        return _plane_frames(place, turned), np.eye(3)[None]
    frames, stretches = place.frame.copy(), []
    for k in range(len(frames)):
        base = frames[k][:3, :3]
        R, S = split_rotation_scale(base)
        if np.array_equal(S, np.eye(3)) and np.all(place.scale[k] > 0.0):
            S = np.diag(place.scale[k])                        # a rigid frame and a scale op: both to the bit
        else:
            R, S = split_rotation_scale(place.linear[k], mirror=turned[0])
        frames[k][:3, :3] = R[:, turned]
        stretches.append(S[np.ix_(turned, turned)])
    return Placement(place.times, frames, np.ones((len(frames), 3))), np.array(stretches)


def _plane_frames(place: Placement, turned: list[int]) -> Placement:
    """Frames whose z is the plane's normal, on the side that its axis points to."""
    frames = place.frame.copy()
    for k, L in enumerate(place.linear[:, :, turned]):
        if np.abs(L.T @ L - np.eye(3)).max() < 1e-9 and np.linalg.det(L) > 0:
            frames[k][:3, :3] = L
            continue
        normal = np.cross(L[:, 0], L[:, 1])
        if not np.linalg.norm(normal) > 0:
            raise ValueError("its transform flattens it (a scale is zero); give it scales other than zero")
        z = normal / np.linalg.norm(normal) * (1.0 if normal @ L[:, 2] >= 0 else -1.0)
        x = L[:, 0] / np.linalg.norm(L[:, 0])
        frames[k][:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    return Placement(place.times, frames, np.ones((len(frames), 3)))


def _scaled_primitive(reading: StageReading, path: str, sizes: AuthoredShape, place: Placement, S: np.ndarray) -> Shape:
    """The primitive with S in its sizes, or a mesh of it with a note."""
    constant = np.abs(S - S[0]).max() <= SAME * np.abs(S[0]).max()
    if sizes.endless or constant and np.array_equal(S[0], np.diag(np.diag(S[0]))):
        shape = sizes.solid.scaled(sizes.parameters, np.diag(S[0]))
        if shape is not None:
            return shape
    why = "its scale is animated" if not constant else "its scale differs by axis, or it is sheared"
    reading.warn(path, f"this {sizes.solid.kind} collides as a mesh ({why})")
    points, triangles = sizes.solid.outline(sizes.parameters, AROUND)
    return _stretch_mesh((points, np.full(len(triangles), 3), triangles.ravel()), place, S, None)


def _stretch_mesh(mesh, place: Placement, S: np.ndarray, poses: Curve | None) -> Surface:
    """The mesh (points, counts, indices) and its poses with S applied; mirrored faces turn over."""
    points, counts, indices = mesh
    if np.linalg.det(S[0]) < 0:
        indices = reverse_polygons(counts, indices)
    untouched = all(np.array_equal(s, np.eye(3)) for s in S)
    if poses is None and np.abs(S - S[0]).max() > SAME * np.abs(S[0]).max():
        poses = Curve(place.times, np.array([(points @ s).astype(np.float32) for s in S]))
    elif poses is not None and not untouched:
        at = [_stretch_at_time(place.times, S, t) for t in poses.times]
        values = [(v @ s).astype(np.float32) for v, s in zip(poses.values, at, strict=True)]
        poses = Curve(poses.times, np.array(values))
    return Surface(points if untouched else points @ S[0], counts, indices, poses)


def _stretch_at_time(times: np.ndarray, S: np.ndarray, t: float) -> np.ndarray:
    return Curve(times, S).at(t) if len(S) == len(times) else S[0]


def reverse_polygons(counts: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Corners of each polygon in the opposite order."""
    if counts.min(initial=0) < 0 or counts.sum() != len(indices):
        return indices                                         # reported by wsim.scene.check.scene
    ends = np.cumsum(counts)
    return indices[np.repeat(2 * ends - counts - 1, counts) - np.arange(len(indices))]


def _read_collider_faces(reading: StageReading, prim: Usd.Prim) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Counts and indices at the start; of a TetMesh those of its surface."""
    if not prim.IsA(UsdGeom.TetMesh):
        return tuple(attributes.read_attribute(prim, "Cloth", field, reading.units, reading.start)  # type: ignore[return-value]
                     for field in ("counts", "indices"))
    tets = attributes.read_attribute(prim, "Soft", "tets", reading.units, reading.start)
    if tets is None:
        return None, None
    from wsim.geometry.tetra.tets import tet_surface_triangles
    faces = tet_surface_triangles(tets)
    return np.full(len(faces), 3, np.int32), faces.ravel()


def _read_mesh_collider(reading: StageReading, prim: Usd.Prim, place: Placement, S: np.ndarray) -> Surface | None:
    """A mesh collider; animated points become poses at the authored samples."""
    units, path = reading.units, prim.GetPath()
    if not check_topology(reading, prim, "faceVertexCounts", "faceVertexIndices", "tetVertexIndices"):
        return None
    counts, indices = _read_collider_faces(reading, prim)
    attribute = prim.GetAttribute("points")
    default = attributes.read_attribute(prim, "Cloth", "points", units, attributes.DEFAULT)
    points = default if default is not None else attributes.read_attribute(prim, "Cloth", "points", units, reading.start)
    if points is None or counts is None or indices is None:
        reading.fail(path, "is a mesh collider without points or faces (is a payload or reference missing?)")
        return None
    if prim.GetAttribute("orientation").Get() == UsdGeom.Tokens.leftHanded:
        indices = reverse_polygons(counts, indices)
    codes, noted = attribute.GetTimeSamples(), attributes.read_times(attribute, units)
    poses = _skeleton_driven_points(reading, prim)
    if hasattr(poses, "skeleton"):                             # in the space of its skeleton
        return Surface(poses.at(0.0), counts, indices, poses)
    if poses is not None:
        points = poses.at(0.0)
    elif len(codes) > 1 or (len(codes) == 1 and noted is not None):
        values = [attributes.read_attribute(prim, "Cloth", "points", units, code) for code in codes]
        if any(v is None or v.shape != points.shape for v in values):
            reading.fail(path, f"its number of points changes (from {len(points)}); a collider mesh must keep its " "points")
            return None
        times = units.time(np.array(codes)) if noted is None or len(noted) != len(codes) else noted
        poses = Curve(times, np.array(values))
    return _stretch_mesh((points, counts, indices), place, S, poses)


def _skeleton_driven_points(reading: StageReading, prim: Usd.Prim):
    """Points of a mesh that a skeleton moves."""
    if prim.GetPath() not in reading.skinned and not prim.HasAttribute("primvars:skel:jointIndices"):
        return None
    from wsim.usd.prims.skeletons import read_skinned_poses
    return read_skinned_poses(reading, prim)


def author_collider(stage: Usd.Stage, collider: Collider, material: str, units: StageUnits, frames: int) -> None:
    """Defines the prim of a collider, its motion, friction and restitution."""
    prim = author_shape(stage, collider, units, frames)
    prim.AddAppliedSchema(names.COLLISION)
    if isinstance(collider.shape, Surface):
        prim.AddAppliedSchema(names.MESH_COLLISION)
        if (said := collider.approximation) != "none":
            prim.CreateAttribute(APPROXIMATION, Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform).Set(said)
    if collider.thickness is not None:
        prim.AddAppliedSchema(names.WSIM_COLLIDER)
        attributes.author_attribute(prim, "Collider", "thickness", collider.thickness, units)
    author_softness(prim, collider)
    existing = stage.GetPrimAtPath(material)
    bind_physics_material(prim, existing if existing else author_friction(stage, material, surface_values(collider), units))


def surface_values(collider: Collider) -> tuple[float, ...]:
    """Values of a collider's material: friction (static, dynamic) and, where it throws back, restitution."""
    return collider.static_friction, collider.dynamic_friction, *[collider.restitution] * bool(collider.restitution)


def author_shape(stage: Usd.Stage, thing, units: StageUnits, frames: int) -> Usd.Prim:
    """Defines the prim of something with a path, a shape and a motion, as `load_shape` reads them."""
    prim = _author_shape(stage, thing.path, thing.shape, units).GetPrim()
    author_motion(prim, thing.motion, units, frames)
    solid = None if isinstance(thing.shape, Surface) else shape_row(thing.shape)
    if solid and solid.stretch:
        UsdGeom.Xformable(prim).AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(
            tuple(v / units.metres for v in solid.stretch(thing.shape)))
    return prim


def _author_shape(stage: Usd.Stage, path: str, shape: Shape, units: StageUnits) -> UsdGeom.Gprim:
    if isinstance(shape, Surface):
        return _author_surface(stage, path, shape, units)
    solid = shape_row(shape)
    name, *apis = solid.written
    prim = stage.DefinePrim(path, name)
    for api in apis:
        prim.AddAppliedSchema(api)
    geometry = UsdGeom.Gprim(prim)
    if prim.HasAttribute("axis"):
        prim.CreateAttribute("axis", Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform).Set(UsdGeom.Tokens.z)
    for field, value in solid.write(shape).items():
        attribute = prim.GetAttribute(field) or prim.CreateAttribute(field, Sdf.ValueTypeNames.Double, True)
        attribute.Set(float(value) if solid.stretch else value / units.metres)
    if geometry:                                   # a shape that somebody added may be an Xform
        geometry.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(geometry, Usd.TimeCode.Default()))
    return geometry


def _author_surface(stage: Usd.Stage, path: str, shape: Surface, units: StageUnits) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    prim = mesh.GetPrim()
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    for field in ("points", "counts", "indices"):
        attributes.author_attribute(prim, "Cloth", field, getattr(shape, field), units)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    if hasattr(shape.poses, "skeleton"):
        from wsim.scene.methods import method_file
        method_file("Skeleton", "write").bind(stage, path, shape.poses, units)
    elif shape.poses is not None:
        for time, value in zip(shape.poses.times.tolist(), shape.poses.values, strict=True):
            code = Usd.TimeCode(units.code(time))
            points = attributes.to_usd_array(value, "point3f[]", units.metres)
            mesh.GetPointsAttr().Set(points, code)
            mesh.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(points), code)
        attributes.author_times(mesh.GetPointsAttr(), shape.poses.times)
    return mesh
