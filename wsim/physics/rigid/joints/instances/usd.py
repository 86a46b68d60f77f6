"""PointInstancers whose prototypes are rigid bodies: an instance is a `Body`; results write its position and orientation."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from wsim.geometry import rotation
from wsim.physics.rigid.joints.moving import moves_by_forces
from wsim.physics.rigid.objects import Body
from wsim.scene import Surface
from wsim.scene.curve import Motion
from wsim.usd import names
from wsim.usd.result.kinds.instances import instancer_orientations
from wsim.usd.stage import StageReading, applied_schemas
from wsim.usd.transforms import read_placement, split_rotation_scale

SAME = 1e-5                  # of a scale, from axis to axis
UNIT = 1e-2                  # departure of |q| from 1 that quath keeps, tenfold


def load(reading: StageReading, prim: Usd.Prim, body_of) -> list[Body]:
    """body_of(reading, prim) -> Body of a prototype as it stands."""
    instancer, path = UsdGeom.PointInstancer(prim), str(prim.GetPath())
    prototypes = [reading.stage.GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetTargets()]
    if not any(p and _rigid_bodies_below(p) for p in prototypes):
        reading.warn(path, "is a PointInstancer: its prototypes take no part")
        return []
    inner = [str(b.GetPath()) for p in prototypes if p for b in _rigid_bodies_below(p) if b != p]
    if inner or prim.IsInstanceProxy():
        reading.fail(path, f"has the rigid body {inner[0]} within a prototype; author PhysicsRigidBodyAPI on the prototype"
                     if inner else "is a PointInstancer of bodies in an instance; author instanceable = false on the instance")
        return []
    if wrong := list(instancer_array_faults(instancer, reading.start)):
        for text in wrong:
            reading.fail(path, text)
        return []
    if not instancer.GetPositionsAttr().Get(reading.start):
        reading.warn(path, "has no instances: its prototypes are not simulated; author positions and protoIndices")
        return []
    if len(read_placement(reading, prim).times) > 1 or instancer.GetPositionsAttr().ValueMightBeTimeVarying():
        reading.warn(path, "is animated and has dynamic rigid bodies: they start where it does and then move by forces")
    found: list[Body | None] = []
    made: dict = {}
    for k, (index, M) in enumerate(_instance_placements(reading, instancer, prototypes)):
        proto = prototypes[index] if 0 <= index < len(prototypes) else None
        if M is None or not proto or names.RIGID_BODY not in applied_schemas(proto) or not moves_by_forces(reading, proto):
            continue
        if index not in made:
            made[index] = body_of(reading, proto)
        if made[index] is not None:
            found.append(_make_instance_body(reading, prim, proto, made[index], k, M))
    return [body for body in found if body is not None]


def instancer_array_faults(instancer: UsdGeom.PointInstancer, start: Usd.TimeCode) -> Iterator[str]:
    """What is wrong with the arrays of an instancer: how many numbers there are, what they name, and that they are numbers."""
    arrays = {name: np.array(value if (value := getattr(instancer, f"Get{name}Attr")().Get(start)) is not None else [], kind)
              for name, kind in (("ProtoIndices", np.int64), ("Positions", np.float64), ("Scales", np.float64),
                                 ("Velocities", np.float64), ("AngularVelocities", np.float64), ("Ids", np.int64))}
    count, targets = len(arrays["Positions"]), instancer.GetPrototypesRel().GetTargets()
    if not count:
        if len(arrays["ProtoIndices"]):
            yield "has no positions, and so no instances; author one for each of protoIndices"
        return
    for name, values in arrays.items():
        said = name[0].lower() + name[1:]
        if len(values) != count and (len(values) or name == "ProtoIndices"):
            yield f"{said} has {len(values)} entries, and positions {count}; allowed is one for each instance: author as many"
        elif values.dtype == np.float64 and len(bad := np.flatnonzero(~np.isfinite(values).reshape(count, -1).all(axis=1))):
            yield f"{said}[{bad[0]}] is {tuple(values[bad[0]].tolist())}; allowed are finite numbers: author it again"
    indices, ids = arrays["ProtoIndices"], arrays["Ids"]
    bad = np.flatnonzero((indices < 0) | (indices >= len(targets)))
    if len(bad):
        yield (f"protoIndices[{bad[0]}] is {indices[bad[0]]}; allowed is 0 to {len(targets) - 1}: there are {len(targets)} "
               "prototypes; name one of them")
    lost = [path for path in targets if not instancer.GetPrim().GetStage().GetPrimAtPath(path)]
    if lost:
        yield f"its prototype {lost[0]} is no prim (is a payload or reference missing?); name one that is there"
    twice, counts = np.unique(ids, return_counts=True)
    if (counts > 1).any():
        yield f"ids has {twice[counts > 1][0]} {counts[counts > 1][0]} times; allowed is each once: author other ids"
    yield from _check_instance_orientations(instancer, start, count)


def _check_instance_orientations(instancer: UsdGeom.PointInstancer, start: Usd.TimeCode, count: int) -> Iterator[str]:
    for attribute in (instancer.GetOrientationsfAttr(), instancer.GetOrientationsAttr()):
        values = attribute.Get(start) if attribute else None
        if not values:
            continue
        lengths = np.array([q.GetLength() for q in values])
        bad = np.flatnonzero(~(np.abs(lengths - 1.0) < UNIT))
        if len(values) != count:
            yield (f"{attribute.GetName()} has {len(values)} entries, and positions {count}; allowed is one for each instance: "
                   "author as many")
        elif len(bad):
            yield (f"{attribute.GetName()}[{bad[0]}] is a quaternion of length {lengths[bad[0]]:g}; allowed is 1: divide it by "
                   "its length, or leave out orientations")
        return


def _rigid_bodies_below(prim: Usd.Prim) -> list[Usd.Prim]:
    return [p for p in Usd.PrimRange(prim, Usd.TraverseInstanceProxies()) if names.RIGID_BODY in applied_schemas(p)]


def _instance_placements(reading: StageReading, instancer: UsdGeom.PointInstancer,
                         prototypes: list) -> list[tuple[int, np.ndarray | None]]:
    """(prototype, frame of the prototype's contents to world [m], None where it is masked) of each instance. Orientations of
    half precision are made unit ones, which USD leaves as they are."""
    start = reading.start
    indices, places = list(instancer.GetProtoIndicesAttr().Get(start) or []), instancer.GetPositionsAttr().Get(start) or []
    n, scales = len(places), instancer.GetScalesAttr().Get(start)
    turns = rotation.quaternion_to_matrix(instancer_orientations(instancer, start, n))
    sizes = np.array(scales, np.float64) if scales and len(scales) == n else np.ones((n, 3))
    mask = list(instancer.ComputeMaskAtTime(start)) or [True] * n
    W = np.array(UsdGeom.XformCache(start).GetLocalToWorldTransform(instancer.GetPrim())).T
    own = [np.array(UsdGeom.Xformable(p).GetLocalTransformation(start)).T if p else np.eye(4) for p in prototypes]
    found: list[tuple[int, np.ndarray | None]] = []
    for index, x, R, s, shown in zip(indices, places, turns, sizes, mask, strict=False):
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = R * s, x
        M = W @ M @ (own[index] if 0 <= index < len(own) else np.eye(4))
        M[:3, 3] *= reading.units.metres
        found.append((index, M if shown else None))
    return found


def _make_instance_body(reading: StageReading, prim: Usd.Prim, proto: Usd.Prim, body: Body, k: int,
                        M: np.ndarray) -> Body | None:
    path = str(prim.GetPath())
    try:
        R, S = split_rotation_scale(M[:3, :3])
    except ValueError as error:
        reading.fail(path, f"instance {k}: {error}")
        return None
    own = np.eye(3) if body.stretch is None else body.stretch
    ratio = S @ np.linalg.inv(own)
    size = float(np.trace(ratio)) / 3.0
    if np.abs(ratio - size * np.eye(3)).max() > SAME * abs(size) or size <= 0.0:
        reading.fail(path, f"instance {k} is scaled by {np.diag(ratio).round(6).tolist()} against its prototype "
                     f"{proto.GetPath()}; allowed is one factor for all axes: make a prototype of that shape")
        return None
    size = 1.0 if abs(size - 1.0) < SAME else size
    S, frame = size * own, M.copy()
    frame[:3, :3] = R
    name = f"{path}/{proto.GetName()}_{k}"
    velocity, spin = _instance_velocity(reading, prim, k)
    made = replace(body, path=name, motion=Motion.still(frame), instancer=path, instance=k, velocity=velocity, spin=spin,
                   stretch=None if np.array_equal(S, np.eye(3)) else S)
    if size != 1.0:
        given = UsdPhysics.MassAPI(proto).GetMassAttr().Get(reading.start) if proto.HasAPI(UsdPhysics.MassAPI) else 0.0
        made = _scale_body(made, size, not given)
    made.colliders = [replace(c, path=name + c.path[len(str(proto.GetPath())):]) for c in made.colliders]
    return made


def _instance_velocity(reading: StageReading, prim: Usd.Prim, k: int) -> tuple[np.ndarray, np.ndarray]:
    """World velocity [m/s] and spin [rad/s] of an instance, from the instancer's own."""
    instancer, start = UsdGeom.PointInstancer(prim), reading.start
    W = np.array(UsdGeom.XformCache(start).GetLocalToWorldTransform(prim)).T[:3, :3]
    v, w = (np.array(values[k], np.float64) if (values := a.Get(start)) and len(values) > k else np.zeros(3)
            for a in (instancer.GetVelocitiesAttr(), instancer.GetAngularVelocitiesAttr()))
    return W @ v * reading.units.metres, split_rotation_scale(W)[0] @ np.radians(w)


def _scale_body(body: Body, s: float, dense: bool) -> Body:
    """A body of s times the size: dense, of the same density, else of the same mass."""
    m = s**3 if dense else 1.0
    shapes = [replace(c, shape=_scale_shape(c.shape, s), motion=_scale_motion_distance(c.motion, s)) for c in body.colliders]
    return replace(body, colliders=shapes, mass=None if body.mass is None else body.mass * m,
                   center=None if body.center is None else body.center * s,
                   inertia=None if body.inertia is None else body.inertia * m * s * s)


def _scale_motion_distance(motion: Motion, s: float) -> Motion:
    if not motion.plain:
        from wsim.scene.curve import Stack
        return Stack([np.diag([s, s, s, 1.0]), motion, np.diag([1.0 / s, 1.0 / s, 1.0 / s, 1.0])])
    values = motion.values.copy()
    values[:, :3, 3] *= s
    return Motion(motion.times, values)


def _scale_shape(shape, s: float):
    """A shape of s times the size."""
    if isinstance(shape, Surface):
        poses = None if shape.poses is None else shape.poses.scaled(s)
        return replace(shape, points=shape.points * s, poses=poses)
    sizes = {name: tuple(v * s for v in value) if isinstance(value, (tuple, list)) else value * s
             for name, value in vars(shape).items() if isinstance(value, (float, int, tuple, list))}
    return replace(shape, **sizes)
