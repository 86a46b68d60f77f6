"""Meshes that a skeleton moves. One that collides follows, at all times (`wsim.physics.animation`); where its own points or
what binds them are animated besides, at the frames and samples as UsdSkel skins it, linear in between. What is simulated
stands where its points are authored, in the bind pose, while a viewer draws it where skinning puts it: where the two differ
that is an error, and so it is of a shape that is no mesh.

A binding holds below a SkelRoot, on a prim or above it; an empty skel:skeleton ends it (tried with UsdSkel.Cache; blocked joint
indices do not). Results unbind what they write points of, else a viewer would skin those once more.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt

from wsim.scene.curve import Curve
from wsim.scene.methods import method_file
from wsim.usd.stage import StageReading

APART = 1e-4       # of the size of a mesh, by which skinning may move it
MOMENTS = 16       # at which it is looked at, at most


@dataclass
class SkinnedMesh:
    """A mesh and the skeleton that moves it; followed: its skinned points were read."""

    skeleton: UsdSkel.SkeletonQuery
    query: UsdSkel.SkinningQuery
    cache: UsdSkel.Cache                     # of which the queries are
    prim: Usd.Prim                           # of the skeleton; its query has that of the prototype, in an instance
    followed: bool = False


def skeleton_bindings(roots: list[Usd.Prim]) -> dict[Sdf.Path, SkinnedMesh]:
    """Bindings of what skeletons below the SkelRoots move, by path; not those to skeletons that USD cannot read."""
    found = {}
    for root in map(UsdSkel.Root, roots):
        cache = UsdSkel.Cache()
        cache.Populate(root, Usd.TraverseInstanceProxies())
        for binding in cache.ComputeSkelBindings(root, Usd.TraverseInstanceProxies()):
            skeleton = cache.GetSkelQuery(binding.GetSkeleton())
            for query in binding.GetSkinningTargets() if skeleton else ():
                found[query.GetPrim().GetPath()] = SkinnedMesh(skeleton, query, cache, binding.GetSkeleton().GetPrim())
    return found


def report_missing_skeleton(reading: StageReading, prim: Usd.Prim) -> None:
    """Reports that a mesh with joint influences is bound to a skeleton that is not there, or that USD cannot read."""
    if not prim.HasAttribute("primvars:skel:jointIndices"):
        return
    above, relationship = prim, UsdSkel.BindingAPI(prim).GetSkeletonRel()
    while above and not (relationship and relationship.HasAuthoredTargets()):
        above = above.GetParent()
        relationship = above and UsdSkel.BindingAPI(above).GetSkeletonRel()
    for target in relationship.GetForwardedTargets() if relationship else ():
        bones = UsdSkel.Skeleton(reading.stage.GetPrimAtPath(target))
        if not bones:
            reading.fail(prim.GetPath(), f"is bound to the skeleton {target}, which is none that can be read (is a payload or "
                         "reference missing?); name one, or author an empty skel:skeleton on it to mean its points as they are")
        elif not UsdSkel.Cache().GetSkelQuery(bones):
            _, why = UsdSkel.Topology(list(bones.GetJointsAttr().Get(reading.units.start) or ())).Validate()
            reading.fail(target, f"is no skeleton that USD can read ({why.rstrip('.') or 'transforms'}); give each joint a "
                         "name of its own, behind those above it")


def read_skinned_poses(reading: StageReading, prim: Usd.Prim) -> Any:
    """Skinned points: a `wsim.physics.animation.objects.Skinned`, in its skeleton's space; where its own points or what
    binds them are animated, a Curve of points [m] in its own space. None where no skeleton moves it; errors are reported."""
    bound = reading.skinned.get(prim.GetPath())
    if bound is None or not prim.IsA(UsdGeom.PointBased):
        report_missing_skeleton(reading, prim)
        return None
    before = len(reading.problems)
    if _compute_skinned_points(bound, reading.units.start) is not None and not _describe_skeleton_motion(reading, bound):
        method_file("Skeleton", "usd").sound(reading, bound)
        return None
    bound.followed = True
    if (skin := _follow_skeleton(reading, bound, prim)) is not None:
        return skin
    if any(problem.fatal for problem in reading.problems[before:]):
        return None
    samples = {*_animation_time_codes(bound.skeleton), *UsdGeom.PointBased(prim).GetPointsAttr().GetTimeSamples()}
    start, end = reading.units.start, reading.units.start + reading.frames
    codes = sorted({*(start + np.arange(reading.frames + 1)).tolist(), *(c for c in samples if start < c < end)})
    values = [_compute_skinned_points(bound, code) for code in codes]
    if any(v is None or not np.all(np.isfinite(v)) for v in values):
        method_file("Skeleton", "usd").sound(reading, bound)
        if not any(problem.fatal for problem in reading.problems[before:]):
            reading.fail(prim.GetPath(), _describe_bad_influences(bound)
                         or f"cannot be skinned by {bound.prim.GetPath()} at all of its frames; "
                         "author joints, indices and weights that belong together, and finite transforms")
        return None
    return Curve(reading.units.time(np.array(codes)), np.array(values) * reading.units.metres)


def _describe_bad_influences(bound: SkinnedMesh) -> str:
    """Message on a mesh whose joint indices or weights do not fit its skeleton; "" if the cause is another one."""
    query, points = bound.query, UsdGeom.PointBased(bound.query.GetPrim()).GetPointsAttr().Get()
    each, joints = query.GetNumInfluencesPerComponent(), len(query.GetJointOrder() or bound.skeleton.GetJointOrder())
    wanted = each * (1 if query.IsRigidlyDeformed() else len(points or ()))
    for primvar in (query.GetJointIndicesPrimvar(), query.GetJointWeightsPrimvar()):
        values, name = np.array(primvar.ComputeFlattened() or ()), primvar.GetAttr().GetName()
        if len(values) != wanted:
            return f"{name} has {len(values)} values; allowed are {wanted}, with {each} influences a point: author as many"
        if name.endswith("Indices") and len(bad := np.flatnonzero((values < 0) | (values >= joints))):
            return (f"{name}[{bad[0]}] is {values[bad[0]]}; allowed are 0 to {joints - 1}, the joints of "
                    f"{bound.prim.GetPath()}: author it again")
    return ""


def _follow_skeleton(reading: StageReading, bound: SkinnedMesh, prim: Usd.Prim):
    """The `Skinned` of a mesh that can be, or None."""
    if _compute_skinned_points(bound, reading.units.start) is None:
        return None
    return method_file("Skeleton", "usd").follow(reading, bound, prim)


def refuse_skinned(reading: StageReading, prims: list[Usd.Prim]) -> None:
    """Reports those of the prims that a skeleton moves and that do not follow it."""
    for prim in prims:
        bound = reading.skinned.get(prim.GetPath())
        if bound and not bound.followed and (found := _describe_skeleton_motion(reading, bound)):
            reading.fail(prim.GetPath(), f"is bound to the skeleton {bound.prim.GetPath()}, which {found}; mesh "
                         "colliders alone follow a skeleton: it would stand in its bind pose. Write its skinned points into "
                         "points (UsdSkel.BakeSkinning does), or author an empty skel:skeleton on it to mean the bind pose")


def _describe_skeleton_motion(reading: StageReading, bound: SkinnedMesh) -> str:
    """How a skeleton moves a mesh at the start or later, in words; "" if it does not."""
    skeleton, query = bound.skeleton, bound.query
    codes = list(_sampled_time_codes(reading, skeleton))
    animation = skeleton.GetAnimQuery()
    if query.HasBlendShapes() and animation and any(np.any(animation.ComputeBlendShapeWeights(code)) for code in codes):
        return "shapes it by blend shapes"
    for code in codes:
        places = _bind_and_skinned_points(bound, code)
        if places is None:
            continue
        authored, put = places
        away, size = np.linalg.norm(put - authored, axis=1).max(initial=0.0), np.ptp(authored, axis=0).max(initial=0.0)
        if not away <= APART * size:
            return (f"puts its points up to {away * reading.units.metres:.3g} m from where they are authored (at time code "
                    f"{code:g})")
    return ""


def _sampled_time_codes(reading: StageReading, skeleton: UsdSkel.SkeletonQuery) -> Iterator[float]:
    """Time codes of the start and of some samples of the animation in the frames to simulate."""
    start = reading.units.start
    yield start
    inside = sorted(c for c in _animation_time_codes(skeleton) if start < c <= start + reading.frames)
    yield from inside[:: -(-len(inside) // MOMENTS) or 1]


def _animation_time_codes(skeleton: UsdSkel.SkeletonQuery) -> set[float]:
    animation = skeleton.GetAnimQuery()
    return {*animation.GetJointTransformTimeSamples(), *animation.GetBlendShapeWeightTimeSamples()} if animation else set()


def _compute_skinned_points(bound: SkinnedMesh, code: float) -> np.ndarray | None:
    """Points of a mesh as it is skinned, in its own space [units], (n, 3)."""
    query, skeleton, prim = bound.query, bound.skeleton, bound.query.GetPrim()
    points = UsdGeom.PointBased(prim).GetPointsAttr().Get(code)
    if not points or not _add_blend_shapes(bound, points, code):
        return None
    if not query.HasJointInfluences():
        return np.array(points, np.float64)
    if not query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(code), points, code):
        return None
    cache = UsdGeom.XformCache(Usd.TimeCode(code))
    back = np.array(cache.GetLocalToWorldTransform(bound.prim) * cache.GetLocalToWorldTransform(prim).GetInverse())
    return np.array(points, np.float64) @ back[:3, :3] + back[3, :3]


def _add_blend_shapes(bound: SkinnedMesh, points: Vt.Vec3fArray, code: float) -> bool:
    """Adds the blend shapes at their weights to points; whether that could be done."""
    query, animation = bound.query, bound.skeleton.GetAnimQuery()
    if not query.HasBlendShapes() or not animation:
        return True
    weights = animation.ComputeBlendShapeWeights(code)
    mapper = query.GetBlendShapeMapper()
    if mapper:
        weights = mapper.Remap(weights)
    shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(query.GetPrim()))
    parts = shapes.ComputeSubShapeWeights(weights)
    return bool(parts) and shapes.ComputeDeformedPoints(*parts, shapes.ComputeBlendShapePointIndices(),
                                                        shapes.ComputeSubShapePointOffsets(), points)


def _bind_and_skinned_points(bound: SkinnedMesh, code: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Points in the world as authored, and as skinned [units], (n, 3) each; None where there is nothing to skin, or a binding
    that cannot be."""
    skeleton, query, cache = bound.skeleton, bound.query, UsdGeom.XformCache(Usd.TimeCode(code))
    prim = query.GetPrim()
    if not query.HasJointInfluences():
        return None
    transforms = skeleton.ComputeSkinningTransforms(code)
    own, frame = (np.array(cache.GetLocalToWorldTransform(p)) for p in (prim, bound.prim))
    if not prim.IsA(UsdGeom.PointBased):                       # rigid: a sphere, say
        local = np.eye(3)
        moved = np.array(query.ComputeSkinnedTransform(transforms, code))
        return local @ own[:3, :3] + own[3, :3], (local @ moved[:3, :3] + moved[3, :3]) @ frame[:3, :3] + frame[3, :3]
    points = UsdGeom.PointBased(prim).GetPointsAttr().Get(code)
    put = Vt.Vec3fArray(points or [])
    if not points or not query.ComputeSkinnedPoints(transforms, put, code):
        return None
    return np.array(points) @ own[:3, :3] + own[3, :3], np.array(put) @ frame[:3, :3] + frame[3, :3]
