"""Cloth material: what a thin sheet is made of, in SI units, validated when made.

Energy of a deformed sheet, per rest area (plane stress; e_u, e_v stretches, g shear of warp and weft):

    psi = 1/2 stretch/(1 - nu^2) (e_u^2 + e_v^2 + 2 nu e_u e_v) + 1/2 shear g^2 + 1/2 bend kappa^2

so `stretch` = E t is the stiffness of a strip, force per width and strain [N/m], `shear` = G t [N/m],
`bend` = E t^3 / (12 (1 - nu^2)) [N m] for a homogeneous sheet of thickness t.
"""

from dataclasses import dataclass, fields
from math import inf, isfinite


@dataclass(frozen=True)
class Fabric:
    """Parameters of a sheet. Raises ValueError naming the parameter, what was found and what is allowed."""

    stretch: float = 1.0e3          # in-plane stiffness E t [N/m], > 0
    shear: float = 3.0e2            # shear stiffness G t [N/m], >= 0
    bend: float = 1.0e-5            # bending stiffness [N m], >= 0
    thickness: float = 1.0e-3       # [m], > 0; also the distance that a collider keeps (half a side)
    density: float = 200.0          # [kg/m^3], > 0; density * thickness is the mass per area
    poisson: float = 0.0            # nu, in (-1, 0.5)
    damping: float = 0.0            # relaxation time of elastic forces [s]: damping force = damping * stiffness * rate
    strain_limit: float = inf       # edges may not stretch beyond 1 + strain_limit times rest; inf: no limit
    static_friction: float = 0.5
    dynamic_friction: float = 0.5

    def __post_init__(self):
        for f in fields(self):
            value = getattr(self, f.name)
            low, strict, high = _RANGES.get(f.name, (0.0, False, inf))
            if not (isfinite(value) or (f.name == "strain_limit" and value == inf)):
                raise ValueError(f"{f.name} is {value}; it must be finite")
            if value < low or (strict and value == low) or (high < inf and value >= high):
                raise ValueError(f"{f.name} is {value:g}; allowed is {'>' if strict else '>='} {low:g}"
                                 + (f" and < {high:g}" if high < inf else ""))


_RANGES = {"stretch": (0.0, True, inf), "thickness": (0.0, True, inf), "density": (0.0, True, inf),
           "poisson": (-1.0, True, 0.5), "strain_limit": (0.0, False, inf)}
