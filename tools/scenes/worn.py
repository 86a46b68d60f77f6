"""A garment that collides with itself and with the body that wears it."""

from math import pi, sin

import numpy as np

from tools.scenes.cloth import SOFT, looks, material, thickness
from tools.scenes.skeleton import HEIGHT, JOINTS, SKINNED, bones, camera, dummy
from tools.scenes.touching import TOUCHING
from tools.usda import block, listed, moved, said, scene, settings
from wsim.geometry import rotation


def leaning(frames: int) -> str:
    """Keys of the joints: the chest turns to and fro and bows, while the hips sway, from frame 10 on."""
    lines, named = [], ", ".join(f'"{name}"' for name in JOINTS)
    heights, keys = (0.12 * HEIGHT, 0.22 * HEIGHT, 0.6 * HEIGHT), range(0, frames + 1, 4)
    for frame in keys:
        a = 2.0 * pi * max(frame - 8, 0) / 40.0
        T = [(0.06 * sin(a), heights[0], 0.0), *((0.0, h, 0.0) for h in heights[1:])]
        turns = [(0.0, 0.2 * sin(a), -0.1 * sin(a)), (0.1 * sin(2.0 * a), 0.5 * sin(a), 0.0), (0.0, 0.4 * sin(a), 0.0)]
        lines.append((T, rotation.quaternion_exponential(np.array(turns))[:, [3, 0, 1, 2]]))
    body = [f"uniform token[] joints = [{named}]"]
    for k, name in enumerate(("float3[] translations", "quatf[] rotations")):
        body += [f"{name}.timeSamples = {{", *(f"    {f}: {listed(row[k])}," for f, row in zip(keys, lines, strict=True)), "}"]
    body.append("half3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]")
    return block("SkelAnimation", "Walk", "\n".join(body), comment="Turns of joints, every sixth of a second.")


def worn_shirt() -> str:
    frames, n = 48, 0.01                                                       # the asset is in centimetres
    points, counts, indices, weights = dummy()
    mesh = "\n".join([f"float3[] extent = {listed(np.array([points.min(axis=0), points.max(axis=0)]))}",
                      f"point3f[] points = {listed(points)}", f"int[] faceVertexCounts = {listed(counts)}",
                      f"int[] faceVertexIndices = {listed(indices)}", 'uniform token subdivisionScheme = "none"',
                      "rel skel:skeleton = </World/Dancer/Bones>",
                      f"int[] primvars:skel:jointIndices = {listed(np.tile([0, 1, 2], len(points)))} (elementSize = 3\n"
                      '    interpolation = "vertex")',
                      f"float[] primvars:skel:jointWeights = {listed(weights.ravel())} (elementSize = 3\n"
                      '    interpolation = "vertex")',
                      'uniform token primvars:skel:skinningMethod = "dualQuaternion"',
                      "color3f[] primvars:displayColor = [(0.62, 0.52, 0.43)]"])
    dancer = "\n".join(["double xformOp:rotateY = 180", moved(0, 0.76, -0.042, "xformOp:rotateY"), bones(), leaning(frames),
                        block("Mesh", "Torso", mesh, SKINNED, "Its corners and edges meet the triangles of the shirt, too; "
                              "half of the shirt's thickness is kept.")])
    garment = "\n".join([looks("cotton", (0.10, 0.30, 0.34)), said("Cloth", 1.0, self_collision=True), thickness("cotton", 1.0),
                         'uniform token subdivisionScheme = "none"', f"float3 xformOp:scale = ({n}, {n}, {n})",
                         moved(0, 0.04, 0, "xformOp:scale")])
    worn = block("Mesh", "Shirt", garment, SOFT, "The garment of assets/, which is in centimetres, scaled. wsim:selfCollision: "
                 "no substep ends with triangles that intersect, those of the body among them.")
    there = "prepend references = @assets/unisex_shirt.usd@</root/shirt>\n    "
    return scene("A shirt on a dummy whose bones turn and sway; it passes neither through the body nor through itself.", [
        settings(solver="xpbd", substeps=128, iterations=2, air_drag=1.0, comment=TOUCHING),
        material("cotton"), worn.replace("prepend apiSchemas", there + "prepend apiSchemas", 1),
        block("SkelRoot", "Dancer", dancer, comment="What skeletons move stands below a SkelRoot."),
        camera((0.68, 1.3, -2.05), 162.0, -4.5, "From its left front."),
    ], frames=frames)


WORN_SCENES = {"worn_shirt": worn_shirt}
