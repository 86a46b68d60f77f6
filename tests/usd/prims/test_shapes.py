"""Colliders of a stage are where USD puts them: sizes, axes, scales, mirrors, shear, animation."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from wsim.geometry import primitives, topology
from wsim.scene import Box, Capsule, Collider, Cone, Cylinder, Plane, Sphere, Surface
from wsim.scene.check import mesh
from wsim.usd.prims.colliders import AROUND, load_collider
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import split_rotation_scale

CHORD = 2.0 * (1.0 - np.cos(np.pi / AROUND))      # how far a facet lies inside its sphere, of the radius


def inside(shape, p: np.ndarray) -> np.ndarray:
    """< 0 inside, 0 on the surface, > 0 outside, for points (n, 3) in the shape's own frame. Written for the test."""
    r, z = np.linalg.norm(p[:, :2], axis=1), p[:, 2]
    match shape:
        case Plane():
            return z
        case Sphere(radius=R):
            return np.linalg.norm(p, axis=1) - R
        case Box(half=h):
            return (np.abs(p) - np.array(h)).max(axis=1)
        case Capsule(radius=R, half_height=h):
            return np.hypot(r, np.maximum(np.abs(z) - h, 0.0)) - R
        case Cylinder(radius=R, half_height=h):
            return np.maximum(r - R, np.abs(z) - h)
        case Cone(radius=R, half_height=h):
            return np.maximum((r - R * (h - z) / (2 * h)) * 2 * h / np.hypot(R, 2 * h), -h - z)
    raise TypeError(shape)


LOCAL = {"Sphere": Sphere(0.7), "Cube": Box((0.6, 0.6, 0.6)), "Capsule": Capsule(0.4, 0.8),
         "Cylinder": Cylinder(0.4, 0.8), "Cone": Cone(0.5, 0.8), "Plane": Plane()}


def define(stage: Usd.Stage, kind: str, axis: str) -> Usd.Prim:
    prim = stage.DefinePrim("/up/shape", kind)
    prim.AddAppliedSchema("PhysicsCollisionAPI")
    shape = LOCAL[kind]
    values = {"radius": getattr(shape, "radius", None), "height": 2 * getattr(shape, "half_height", 0.0) or None,
              "size": 1.2 if kind == "Cube" else None, "axis": axis if kind not in ("Sphere", "Cube") else None}
    for name, value in values.items():
        if value is not None:
            prim.GetAttribute(name).Set(value)
    return prim


def boundary(kind: str, axis: str, rng) -> np.ndarray:
    """Points on the local shape, (n, 3), in the prim's frame, found along rays from its inside."""
    rays = rng.normal(size=(100, 3))
    if kind == "Plane":
        rays[:, 2] = 0.0
        on = rays
    else:
        low, high = np.zeros(len(rays)), np.full(len(rays), 9.0)
        for _ in range(60):
            middle = 0.5 * (low + high)
            within = inside(LOCAL[kind], rays * middle[:, None]) < 0
            low, high = np.where(within, middle, low), np.where(within, high, middle)
        on = rays * low[:, None]
    turned = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}[axis if kind not in ("Sphere", "Cube") else "Z"]
    return on[:, turned]


def place(stage: Usd.Stage, transform: str, scale) -> None:
    up = UsdGeom.Xform.Define(stage, "/up")
    up.AddTranslateOp().Set((3.0, -2.0, 1.0))
    up.AddRotateXYZOp().Set((20.0, -50.0, 130.0))
    shape = UsdGeom.Xformable(stage.GetPrimAtPath("/up/shape"))
    if transform == "parent":
        up.AddScaleOp().Set(scale)
        if len(set(scale)) > 1:
            return
    shape.AddRotateXYZOp().Set((10.0, 70.0, -15.0))
    if transform == "own":
        shape.AddScaleOp().Set(scale)


@pytest.mark.parametrize("kind, axis", [("Sphere", "Z"), ("Cube", "Z"), *(
    (kind, axis) for kind in ("Capsule", "Cylinder", "Cone", "Plane") for axis in "XYZ")])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 2.0, 2.0), (-1.0, 1.0, 1.0), (-1.5, -1.5, -1.5),
                                   (1.0, 2.0, 3.0), (1.0, 1.0, -2.0), (2.0, 1.0, 1.0)])
@pytest.mark.parametrize("transform", ["own", "parent"])
def test_a_shape_is_where_usd_puts_its_surface(kind, axis, scale, transform):
    rng = np.random.default_rng(1)
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    prim = define(stage, kind, axis)
    place(stage, transform, scale)
    M = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    world = 0.01 * (boundary(kind, axis, rng) @ M[:3, :3] + M[3, :3])
    reading = StageReading(stage, StageUnits.of(stage))
    found = load_collider(reading, prim)
    assert isinstance(found, Collider) and not any(p.fatal for p in reading.problems)
    R, t = found.motion.at(0.0)[:3, :3], found.motion.at(0.0)[:3, 3]
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-12 and np.linalg.det(R) > 0
    own = (world - t) @ R
    if isinstance(found.shape, Surface):
        assert "collides as a mesh" in str(reading.problems[0])
        assert _outward(found.shape)
        distance = _distance(found.shape, own)
        assert distance.max() < 0.01 * 0.8 * 3.0 * (CHORD + 1e-6)
    else:
        assert np.abs(inside(found.shape, own)).max() < 1e-8
    if kind == "Plane":                                        # the solid side: what USD has below its axis
        below = -np.eye(3)["XYZ".index(axis)] @ M[:3, :3] * 0.01 + 0.01 * M[3, :3]
        assert inside(found.shape, ((below - t) @ R)[None])[0] < 0


def _outward(mesh: Surface) -> bool:
    """A closed mesh whose signed volume is positive."""
    first = np.cumsum(mesh.counts) - mesh.counts
    volume = 0.0
    for start, count in zip(first, mesh.counts, strict=True):
        a, *rest = mesh.points[mesh.indices[start:start + count]].astype(np.float64)
        volume += sum(np.dot(a, np.cross(b, c)) for b, c in zip(rest, rest[1:], strict=False))
    return volume > 0.0


def _distance(mesh: Surface, points: np.ndarray) -> np.ndarray:
    """Distance of points outside a convex mesh from its planes: the largest signed one, in absolute value."""
    first = np.cumsum(mesh.counts) - mesh.counts
    corner = np.array([mesh.points[mesh.indices[start:start + 3]] for start in first], np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.abs(((points[:, None] - corner[None, :, 0]) * normal[None]).sum(axis=2).max(axis=1))


@pytest.mark.parametrize("solid", [
    primitives.box_outline((1.0, 2.0, 3.0)), primitives.sphere_outline(0.7, AROUND),
    primitives.capsule_outline(0.4, 0.4, 0.8, AROUND),
    primitives.capsule_outline(0.4, 0.2, 0.1, AROUND), primitives.cylinder_outline(0.4, 0.3, 0.8, AROUND),
    primitives.cylinder_outline(0.5, 0.0, 0.8, AROUND),
], ids=["box", "ball", "capsule", "two half balls", "cylinder", "cone"])
def test_a_solid_is_closed_and_holds_no_point_twice(solid):
    """A collider's inside is told by its closed surface: each edge has two sides, and Euler's number is 2."""
    points, triangles = solid
    edges, used = topology.edges_of_triangles(triangles), np.unique(triangles)
    assert len(topology.hinges_of_triangles(triangles)) == len(edges) and len(used) == len(points)
    assert len(points) - len(edges) + len(triangles) == 2
    assert mesh.check_polygon_mesh("/solid", points.astype(np.float32), np.full(len(triangles), 3), triangles.ravel()) == []


@pytest.mark.parametrize("scale, mirrored", [((1, 1, 1), False), ((1, -2, 1), True), ((-1, -1, 3), False)])
def test_a_mesh_collider_stays_outward_under_a_mirror(scale, mirrored):
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    points, triangles = primitives.box_outline((1.0, 2.0, 3.0))
    counts, indices = np.full(12, 3), triangles.ravel()
    mesh = UsdGeom.Mesh.Define(stage, "/m")
    mesh.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
    mesh.CreateFaceVertexCountsAttr(counts.tolist())
    mesh.CreateFaceVertexIndicesAttr(indices.tolist())
    mesh.AddScaleOp().Set(scale)
    found = load_collider(StageReading(stage, StageUnits.of(stage)), mesh.GetPrim())
    assert np.array_equal(found.shape.indices, indices) != mirrored and _outward(found.shape)
    M = found.motion.at(0.0)
    world = found.shape.points @ M[:3, :3].T + M[:3, 3]
    assert np.allclose(sorted(map(tuple, world)), sorted(map(tuple, points * scale)))


def test_animated_points_and_xforms_of_a_collider_are_followed():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetStartTimeCode(10)
    points, triangles = primitives.box_outline((1.0, 1.0, 1.0))
    counts, indices = np.full(12, 3), triangles.ravel()
    mesh = UsdGeom.Mesh.Define(stage, "/m")
    mesh.CreateFaceVertexCountsAttr(counts.tolist())
    mesh.CreateFaceVertexIndicesAttr(indices.tolist())
    for code, size in ((10.0, 1.0), (22.0, 3.0)):
        mesh.CreatePointsAttr().Set([Gf.Vec3f(*map(float, size * p)) for p in points], code)
    spin = mesh.AddRotateZOp()
    spin.Set(0.0, 10.0)
    spin.Set(90.0, 34.0)
    reading = StageReading(stage, StageUnits.of(stage), frames=24)
    found = load_collider(reading, mesh.GetPrim())
    assert found.shape.poses.times.tolist() == [0.0, 0.5]
    assert np.allclose(found.shape.poses.at(0.25), 0.02 * points, rtol=1e-6)
    for frame in range(25):
        a = np.radians(90.0 * frame / 24)
        expected = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
        assert np.abs(found.motion.at(frame / 24.0)[:2, :2] - expected).max() < 1e-7


def test_an_animated_scale_becomes_animated_points():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    ball = UsdGeom.Sphere.Define(stage, "/b")
    scale = ball.AddScaleOp()
    scale.Set((1.0, 1.0, 1.0), 0.0)
    scale.Set((3.0, 3.0, 3.0), 24.0)
    reading = StageReading(stage, StageUnits.of(stage), frames=24)
    found = load_collider(reading, ball.GetPrim())
    assert "its scale is animated" in str(reading.problems[0])
    assert np.allclose(np.linalg.norm(found.shape.poses.at(0.5), axis=1), 2.0, rtol=1e-6)


def test_a_scale_of_zero_is_an_error_with_the_path():
    stage = Usd.Stage.CreateInMemory()
    ball = UsdGeom.Sphere.Define(stage, "/b")
    ball.AddScaleOp().Set((1.0, 0.0, 1.0))
    reading = StageReading(stage, StageUnits.of(stage))
    assert load_collider(reading, ball.GetPrim()) is None
    assert reading.problems[0].fatal and reading.problems[0].path == "/b" and "flattens" in reading.problems[0].text


def test_split_gives_a_rotation_and_what_is_left():
    rng = np.random.default_rng(4)
    for _ in range(50):
        L = rng.normal(size=(3, 3))
        R, S = split_rotation_scale(L)
        assert np.abs(R @ S - L).max() < 1e-12 and np.abs(R.T @ R - np.eye(3)).max() < 1e-12 and np.linalg.det(R) > 0
