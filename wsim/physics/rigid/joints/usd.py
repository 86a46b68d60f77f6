"""Prims of the type PhysicsJoint and those that derive from it <-> `Joint`.

Angles are degrees on a stage, and stiffness and damping of angular drives per degree. A frame is placed in its prim with the
scale of that, and turned without. What a joint names and what moves is a body, or lies in one; anything else holds the joint
where it stands or goes.
"""

from math import inf, pi

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from wsim.geometry import rotation
from wsim.physics.rigid.joints.authored import authored_joint_faults, warn_unapplied_joint_apis
from wsim.physics.rigid.joints.joint import AXES, DISTANCE, LOCKED, SHIFTS, TURNS, Drive, Joint, locked_limits_except
from wsim.physics.rigid.joints.moving import body_of, fixes_massless_frame
from wsim.physics.rigid.joints.passive import author_passive_terms, read_passive_terms
from wsim.physics.rigid.joints.stacked import REFERENCE, merge_joints, mujoco_reference_value, passive_drives, stacked_joints
from wsim.scene.curve import Motion
from wsim.usd.load_varying import note_varying_values
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement, split_rotation_scale

DEGREE = pi / 180.0
ENDLESS = 3e38              # largest floats stand for none
ANCHOR = "anchor"
UNIT = 1e-3                 # departure of |q| from 1 that is no mistake of the author
KINDS = {"PhysicsRevoluteJoint": ("rotX", "angular"), "PhysicsPrismaticJoint": ("transX", "linear")}


def load(reading: StageReading, prim: Usd.Prim) -> Joint | None:
    """The joint of a prim; of several that act one behind the other, one joint at the first of them."""
    group = stacked_joints(reading, prim)
    if prim != group[0]:
        return None
    joints = [joint for each in group if (joint := read_single_joint(reading, each)) is not None]
    return merge_joints(reading, joints) if len(joints) > 1 else joints[0] if joints else None


def read_single_joint(reading: StageReading, prim: Usd.Prim) -> Joint | None:
    path, api = str(prim.GetPath()), UsdPhysics.Joint(prim)
    targets = [_read_joint_target(reading, prim, rel) for rel in (api.GetBody0Rel(), api.GetBody1Rel())]
    if "" in targets:
        return None
    if prim.IsInstanceProxy():
        reading.fail(path, "is a joint in an instance, whose contents cannot be written over; author instanceable = false "
                     "on the instance")
        return None
    bodies = [None if t is None else body_of(reading, t) for t in targets]
    if fixes_massless_frame(reading, prim) and (bodies[0] == bodies[1]):
        return None
    if bodies == [None, None]:
        if targets == [None, None]:
            reading.fail(path, "joins no body; author physics:body0 or physics:body1")
        else:
            reading.warn(path, "joins nothing that moves by forces: it is left out")
        return None
    given: dict = {}
    for k, (target, body) in enumerate(zip(targets, bodies, strict=True)):
        given |= _read_joint_side(reading, api, k, target, body)
    if any(value is None for value in given.values()):
        return None
    kind = str(prim.GetTypeName())
    wrong = list(authored_joint_faults(prim, reading.start))
    reading.problems += wrong
    if any(problem.fatal for problem in wrong):
        return None
    warn_unapplied_joint_apis(reading, prim)
    limits, drives, cone, turn = _read_joint_table(reading, prim, kind)
    for k in (0, 1):
        given[f"turn{k}"] = rotation.quat_product(given[f"turn{k}"], turn)
    aims = [a for name, _ in _read_drives(prim, kind) for api in [UsdPhysics.DriveAPI(prim, name)]
            for a in (api.GetTargetPositionAttr(), api.GetTargetVelocityAttr())]
    note_varying_values(reading, path, Joint, aims, lambda at: _read_drive_targets(at, prim, kind))
    return Joint(path, limits=limits, drives=drives, cone=cone, **read_passive_terms(reading, prim, limits), **given,
                 **_read_joint_breaking(reading, api))


def _read_joint_breaking(reading: StageReading, api: UsdPhysics.Joint) -> dict:
    start, units = reading.start, reading.units
    force, torque = (float(a.Get(start)) for a in (api.GetBreakForceAttr(), api.GetBreakTorqueAttr()))
    return {"collides": bool(api.GetCollisionEnabledAttr().Get(start)), "enabled": bool(api.GetJointEnabledAttr().Get(start)),
            "force": inf if force > ENDLESS else force * units.factor("N"),
            "torque": inf if torque > ENDLESS else torque * units.factor("N m")}


def _read_joint_target(reading: StageReading, prim: Usd.Prim, rel: Usd.Relationship):
    """The prim that a side names, None for the world, "" where it is wrong."""
    targets = rel.GetTargets()
    if not targets:
        return None
    found = reading.stage.GetPrimAtPath(targets[0])
    if len(targets) > 1 or not found:
        what = f"{len(targets)} prims; allowed is one" if len(targets) > 1 else f"{targets[0]}, which is no prim; name a body"
        reading.fail(prim.GetPath(), f"{rel.GetName()} names {what}")
        return ""
    return found


def _read_joint_side(reading: StageReading, api: UsdPhysics.Joint, k: int, target, body) -> dict:
    """Fields of one side of a `Joint`."""
    pos, rot = ((api.GetLocalPos0Attr(), api.GetLocalRot0Attr()), (api.GetLocalPos1Attr(), api.GetLocalRot1Attr()))[k]
    at = np.array(pos.Get(reading.start), np.float64) * reading.units.metres
    q = rot.Get(reading.start)
    q = np.array([*q.GetImaginary(), q.GetReal()], np.float64)
    length = float(np.linalg.norm(q))
    if not 0.0 < length < inf:
        reading.fail(rot.GetPath(), f"is a quaternion of length {length:g}; author one of length 1")
        return {"at": None}
    if abs(length - 1.0) > UNIT:
        reading.warn(rot.GetPath(), f"is a quaternion of length {length:g} and taken as {_usd_quaternion_text(q / length)}; "
                     "author one of length 1")
    q = rotation.unit_quat(q)
    if target is None:
        return {f"at{k}": at, f"turn{k}": q}
    place = read_placement(reading, target)
    try:
        parts = [split_rotation_scale(linear) for linear in place.linear]
    except ValueError as error:
        reading.fail(target.GetPath(), str(error))
        return {"at": None}
    frames = place.frame.copy()
    frames[:, :3, :3] = [R for R, _ in parts]
    at = parts[0][1] @ at
    if body is None:
        return {f"at{k}": at, f"turn{k}": q, "motion": place.follow(frames), "still": str(target.GetPath())}
    own = read_placement(reading, body)
    M = own.frame[0].copy()
    M[:3, :3] = split_rotation_scale(own.linear[0])[0]
    F = np.linalg.inv(M) @ frames[0]
    q = rotation.quat_product(rotation.matrix_quat(F[:3, :3]), q) if target != body else q
    return {f"body{k}": str(body.GetPath()), f"at{k}": F[:3, :3] @ at + F[:3, 3] if target != body else at, f"turn{k}": q}


def _usd_quaternion_text(q: np.ndarray) -> str:
    """A quaternion (x, y, z, w) as USD writes it."""
    return "(" + ", ".join(f"{v:.4g}" for v in (q[3], *q[:3])) + ")"


def _unit(units: StageUnits, name: str) -> float:
    return DEGREE if name in TURNS else units.metres


def _limit_range(units: StageUnits, name: str, low, high) -> tuple[float, float]:
    low, high = (-inf if low < -ENDLESS else float(low)), (inf if high > ENDLESS else float(high))
    return LOCKED if low > high else (low * _unit(units, name), high * _unit(units, name))


def _read_joint_table(reading: StageReading, prim: Usd.Prim, kind: str):
    """(limits, drives, cone, turn): turn is a quaternion of what the joint calls its axis to x."""
    start, units, turn, cone = reading.start, reading.units, np.array([0.0, 0.0, 0.0, 1.0]), None
    axis = prim.GetAttribute("physics:axis")
    if axis and (k := "XYZ".index(axis.Get(start))):
        turn = rotation.matrix_quat(np.eye(3)[:, [k, (k + 1) % 3, (k + 2) % 3]])
    limits: dict[str, tuple[float, float]] = {}
    if kind == "PhysicsFixedJoint":
        limits = locked_limits_except()
    elif kind in KINDS:
        name = KINDS[kind][0]
        own = _limit_range(units, name, *(prim.GetAttribute(f"physics:{side}Limit").Get(start) for side in ("lower", "upper")))
        zero = mujoco_reference_value(reading, prim, name, REFERENCE)
        limits = locked_limits_except(name) | ({} if own == (-inf, inf) else {name: (own[0] - zero, own[1] - zero)})
    elif kind == "PhysicsSphericalJoint":
        limits = locked_limits_except(*TURNS)
        angles = [prim.GetAttribute(f"physics:coneAngle{k}Limit").Get(start) for k in (0, 1)]
        if any(a >= 0.0 for a in angles):
            cone = tuple(float(a) * DEGREE if a >= 0.0 else inf for a in angles)
    elif kind == "PhysicsDistanceJoint":
        low, high = (prim.GetAttribute(f"physics:{side}Distance").Get(start) for side in ("min", "max"))
        limits = {DISTANCE: (low * units.metres if low >= 0.0 else -inf, high * units.metres if high >= 0.0 else inf)}
    else:
        for name in (*AXES, DISTANCE):
            if f"PhysicsLimitAPI:{name}" in applied_schemas(prim):
                own = UsdPhysics.LimitAPI(prim, name)
                limits[name] = _limit_range(units, name, own.GetLowAttr().Get(start), own.GetHighAttr().Get(start))
    drives = {name: _read_joint_drive(reading, prim, given, name) for given, name in _read_drives(prim, kind)}
    if kind in KINDS:
        drives = passive_drives(reading, prim, KINDS[kind][0], drives)
    return limits, drives, cone, turn


def _read_drives(prim: Usd.Prim, kind: str) -> list[tuple[str, str]]:
    """(instance name of a drive, coordinate)."""
    given = [api.partition(":")[2] for api in applied_schemas(prim) if api.startswith("PhysicsDriveAPI:")]
    if kind in KINDS:
        name, own = KINDS[kind]
        return [(each, name) for each in given if each in (own, name)]
    return [(each, each) for each in given if each in (*AXES, DISTANCE)]


def _read_drive_targets(reading: StageReading, prim: Usd.Prim, kind: str) -> dict:
    """Where drives go, and how fast."""
    drives = {name: _read_joint_drive(reading, prim, given, name) for given, name in _read_drives(prim, kind)}
    joint = Joint("", drives=drives)
    return {name: joint.taken(name) for name in ("target", "speed")}


def author_at(prim: Usd.Prim, joint: Joint, name: str, value, units: StageUnits, code: float) -> list[Usd.Attribute]:
    """Writes target or speed of the drives at a time code, in the order of `Joint.driven`; their attributes."""
    found, instance = [], {axis: given for given, axis in _read_drives(prim, str(prim.GetTypeName()))}
    for axis, number in zip(joint.driven(), np.broadcast_to(value, len(joint.drives)).tolist(), strict=True):
        api = UsdPhysics.DriveAPI(prim, instance[axis])
        found.append((api.CreateTargetPositionAttr if name == "target" else api.CreateTargetVelocityAttr)())
        found[-1].Set(number / _unit(units, axis), code)
    return found


def _read_joint_drive(reading: StageReading, prim: Usd.Prim, given: str, name: str) -> Drive:
    api, units, start = UsdPhysics.DriveAPI(prim, given), reading.units, reading.start
    unit, force = _unit(units, name), units.factor("N m" if name in TURNS else "N")
    acceleration = api.GetTypeAttr().Get(start) == "acceleration"
    per = 1.0 / DEGREE if name in TURNS else 1.0
    per *= 1.0 if acceleration else units.factor("N m" if name in TURNS else "N/m")
    most = float(api.GetMaxForceAttr().Get(start))
    return Drive(float(api.GetStiffnessAttr().Get(start)) * per, float(api.GetDampingAttr().Get(start)) * per,
                 float(api.GetTargetPositionAttr().Get(start)) * unit, float(api.GetTargetVelocityAttr().Get(start)) * unit,
                 inf if most > ENDLESS else most * force, acceleration)


def author(stage: Usd.Stage, joint: Joint, units: StageUnits) -> None:
    prim = stage.DefinePrim(joint.path, usd_joint_type(joint))
    api = UsdPhysics.Joint(prim)
    for k, (rel, pos, rot) in enumerate(((api.CreateBody0Rel, api.CreateLocalPos0Attr, api.CreateLocalRot0Attr),
                                         (api.CreateBody1Rel, api.CreateLocalPos1Attr, api.CreateLocalRot1Attr))):
        body, at, q = getattr(joint, f"body{k}"), getattr(joint, f"at{k}"), getattr(joint, f"turn{k}")
        if body:
            rel().SetTargets([Sdf.Path(body)])
        elif joint.motion != Motion.still():
            anchor = UsdGeom.Xform.Define(stage, f"{joint.path}/{ANCHOR}").GetPrim()
            author_motion(anchor, joint.motion, units, 0)
            rel().SetTargets([anchor.GetPath()])
        pos(Gf.Vec3f(*(at / units.metres).tolist()))
        rot(Gf.Quatf(float(q[3]), Gf.Vec3f(*q[:3].tolist())))
    api.CreateJointEnabledAttr(joint.enabled)
    api.CreateCollisionEnabledAttr(joint.collides)
    api.CreateBreakForceAttr(joint.force / units.factor("N"))
    api.CreateBreakTorqueAttr(joint.torque / units.factor("N m"))
    _author_table(prim, joint, units)
    author_passive_terms(prim, joint, units)


def usd_joint_type(joint: Joint) -> str:
    """Type of the prim that says a joint."""
    locked = {name for name, range_of in joint.limits.items() if range_of == LOCKED}
    open_ = set(joint.limits) - locked
    driven = set(joint.drives)
    if locked == set(AXES) and not driven:
        return "PhysicsFixedJoint"
    for kind, (name, _) in KINDS.items():
        if locked == {*AXES} - {name} and open_ | driven <= {name}:
            return kind
    if locked == set(SHIFTS) and not open_ | driven:
        return "PhysicsSphericalJoint"
    return "PhysicsDistanceJoint" if set(joint.limits) == {DISTANCE} and not driven else "PhysicsJoint"


def _author_table(prim: Usd.Prim, joint: Joint, units: StageUnits) -> None:
    kind = str(prim.GetTypeName())

    def put_attribute(name: str, value: float) -> None:
        prim.GetAttribute(f"physics:{name}").Set(float(value))
    given = {name: name for name in joint.drives}
    if kind in KINDS:
        name, own = KINDS[kind]
        given = {name: own}
        for side, value in zip(("lower", "upper"), joint.limits.get(name, (-inf, inf)), strict=True):
            put_attribute(f"{side}Limit", value / _unit(units, name))
    elif kind == "PhysicsSphericalJoint":
        for k, angle in enumerate(joint.cone or (inf, inf)):
            put_attribute(f"coneAngle{k}Limit", angle / DEGREE if angle < inf else -1.0)
    elif kind == "PhysicsDistanceJoint":
        low, high = joint.limits[DISTANCE]
        put_attribute("minDistance", low / units.metres if low >= 0.0 else -1.0)
        put_attribute("maxDistance", high / units.metres if high < inf else -1.0)
    elif kind == "PhysicsJoint":
        for name, range_of in joint.limits.items():
            api = UsdPhysics.LimitAPI.Apply(prim, name)
            low, high = (1.0, -1.0) if range_of == LOCKED else (value / _unit(units, name) for value in range_of)
            api.CreateLowAttr(low)
            api.CreateHighAttr(high)
    for name, drive in joint.drives.items():
        _author_drive(UsdPhysics.DriveAPI.Apply(prim, given[name]), drive, name, units)


def _author_drive(api: UsdPhysics.DriveAPI, drive: Drive, name: str, units: StageUnits) -> None:
    unit, force = _unit(units, name), units.factor("N m" if name in TURNS else "N")
    per = 1.0 / DEGREE if name in TURNS else 1.0
    per *= 1.0 if drive.acceleration else units.factor("N m" if name in TURNS else "N/m")
    api.CreateTypeAttr("acceleration" if drive.acceleration else "force")
    api.CreateStiffnessAttr(drive.stiffness / per)
    api.CreateDampingAttr(drive.damping / per)
    api.CreateTargetPositionAttr(drive.target / unit)
    api.CreateTargetVelocityAttr(drive.speed / unit)
    api.CreateMaxForceAttr(drive.most / force)
