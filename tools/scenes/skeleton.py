"""Example scenes of characters that wear a cloth: a skeleton moves a mesh, the cloth is pinned to it and collides with it."""

from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from tools.scenes.cloth import cloth, material
from tools.usda import block, ground, indented, listed, moved, number, said, scene, settings
from wsim.geometry import rotation
from wsim.physics.animation import skinning
from wsim.scene import shapes

ASSETS = Path(__file__).resolve().parents[2] / "scenes" / "assets"
MAN = "Geom/Z_UP/Armature/Skeleton_torso_joint_1_3/Cesium_Man_2"
SKINNED = ('["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "WsimColliderAPI", "SkelBindingAPI"]')
FAST = "The cloth meets a mesh of thousands of triangles that moves: short substeps of few iterations."


def attached(name: str, body: str, points, target: str, places: tuple[np.ndarray, np.ndarray], comment: str) -> str:
    """Holds points of a cloth to faces of a mesh that a skeleton moves: faces, and (u, v, h) on them."""
    lines = [f"rel physics:src0 = <{body}>", f"int[] physics:indices0 = {listed(np.asarray(points, int))}",
             'uniform token physics:type0 = "point"', f"rel physics:src1 = <{target}>", 'uniform token physics:type1 = "face"',
             f"int[] physics:indices1 = {listed(places[0])}", f"vector3f[] physics:coords1 = {listed(places[1])}"]
    return block("PhysicsAttachment", name, "\n".join(lines), comment=comment)


def over(x: np.ndarray, triangles: np.ndarray, faces: np.ndarray, places: np.ndarray, one=None) -> tuple:
    """Face nearest to each place (k, 3) [m], of triangles (t, 3) that stand at the front of those faces, and (u, v, h) on it.
    one: a place (3,) to which the face of all is nearest."""
    chosen = skinning.nearest_triangles(x[triangles], np.asarray(places if one is None else [one] * len(places), np.float64))
    return faces[chosen], skinning.triangle_coordinates(x[triangles[chosen]], places)


def camera(at: tuple, turn: float, tilt: float, comment: str) -> str:
    """A camera at a place [m], turned [degrees] about the vertical, then tilted."""
    lines = ["float focalLength = 50", "float horizontalAperture = 36", "float verticalAperture = 20.25",
             f"double3 xformOp:translate = ({', '.join(map(number, at))})", f"double xformOp:rotateY = {number(turn)}",
             f"double xformOp:rotateX = {number(tilt)}",
             'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY", "xformOp:rotateX"]']
    return block("Camera", "Behind", "\n".join(lines), comment=comment)


def man() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The walking man where he starts: points [m], corners of each face that `over` takes, numbers of those faces."""
    stage = Usd.Stage.Open(str(ASSETS / "CesiumMan.usdz"))
    prim = stage.GetPrimAtPath(f"/CesiumMan/{MAN}")
    root, cache = UsdSkel.Root.Find(prim), UsdSkel.Cache()
    cache.Populate(root, Usd.TraverseInstanceProxies())
    (bound,) = cache.ComputeSkelBindings(root, Usd.TraverseInstanceProxies())
    skeleton, mesh = cache.GetSkelQuery(bound.GetSkeleton()), UsdGeom.Mesh(prim)
    points = mesh.GetPointsAttr().Get()
    cache.GetSkinningQuery(prim).ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(0.0), points, 0.0)
    M = np.array(UsdGeom.XformCache(0.0).GetLocalToWorldTransform(skeleton.GetPrim()))
    counts, corners = np.array(mesh.GetFaceVertexCountsAttr().Get()), np.array(mesh.GetFaceVertexIndicesAttr().Get())
    first = np.cumsum(counts) - counts
    return np.array(points, np.float64) @ M[:3, :3] + M[3, :3], corners[first[:, None] + np.arange(3)], np.arange(len(counts))


def caped_man() -> str:
    columns, rows, top, hem, middle = 16, 40, 1.05, 0.42, -0.018
    points, counts, indices = shapes.sheet(1.0, 1.0, columns, rows)
    down = 0.5 - points[:, 1]                                          # 0 at the shoulders, 1 at the hem
    y = top - (top - hem) * down
    place = np.stack([middle + points[:, 0] * (0.13 + 0.17 * down), y, -0.095 - 0.16 * down], axis=1)
    edge = np.arange(columns + 1)
    *above, last = MAN.split("/")
    mesh = (f'over "{last}" (\n    prepend apiSchemas = ["PhysicsCollisionAPI", "WsimColliderAPI"]\n)\n{{\n'
            + indented(said("Collider", 1.0, thickness=0.005)) + "\n}")
    for name in reversed(above):
        mesh = f'over "{name}"\n{{\n{indented(mesh)}\n}}'
    body = block("Xform", "Man", mesh, comment="A skeleton of 19 joints moves a mesh of 3273 points, by an animation of two "
                 "seconds. Its mesh collides: PhysicsCollisionAPI is all that is authored over the reference. Points keep 5 mm "
                 "from it.")
    body = body.replace('def Xform "Man"', 'def Xform "Man" (\n    prepend references = @assets/CesiumMan.usdz@\n)')
    return scene("A man walks in a cape of leather.", [
        settings(substeps=40, iterations=2, air_density=1.2, comment=FAST),
        material("leather"), body,
        cloth("Cape", (place, counts, indices), "leather", (0.45, 0.08, 0.12), "It hangs behind the back where it starts; the "
              "legs reach it.", drag=1.2, lift=0.6),
        attached("Shoulders", "/World/Cape", edge, f"/World/Man/{MAN}", over(*man(), place[edge], place[10]),
                 "The upper edge keeps to a face of the skinned mesh, between the shoulders: indices1 are faces, coords1 "
                 "places on them (u, v, and the height above)."),
        ground(), camera((-1.9, 1.2, -3.6), 207.8, -6.3, "From behind, where the cape is."),
    ], frames=48)


HEIGHT, JOINTS = 0.85, ("hips", "hips/chest", "hips/chest/head")


def dummy() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A tailor's dummy, up along y, with the front along z: points, counts, indices, weights of its joints."""
    points, counts, indices = shapes.torso(HEIGHT, 20)
    points = points[:, [0, 2, 1]] * (-1.0, 1.0, 1.0)
    s = points[:, 1] / HEIGHT
    chest = np.clip((s - 0.22) / 0.26, 0.0, 1.0)
    head = np.clip((s - 0.82) / 0.1, 0.0, 1.0)
    chest, head = (w * w * (3.0 - 2.0 * w) for w in (chest, head))
    return points, counts, indices, np.stack([1.0 - chest, chest - head, head], axis=1)


def twisting() -> str:
    """Keys of the joints: two turns of the chest to and fro, while the hips sway and bow."""
    keys = range(0, 97, 4)
    heights = [0.12 * HEIGHT, 0.22 * HEIGHT, 0.6 * HEIGHT]               # of a joint over the one below
    T, Q = [], []
    for frame in keys:
        a = 2.0 * pi * max(frame - 12, 0) / 42.0
        T.append([(0.12 * sin(0.5 * a), heights[0], 0.0), *((0.0, h, 0.0) for h in heights[1:])])
        turns = [(0.12 * sin(a), 0.35 * sin(a), 0.0), (0.15 * (1.0 - cos(a)), 0.9 * sin(a), 0.0), (0.0, 0.5 * sin(a), 0.0)]
        Q.append(rotation.quaternion_exponential(np.array(turns))[:, [3, 0, 1, 2]])
    lines = ["float3[] translations.timeSamples = {", *(f"    {f}: {listed(t)}," for f, t in zip(keys, T, strict=True)), "}",
             "quatf[] rotations.timeSamples = {", *(f"    {f}: {listed(q)}," for f, q in zip(keys, Q, strict=True)), "}",
             "half3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]"]
    named = ", ".join(f'"{name}"' for name in JOINTS)
    return block("SkelAnimation", "Walk", f"uniform token[] joints = [{named}]\n" + "\n".join(lines),
                 comment="Rotations between keys turn at constant speed, as USD says.")


def bones() -> str:
    named, at = ", ".join(f'"{name}"' for name in JOINTS), np.cumsum([0.12 * HEIGHT, 0.22 * HEIGHT, 0.6 * HEIGHT])
    def frames(heights) -> str:
        return "[" + ", ".join(f"((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, {number(h)}, 0, 1))" for h in heights) + "]"
    body = [f"uniform token[] joints = [{named}]", f"uniform matrix4d[] bindTransforms = {frames(at)}",
            f"uniform matrix4d[] restTransforms = {frames(np.diff(at, prepend=0.0))}",
            "rel skel:animationSource = </World/Dancer/Walk>"]
    return block("Skeleton", "Bones", "\n".join(body), '["SkelBindingAPI"]')


def bone_cape() -> str:
    columns, rows, tilt = 40, 20, radians(30.0)
    points, counts, indices, weights = dummy()
    sheet, sheet_counts, sheet_indices = shapes.sheet(1.0, 1.0, columns, rows)
    turn, along = radians(240.0) * sheet[:, 0], 0.52 * (0.5 - sheet[:, 1])
    neck = 0.86 * HEIGHT
    place = np.stack([-(0.079 + along * cos(tilt)) * np.sin(turn), neck - along * sin(tilt),
                      -(0.066 + along * cos(tilt)) * np.cos(turn)], axis=1)
    mesh = "\n".join([f"float3[] extent = {listed(np.array([points.min(axis=0), points.max(axis=0)]))}",
                      f"point3f[] points = {listed(points)}", f"int[] faceVertexCounts = {listed(counts)}",
                      f"int[] faceVertexIndices = {listed(indices)}", 'uniform token subdivisionScheme = "none"',
                      "rel skel:skeleton = </World/Dancer/Bones>",
                      f"int[] primvars:skel:jointIndices = {listed(np.tile([0, 1, 2], len(points)))} (elementSize = 3\n"
                      '    interpolation = "vertex")',
                      f"float[] primvars:skel:jointWeights = {listed(weights.ravel())} (elementSize = 3\n"
                      '    interpolation = "vertex")',
                      'uniform token primvars:skel:skinningMethod = "dualQuaternion"', said("Collider", 1.0, thickness=0.0075),
                      "color3f[] primvars:displayColor = [(0.62, 0.52, 0.43)]"])
    dancer = "\n".join([moved(0, 0.5, 0), bones(), twisting(), block("Mesh", "Torso", mesh, SKINNED, "Dual quaternions keep "
                        "the waist from shrinking where the chest turns.")])
    front = counts == 4 if (counts == 4).any() else counts == 3
    first = (np.cumsum(counts) - counts)[front]
    edge = np.arange(columns + 1)
    held = over(points, indices[first[:, None] + np.arange(3)], np.flatnonzero(front), place[edge])
    return scene("A cape of leather on a dummy whose bones turn and sway.", [
        settings(substeps=40, iterations=2, air_density=1.2, comment=FAST),
        material("leather"),
        block("SkelRoot", "Dancer", dancer, comment="What skeletons move stands below a SkelRoot."),
        cloth("Cape", (place + (0.0, 0.5, 0.0), sheet_counts, sheet_indices), "leather", (0.13, 0.22, 0.42),
              "A cone that opens in front and falls over the shoulders.", drag=1.2, lift=0.6),
        attached("Collar", "/World/Cape", edge, "/World/Dancer/Torso", held, "The upper edge keeps to the neck, which two "
                 "bones move."),
        ground(), camera((-1.3, 1.55, -2.3), 209.5, -15.0, "From behind, where the cape is."),
    ], frames=96)


SKELETON_SCENES = {"caped_man": caped_man, "bone_cape": bone_cape}
