"""What can be wrong with a joint. NumPy only."""

from collections.abc import Iterator
from math import atan2, hypot, inf, isfinite, isnan, pi

import numpy as np

from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import AXES, DISTANCE, PASSIVE, SHIFTS, TURNS, Joint
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import check_rigid_motion, object_warning, thing_error

UNIT = 1e-4                  # departure of |q| from 1 that float32 quaternions keep
CLOSED = 1e-3                # [m], [rad] by which a joint may start apart without a word
TINY = 1e-9                  # [rad] of a cone that is closed
NAMES = (*AXES, DISTANCE)
MANY_TURNS = 4.0 * pi          # [rad] of a limit: beyond, it was meant in degrees more often than not
LARGEST = 1e15               # [N/m], [N], ... of what drives: beside more, double precision keeps no other force
SAME = 1e-6                  # of a singular value over the largest: rows that lock the same


def check(joint: Joint, scene: Scene) -> Iterator[Problem]:
    wrong = [*_check_joint_bodies(joint, scene), *_check_joint_numbers(joint), *_check_passive_terms(joint, scene)]
    yield from wrong
    yield from _check_joint_turns(joint)
    if not any(p.fatal for p in wrong):
        yield from _check_joint_closed(joint, scene)
        yield from _check_joint_twins(joint, scene)


def _check_joint_bodies(joint: Joint, scene: Scene) -> Iterator[Problem]:
    path, bodies = joint.path, {body.path for body in scene.things("Body")}
    if joint.body0 == joint.body1:
        found = f"joins {joint.body0} to itself" if joint.body0 else "joins no body"
        yield thing_error(path, found, "two bodies, or one and the world", "name another as body0 or body1 (physics:body0, "
                          "physics:body1)")
        return
    for body in (joint.body0, joint.body1):
        if body and body not in bodies:
            yield thing_error(path, f"joins {body}, which is no rigid body that moves", "a body of the scene, or \"\"",
                              "name a prim with PhysicsRigidBodyAPI, or add the body; what keyframes move is a collider: "
                              "scene.joint(kind, path, collider, body)")
    if joint.body0 and joint.body1 and joint.still:
        yield thing_error(path, f"joins two bodies and hangs on {joint.still}", "two sides", "take one of them out")
    yield from check_rigid_motion(path, joint.motion, "what a joint hangs on keeps its size: take the scale out of its motion")


def _check_joint_numbers(joint: Joint) -> Iterator[Problem]:
    path = joint.path
    for name in ("at0", "at1", "turn0", "turn1"):
        value = getattr(joint, name)
        if not np.isfinite(value).all():
            yield thing_error(path, f"{name} is not finite", "finite numbers", f"author another {name}")
        elif name.startswith("turn") and abs(np.linalg.norm(value) - 1.0) > UNIT:
            yield thing_error(path, f"{name} is a quaternion of length {np.linalg.norm(value):g}",
                               "a unit quaternion (x, y, z, w)", f"divide physics:localRot{name[-1]} by its length")
    for name in {*joint.limits, *joint.drives} - set(NAMES):
        yield thing_error(path, f"has no axis {name}", ", ".join(NAMES), "name one of these")
    for name, (low, high) in joint.limits.items():
        if isnan(low) or isnan(high) or low == inf or high == -inf:
            yield thing_error(path, f"limits of {name} are {low:g} and {high:g}",
                               "numbers, -inf for none below, inf for none above", "author other limits")
        elif low > high:
            yield thing_error(path, f"limits of {name} are {low:g} and {high:g}, the lower above the upper",
                               "a lower limit that is not above the upper one", "swap them; equal ones lock the coordinate")
    for name, drive in joint.drives.items():
        for field in ("stiffness", "damping", "most"):
            value = getattr(drive, field)
            if not value >= 0.0 or (value == inf and field != "most"):
                yield thing_error(path, f"{field} of the drive of {name} is {value:g}", "finite and >= 0",
                                   f"author another {field}: a drive that pushes the other way has another target")
            elif value > LARGEST and field != "most":                       # files say no limit by such numbers
                yield thing_error(path, f"{field} of the drive of {name} is {value:g}", f"up to {LARGEST:g}",
                                   f"author a smaller one; where {name} is not to move, lock it by two equal limits")
        if not (isfinite(drive.target) and isfinite(drive.speed)):
            yield thing_error(path, f"the drive of {name} goes to {drive.target:g} at {drive.speed:g}", "finite numbers",
                               "author another target")
        elif max(abs(drive.target), abs(drive.speed)) > LARGEST:
            yield thing_error(path, f"the drive of {name} goes to {drive.target:g} at {drive.speed:g}",
                               f"sizes up to {LARGEST:g}", "author another target or speed")
        if joint.locked(name):
            yield object_warning(path, f"drives {name}, which its limits lock", "drives of axes that are free, or have a range",
                                 f"give {name} limits that leave it room, or take the drive away")
    if joint.cone is not None and not all(c >= 0.0 for c in joint.cone):
        yield thing_error(path, f"its cone is {joint.cone}", "two angles >= 0, inf for free", "author other cone angles")
    for name in ("force", "torque"):
        if not getattr(joint, name) >= 0.0:
            yield thing_error(path, f"breaks at a {name} of {getattr(joint, name):g}", ">= 0, inf for never",
                               f"author another physics:break{name.capitalize()}")


def _check_joint_turns(joint: Joint) -> Iterator[Problem]:
    """Limits of turns that look like degrees."""
    for name in TURNS:
        low, high = joint.limits.get(name, (0.0, 0.0))
        if MANY_TURNS < max(abs(low), abs(high)) < LARGEST and low <= high:
            yield object_warning(joint.path, f"limits of {name} are {low:g} and {high:g} rad, which is more than two turns",
                                 "radians", f"if these are degrees, give low=np.radians({low:g}), high=np.radians({high:g})")


def _check_passive_terms(joint: Joint, scene: Scene) -> Iterator[Problem]:
    """Armature, dry friction, mimics."""
    path = joint.path
    for field in PASSIVE:
        for name, value in getattr(joint, field).items():
            if name not in AXES or not 0.0 <= value <= LARGEST:
                yield thing_error(path, f"{field} of {name} is {value:g}", f"from 0 to {LARGEST:g}, of {', '.join(AXES)}",
                                  f"author another {field}")
    others = {other.path: other for other in scene.things("Joint") if other.enabled}
    for name, mimic in joint.mimics.items():
        if name not in AXES or joint.locked(name):
            yield thing_error(path, f"{name} mimics {mimic.leader}, and cannot move", ", ".join(joint.free()),
                              "name one of these")
        elif not 1 <= len(mimic.coefficients) <= 5 or not all(isfinite(c) for c in mimic.coefficients):
            yield thing_error(path, f"its mimic has the coefficients {mimic.coefficients}", "one to five finite numbers",
                              "author others")
        elif mimic.leader and mimic.leader not in others:
            yield thing_error(path, f"mimics {mimic.leader}, which is no joint of the scene that is enabled",
                              "a joint with one free coordinate", "name such a joint; one that another joint has taken in "
                              "needs a body between them")
        elif mimic.leader == path:
            yield thing_error(path, "mimics itself", "another joint", "name another joint")
        elif mimic.leader and len(others[mimic.leader].free()) != 1:
            yield thing_error(path, f"mimics {mimic.leader}, which has {len(others[mimic.leader].free())} free coordinates",
                              "a joint with one", "name another joint")


def joint_frames_at_start(joint: Joint, scene: Scene) -> list[np.ndarray]:
    """Both frames of a joint at the start, to the world (4, 4) [m]."""
    by_path, found = {body.path: body for body in scene.things("Body")}, []
    for body, at, turn in ((joint.body0, joint.at0, joint.turn0), (joint.body1, joint.at1, joint.turn1)):
        M = (by_path[body].motion if body else joint.motion).at(0.0)
        F = np.eye(4)
        F[:3, :3], F[:3, 3] = rotation.quaternion_to_matrix(rotation.unit_quat(turn)), at
        found.append(M @ F)
    return found


def _locked_rows(joint: Joint, scene: Scene) -> np.ndarray:
    """What a joint locks at the start: rows over angular velocity, and velocity at the origin, of side 1 against side 0."""
    A, B = joint_frames_at_start(joint, scene)
    rows = [np.concatenate([np.cross(B[:3, 3], A[:3, k]), A[:3, k]]) for k in range(3) if joint.locked(SHIFTS[k])]
    rows += [np.concatenate([A[:3, k], np.zeros(3)]) for k in range(3) if joint.locked(TURNS[k])]
    return np.array(rows).reshape(-1, 6)


def _check_joint_twins(joint: Joint, scene: Scene) -> Iterator[Problem]:
    """A joint that joins the same two bodies as one before, where one of them changes nothing, or both leave nothing free."""
    own = {joint.body0 or joint.still, joint.body1 or joint.still}
    for other in scene.things("Joint"):
        if other is joint or not joint.enabled:
            return
        if not other.enabled or {other.body0 or other.still, other.body1 or other.still} != own:
            continue
        both = [_locked_rows(each, scene) for each in (joint, other)]
        alone, together = [len(rows) for rows in both], np.concatenate(both)
        rank = int(np.linalg.matrix_rank(together, tol=SAME * np.linalg.norm(together))) if min(alone) else 7
        said = "one of them locks nothing more" if rank <= max(alone) else "together they leave nothing free"
        if rank <= max(alone) or rank == 6 > max(alone):
            yield object_warning(joint.path, f"joins the same two bodies as {other.path}, and {said}",
                                 "one joint of two bodies, or joints that leave a motion in common",
                                 "disable one of them (physics:jointEnabled = 0)")


def _check_joint_closed(joint: Joint, scene: Scene) -> Iterator[Problem]:
    """A joint that does not start closed."""
    if not joint.enabled:
        return
    A, B = joint_frames_at_start(joint, scene)
    d = A[:3, :3].T @ (B[:3, 3] - A[:3, 3])
    low, high = zip(*(_limit_range(joint, name) for name in SHIFTS), strict=True)
    shift = float(np.linalg.norm(d - np.clip(d, low, high)))
    low_far, high_far = _limit_range(joint, DISTANCE)
    shift = max(shift, abs(float(np.linalg.norm(d)) - min(max(float(np.linalg.norm(d)), low_far), high_far)))
    turn = _start_angle_violation(joint, rotation.matrix_quat(A[:3, :3].T @ B[:3, :3]))
    if shift > CLOSED or turn > CLOSED:
        yield object_warning(joint.path,
                             f"starts {shift:.3g} m and {turn:.3g} rad apart: its bodies are pulled together, at most "
                             "4 m/s and 10 rad/s fast", "frames that meet, within its "
                             "limits", "author physics:localPos0, localRot0 or those of body 1 again, or other limits")


def _start_angle_violation(joint: Joint, q: np.ndarray) -> float:
    """Angle [rad] by which a joint starts beyond what its turns and its cone allow; q: from frame 1 to frame 0."""
    if all(joint.locked(name) for name in TURNS):
        return float(np.linalg.norm(rotation.quaternion_logarithm(q)))
    x, w = (q[0], q[3]) if q[3] >= 0.0 else (-q[0], -q[3])
    twist = np.array([x, 0.0, 0.0, w]) / hypot(x, w) if hypot(x, w) > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])
    swing = rotation.quaternion_logarithm(rotation.quat_product(q, rotation.quat_conjugate(twist)))
    turned = np.array([2.0 * atan2(twist[0], twist[3]), swing[1], swing[2]])
    low, high = zip(*(_limit_range(joint, name) for name in TURNS), strict=True)
    beyond = float(np.linalg.norm(turned - np.clip(turned, low, high)))
    if joint.cone is not None:
        out = hypot(*(angle / max(limit, TINY) for angle, limit in zip(turned[1:], joint.cone, strict=True)))
        beyond = max(beyond, (1.0 - 1.0 / out) * float(np.linalg.norm(turned[1:])) if out > 1.0 else 0.0)
    return beyond


def _limit_range(joint: Joint, name: str) -> tuple[float, float]:
    low, high = joint.limits.get(name, (-inf, inf))
    return (low, max(low, high))
