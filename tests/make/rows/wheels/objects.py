"""Wheels: theta' = omega, omega' = -drag omega, so that theta = theta_0 + omega_0 (1 - exp(-drag t)) / drag."""

from dataclasses import dataclass

from wsim.scene.bodies import ArrayDataclass


@dataclass(eq=False)
class Wheel(ArrayDataclass):
    path: str
    angle: float = 0.0          # [rad]
    rate: float = 1.0           # [rad/s]
    drag: float = 0.0           # [1/s]
