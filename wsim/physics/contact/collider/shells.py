"""What fluids and material points meet besides colliders: rigid bodies, by their colliders that meet anything, but planes;
surfaces of cloth and soft bodies. NumPy only."""

from dataclasses import dataclass

import numpy as np

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
    static_friction, dynamic_friction    coefficients [1]
    """

    path: str
    shape: Shape
    motion: Motion
    body: int
    static_friction: float = 0.0
    dynamic_friction: float = 0.0


def body_shells(scene) -> list[Shell]:
    return [Shell(c.path, c.shape, Motion.still(body.motion.at(0.0) @ c.motion.at(0.0)), k, c.static_friction,
                  c.dynamic_friction)
            for k, body in enumerate(scene.things("Body")) for c in body.colliders
            if c.meets and not isinstance(c.shape, Plane)]


@dataclass
class ObstacleSheet:
    """The surface of a cloth or soft body of one world.

    path      prim path
    shape     its triangles where the scene starts, from the body's origin
    motion    that origin
    rows      of the points of the state, of each point of the shape
    static_friction, dynamic_friction    coefficients [1]
    """

    path: str
    shape: Surface
    motion: Motion
    rows: np.ndarray
    static_friction: float = 0.0
    dynamic_friction: float = 0.0


def obstacle_sheets(model, world: int = 0) -> list[ObstacleSheet]:
    found = []
    for body in model.bodies:
        if body.world == world and len(body.triangles):
            rows, corners = np.unique(body.triangles, return_inverse=True)
            shape = Surface(body.places[rows - body.first], np.full(len(body.triangles), 3), corners.ravel())
            found.append(ObstacleSheet(body.path, shape, Motion.at_place(tuple(body.origin)), rows,
                                       *map(float, body.friction)))
    return found


def has_obstacles(scene) -> bool:
    """True if a scene has shells or surfaces."""
    return bool(scene.bodies() or body_shells(scene))
