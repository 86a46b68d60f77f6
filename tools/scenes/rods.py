"""Example scenes of rods: hair on a shaken head."""

import numpy as np

from tools.usda import block, listed, number, pin, said, scene, settings, solid

STRANDS, POINTS, RADIUS, LENGTH = 140, 18, 0.1, 0.24


def golden(n: int, least: float) -> np.ndarray:
    """Directions (n, 3) spread evenly over the part of a sphere with y above `least`."""
    k = np.arange(n) + 0.5
    y = 1.0 - (1.0 - least) * k / n
    turn = np.pi * (1.0 + 5.0**0.5) * k
    out = np.sqrt(1.0 - y * y)
    return np.stack([out * np.cos(turn), y, out * np.sin(turn)], axis=1)


def shaken_head() -> str:
    up = np.array([0.0, 0.3, 0.0])
    n = golden(STRANDS, 0.05)
    s = np.linspace(0.0, 1.0, POINTS)[None, :, None]
    out = n * (1.0, 0.0, 1.0) / np.linalg.norm(n * (1.0, 0.0, 1.0), axis=1, keepdims=True)
    down = (out * 0.25 - (0.0, 1.0, 0.0))[:, None]                     # combed down and out: their shape at rest
    points = up + n[:, None] * (RADIUS - 0.004 + 0.5 * LENGTH * s * (2.0 - s)) + 0.5 * LENGTH * s**2 * down
    edge = np.arange(STRANDS) * POINTS
    keys = [(f, 55.0 * np.sin(2.0 * np.pi * (f - 12) / 16.0) * min((f - 12) / 8.0, (76 - f) / 8.0, 1.0))
            for f in range(12, 77, 2)]
    turn = "".join(f"    {f}: {number(a)},\n" for f, a in [(0, 0.0), *keys])
    head = ("double3 xformOp:translate = (0, 0.3, 0)\ndouble xformOp:rotateY.timeSamples = {\n" + turn + "}\n"
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]\n'
            + solid("Sphere", "Skull", f"double radius = {RADIUS}", (0.82, 0.66, 0.54)))
    material = block("Material", "hair", "\n".join([
        said("RodMaterial", 1.0, young=5e7, poisson=0.3), said("Friction", 1.0, density=1300.0, static_friction=0.3,
                                                               dynamic_friction=0.3)]),
        '["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"]',
        "Strands are tufts of hairs, 1.5 mm thick; a single hair is 0.08 mm thick and 60 times stiffer.")
    curves = "\n".join([
        'uniform token type = "linear"', f"int[] curveVertexCounts = {listed(np.full(STRANDS, POINTS))}",
        f"point3f[] points = {listed(points.reshape(-1, 3))}", "float[] widths = [0.0015] (interpolation = \"constant\")",
        "float[] physics:thicknesses = [0.0015]    # m", "rel material:binding:physics = </World/hair>",
        "color3f[] primvars:displayColor = [(0.22, 0.11, 0.05)]"])
    return scene("Hair on a head that is shaken.", [
        settings(), material, block("Xform", "Head", head, comment="It turns to and fro, three times in two seconds."),
        block("BasisCurves", "Hair", curves,
              '["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "MaterialBindingAPI"]',
              "A curve a strand, in the shape in which it is without strain."),
        pin("Roots", "/World/Hair", np.sort(np.concatenate([edge, edge + 1])), "/World/Head",
            "The first two points of every strand go with the head: it is clamped there, and its twist too."),
    ], frames=96)


ROD_SCENES = {"shaken_head": shaken_head}
