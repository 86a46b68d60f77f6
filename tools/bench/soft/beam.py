"""Beam theory: a straight bar, clamped at one end and free at the other, small deflections. What a fine mesh should come to.

    w'' = M/(E I)                          Euler, Bernoulli: plane sections stay normal to the axis
    w' = theta + V/(k G A),  theta' = M/(E I),  M' = -V - rho I omega^2 theta,  V' = -rho A omega^2 w        Timoshenko 1921

w deflection [m], theta turn of the section [rad], M moment [N m], V shear force [N]. k is Cowper's shear coefficient of a
rectangle (Cowper 1966), 10 (1 + nu) / (12 + 11 nu). Both leave out that a clamp hinders the section from narrowing.
"""

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

FIRST = 1.8751040687119611        # cos(b) cosh(b) = -1


@dataclass(frozen=True)
class Beam:
    """A bar of rectangular section: length, width, height (the way it bends) [m], young [Pa], poisson, density [kg/m^3]."""

    length: float
    width: float
    height: float
    young: float
    poisson: float
    density: float

    @property
    def area(self) -> float:
        return self.width * self.height

    @property
    def bend(self) -> float:
        """E I [N m^2]."""
        return self.young * self.width * self.height ** 3 / 12.0

    @property
    def shear(self) -> float:
        """k G A [N]."""
        nu = self.poisson
        return 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu) * self.young / (2.0 * (1.0 + nu)) * self.area

    def sag(self, gravity: float = 9.81, timoshenko: bool = True) -> float:
        """Deflection of the tip [m] under the bar's own weight, where it is small beside the length."""
        load = gravity * self.density * self.area
        return load * self.length ** 4 / (8.0 * self.bend) + timoshenko * load * self.length ** 2 / (2.0 * self.shear)

    def frequency(self, timoshenko: bool = True) -> float:
        """First frequency [Hz] of bending. Timoshenko's is the first zero of the determinant that a free end asks for."""
        slender = (FIRST / self.length) ** 2 * sqrt(self.bend / (self.density * self.area)) / (2.0 * pi)
        if not timoshenko:
            return slender
        inertia = self.density * self.width * self.height ** 3 / 12.0

        def left_over(hertz):
            square = (2.0 * pi * hertz) ** 2
            A = np.array([[0.0, 1.0, 0.0, 1.0 / self.shear],
                          [0.0, 0.0, 1.0 / self.bend, 0.0],
                          [0.0, -inertia * square, 0.0, -1.0],
                          [-self.density * self.area * square, 0.0, 0.0, 0.0]])
            return np.linalg.det(expm(A * self.length)[2:, 2:])     # of M, V at the tip from M, V at the clamp

        return float(brentq(left_over, 0.3 * slender, 1.1 * slender, xtol=1e-12 * slender))
