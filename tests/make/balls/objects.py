"""Balls of a mass that do not turn."""

from dataclasses import dataclass

from wsim.scene.bodies import Compared


@dataclass(eq=False)
class Ball(Compared):
    path: str
    place: tuple[float, float, float]           # [m]
    velocity: tuple[float, float, float]        # [m/s]
    mass: float = 1.0                           # [kg]
    radius: float = 0.1                         # [m]
    friction: tuple[float, float] = (0.0, 0.0)
    restitution: float = 0.0
