"""Obstacles of fluids besides colliders: rigid bodies, by their colliders that meet anything, but planes; surfaces of cloth and
soft bodies. NumPy only."""

from dataclasses import dataclass

import numpy as np

from wsim.physics.fluid.objects import Fluid
from wsim.scene import Surface
from wsim.scene.curve import Motion
from wsim.scene.solids import Plane, Shape


@dataclass
class Shell:
    """A collider of a body.

    path      prim path
    shape     its shape
    motion    its frame to world where the scene starts
    body      number of the body among those of the scene
    """

    path: str
    shape: Shape
    motion: Motion
    body: int


def meets_bodies(fluid: Fluid) -> bool:
    """Whether smoke meets bodies and cloth: not in a part that follows it, nor by a direct solve."""
    return fluid.margin == 0.0 and fluid.pressure != "direct"


def body_shells(scene) -> list[Shell]:
    return [Shell(c.path, c.shape, Motion.still(body.motion.at(0.0) @ c.motion.at(0.0)), k)
            for k, body in enumerate(scene.things("Body")) for c in body.colliders
            if c.meets and not isinstance(c.shape, Plane)]


@dataclass
class ObstacleSheet:
    """The surface of a cloth or soft body of one world.

    path      prim path
    shape     its triangles where the scene starts, from the body's origin
    motion    that origin
    rows      of the points of the state, of each point of the shape
    """

    path: str
    shape: Surface
    motion: Motion
    rows: np.ndarray


def obstacle_sheets(model, world: int = 0) -> list[ObstacleSheet]:
    found = []
    for body in model.bodies:
        if body.world == world and len(body.triangles):
            rows, corners = np.unique(body.triangles, return_inverse=True)
            shape = Surface(body.places[rows - body.first], np.full(len(body.triangles), 3), corners.ravel())
            found.append(ObstacleSheet(body.path, shape, Motion.at_place(tuple(body.origin)), rows))
    return found
