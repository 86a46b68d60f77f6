"""What tests/physics/rigid/standing/test_stacks.py shares with other tests: dice, floor, moved, piled, tower."""

import numpy as np

from tests.physics.rigid.pairs import WHERE
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Plane, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def floor(rub: float = 0.5, **more) -> Scene:
    """A stage's defaults: 24 fps, no substeps named."""
    scene = Scene(up="Z", **more)
    scene.collider("/floor", Plane(), static_friction=rub, dynamic_friction=rub)
    return scene


def piled(shapes: list, masses=None, **more) -> Scene:
    """Shapes on one another; (shape, height) of each [m]."""
    scene, z = floor(**more), 0.0
    for k, (shape, height) in enumerate(shapes):
        scene.add(Body(f"/b{k}", [Collider(f"/b{k}/shape", shape)], Motion.at_place((0.0, 0.0, z + 0.5 * height)),
                       mass=masses[k] if masses else None))
        z += height
    return scene


def dice(n: int = 10, size: float = 0.016, **more) -> Scene:
    return piled([(Box((0.5 * size,) * 3), size)] * n, **more)


def tower() -> Scene:
    """18 levels of three wooden blocks of 75 x 25 x 15 mm, every other level turned."""
    scene, long, wide = floor(), 0.0375, 0.0125
    for k in range(54):
        level, side = divmod(k, 3)
        turned, at = level % 2, 0.0252 * (side - 1)
        half = (wide, long, 0.0075) if turned else (long, wide, 0.0075)
        place = (at * turned, at * (1 - turned), 0.015 * (level + 0.5))
        scene.add(Body(f"/b{k}", [Collider(f"/b{k}/shape", Box(half))], Motion.at_place(place), density=600.0))
    return scene


def moved(scene: Scene, seconds: float = 5.0) -> tuple[float, float, Simulation]:
    """How far the top has sunk [m], the largest turn of a body [degrees], and the simulation."""
    sim = Simulation(scene, **WHERE)
    rigid = sim.plan.method("rigid")
    start = rigid.poses()
    sim.run(round(seconds * scene.fps))
    end = rigid.poses()
    turns = np.einsum("nij,nij->n", start[:, :3, :3], end[:, :3, :3])
    top = np.argmax(start[:, 2, 3])
    return start[top, 2, 3] - end[top, 2, 3], float(np.degrees(np.arccos(np.clip(0.5 * (turns - 1.0), -1.0, 1.0))).max()), sim
