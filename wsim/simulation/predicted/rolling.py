"""Substeps a frame for bodies that roll or spin on others at the start. NumPy only.

A hull that turns at omega [rad/s] on another body passes omega / 2 pi times the facets of one turn each second. The contact
point of a leaning coin precesses at |de / dt| [rad/s], see kernels/rigid/narrow/rolling.py. If more than MANY facets or radians
pass in a substep, the body loses too much speed; FEW are accurate enough. This file counts them at the start, for bodies that
touch something there. Bodies that begin to roll later are checked during the run (`wsim.simulation.measure.checks.rolling`).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from wsim.simulation.predicted.bearing import BearingBodies

FEW, MANY = 0.25, 0.35 # facets or [rad] in a substep; MANY as kernels/rigid/checks.py has it
SAMPLES, SAME, FLAT = 256, 1e-3, 1e-2          # as kernels/rigid/narrow/rolling.py has them
BRIEF = 1e-4           # [rad] of turn, over which the rate of a rim is taken
ROLLS = {"hull": "rolls over {} facets of its hull", "rim": "precesses on its rim by {} rad"}


def facets_in_one_turn(points: np.ndarray, axis: np.ndarray, n: np.ndarray) -> int:
    """Number of facets of a hull that pass in one turn about the unit vector `axis`. points: its vertices, (p, 3); n: outward
    unit normal at the start of the turn, (3,)."""
    along = (n @ axis) * axis
    x = n - along
    a = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    d = along + np.cos(a)[:, None] * x + np.sin(a)[:, None] * np.cross(axis, x)
    best = points[np.argmax(d @ points.T, axis=1)]
    turning = best - (best @ axis)[:, None] * axis
    moved = np.linalg.norm(turning - np.roll(turning, 1, axis=0), axis=1)
    return int((moved > SAME * np.linalg.norm(points, axis=1).max()).sum())


def rim_rate(axis: np.ndarray, spin: np.ndarray, n: np.ndarray) -> float:
    """Precession rate [rad/s] of the contact point of a rim, in the world frame; 0 for a disc that rolls straight on. axis: of
    the disc; n: outward normal; both unit vectors (3,). spin: angular velocity [rad/s], (3,)."""
    speed = float(np.linalg.norm(spin))
    across = n - (n @ axis) * axis
    if speed == 0.0 or np.linalg.norm(across) < FLAT:
        return 0.0
    time = BRIEF / speed
    later = axis + time * np.cross(spin, axis)
    later /= np.linalg.norm(later)
    then = n - (n @ later) * later
    return float(np.arctan2(np.linalg.norm(np.cross(across, then)), across @ then)) / time


@dataclass(frozen=True)
class RollingBody:
    """A body that rolls or spins at the start.

    path    of its prim; "": no body does
    rate    facets or radians that pass a second [1/s]
    kind    key of `ROLLS`
    """

    path: str = ""
    rate: float = 0.0
    kind: str = "hull"

    def describe_substeps(self, h: float) -> str:
        """Message with the facets or radians that pass in a substep of h [s]."""
        return f"{self.path} {ROLLS[self.kind].format(f'{h * self.rate:.2g}')} in a substep"


def fastest_rolling_body(bodies: "BearingBodies") -> RollingBody:
    """The body with the highest rate among those that touch something at the start."""
    s, t, found = bodies.solids, bodies.touches, RollingBody()
    spins = np.array([*[body.spin for body in bodies.bodies], np.zeros(3)], np.float64)      # of what stands: the last
    for a, b, n in zip(t.a, t.b, t.n, strict=True):
        for shape, other, out in ((a, b, -n), (b, a, n)):
            own = spins[s.body[shape]] if shape >= 0 else np.zeros(3)
            spin = own - (spins[s.body[other]] if other >= 0 else 0.0)
            speed = float(np.linalg.norm(spin))
            if speed == 0.0 or np.linalg.norm(own) < 0.5 * speed:
                continue
            R, rate, kind = s.axes[shape], 0.0, "rim" if s.disc[shape] > 0.0 else "hull"
            if kind == "rim":
                rate = rim_rate(R[:, 2], spin, out)
            elif s.hulls[shape] >= 0 and np.linalg.norm(np.cross(out, spin / speed)) > FLAT:
                rate = facets_in_one_turn(s.vertices[s.hulls[shape]], R.T @ spin / speed, R.T @ out) * speed / (2.0 * np.pi)
            if rate > found.rate:
                found = RollingBody(bodies.bodies[s.body[shape]].path, rate, kind)
    return found
