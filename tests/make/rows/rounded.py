"""A collider shape that is no part of wsim: a cylinder whose rim is rounded. One file and one row (`ROW`).

The core is a cylinder that is smaller by the rim's radius r on all sides, and the shape is all within r of it: with a = rho -
(R - r) and b = |z| - (H - r), phi = |(max(a, 0), max(b, 0))| + min(max(a, b), 0) - r, exact inside and outside.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import primitives
from wsim.kernels.contact.collider.shape import radial_distance
from wsim.scene.solids import ShapeRow, is_uniform_scale


@dataclass(frozen=True)
class Rounded:
    """Along own z; half_height [m] of all of it, radius [m] and that of the rim [m]."""

    radius: float
    half_height: float
    rim: float


@wp.func
def formula(size: Any, q: Any):
    zero = type(q[0])(0.0)
    rho, out = radial_distance(q)
    up = type(q)(zero, zero, wp.sign(q[2]))
    a = rho - (size[0] - size[2])
    b = wp.abs(q[2]) - (size[1] - size[2])
    phi = wp.max(a, b)
    n = out
    if b > a:
        n = up
    if a > zero and b > zero:
        phi = wp.sqrt(a * a + b * b)
        n = (a * out + b * up) / phi
    return phi - size[2], n


def distance(shape: Rounded, q: np.ndarray) -> np.ndarray:
    a = np.hypot(q[:, 0], q[:, 1]) - (shape.radius - shape.rim)
    b = np.abs(q[:, 2]) - (shape.half_height - shape.rim)
    return np.hypot(np.maximum(a, 0.0), np.maximum(b, 0.0)) + np.minimum(np.maximum(a, b), 0.0) - shape.rim


def outline(parameters, sides: int) -> primitives.Outline:
    R, H, r = parameters
    angle = np.linspace(0.0, 0.5 * np.pi, sides // 8 + 1)
    rim = np.stack([R - r + r * np.sin(angle), -(H - r) - r * np.cos(angle)], axis=1)
    return primitives.surface_of_revolution([(0.0, -H), *rim, *(rim[::-1] * (1.0, -1.0)), (0.0, H)], sides)


ROW = ShapeRow("rounded", Rounded, ball=lambda s: float(np.hypot(s.radius, s.half_height)), curvature=lambda s: s.rim,
               distance=distance, usd={"ToyRoundedAPI": ("radius", "height", "toy:rim")}, written=("Cylinder", "ToyRoundedAPI"),
               read=lambda radius, height, rim: (radius, height / 2.0, rim),
               scaled=lambda p,
               scale: Rounded(*(float(v * abs(scale[0])) for v in p)) if is_uniform_scale(scale, (1, 2)) else None,
               outline=outline, write=lambda s: {"radius": s.radius, "height": 2.0 * s.half_height, "toy:rim": s.rim},
               given=lambda s: (s.radius, s.half_height, s.rim), formula="tests.make.rows.rounded:formula")
