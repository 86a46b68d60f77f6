"""Growth of small differences in a run, and the error of leapfrog, measured as the run goes.

A point that moves across its sheet by u is driven back by u sum_e T_e, T_e = f_e / l_e the tension of its edges [N/m]: of
springs k strain, of a sheet stretch strain + bend (pi / l)^2. Where the sum is negative u grows as exp(sigma t),

    sigma^2 = -sum_e T_e / m,    growth = exp(integral of r dt),    r = (s^2 + c^2 / 4)^(1/2) - c / 2,    s = GROWS RMS sigma

in air that takes the body with it at the rate c [1/s]. Leapfrog of steps h errs, over the size L, by the sum of

    p       LEAP (g + a) h^2 / L + (c h)^2 w / 2 L: a is the acceleration by the wind, w the distance that the points have gone
            (RMS speed, summed); half of a step's change by the air is taken from the step before. SLIVERS where slivers have
            more mass, and the rounding of float32
    hits    HIT h v / L once something touches a collider, v the largest RMS speed since the frame before: met at some time
            of a step
    edges   a sheet's points beside an edge of a box, or a rim, go to one side or the other of it, whatever the steps:
            l sqrt(share of the points that touch there, the largest so far, from EDGED on), l an edge of the sheet over L
    folds   a SHARE of what p gains in each frame, and SEED, times the growth from there on; at most FOLD edges

Measured (tools/bench/choice/reported_errors.py; random meshes, nets, soft bodies on and off colliders): the logarithm of the
growth of a perturbation that two runs show is 0.4 to 1.4 times what is said where that is above 3.
"""

from collections.abc import Callable
from math import exp, sqrt
from typing import Any, cast

import numpy as np

from wsim.model.model import edge_lengths
from wsim.scene import Box, Cone, Cylinder
from wsim.simulation.predicted import errors

GROWS = 0.81           # points of a sheet do not move one by one, and compression comes and goes
SEED = 1e-7            # over the size: what float32 leaves in a frame is 1e-8 to 3e-8
SHARE = 0.3            # of the error that steps make, which is across the sheet
FOLD = 1.0             # folds that come out differently differ by 0.04 to 0.8 edges, in crumpled sheets by 4
HIT = 1.5              # cloths and soft bodies that fall on colliders, RMS error over h v / L: 0.04 to 1.3; a cube that
                       # a box throws up, 8
EDGED = 0.02           # share beside edges of colliders from which they count: of 15 sheets 13 then part by 0.1 to 2 edges
SHEETS, TETS = 1e-6, 5e-6      # error over L that float32 leaves in 6 to 13 frames: 1e-7 to 1e-6, and 6e-7 to 5.5e-6


class DifferenceGrowth:
    """Growth of small differences since a run began; sums are over its frames.

    factor      growth of a difference that was there at the start
    air         rate [1/s] at which the air takes a body with it, the largest
    grown       what has grown from SEED and from a share of the errors of leapfrog, over the size
    """

    def __init__(self, sim):
        self.model, self.dt, self.size = sim.model, 1.0 / sim.scene.fps, errors.size_of_model(sim.model)
        self.edge = max(b.size / b.row for b in errors.falling_bodies(sim.model)) / self.size
        self.air = max(c for _, c in errors.acceleration_by_air(sim.model))
        # soft bodies do not fold
        self.sheets = [AcrossStiffness(b) for b in self.model.bodies if len(b.edges) and not len(b.tets)]
        self.exponent, self.grown, self.touched = 0.0, SEED, False

    @property
    def factor(self) -> float:
        return exp(min(self.exponent, 300.0))

    @property
    def folded(self) -> bool:
        """True where folds come out differently on another device, or with other steps."""
        return self.grown >= FOLD * self.edge

    @property
    def smooth(self) -> bool:
        """True while nothing touched a collider and differences have hardly grown: errors scale with a power of the step."""
        return not self.touched and self.grown < 0.1 * self.edge

    def touch(self, sim, points: int) -> np.ndarray:
        """Mask of the points that touch a collider at the end of a frame, (points,)."""
        mark, touching = sim.state.points.arrays.get("mark"), np.zeros(points, bool)
        if mark is not None:
            from wsim.kernels.contact.project import TOUCHED  # of scenes with colliders
            touching = (mark.numpy() & TOUCHED) > 0
        came = sim.forms["free"] > 0 and not sim.plan.clock.free              # the device saw one come near
        self.touched = bool(self.touched or came or touching.any())
        return touching

    def look(self, x: np.ndarray, error: float = 0.0) -> None:
        """Looks at positions (points, 3) [m] at the end of a frame; error: that its steps made, over the size."""
        s, half = GROWS * max((sheet.rms_instability(x) for sheet in self.sheets), default=0.0), 0.5 * self.air
        grows = (sqrt(s * s + half * half) - half) * self.dt
        self.exponent += grows
        self.grown = self.grown * exp(min(grows, 300.0)) + SHARE * error


class LeapfrogErrorGrowth(DifferenceGrowth):
    """The error of a run of leapfrog so far; edged: largest share of points that touched beside edges of colliders."""

    def __init__(self, sim):
        super().__init__(sim)
        soft = any(len(b.tets) for b in sim.model.bodies)
        self.edges, self.edged = [] if soft else [c for c in sim.scene.colliders if type(c.shape) in BESIDE], 0.0
        choice, bodies = sim.plan.choice, errors.falling_bodies(sim.model)
        self.h, self.way, self.speed, self.fastest = self.dt / choice.steps, 0.0, 0.0, 0.0
        pulled = max(b.g + a for b, (a, _) in zip(bodies, errors.acceleration_by_air(sim.model), strict=True))
        self.plain = errors.LEAP * pulled * self.h**2 / self.size + choice.slowed * errors.SLIVERS
        self.rounded = TETS if soft else SHEETS
        self.before = 0.0

    @property
    def steps(self) -> float:
        """Error p of its steps."""
        return self.plain + 0.5 * (self.air * self.h)**2 * self.way

    @property
    def error(self) -> float:
        """Over the size."""
        aside = self.edge * sqrt(self.edged) if self.edged > EDGED else 0.0
        return self.rounded + self.steps + HIT * self.h * self.fastest + aside + min(self.grown, FOLD * self.edge)

    @property
    def folded(self) -> bool:
        return super().folded or self.edged > EDGED

    def follow(self, sim, x: np.ndarray) -> None:
        """Looks at the end of a frame of positions x (points, 3) [m]."""
        speed = float(np.sqrt((sim.state.v.numpy().astype(np.float64)**2).sum(axis=1).mean())) / self.size
        self.way += speed * self.dt
        touching = self.touch(sim, len(x))
        if self.edges and touching.any():
            self.edged = max(self.edged, self.beside(sim, x, touching))
        if self.touched:
            self.fastest = max(self.fastest, speed, self.speed)
        self.speed = speed
        self.look(x, self.steps - self.before)
        self.before = self.steps

    def beside(self, sim, x: np.ndarray, touching: np.ndarray) -> float:
        """Share of the points at x (points, 3) [m] that touch a collider within an edge of the sheet from one of its own."""
        x = np.concatenate([x[b.first:b.last] + b.origin for b in self.model.bodies])[touching]
        found = np.zeros(len(x), bool)
        for collider in self.edges:
            M = collider.motion.at(sim.time)
            found |= BESIDE[type(collider.shape)](collider.shape, (x - M[:3, 3]) @ M[:3, :3], self.edge * self.size)
        return float(found.sum()) / len(touching)


def beside_box(box: Box, q: np.ndarray, near: float) -> np.ndarray:
    """Mask of places q (n, 3) [m] on a box that are nearer than that [m] to one of its edges."""
    return (np.abs(q) > np.array(box.half) - near).sum(axis=1) >= 2


def beside_rims(cylinder: Cylinder, q: np.ndarray, near: float) -> np.ndarray:
    """The same of the rims of a cylinder."""
    return (np.hypot(q[:, 0], q[:, 1]) > cylinder.radius - near) & (np.abs(q[:, 2]) > cylinder.half_height - near)


def beside_cone(cone: Cone, q: np.ndarray, near: float) -> np.ndarray:
    """The same of the rim and the apex of a cone."""
    rim = (q[:, 2] < near - cone.half_height) & (np.hypot(q[:, 0], q[:, 1]) > cone.radius - near)
    return rim | (q[:, 2] > cone.half_height - near)


BESIDE: dict[type, Callable] = {Box: beside_box, Cylinder: beside_rims, Cone: beside_cone}


class AcrossStiffness:
    """Stiffness of a net or sheet against points that move across it: lengths and ends of its edges are looked up once."""

    def __init__(self, body):
        rest, source = edge_lengths(body), cast(Any, body.source)
        good = rest > 0.0
        self.edges, self.rest = body.edges[good], rest[good]
        self.ends = np.ravel(self.edges.T - body.first)
        self.free, self.bend = body.masses > 0.0, np.zeros(1)
        self.masses = np.where(self.free, body.masses, 1.0)
        if source.is_sheet:
            self.stretch = source.material.stretch if source.stretches is None else float(np.mean(source.stretches))
            self.bend = source.material.bend * (np.pi / self.rest)**2
        else:
            self.stretch = float(np.mean(source.stiffness))

    def rms_instability(self, x: np.ndarray) -> float:
        """RMS over the points of sigma [1/s] at positions x (points, 3) [m]."""
        ends = x[self.edges[:, 1]] - x[self.edges[:, 0]]
        strain = np.sqrt(np.einsum("ij,ij->i", ends, ends)) / self.rest - 1.0
        tension = self.stretch * strain + self.bend
        across = np.bincount(self.ends, np.tile(tension, 2), len(self.free)) / self.masses
        return float(np.sqrt(np.mean(np.maximum(-across[self.free], 0.0))))
