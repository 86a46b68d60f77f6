"""Meshes that a skeleton moves. Skeletons are not evaluated: what collides or is simulated stands where its points are
authored, in the bind pose, while a viewer draws it where UsdSkel's skinning puts it. Where the two differ that is an error.

A binding holds below a SkelRoot, on a prim or above it; an empty skel:skeleton ends it (tried with UsdSkel.Cache; blocked joint
indices do not). Results unbind what they write points of, else a viewer would skin those once more.
"""

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, Vt

from wsim.usd.stage import Reading

APART = 1e-4       # of the size of a mesh, by which skinning may move it
MOMENTS = 16       # at which it is looked at, at most


def skinned(reading: Reading, roots: list[Usd.Prim], prims: list[Usd.Prim]) -> None:
    """Reports those of the prims that a skeleton below one of the SkelRoots moves."""
    wanted = {prim.GetPath() for prim in prims}
    for root in map(UsdSkel.Root, roots):
        cache = UsdSkel.Cache()
        cache.Populate(root, Usd.TraverseInstanceProxies())
        for binding in cache.ComputeSkelBindings(root, Usd.TraverseInstanceProxies()):
            skeleton = cache.GetSkelQuery(binding.GetSkeleton())
            for query in binding.GetSkinningTargets():
                path = query.GetPrim().GetPath()
                if path in wanted and (found := _moved(reading, skeleton, query)):
                    reading.fail(path, f"is bound to the skeleton {skeleton.GetPrim().GetPath()}, which {found}; skeletons are "
                                 "not evaluated, and it would stand in its bind pose. Write its skinned points into points "
                                 "(UsdSkel.BakeSkinning does), or author an empty skel:skeleton on it to mean the bind pose")


def _moved(reading: Reading, skeleton: UsdSkel.SkeletonQuery, query: UsdSkel.SkinningQuery) -> str:
    """How a skeleton moves a mesh at the start or later, in words; "" if it does not."""
    codes = list(_moments(reading, skeleton))
    animation = skeleton.GetAnimQuery()
    if query.HasBlendShapes() and animation and any(np.any(animation.ComputeBlendShapeWeights(code)) for code in codes):
        return "shapes it by blend shapes"
    for code in codes:
        places = _places(skeleton, query, code)
        if places is None:
            continue
        authored, put = places
        away, size = np.linalg.norm(put - authored, axis=1).max(initial=0.0), np.ptp(authored, axis=0).max(initial=0.0)
        if not away <= APART * size:
            return (f"puts its points up to {away * reading.units.metres:.3g} m from where they are authored (at time code "
                    f"{code:g})")
    return ""


def _moments(reading: Reading, skeleton: UsdSkel.SkeletonQuery) -> Iterator[float]:
    """Time codes of the start and of some samples of the animation in the frames to simulate."""
    start, animation = reading.units.start, skeleton.GetAnimQuery()
    yield start
    samples = {*animation.GetJointTransformTimeSamples(), *animation.GetBlendShapeWeightTimeSamples()} if animation else set()
    inside = sorted(c for c in samples if start < c <= start + reading.frames)
    yield from inside[:: -(-len(inside) // MOMENTS) or 1]


def _places(skeleton: UsdSkel.SkeletonQuery, query: UsdSkel.SkinningQuery, code: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Points in the world as authored, and as skinned [units], (n, 3) each; None where there is nothing to skin, or a binding
    that cannot be."""
    prim, cache = query.GetPrim(), UsdGeom.XformCache(Usd.TimeCode(code))
    if not query.HasJointInfluences():
        return None
    transforms = skeleton.ComputeSkinningTransforms(code)
    own, frame = (np.array(cache.GetLocalToWorldTransform(p)) for p in (prim, skeleton.GetPrim()))
    if not prim.IsA(UsdGeom.PointBased):                       # rigid: a sphere, say
        local = np.eye(3)
        moved = np.array(query.ComputeSkinnedTransform(transforms, code))
        return local @ own[:3, :3] + own[3, :3], (local @ moved[:3, :3] + moved[3, :3]) @ frame[:3, :3] + frame[3, :3]
    points = UsdGeom.PointBased(prim).GetPointsAttr().Get(code)
    put = Vt.Vec3fArray(points or [])
    if not points or not query.ComputeSkinnedPoints(transforms, put, code):
        return None
    return np.array(points) @ own[:3, :3] + own[3, :3], np.array(put) @ frame[:3, :3] + frame[3, :3]
