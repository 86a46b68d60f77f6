"""What can be wrong with a skeleton and with what follows it. NumPy only."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsim.geometry.rotation import unit_quat
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import DUAL, LINEAR, LOOSE, Follow, Skeleton, Skinned
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import check_rigid_motion, object_warning, thing_error
from wsim.scene.methods import driving_bodies, paths_following

UNIT = 1e-3            # by which a quaternion's length may differ from 1 without a word
MOST = 1 << 16         # joints of a skeleton: their numbers have 16 bits on the device


def check(thing: Skeleton, scene: Scene) -> Iterator[Problem]:
    found = [*_check_skeleton_arrays(thing)]
    found = found or [*_check_joint_tree(thing), *_check_skeleton_numbers(thing), *_check_driving_bodies(thing, scene)]
    yield from found
    if any(problem.fatal for problem in found):
        return
    for collider in scene.colliders:
        shape: Any = collider.shape
        skin = getattr(shape, "poses", None)
        if isinstance(skin, Skinned) and skin.skeleton is thing:
            yield from _check_skinned_points(collider.path, skin)
            if collider.motion != thing.motion:
                yield thing_error(collider.path, f"its points follow {thing.path}, and its motion is another",
                                   f"the motion of {thing.path}, in whose space they are", "give it motion=bones.motion")
            if len(skin.points) != len(shape.points):
                yield thing_error(collider.path, f"{len(skin.points)} skinned points", f"{len(shape.points)}, as many as "
                                   "its shape has", "give it the points at the start: Surface(skin.at(0.0), ...)")
    for pin in scene.all_pins():
        if isinstance(pin.follows, Follow) and pin.follows.skin.skeleton is thing:
            yield from _check_following_pin(pin.path, pin.follows, len(pin.points))


def _check_skeleton_arrays(bones: Skeleton) -> Iterator[Problem]:
    n, keys = len(bones.joints), len(bones.times)
    wanted = {"bind": (n, 4, 4), "rest": (n, 4, 4), "parents": (n,), "animated": (n,), "translations": (keys, n, 3),
              "rotations": (keys, n, 4), "scales": (keys, n, 3)}
    for name, shape in wanted.items():
        value = getattr(bones, name)
        if value is not None and value.shape != shape:
            yield thing_error(bones.path, f"{name} of shape {value.shape}", f"{shape}: {n} joints, {keys} keys",
                               f"give {name} of each")
    if not 0 < n <= MOST:
        yield thing_error(bones.path, f"{n} joints", f"1 to {MOST}", "name its joints, or split it")
    if len(set(bones.joints)) < n:
        again = next(name for name in bones.joints if bones.joints.count(name) > 1)
        yield thing_error(bones.path, f"two joints are named {again}", "a name of its own for each", "rename one")
    if bones.weights is not None and bones.weights.values.shape[1:] != (len(bones.shapes),):
        yield thing_error(bones.path, f"weights of shape {bones.weights.values.shape}", f"(keys, {len(bones.shapes)})",
                           "give a weight for each blend shape at each key")
    if not (np.isfinite(bones.times).all() and (np.diff(bones.times) > 0.0).all()):
        yield thing_error(bones.path, "its key times do not increase, or are not finite",
                           "finite times, each later than the one before",
                           "sort its keys, and leave one of those at the same time")


def _check_joint_tree(bones: Skeleton) -> Iterator[Problem]:
    n = len(bones.joints)
    wrong = (bones.parents < -1) | (bones.parents >= n)
    if wrong.any():
        k = int(np.argmax(wrong))
        yield thing_error(bones.path, f"the parent of {bones.joints[k]} is joint {bones.parents[k]}",
                           f"-1 (a root) to {n - 1}", "give each joint the number of another, or -1")
        return
    try:
        skinning.joints_by_depth(bones.parents)
    except ValueError:
        ring = _joint_cycle(bones.parents)
        yield thing_error(bones.path, f"joints hang on each other in a ring: {' < '.join(bones.joints[j] for j in ring)}",
                           "a tree", "give one of them the parent -1")


def _joint_cycle(parents: np.ndarray) -> list[int]:
    """Joints that are above themselves, one of them first and last."""
    for start in range(len(parents)):
        seen, j = [start], int(parents[start])
        while j >= 0 and j not in seen:
            seen.append(j)
            j = int(parents[j])
        if j == start:
            return [*seen, start]
    return []


def _check_skeleton_numbers(bones: Skeleton) -> Iterator[Problem]:
    path = bones.path
    for name in ("bind", "rest", "translations", "rotations", "scales"):
        value = getattr(bones, name)
        if value is not None and not np.isfinite(value).all():
            yield thing_error(path, f"{name} hold NaN or infinity", "finite numbers", "export the skeleton again")
            return
    for name in ("bind", "rest"):
        if np.abs(getattr(bones, name)[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(initial=0.0) > 1e-9:
            yield thing_error(path, f"{name} transforms that are not affine", "(0, 0, 0, 1) as the last row",
                               "give matrices that " "act on columns, translation in the last column")
    flat = skinning.is_singular_transform(bones.bind)
    if flat.any():
        yield thing_error(path, f"the bind transform of {bones.joints[int(np.argmax(flat))]} flattens space",
                           "one with an inverse", "bind with scales other than zero")
    if bones.rotations is not None:
        size = np.linalg.norm(bones.rotations[:, bones.animated], axis=-1)
        if (size == 0.0).any():
            yield thing_error(path, "a rotation of length 0", "unit quaternions (x, y, z, w)",
                               "give (0, 0, 0, 1) for no rotation")
        elif np.abs(size - 1.0).max(initial=0.0) > UNIT:
            yield object_warning(path, f"quaternions of length {size.min():.4g} to {size.max():.4g}, which are divided by it",
                                 "unit quaternions (x, y, z, w)", "normalise them")
    yield from check_rigid_motion(path, bones.motion, "put the scale into stretch")


def _check_driving_bodies(bones: Skeleton, scene: Scene) -> Iterator[Problem]:
    there = {body.path for body in scene.things("Body")}
    for joint, body in bones.bodies.items():
        if joint not in bones.joints:
            yield thing_error(bones.path, f"{body} drives joint {joint}, which it does not have", ", ".join(bones.joints[:5]),
                               "name one of its joints")
        if body not in there:
            yield thing_error(bones.path, f"joint {joint} is driven by {body}, which is no rigid body here",
                               ", ".join(sorted(there)[:5]) or "none, the scene has none", "name a rigid body")
    if bones.bodies and (skins := paths_following(scene, bones)):
        apart = driving_bodies(scene)
        others = [b.path for b in scene.things("Body") if b.path not in apart and any(c.meets for c in b.colliders)]
        if scene.bodies() and others:
            yield thing_error(others[0],
                               f"can meet {scene.bodies()[0].path}, where {skins[0]} follows {bones.path}, whose joints "
                               "other bodies drive: those take their frame before points do",
                               "bodies that drive joints, or meet "
                               "nothing", "switch its collisions off (physics:collisionEnabled, Collider.meets), or let it "
                               "drive a joint")
        meeting = [path for path in sorted(set(bones.bodies.values())) for b in scene.things("Body")
                   if b.path == path and any(c.meets for c in b.colliders)]
        if scene.bodies() and meeting:
            yield object_warning(meeting[0],
                                 f"drives a joint of {bones.path}, and cloth and soft bodies do not meet it, but what "
                                 f"follows {bones.path} ({', '.join(skins[:3])})", "a skinned mesh that collides, in its stead",
                                 "let the mesh of the character collide")


def _check_skinned_points(path: str, skin: Skinned) -> Iterator[Problem]:
    n = len(skin.skeleton.joints)
    if skin.joints.shape != skin.weights.shape:
        yield thing_error(path, f"{skin.joints.shape} joints and {skin.weights.shape} weights", "as many of both",
                           "give each point a weight for each of its joints")
        return
    if ((skin.joints < 0) | (skin.joints >= n)).any():
        bad = skin.joints[(skin.joints < 0) | (skin.joints >= n)][0]
        yield thing_error(path, f"a point follows joint {bad}", f"0 to {n - 1}, joints of {skin.skeleton.path}",
                           "name one of them")
        return
    if not (np.isfinite(skin.weights).all() and np.isfinite(skin.points).all() and np.isfinite(skin.geom).all()):
        yield thing_error(path, "skinned points, weights or their bind transform hold NaN or infinity", "finite numbers",
                           "export the mesh again")
        return
    sums = skin.weights.sum(axis=1)
    if (sums <= 0.0).any():
        yield thing_error(path, f"the weights of {int((sums <= 0.0).sum())} points sum to 0 or less, first of point "
                           f"{int(np.argmax(sums <= 0.0))}", "a sum of 1", "give it a joint with the weight 1")
    elif np.abs(sums - 1.0).max() > LOOSE:
        k = int(np.argmax(np.abs(sums - 1.0)))
        yield object_warning(path, f"the weights of {int((np.abs(sums - 1.0) > LOOSE).sum())} points do not sum to 1 (of point "
                                   f"{k} to "
                             f"{sums[k]:.4g}): they are divided by their sum", "a sum of 1",
                             "normalise them where they are painted")
    if skinning.is_singular_transform(skin.geom[None]).any():
        yield thing_error(path, "its geomBindTransform flattens it", "one with an inverse",
                           "bind it with scales other than zero")
    if skin.method not in (LINEAR, DUAL):
        yield thing_error(path, f"skinningMethod is '{skin.method}'", f"{LINEAR} or {DUAL}", "choose one of them")
    yield from _check_blend_shapes(path, skin)
    yield from _check_corrective_shapes(path, skin)


def _check_corrective_shapes(path: str, skin: Skinned) -> Iterator[Problem]:
    """Corrective shapes of joints that bodies drive."""
    bones = skin.skeleton
    for shape in skin.blends:
        if 0 <= shape.joint < len(bones.joints) and bones.joints[shape.joint] in bones.bodies:
            yield thing_error(path, f"blend shape {shape.name} is driven by joint {bones.joints[shape.joint]}, which "
                               f"{bones.bodies[bones.joints[shape.joint]]} drives", "joints that are animated",
                               "leave the shape out")


def _check_blend_shapes(path: str, skin: Skinned) -> Iterator[Problem]:
    for shape in skin.blends:
        name, k = f"blend shape {shape.name}", len(shape.points)
        if ((shape.points < 0) | (shape.points >= len(skin.points))).any() or shape.offsets.shape[1] != k:
            yield thing_error(path, f"{name} has {shape.offsets.shape[1]} offsets for points {shape.points.min(initial=0)} to "
                               f"{shape.points.max(initial=0)}", f"one for each, points 0 to {len(skin.points) - 1}",
                               "export it again")
        if not np.isfinite(shape.offsets).all() or (np.diff(shape.knots) <= 0.0).any() or (shape.knots == 0.0).any():
            yield thing_error(path, f"{name} has weights {shape.knots.tolist()} of offsets, or offsets that are not finite",
                               "increasing weights other than 0, finite offsets", "export it again")
        if shape.joint >= 0 and (shape.joint >= len(skin.skeleton.joints) or not shape.width > 0.0):
            yield thing_error(path, f"{name} is driven by joint {shape.joint} over {shape.width:g} rad",
                               f"joints 0 to {len(skin.skeleton.joints) - 1}, an angle > 0",
                               "name a joint, and give it an angle")
        if shape.joint >= 0 and not np.abs(unit_quat(np.array(shape.rotation)) - shape.rotation).max() < UNIT:
            yield thing_error(path, f"{name} is driven to {shape.rotation}", "a unit quaternion (x, y, z, w)", "normalise it")


def _check_following_pin(path: str, follow: Follow, count: int) -> Iterator[Problem]:
    found = [problem for problem in _check_skinned_points(path, follow.skin) if problem.fatal]
    yield from found
    if len(follow.corners) != count or len(follow.places) != count:
        yield thing_error(path, f"{count} points and {len(follow.corners)} places on the mesh that it follows",
                           "one place a point", "give a place for each")
    elif not found and ((follow.corners < 0) | (follow.corners >= len(follow.skin.points))).any():
        yield thing_error(path, "a place names a point that the mesh does not have", f"0 to {len(follow.skin.points) - 1}",
                           "count from 0, in the order of the mesh's points")
