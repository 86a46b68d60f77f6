"""Skeletons and skinned meshes for tests: random ones, and the meshes of characters that USD skins."""

from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from tests.make.usda import cloth
from wsim.physics.animation.objects import LINEAR, BlendShape, Skeleton, Skinned
from wsim.scene import Scene, Surface, shapes

ASSETS = Path(__file__).parents[3] / "scenes" / "assets"
JOINTS = ("hip", "hip/knee", "hip/knee/foot", "hip/tail")
CHARACTERS = {"RiggedSimple.usdz": "/RiggedSimple/Geom/Z_UP/Armature/Bone_3/Cylinder_2",
              "CesiumMan.usdz": "/CesiumMan/Geom/Z_UP/Armature/Skeleton_torso_joint_1_3/Cesium_Man_2"}


def bones(rng, scaled: bool = False, path: str = "/man/bones", keys: int = 3) -> Skeleton:
    """A tree of four joints that turn about anyhow."""
    n = len(JOINTS)
    bind = np.tile(np.eye(4), (n, 1, 1))
    bind[:, 1, 3] = (0.0, 0.5, 1.0, 0.3)
    Q = rng.normal(size=(keys, n, 4))
    scales = rng.uniform(0.6, 1.4, (keys, n, 3)) if scaled else None
    places = 0.3 * rng.normal(size=(keys, n, 3))
    return Skeleton(path, JOINTS, bind, times=np.linspace(0.0, 0.1, keys) ** 1.2, translations=places,
                    rotations=Q / np.linalg.norm(Q, axis=-1, keepdims=True), scales=scales)


def skin(rng, skeleton: Skeleton, points: np.ndarray, m: int = 3, method: str = LINEAR, blends=()) -> Skinned:
    weights = rng.uniform(0.0, 1.0, (len(points), m))
    joints = rng.integers(0, len(skeleton.joints), (len(points), m))
    return Skinned(skeleton, points, joints, weights / weights.sum(1, keepdims=True), method=method, blends=list(blends))


def lump(rng) -> BlendShape:
    """A corrective shape that a joint drives."""
    return BlendShape("lump", np.array([1, 4, 5]), 0.1 * rng.normal(size=(2, 3, 3)), [0.5, 1.0], joint=1, width=2.5)


def scene_of(skinned: Skinned, counts, indices, path: str = "/man/body") -> Scene:
    """A sheet above a collider that follows a skeleton."""
    scene = Scene(frames=2, substeps=5)
    scene.add(skinned.skeleton)
    scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 4, 4, horizontal=True, at=(0.0, 3.0, 0.0)))
    scene.collider(path, Surface(skinned.at(0.0), counts, indices, poses=skinned), motion=skinned.skeleton.motion)
    return scene


def worn(folder: Path, asset: str, method: str, metres: float = 0.5) -> tuple[Path, str]:
    """A character whose mesh collides, beside a sheet: file, and path of the mesh."""
    file, path = folder / "worn.usda", CHARACTERS[asset]
    stage = Usd.Stage.CreateNew(str(file))
    stage.GetRootLayer().subLayerPaths = [str(ASSETS / asset)]
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetStartTimeCode(1), stage.SetEndTimeCode(20), stage.SetTimeCodesPerSecond(24)
    mesh = stage.OverridePrim(path)
    mesh.AddAppliedSchema("PhysicsCollisionAPI")
    mesh.CreateAttribute("primvars:skel:skinningMethod", Sdf.ValueTypeNames.Token).Set(method)
    sheet = Usd.Stage.CreateInMemory()
    sheet.GetRootLayer().ImportFromString("#usda 1.0\n" + cloth())
    Sdf.CopySpec(sheet.GetRootLayer(), "/cloth", stage.GetRootLayer(), "/cloth")
    stage.Save()
    return file, path


def theirs(file: Path, path: str, codes) -> list[np.ndarray]:
    """World points [units] of a mesh as UsdSkel skins them at time codes."""
    stage = Usd.Stage.Open(str(file))
    root, cache = UsdSkel.Root.Find(stage.GetPrimAtPath(path)), UsdSkel.Cache()
    cache.Populate(root, Usd.TraverseInstanceProxies())
    prim = stage.GetPrimAtPath(path)
    query = cache.GetSkinningQuery(prim)
    bound = next(b for b in cache.ComputeSkelBindings(root, Usd.TraverseInstanceProxies())
                 if any(q.GetPrim() == prim for q in b.GetSkinningTargets()))
    skeleton = cache.GetSkelQuery(bound.GetSkeleton())
    found = []
    for code in codes:
        points = UsdGeom.Mesh(prim).GetPointsAttr().Get(code)
        assert query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(code), points, code)
        M = np.array(UsdGeom.XformCache(Usd.TimeCode(code)).GetLocalToWorldTransform(skeleton.GetPrim()))
        found.append(np.array(points, np.float64) @ M[:3, :3] + M[3, :3])
    return found
