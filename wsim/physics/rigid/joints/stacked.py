"""Joints of robots: merges several joints between the same two bodies into one, and reads passive springs and dampers.

In an articulation with `newton:jointsAddMobility`, revolute and prismatic joints between the same two bodies act one behind the
other, the first outermost, as MuJoCo has them: R = R(a_1) R(a_2) ... R(a_n). One `Joint` has the same freedom: rotX (twist)
is the innermost turn, rotY and rotZ (swing) are the outer turns, and `Joint.hinges` says where each of them turns. That is
exact in reduced coordinates. In maximal ones, two turns about one point are exact; with three, limits and springs agree only
for small angles. So does a slide that a turn carries along. Without the attribute each joint is a constraint of its own.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
from pxr import Usd, UsdPhysics

from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import AXES, LOCKED, PASSIVE, SHIFTS, Drive, Joint
from wsim.usd import names
from wsim.usd.stage import StageReading, StageUnits

SINGLE = ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint")
DAMPING, STIFFNESS, REST, REFERENCE = "newton:damping", "mjc:stiffness", "mjc:springref", "mjc:ref"
ANGLE = "mjc:compiler:angle"                # of a PhysicsScene: unit of REST and REFERENCE of revolute joints
ACROSS = 1e-3                # cosine between axes that count as orthogonal
DEGREE = np.pi / 180.0


def stacked_joints(reading: StageReading, prim: Usd.Prim) -> list[Usd.Prim]:
    """Joints that act one behind the other with a joint, outermost first; of others the joint alone."""
    if reading.stacks is None:
        reading.stacks = {}
        groups = defaultdict(list)
        for each in Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
            if each.GetTypeName() in SINGLE and UsdPhysics.Joint(each).GetJointEnabledAttr().Get(reading.start) is not False:
                api = UsdPhysics.Joint(each)
                ends = tuple(tuple(rel.GetTargets()) for rel in (api.GetBody0Rel(), api.GetBody1Rel()))
                groups[ends].append(each)
        for ends, joints in groups.items():
            if len(joints) > 1 and len(ends[1]) == 1 and _joints_add_mobility(reading, reading.stage.GetPrimAtPath(ends[1][0])):
                reading.stacks |= {joint.GetPath(): joints for joint in joints}
    return reading.stacks.get(prim.GetPath(), [prim])


def _joints_add_mobility(reading: StageReading, prim: Usd.Prim) -> bool:
    """Whether a body lies in an articulation whose joints add mobility."""
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(names.JOINTS_ADD)
        if attribute and attribute.Get(reading.start) is not None:
            return bool(attribute.Get(reading.start))
        prim = prim.GetParent()
    return False


def merge_joints(reading: StageReading, joints: list[Joint]) -> Joint | None:
    """One joint with the freedom of revolute and prismatic ones, outermost first; None, with an error, where axes are not
    orthogonal or a drive varies in time."""
    free = [next(name for name in AXES if not joint.locked(name)) for joint in joints]
    turns = [joint for joint, name in zip(joints, free, strict=True) if name == "rotX"][::-1]          # innermost first
    shifts = [joint for joint, name in zip(joints, free, strict=True) if name == "transX"]
    axes: list[np.ndarray] = []
    for joint in (*turns, *shifts):
        axis = rotation.quat_rotate(joint.turn1, np.array([1.0, 0.0, 0.0]))
        if all(abs(axis @ other) < 1.0 - ACROSS for other in axes):
            axes.append(axis)
    apart = all(_axes_differ(group) for group in (turns, shifts))
    if len(axes) > 3 or not apart or any(abs(a @ b) > ACROSS for k, a in enumerate(axes) for b in axes[:k]):
        reading.fail(joints[0].path, f"{len(joints)} joints between the same bodies add mobility along axes that are not "
                     "orthogonal; allowed: orthogonal axes; fix: put a body between each two of these joints")
        return None
    if any(varying.path in {joint.path for joint in joints} for _, varying in reading.varying):
        reading.fail(joints[0].path, f"is one of {len(joints)} joints that add mobility between the same bodies, and a drive "
                     "of theirs varies in time; allowed: constant targets; fix: put a body between each two of these joints")
        return None
    if "transX" in free[(free + ["rotX"]).index("rotX"):]:
        reading.warn(joints[0].path, "a slide of theirs turns with a hinge before it, and here it does not: that is right for "
                     "small angles alone; put a body between each two of these joints")
    R = np.stack(axes, 1) if len(axes) == 3 else np.eye(3)
    if len(axes) < 3:
        R = np.stack([*axes, *_complete_axes(axes)], 1)
    if np.linalg.det(R) < 0.0:
        R[:, 2] *= -1.0
    first = (turns or shifts)[0]
    found = replace(first, path=joints[0].path, limits=dict.fromkeys(AXES, LOCKED), drives={}, armature={},
                    friction={}, mimics={}, hinges={})
    between = rotation.quat_product(first.turn0, rotation.quat_conjugate(first.turn1))  # body 1 in body 0, where it stands
    found.turn1 = rotation.matrix_quat(R)
    found.turn0 = rotation.quat_product(between, found.turn1)
    for joint in joints:
        _add_joint_freedom(found, joint, R, several=len(turns) > 1)
    return found


def _axes_differ(joints: list[Joint]) -> bool:
    """Whether no two of these joints have the same axis."""
    axes = [rotation.quat_rotate(joint.turn1, np.array([1.0, 0.0, 0.0])) for joint in joints]
    return all(abs(a @ b) < 1.0 - ACROSS for k, a in enumerate(axes) for b in axes[:k])


def _complete_axes(axes: list[np.ndarray]) -> list[np.ndarray]:
    if len(axes) == 2:
        return [np.cross(axes[0], axes[1])]
    other = np.cross(axes[0], np.eye(3)[np.argmin(np.abs(axes[0]))])
    other /= np.linalg.norm(other)
    return [other, np.cross(axes[0], other)]


def _add_joint_freedom(found: Joint, joint: Joint, R: np.ndarray, several: bool) -> None:
    """Gives a merged joint the freedom of one of its parts. several: it has more than one turn."""
    own = next(name for name in AXES if not joint.locked(name))
    along = rotation.quat_rotate(joint.turn1, np.array([1.0, 0.0, 0.0])) @ R
    k = int(np.argmax(np.abs(along)))
    name, sign = AXES[k + 3 * (own == "rotX")], float(np.sign(along[k]))
    del found.limits[name]
    if several and own == "rotX":
        found.hinges[name] = tuple(((joint.at1 - found.at1) @ R).tolist())
    if own in joint.limits:
        low, high = joint.limits[own]
        found.limits[name] = (low, high) if sign > 0.0 else (-high, -low)
    if own in joint.drives:
        drive = joint.drives[own]
        found.drives[name] = replace(drive, target=sign * drive.target, speed=sign * drive.speed)
    for field in PASSIVE:
        if own in getattr(joint, field):
            getattr(found, field)[name] = getattr(joint, field)[own]
    if own in joint.mimics:
        mimic = joint.mimics[own]
        found.mimics[name] = replace(mimic, coefficients=tuple(sign * c for c in mimic.coefficients))


def passive_drives(reading: StageReading, prim: Usd.Prim, name: str, drives: dict[str, Drive]) -> dict[str, Drive]:
    """Drives of a joint with one free coordinate, and with its passive spring and damper (NewtonJointAPI, MjcJointAPI)."""
    values = {key: float(attribute.Get(reading.start) or 0.0) for key in (DAMPING, STIFFNESS)
              if (attribute := prim.GetAttribute(key)) and attribute.HasAuthoredValue()}
    damping, stiffness = _passive_joint_gains(reading.units, name, values)
    if damping == 0.0 and stiffness == 0.0:
        return drives
    own = drives.get(name, Drive())
    if own.acceleration or own.speed or (stiffness and name in drives):
        reading.warn(prim.GetPath(), f"{DAMPING} and {STIFFNESS} are ignored: they do not combine with this joint's drive; "
                     "remove the drive to use them")
        return drives
    rest, zero = (mujoco_reference_value(reading, prim, name, key) for key in (REST, REFERENCE))
    rest = rest - zero if stiffness else own.target
    return drives | {name: replace(own, damping=own.damping + damping, stiffness=own.stiffness + stiffness, target=rest)}


def mujoco_reference_value(reading: StageReading, prim: Usd.Prim, name: str, key: str) -> float:
    """Value of mjc:ref or mjc:springref of a joint [m] or [rad]; 0 where it is not authored. In the pose of the stage, the
    joint coordinate is mjc:ref in MuJoCo and 0 in wsim. So mjc:ref is subtracted from limits and from the spring's rest."""
    attribute = prim.GetAttribute(key)
    value = float(attribute.Get(reading.start) or 0.0) if attribute and attribute.HasAuthoredValue() else 0.0
    if name in SHIFTS or value == 0.0:
        return value * reading.units.metres
    scenes = (each.GetAttribute(ANGLE) for each in reading.stage.Traverse() if each.GetTypeName() == "PhysicsScene")
    radians = any(a and str(a.Get(reading.start)) == "radian" for a in scenes)
    return value if radians else value * DEGREE


def _passive_joint_gains(units: StageUnits, name: str, values: dict[str, float]) -> tuple[float, float]:
    """Damping and stiffness in SI units: newton's per degree, MuJoCo's per radian."""
    damping, stiffness = values.get(DAMPING, 0.0), values.get(STIFFNESS, 0.0)
    if name in SHIFTS:
        return damping * units.factor("N s/m"), stiffness * units.factor("N/m")
    return damping / DEGREE * units.factor("N m"), stiffness * units.factor("N m")
