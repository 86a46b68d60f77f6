"""Writes the example scenes, small commented .usda files. Run: python -m tools.scenes [FOLDER]   (default: scenes)

Numbers come from `wsim.shapes` and `wsim.scene.fabric`; attribute names and units from the table of `wsim.usd.names`
(tools/usda.py). The comments are for people who author such files themselves. tests/tools/test_scenes.py holds the files
equal to what is written.
"""

from math import cos, pi, radians, sin

import numpy as np

from tools.scenes.animation import ANIMATION_SCENES
from tools.scenes.bodies import BODY_SCENES
from tools.scenes.cloth import SOFT, cloth, looks, material, thickness
from tools.scenes.clusters import CLUSTER_SCENES
from tools.scenes.fluid import FLUID_SCENES
from tools.scenes.grains import GRAIN_SCENES
from tools.scenes.machines import MACHINE_SCENES
from tools.scenes.rigid import RIGID_SCENES
from tools.scenes.rods import ROD_SCENES
from tools.scenes.skeleton import SKELETON_SCENES
from tools.scenes.soft import SOFT_SCENES
from tools.scenes.touching import TOUCHING_SCENES
from tools.scenes.worn import WORN_SCENES
from tools.usda import block, ground, listed, moved, number, pin, scene, settings, solid
from wsim.scene import shapes

SHORT = "Many short substeps of few iterations: a fine cloth's stretch goes with h^2 / iterations."


def hanging_cloth() -> str:
    n = 32
    surface = shapes.sheet(1.0, 1.0, n, n, horizontal=True, at=(0.0, 1.2, 0.0))
    return scene("A square metre of cotton, held by two corners, swings down from the horizontal.", [
        settings(substeps=40, iterations=2, air_drag=0.5, comment=SHORT),
        material("cotton", damping=3e-4),
        cloth("Cloth", surface, "cotton", (0.75, 0.2, 0.16), "Simulated and drawn: one Mesh does both. Without a "
              "damping time of 0.3 ms the swing leaves zigzag below the pins, and crumples the free corners."),
        block("Xform", "Rail", "", comment="What the corners hang on. Animate it, and they follow."),
        pin("Corners", "/World/Cloth", [0, n], "/World/Rail", "indices0 are points of the mesh in their order."),
    ], frames=96)


def flag() -> str:
    nx, ny = 36, 24
    surface = shapes.sheet(1.5, 1.0, nx, ny, at=(0.75, 2.0, 0.0))
    pole = ('uniform token axis = "Y"\ndouble radius = 0.02\ndouble height = 2.7\n' + moved(-0.02, 1.35, 0)
            + "\ncolor3f[] primvars:displayColor = [(0.45, 0.4, 0.35)]")
    return scene("A flag of sailcloth on a pole, in a wind of 6 m/s that comes a little from the side.", [
        settings(comment="The wind is the velocity of the air; what is at rest in it feels it all.",
                 substeps=40, iterations=2, wind=(6.0, 0.0, 0.5), air_density=1.2),
        material("sailcloth", comment="Polyester of 170 g/m^2, stiff with resin: the wind bends it over (bend / pressure)^"
                 "(1/3) = 5 cm, and a mesh of 4 cm shows its folds; those of a silk, of 8 mm, it could not, and would crumple. "
                 "The stretch is a fortieth of such a cloth's: what it gives is not seen, and smaller steps are saved."),
        cloth("Flag", surface, "sailcloth", (0.1, 0.3, 0.65), "drag acts along the relative wind, lift across it; without "
              "them wind does nothing. Lift makes it flutter: of a thin plate it is 2 pi times the sine of the angle, "
              "less where the plate is short.", drag=0.3, lift=0.7),
        block("Cylinder", "Pole", pole, comment="To be seen only: it has no PhysicsCollisionAPI."),
        pin("Rope", "/World/Flag", np.arange(ny + 1) * (nx + 1), "/World/Pole", "The edge along the pole."),
    ], frames=96)


def cape_surface(columns: int, rows: int, radius: float, center: np.ndarray, length: float):
    """A cone, touching a ball at 45 degrees from above, open in front: it lies on the shoulders and can fall."""
    points, counts, indices = shapes.sheet(1.0, 1.0, columns, rows)
    turn = radians(230.0) * points[:, 0]                             # -115 .. 115 degrees from the back (-z)
    down = length * (0.5 - points[:, 1])                             # along the cloth from its upper edge
    out = (radius + down) * sin(pi / 4)
    place = np.stack([-out * np.sin(turn), (radius - down) * cos(pi / 4), -out * np.cos(turn)], axis=1)
    return place + center, counts, indices


def cape() -> str:
    columns, rows, radius, center = 54, 30, 0.25, np.array([0.0, 1.3, 0.0])
    surface = cape_surface(columns, rows, radius + 0.006, center, 0.85)
    keys = []
    for frame in range(0, 121, 3):                                   # rest, walk 1.2 m and back, turning half round
        s = min(max((frame - 24) / 84.0, 0.0), 1.0)
        s = s * s * (3.0 - 2.0 * s)
        keys.append((frame, 0.6 * sin(2.0 * pi * s), 0.9 * s, 180.0 * s))
    walk = ("double3 xformOp:translate.timeSamples = {\n"
            + "".join(f"    {f}: ({number(x)}, {center[1]:g}, {number(z)}),\n" for f, x, z, _ in keys) + "}\n"
            + "double xformOp:rotateY.timeSamples = {\n" + "".join(f"    {f}: {number(a)},\n" for f, _, _, a in keys)
            + '}\nuniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]\n')
    ball = solid("Sphere", "Ball", f"double radius = {radius}\nfloat3[] extent = [(-0.25, -0.25, -0.25), (0.25, 0.25, "
                 "0.25)]", (0.82, 0.68, 0.52), "A collider below an animated Xform moves, and drags what touches it. Points "
                 "keep 4 mm from it, so that flat triangles between them do not cut into it.", keep=0.004)
    return scene("A cape of leather on an animated ball that walks and turns.", [
        settings(substeps=40, iterations=2, air_density=1.2, comment=SHORT),
        material("leather"),
        block("Xform", "Wearer", walk + "\n" + ball, comment="Rests for a second, then walks and turns half round."),
        cloth("Cape", surface, "leather", (0.45, 0.08, 0.12), "A cone that opens in front. Gravity bends leather over 6 cm, "
              "(bend / (weight per area))^(1/3): this mesh shows its folds, where those of cotton are angular. Air resistance "
              "keeps it from fluttering like a sheet in vacuum; a flat plate has a drag of 1.2 (Hoerner 1965).", drag=1.2,
              lift=0.6),
        pin("Collar", "/World/Cape", np.arange(columns + 1), "/World/Wearer", "The upper edge moves with the wearer."),
    ], frames=120)


def tablecloth() -> str:
    table = ("double size = 1\nfloat3[] extent = [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]\n"
             "float3 xformOp:scale = (0.46, 0.45, 0.46)\n" + moved(0, 0.225, 0, "xformOp:scale"))
    n = 32
    surface = shapes.sheet(0.8, 0.8, n, n, horizontal=True, at=(0.0, 0.51, 0.0))
    return scene("A tablecloth of denim falls on a side table and drapes over its edges.", [
        settings(substeps=24, iterations=3, air_drag=0.5),
        material("denim", damping=1e-4),
        cloth("Tablecloth", surface, "denim", (0.2, 0.32, 0.52), "Starts 6 cm above the table. The length over which gravity "
              "bends denim, (bend / (weight per area))^(1/3), is 17 mm: a mesh of 25 mm just shows its folds, one of 47 mm "
              "crumples at the corners."),
        solid("Cube", "Table", table, (0.5, 0.36, 0.24), "A Cube of size 1, scaled to 46 x 45 x 46 cm. "
              "Points keep 10 mm from it: a thread of length l cuts a sharp edge unless its ends keep l / sqrt(8), "
              "here 9 mm.", keep=0.01),
        ground(),
    ], frames=72)


def shirt() -> str:
    metres = 0.01
    points, counts, indices = shapes.torso(0.85)
    points = points[:, [0, 2, 1]] * (1.0, 1.0, -1.0) / metres         # up is y; the front, +y of the dummy, becomes -z
    dummy = "\n".join([f"float3[] extent = {listed(np.array([points.min(axis=0), points.max(axis=0)]))}",
                       f"point3f[] points = {listed(points)}", f"int[] faceVertexCounts = {listed(counts)}",
                       f"int[] faceVertexIndices = {listed(indices)}", 'uniform token subdivisionScheme = "none"',
                       moved(0, 76, -4.2)])
    garment = "\n".join([looks("cotton", (0.10, 0.30, 0.34)), thickness("cotton", metres),
                         'uniform token subdivisionScheme = "none"', moved(0, 4, 0)])
    mesh = block("Mesh", "Shirt", garment, SOFT, "The garment as it was delivered: a bare mesh in another file, "
                 "untouched. Its units are not authored; it is in centimetres, and so is this stage. What makes it a "
                 "cloth is authored here, over the reference.")
    there = "prepend references = @assets/unisex_shirt.usd@</root/shirt>\n    "
    mesh = mesh.replace("prepend apiSchemas", there + "prepend apiSchemas", 1)
    return scene("A shirt drops on a tailor's dummy. Everything is in centimetres.", [
        settings(metres, substeps=192, iterations=1, error=0.025, air_drag=1.0, comment=SHORT + " 96 of them left "
                 "a strain of 0.8 in the seams of its collar, 1.5 mm wide. An error of 2.5 % of its size may be, where "
                 "1 % is the default."),
        material("cotton", metres), mesh,
        solid("Mesh", "Dummy", dummy, (0.62, 0.52, 0.43), "A closed mesh is solid; its faces are wound outward. "
              "Points keep 4 mm from it.", ', "PhysicsMeshCollisionAPI"', keep=0.004, metres=metres),
    ], frames=72, metres=metres)


SCENES = {"hanging_cloth": hanging_cloth, "flag": flag, "cape": cape, "tablecloth": tablecloth, "shirt": shirt,
          **SOFT_SCENES, **RIGID_SCENES, **BODY_SCENES, **MACHINE_SCENES, **FLUID_SCENES, **GRAIN_SCENES, **ANIMATION_SCENES,
          **SKELETON_SCENES, **ROD_SCENES, **TOUCHING_SCENES, **WORN_SCENES, **CLUSTER_SCENES}
