"""Brakes: v' = -grip v of every point of a body, beside all that moves it."""

from dataclasses import dataclass

from wsim.scene.bodies import ArrayDataclass


@dataclass(eq=False)
class Brake(ArrayDataclass):
    path: str
    body: str                   # path of a body
    grip: float = 0.0           # [1/s]
