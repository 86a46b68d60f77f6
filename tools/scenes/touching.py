"""Scenes of cloths that collide with themselves."""

import numpy as np

from tools.scenes.cloth import cloth, material
from tools.scenes.soft import eased, samples
from tools.usda import block, ground, listed, moved, pin, scene, settings, solid
from wsim.scene import shapes

TOUCHING = "Sweeps, by name: contacts of surfaces are rows among the others there, and the step is short for what meets."


def ribbon() -> str:
    points, counts, indices = shapes.sheet(0.12, 1.2, 6, 60)
    points = np.array(points, np.float64)
    points[:, 1] -= points[:, 1].min() - 0.03
    points[:, 2] += 0.03 * np.sin(26.0 * points[:, 1])
    return scene("A ribbon of denim falls on its end and lays itself in folds.", [
        settings(solver="xpbd", substeps=24, iterations=4, air_drag=0.3, comment=TOUCHING),
        material("denim", damping=1e-4),
        cloth("Ribbon", (points, counts, indices), "denim", (0.62, 0.14, 0.1), "12 x 120 cm, on end, 3 cm above the ground and "
              "wavy. wsim:selfCollision: no substep ends with triangles that intersect.", self_collision=True),
        ground(),
    ], frames=60)


def twisted_cloth() -> str:
    width, length, turns, frames = 0.08, 1.0, 10.0, 120                        # [m]
    surface = shapes.sheet(length, width, 120, 12, at=(0.0, 0.3, 0.0))
    x, y = np.asarray(surface[0]).T[:2]

    def grip(name: str, sign: float) -> str:
        keys = [(f, turns * eased(f, 8, 112)) for f in range(0, frames + 1, 2)]
        nearer = [0.015 * min(0.5 * n, 1.0)**2 + 0.004 * n for _, n in keys]   # fibres go round: the rope is shorter [m]
        body = "\n".join([
            samples("float3", "xformOp:rotateXYZ", [(f, (sign * 180.0 * n, 0.0, 0.0)) for f, n in keys]),
            samples("double3", "xformOp:translate", [
                (f, (sign * (x.max() - near), y.mean(), 0.0)) for (f, _), near in zip(keys, nearer, strict=True)]),
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]'])
        return block("Xform", name, body, comment="Turns about the axis of the cloth, and comes 5.5 cm nearer.")
    return scene("A strip of cloth is twisted into a rope: its ends turn against each other, ten turns in all.", [
        settings(solver="xpbd", substeps=24, iterations=8, air_drag=1.0, comment=TOUCHING),
        material("denim", damping=1e-4),
        cloth("Cloth", surface, "denim", (0.75, 0.6, 0.2), "100 x 8 cm. wsim:selfCollision: it winds about itself and does "
              "not pass through.", self_collision=True),
        grip("Left", -1.0), grip("Right", 1.0),
        pin("Leftmost", "/World/Cloth", np.flatnonzero(x < x.min() + 1e-6), "/World/Left", "The left edge."),
        pin("Rightmost", "/World/Cloth", np.flatnonzero(x > x.max() - 1e-6), "/World/Right", "The right edge."),
    ], frames=frames)


def mesh(points, counts, indices) -> str:
    """Lines of a Mesh."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return "\n".join([f"float3[] extent = {listed(np.array([low, high]))}", f"point3f[] points = {listed(points)}",
                      f"int[] faceVertexCounts = {listed(counts)}", f"int[] faceVertexIndices = {listed(indices)}",
                      'uniform token subdivisionScheme = "none"'])


def rollers() -> str:
    radius, gap, level, frames, speed = 0.05, 0.9e-3, 0.25, 72, 0.3             # [m], [m/s]
    points, counts, indices = shapes.cylinder(radius, 0.16, 96)
    points = np.asarray(points)[:, [2, 0, 1]]                                  # its axis is x
    surface = shapes.sheet(0.24, 0.72, 10, 30, horizontal=True, at=(0.0, level, -0.335))

    def roller(name: str, sign: float, color) -> str:
        keys = [(f, (-sign * np.rad2deg(speed / radius * f / 24.0), 0.0, 0.0)) for f in range(0, frames + 1, 2)]
        body = mesh(points, counts, indices) + "\n" + samples("float3", "xformOp:rotateXYZ", keys)
        return solid("Mesh", name, body + "\n" + moved(0, level + sign * (radius + 0.5 * gap), 0, "xformOp:rotateXYZ"), color,
                     "A prism of 96 sides, which turns: 30 cm/s where it meets the cloth. Its edges and corners meet the "
                     "triangles of the cloth, too.", ', "PhysicsMeshCollisionAPI"')
    table = ("double size = 1\nfloat3[] extent = [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]\n"
             "float3 xformOp:scale = (0.3, 0.02, 0.68)\n" + moved(0, level - 0.0115, -0.40, "xformOp:scale"))
    return scene("Two rollers that turn pull a cloth from a table through their gap, by friction.", [
        settings(solver="xpbd", substeps=24, iterations=6, air_drag=0.3, comment=TOUCHING),
        material("denim", damping=1e-4),
        cloth("Cloth", surface, "denim", (0.2, 0.32, 0.52), "24 x 72 cm and 1 mm thick; the gap is 0.9 mm. wsim:selfCollision: "
              "no substep ends with triangles that intersect, those of the rollers and of the table among them.",
              self_collision=True),
        roller("Upper", 1.0, (0.62, 0.52, 0.43)), roller("Lower", -1.0, (0.5, 0.36, 0.24)),
        solid("Cube", "Table", table, (0.55, 0.56, 0.6), "A Cube of size 1, scaled."),
        ground(),
    ], frames=frames)


TOUCHING_SCENES = {"ribbon": ribbon, "twisted_cloth": twisted_cloth, "rollers": rollers}
