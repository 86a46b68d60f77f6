"""UsdSkel -> `Skeleton` and `Skinned`; places on skinned meshes <-> `Follow`. Written by
`wsim.physics.animation.write`.

A skeleton is in the scene where a mesh collider or a pin follows it, or bodies drive it. Joints are found by name: the order of
an animation, and that of a mesh's own skel:joints, may be another than the skeleton's; a joint that is not animated is in its
rest pose. Keys are at all samples of translations, rotations and scales. wsim:skel:bodies names the rigid
bodies that drive joints, wsim:corrective:joint of a BlendShape the joint that drives it.
"""

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from wsim.physics.animation.objects import LINEAR, BlendShape, Follow, Skeleton, Skinned
from wsim.physics.animation.skinning import is_singular_transform, triangle_coordinates
from wsim.physics.animation.write import BODIES, DRIVEN, JOINT, ROTATION, WIDTH, author
from wsim.scene.curve import Curve, Motion
from wsim.usd import names
from wsim.usd.attributes import read_attribute, read_times
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import read_placement, split_placement

__all__ = ["author", "follow", "hang", "load"]

SAME = 1e-6            # of a stretch, by which it may change over time
UNIT = 1e-3            # by which a quaternion's length may differ from 1 without a word


def load(reading: StageReading, prim: Usd.Prim) -> Skeleton | None:
    """The skeleton of a prim, if something that was read before follows it."""
    relationship = prim.GetRelationship(BODIES)
    if relationship and relationship.GetTargets():
        _read_driving_bodies(reading, prim)
    return reading.bones.get(prim.GetPath())


def _read_driving_bodies(reading: StageReading, prim: Usd.Prim) -> None:
    """Adds the bodies that drive joints."""
    above = prim
    while above and above.GetTypeName() != "SkelRoot":
        above = above.GetParent()
    cache = UsdSkel.Cache()
    if above:
        cache.Populate(UsdSkel.Root(above), Usd.TraverseInstanceProxies())
    query = cache.GetSkelQuery(UsdSkel.Skeleton(prim))
    bones = query and cached_skeleton(reading, prim, query)
    if not bones:
        return
    bodies = [str(p) for p in prim.GetRelationship(BODIES).GetTargets()]
    joints = [str(name) for name in prim.GetAttribute(DRIVEN).Get() or ()]
    if len(joints) != len(bodies):
        reading.fail(prim.GetPath(), f"{BODIES} names {len(bodies)} bodies and {DRIVEN} {len(joints)} joints; author one joint "
                     "a body")
        return
    bones.bodies = dict(zip(joints, bodies, strict=True))


def cached_skeleton(reading: StageReading, prim: Usd.Prim, query: UsdSkel.SkeletonQuery) -> Skeleton | None:
    """The skeleton of a prim, once; None where it is broken (reported) or cannot be said so (its scale is animated)."""
    path = prim.GetPath()
    if path not in reading.bones:
        reading.bones[path] = _read_skeleton(reading, prim, query)
    return reading.bones[path]


def sound(reading: StageReading, bound) -> None:
    """Reports what is wrong with a skeleton that moves nothing: an animation that is not there, say."""
    if bound.prim.GetPath() not in reading.bones:
        _read_skeleton(reading, bound.prim, bound.skeleton)


def _read_skeleton(reading: StageReading, prim: Usd.Prim, query: UsdSkel.SkeletonQuery) -> Skeleton | None:
    path, units = prim.GetPath(), reading.units
    place = read_placement(reading, prim)
    try:
        frames, stretches = split_placement(place)
    except ValueError as error:
        reading.fail(path, str(error))
        return None
    if np.abs(stretches - stretches[0]).max() > SAME * np.abs(stretches[0]).max():
        return None
    if lost := _missing_animation_path(prim, query):
        unused = UsdSkel.Animation(reading.stage.GetPrimAtPath(lost)) and not prim.HasAPI(UsdSkel.BindingAPI)
        why = ("but has no SkelBindingAPI, so that USD ignores it; apply SkelBindingAPI" if unused else "which is no "
               "SkelAnimation that can be read (is a payload or reference missing?); name one")
        reading.fail(path, f"names {lost} as its animation, {why}, or leave skel:animationSource out for the rest pose")
        return None
    n = len(query.GetJointOrder())
    bind = _matrices_in_metres(query.GetJointWorldBindTransforms(), units.metres) if query.HasBindPose() else None
    rest = query.ComputeJointLocalTransforms(units.start, True) if query.HasRestPose() else None
    if bind is None or len(bind) != n:
        reading.fail(path, f"has {n} joints and {0 if bind is None else len(bind)} bind transforms; author bindTransforms, one "
                     "a joint")
        return None
    if is_singular_transform(bind).any():
        joint = query.GetJointOrder()[int(np.argmax(is_singular_transform(bind)))]
        reading.fail(path, f"the bind transform of {joint} flattens space; author one with an inverse: bind with scales other "
                     "than zero")
        return None
    more: dict[str, Any] = _read_skel_animation(reading, query) if query.GetAnimQuery() else {}
    stretch = None if np.array_equal(stretches[0], np.eye(3)) else stretches[0]
    return Skeleton(str(path), tuple(map(str, query.GetJointOrder())), bind,
                    _matrices_in_metres(rest, units.metres) if rest and len(rest) == n else None,
                    np.array(query.GetTopology().GetParentIndices(), np.int32), motion=Motion(place.times, frames),
                    stretch=stretch, **more)


def _missing_animation_path(prim: Usd.Prim, query: UsdSkel.SkeletonQuery) -> str:
    """Path of an animation that is named, for a skeleton that has none."""
    if query.GetAnimQuery():
        return ""
    while prim and not prim.IsPseudoRoot():
        relationship = prim.GetRelationship("skel:animationSource")
        if relationship and relationship.HasAuthoredTargets():
            targets = relationship.GetForwardedTargets()
            return str(targets[0]) if targets else ""
        prim = prim.GetParent()
    return ""


def _matrices_in_metres(matrices, metres: float) -> np.ndarray:
    """Matrices (n, 4, 4) [m] that act on columns."""
    found = np.array([np.array(M).T for M in matrices], np.float64).reshape(-1, 4, 4)
    found[:, :3, 3] *= metres
    return found


def _noted_sample_times(attribute: Usd.Attribute, codes: list[float], units: StageUnits) -> np.ndarray:
    """Times [s] of samples: those noted beside them, else of their time codes."""
    noted = read_times(attribute, units)
    return noted if noted is not None and len(noted) == len(codes) else units.time(np.array(codes, np.float64))


def _read_skel_animation(reading: StageReading, query: UsdSkel.SkeletonQuery) -> dict:
    """Keys of joints and of blend shapes, in the skeleton's order."""
    animation, units = query.GetAnimQuery(), reading.units
    place = {str(name): k for k, name in enumerate(animation.GetJointOrder())}
    order = [place.get(str(name), -1) for name in query.GetJointOrder()]
    found: dict[str, Any] = {}
    if strange := [name for name in place if name not in set(map(str, query.GetJointOrder()))]:
        reading.warn(animation.GetPrim().GetPath(), f"moves {', '.join(strange[:3])}{' ...' * (len(strange) > 3)}, which "
                     f"{query.GetPrim().GetPath()} does not have: {len(strange)} of its {len(place)} joints move nothing; name "
                     "joints of that skeleton")
    if max(order, default=-1) >= 0:
        codes = list(animation.GetJointTransformTimeSamples()) or [units.start]
        parts = [animation.ComputeJointLocalTransformComponents(code) for code in codes]
        if any(part is None or any(len(column) != len(place) for column in part) for part in parts):
            reading.fail(animation.GetPrim().GetPath(), f"has {len(place)} joints and other numbers of translations, rotations "
                         "or scales; author one a joint")
            return {}
        T, S = (np.array([np.array(part[k], np.float32) for part in parts])[:, order] for k in (0, 2))
        Q = np.array([[[*q.GetImaginary(), q.GetReal()] for q in part[1]] for part in parts], np.float32)[:, order]
        size = np.linalg.norm(Q, axis=-1)
        if not np.isfinite(Q).all() or (size == 0.0)[:, np.array(order) >= 0].any():
            reading.fail(animation.GetPrim().GetPath(), "holds a rotation that is no quaternion (0, NaN or infinity); export "
                         "the animation again")
            return {}
        if np.abs(size - 1.0).max(initial=0.0) > UNIT:
            reading.warn(animation.GetPrim().GetPath(), f"holds quaternions of length {size.min():.4g} to {size.max():.4g}: "
                         "they are divided by it; author unit quaternions")
        times = _noted_sample_times(UsdSkel.Animation(animation.GetPrim()).GetTranslationsAttr(), codes, units)
        found |= {"times": times, "translations": T * units.metres, "rotations": Q, "scales": S,
                  "animated": np.array(order) >= 0}
    shapes = [str(name) for name in animation.GetBlendShapeOrder()]
    if shapes:
        codes = list(animation.GetBlendShapeWeightTimeSamples()) or [units.start]
        values = [np.array(animation.ComputeBlendShapeWeights(code), np.float64) for code in codes]
        times = _noted_sample_times(UsdSkel.Animation(animation.GetPrim()).GetBlendShapeWeightsAttr(), codes, units)
        if all(len(v) == len(shapes) for v in values):
            found |= {"shapes": tuple(shapes), "weights": Curve(times, np.array(values))}
    return found


def follow(reading: StageReading, bound, prim: Usd.Prim) -> Skinned | None:
    """Skinned points of a mesh; None where that is broken (reported), or where its points, its influences or the scale of its
    skeleton are animated besides. bound: `wsim.usd.prims.skeletons.SkinnedMesh`."""
    query, start, units = bound.query, reading.units.start, reading.units
    points = UsdGeom.PointBased(prim).GetPointsAttr()
    primvars = [p for p in (query.GetJointIndicesPrimvar(), query.GetJointWeightsPrimvar()) if p]
    varying = [points, query.GetGeomBindTransformAttr(), *(p.GetAttr() for p in primvars)]
    if any(a and a.ValueMightBeTimeVarying() for a in varying) or not query.HasJointInfluences():
        return None
    bones = cached_skeleton(reading, bound.prim, bound.skeleton)
    if bones is None:
        return None
    x = np.array(points.Get(start), np.float32)
    found = query.ComputeVaryingJointInfluences(len(x), start)
    if not found or not len(found[0]):
        return None
    joints, weights = (np.array(column).reshape(len(x), -1) for column in found)
    own = query.GetJointOrder()
    if own:
        number = {name: k for k, name in enumerate(bones.joints)}
        missing = [str(name) for name in own if str(name) not in number]
        if missing:
            reading.fail(prim.GetPath(), f"is bound to joint {missing[0]}, which {bones.path} does not have; name its joints "
                         "in skel:joints")
            return None
        order = np.array([number[str(name)] for name in own])
        joints = order[np.clip(joints, 0, len(order) - 1)]
    geom = _matrices_in_metres([query.GetGeomBindTransform(start)], units.metres)[0]
    method = str(query.GetSkinningMethod() or LINEAR)
    return Skinned(bones, x * units.metres, joints, weights, geom, method, _read_blend_shapes(reading, bound, bones))


def _read_blend_shapes(reading: StageReading, bound, bones: Skeleton) -> list[BlendShape]:
    """Blend shapes of a mesh."""
    if not bound.query.HasBlendShapes():
        return []
    query, metres = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(bound.query.GetPrim())), reading.units.metres
    points, offsets = query.ComputeBlendShapePointIndices(), query.ComputeSubShapePointOffsets()
    shapes = []
    for k, name in enumerate(map(str, bound.query.GetBlendShapeOrder())):
        subs = [s for s in range(query.GetNumSubShapes()) if query.GetBlendShapeIndex(s) == k and len(offsets[s])]
        knots = np.array([query.GetInbetween(s).GetWeight() if query.GetInbetween(s) else 1.0 for s in subs])
        if not subs:
            continue
        values = np.array([np.array(offsets[s], np.float32) for s in subs]) * metres
        own = np.array(points[k]) if len(points[k]) else np.arange(values.shape[1])
        order = np.argsort(knots)
        shapes.append(BlendShape(name, own, values[order], knots[order],
                                 **_read_corrective_driver(reading, query.GetBlendShape(k), bones)))
    return shapes


def _read_corrective_driver(reading: StageReading, shape: UsdSkel.BlendShape, bones: Skeleton) -> dict:
    """Joint that drives a corrective shape; {}: the animation does."""
    prim = shape.GetPrim()
    joint = prim.GetAttribute(JOINT)
    if not joint or not joint.Get():
        return {}
    name = str(joint.Get())
    if name not in bones.joints:
        reading.fail(prim.GetPath(), f"{JOINT} is {name}, which {bones.path} does not have; name one of its joints: "
                     f"{', '.join(bones.joints[:5])}")
        return {}
    q, width = prim.GetAttribute(ROTATION).Get(), prim.GetAttribute(WIDTH).Get()
    rotation = (0.0, 0.0, 0.0, 1.0) if q is None else tuple(map(float, (*q.GetImaginary(), q.GetReal())))
    angle = float(np.radians(180.0 if width is None else width))
    return {"joint": bones.joints.index(name), "rotation": rotation, "width": angle}


def hang(reading: StageReading, prim: Usd.Prim, target: Usd.Prim, kind: str, x: np.ndarray) -> Follow | None:
    """Places of an attachment on a skinned mesh, kind "point" or "face"; None where there is none such (reported).
    x: places of its points at the start, world (k, 3) [m]."""
    bound, units = reading.skinned.get(target.GetPath()), reading.units
    skin = follow(reading, bound, target) if bound else None
    indices, mesh = read_attribute(prim, "Tie", "others", units), UsdGeom.Mesh(target)
    if bound is None or skin is None or indices is None or len(indices) != len(x):
        said = "is moved by no skeleton that can be followed" if skin is None else f"wants physics:indices1 of {len(x)} entries"
        reading.fail(prim.GetPath(), f"attaches points to {kind}s of {target.GetPath()}: it {said}; author it, or attach to an "
                     "xform")
        return None
    bound.followed = True
    count = len(skin.points) if kind == "point" else len(mesh.GetFaceVertexCountsAttr().Get(units.start) or ())
    if ((indices < 0) | (indices >= count)).any():
        bad = indices[(indices < 0) | (indices >= count)][0]
        reading.fail(prim.GetPath(), f"physics:indices1 holds {bad}; allowed is 0 to {count - 1}, {kind}s of "
                     f"{target.GetPath()}; count from 0")
        return None
    if kind == "point":
        return Follow.at_points(skin, indices)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(units.start))
    first = (np.cumsum(counts) - counts)[indices]
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(units.start))[first[:, None] + np.arange(3)]
    coords = prim.GetAttribute(names.attribute_entry("Pin", "places").attribute).Get()
    if coords is None or len(coords) != len(indices):
        places = triangle_coordinates(skin.skeleton.motion.points(skin.at(0.0))[corners], x)
    else:
        places = np.array(coords, np.float32) * np.array((1.0, 1.0, units.metres), np.float32)
    return Follow(skin, corners, places, indices)
