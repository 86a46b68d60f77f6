"""Rigid bodies as fluids meet them: the colliders of each that meet anything, but planes. NumPy only."""

from dataclasses import dataclass

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


def shells(scene) -> list[Shell]:
    return [Shell(c.path, c.shape, Motion.still(body.motion.at(0.0) @ c.motion.at(0.0)), k)
            for k, body in enumerate(scene.things("Body")) for c in body.colliders
            if c.meets and not isinstance(c.shape, Plane)]
