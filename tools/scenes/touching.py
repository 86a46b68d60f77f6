"""Scenes of cloths that collide with themselves."""

import numpy as np

from tools.scenes.cloth import cloth, material
from tools.scenes.soft import eased, samples
from tools.usda import block, ground, moved, pin, scene, settings
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
    columns, rows, turns, frames = 16, 32, 0.8, 72
    surface = shapes.sheet(0.4, 0.8, columns, rows, at=(0.0, 0.5, 0.0))
    up = np.asarray(surface[0])[:, 1]

    def grip(name: str, sign: float, y: float) -> str:
        keys = [(f, (0.0, sign * 180.0 * turns * eased(f, 4, 64), 0.0)) for f in range(0, frames + 1, 2)]
        body = samples("float3", "xformOp:rotateXYZ", keys) + "\n" + moved(0, y, 0, "xformOp:rotateXYZ")
        return block("Xform", name, body, comment="Turns about the axis of the cloth.")
    return scene("A cloth is twisted into a rope: its ends turn against each other, 0.8 of a turn in all.", [
        settings(solver="xpbd", substeps=24, iterations=10, air_drag=1.0, comment=TOUCHING),
        material("cotton", damping=1e-4),
        cloth("Cloth", surface, "cotton", (0.75, 0.6, 0.2), "40 x 80 cm. wsim:selfCollision: it winds about itself and does "
              "not pass through.", self_collision=True),
        grip("Upper", 1.0, float(up.max())), grip("Lower", -1.0, float(up.min())),
        pin("Above", "/World/Cloth", np.flatnonzero(up > up.max() - 1e-6), "/World/Upper", "The upper edge."),
        pin("Below", "/World/Cloth", np.flatnonzero(up < up.min() + 1e-6), "/World/Lower", "The lower edge."),
    ], frames=frames)


TOUCHING_SCENES = {"ribbon": ribbon, "twisted_cloth": twisted_cloth}
