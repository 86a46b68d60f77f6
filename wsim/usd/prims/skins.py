"""Meshes of a soft body that are only seen <-> `Skin`.

Every Mesh below the body's prim is one, but for what collides by an API of its own and what lies in a nested body. Its points
count where the bind pose is: those of PhysicsDeformablePoseAPI with purpose bindPose, else the default value of `points`, of
skin and TetMesh alike. A `Skin` has them in the TetMesh's frame where its rest shape is; where rest and bind pose differ they
are carried from one to the other by the tets.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom

from wsim.scene import Problem, Scene, SceneError, Skin, Soft, Surface
from wsim.scene.nodal.skin import embed_skin
from wsim.usd import names
from wsim.usd.attributes import DEFAULT, author_attribute, read_attribute, read_table_attribute
from wsim.usd.load_varying import check_topology
from wsim.usd.names import attribute_entry
from wsim.usd.prims.colliders import reverse_polygons
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement

BIND = "bindPose"


def load_skins(reading: StageReading, mesh: Usd.Prim, body: Usd.Prim, soft: Soft) -> list[Skin]:
    """The skins of a soft body; what follows it not, though it lies in the body, is noted."""
    skins = []
    tied = _bind_points(reading, mesh, "Soft")
    tied = soft.points if tied is None else tied
    for prim in _find_skin_meshes(reading, mesh, body):
        if not check_topology(reading, prim, "faceVertexCounts", "faceVertexIndices"):
            continue
        points = _bind_points(reading, prim, "Cloth")
        counts, indices = (read_attribute(prim, "Cloth", field, reading.units, reading.start)
                           for field in ("counts", "indices"))
        if points is None or counts is None or indices is None:
            reading.warn(prim.GetPath(), f"lies in the deformable body {body.GetPath()} and has no points or no faces: it is "
                         "no skin of it")
            continue
        own, there = soft.motion.at(0.0), read_placement(reading, prim).motion.at(0.0)
        if not np.isfinite(there).all():
            reading.fail(prim.GetPath(), "its transform holds NaN or infinity; author its xformOps again")
            continue
        turned = prim.GetAttribute("orientation").Get() == UsdGeom.Tokens.leftHanded
        if not np.array_equal(own, there):
            with np.errstate(invalid="ignore"):                # points that are not finite: reported by wsim.physics.soft.check
                points = _world_to_frame(own, points @ there[:3, :3].T + there[:3, 3])
            turned ^= (np.linalg.det(there[:3, :3]) < 0) != is_mirrored_frame(soft)
        skin = Skin(str(prim.GetPath()), points, counts, reverse_polygons(counts, indices) if turned else indices)
        rest = soft.points if soft.rest_points is None else soft.rest_points
        finite = all(np.isfinite(values).all() for values in (own, tied, rest))
        if finite and tied.shape == rest.shape and not np.array_equal(tied, rest):
            try:
                skin.points = skin_points_from_tets(soft, skin, tied, rest)
            except SceneError as error:
                reading.problems += error.problems
                continue
        skins.append(skin)
    return skins


def _find_skin_meshes(reading: StageReading, mesh: Usd.Prim, body: Usd.Prim) -> Iterator[Usd.Prim]:
    """The meshes of a body that are skins; others with points are noted."""
    prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    for prim in prims:
        apis = applied_schemas(prim)
        if prim != body and names.BODY in apis:
            prims.PruneChildren()
            continue
        if prim == mesh or not prim.IsA(UsdGeom.PointBased):
            continue
        enabled = prim.GetAttribute("physics:collisionEnabled")
        why = ("is no Mesh" if not prim.IsA(UsdGeom.Mesh) else
               f"has {names.COLLISION}: the surface of {mesh.GetPath()} collides in its place"
               if names.COLLISION in apis and not (enabled and enabled.Get() is False) else
               "is in an instance, which cannot be written over" if prim.IsInstanceProxy() else "")
        if why:
            reading.warn(prim.GetPath(), f"lies in the deformable body {body.GetPath()} and does not follow it: it {why}")
        else:
            yield prim


def _bind_points(reading: StageReading, prim: Usd.Prim, owner: str) -> np.ndarray | None:
    """Points [m] of a prim in its bind pose, own frame."""
    for api in applied_schemas(prim):
        if api.startswith(f"{names.POSE}:"):
            pose = f"physics:deformablePose:{api.partition(':')[2]}"
            purposes, points = (read_table_attribute(prim, replace(attribute_entry("Pose", name), attribute=f"{pose}:{name}"),
                                                     reading.units) for name in ("purposes", "points"))
            if purposes and points is not None and BIND in purposes:
                return points
    points = read_attribute(prim, owner, "points", reading.units, DEFAULT)
    return read_attribute(prim, owner, "points", reading.units, reading.start) if points is None else points


def is_mirrored_frame(soft: Soft) -> bool:
    """True if the body's frame is the mirror image of a turned one at the start."""
    return bool(np.isfinite(soft.motion.values).all() and np.linalg.det(soft.motion.at(0.0)[:3, :3]) < 0)


def _world_to_frame(M: np.ndarray, world: np.ndarray) -> np.ndarray:
    """World positions [m] in the frame M (singular or not finite: as they are, wsim.scene.check.scene reports it)."""
    if not np.isfinite(M).all() or np.linalg.det(M[:3, :3]) == 0.0:
        return world
    return (world - M[:3, 3]) @ np.linalg.inv(M[:3, :3]).T


def skin_points_from_tets(soft: Soft, skin: Skin, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Points of a skin [m] in the body's frame, (m, 3) float32, that follow its tets from points `before` to `after`, (n, 3).
    Raises SceneError as `wsim.scene.nodal.skin.embed_skin` does."""
    return embed_skin(replace(soft, rest_points=before), skin).of(after).astype(np.float32)


def deformable_body_path(soft: Soft) -> str:
    """Path of the prim that a save makes the deformable body: the TetMesh, or what is above it if skins lie beside it."""
    return soft.path.rpartition("/")[0] if soft.skins else soft.path


def author_bind_pose(mesh: Usd.Prim, soft: Soft, units: StageUnits) -> None:
    """Notes that skins are bound to the rest shape, where that is not where the body starts."""
    if soft.skins and soft.rest_points is not None:
        _author_pose(mesh, soft.rest_points, units)


def _author_pose(prim: Usd.Prim, points: np.ndarray, units: StageUnits) -> None:
    prim.AddAppliedSchema(f"{names.POSE}:bind")
    author_attribute(prim, "Pose", "purposes", [BIND])
    author_attribute(prim, "Pose", "points", points, units)


def author_skin(stage: Usd.Stage, soft: Soft, skin: Skin, units: StageUnits, frames: int) -> None:
    """Defines the Mesh of a skin. Its points are where the body starts; in the rest shape they are its bind pose."""
    mesh = UsdGeom.Mesh.Define(stage, skin.path)
    prim, points = mesh.GetPrim(), skin.points
    if soft.rest_points is not None:
        points = skin_points_from_tets(soft, skin, soft.rest_points, soft.points)
        _author_pose(prim, skin.points, units)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    for field, value in (("points", points), ("counts", skin.counts), ("indices", skin.indices)):
        author_attribute(prim, "Cloth", field, value, units)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    author_motion(prim, soft.motion, units, frames)


def skin_problems(scene: Scene) -> Iterator[Problem]:
    """Skins that a stage cannot hold as meshes of their body."""
    bodies: dict[str, str] = {}
    for soft in (soft for soft in scene.softs if soft.skins):
        body = deformable_body_path(soft)
        for skin in soft.skins:
            if len(skin.counts) == 0:
                yield Problem(skin.path, "has no faces; give counts and indices, as to a cloth")
            if not body or not skin.path.startswith(body + "/"):
                yield Problem(skin.path, f"must lie beside {soft.path}, below the prim above it, which becomes the body; "
                                         "allowed is like /ball/sim for the soft body and /ball/skin for its skin")
        if body in bodies:
            yield Problem(soft.path, f"and {bodies[body]} both have skins below {body}, which can be the body of one; give "
                                     "each a prim of its own above")
        bodies[body] = soft.path
        for thing in scene.colliders:
            if body and thing.path.startswith(body + "/") and isinstance(thing.shape, Surface):
                yield Problem(thing.path, f"is a mesh collider below {body}, the body of {soft.path}, which takes in every "
                                          "mesh there; give it a place elsewhere")
