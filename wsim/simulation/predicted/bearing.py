"""Rigid bodies that bear each other at rest, as a net of springs along gravity: how far each sinks, and what makes it lean.

Groups of bodies, each of what joints hold together, are tied by the patches on which they touch
(`wsim.simulation.predicted.touching`). A patch of A = 1 / sum (1 / A_jj), of its points j side by side, is a spring of 1 / A
at h / (h w) = 1 (`wsim.simulation.predicted.sag`). One whose normal leans by n_z = n . up bears V with N = V / n_z, as if
without friction, and gives way by d / n_z: it is n_z^2 as stiff. Contacts that would pull are left out.

    sinks   K u = m g, solved once: u in [m/s^2], times (h / (h w))^2 the sag
    leans   a body that bears F, whose centre lies c above what bears it, is tipped by F c theta and set upright by k p^2 theta,
            k the stiffness below it and p the least radius of gyration of the points there (if they lie on a line, as below a
            coin on its rim, the radius along the line): D = F c / (k p^2), summed on the
            way down (Dunkerley's rule). At D (h / (h w))^2 = 1.3 a column of n equal cubes buckles, as a beam under its own
            weight does (Greenhill 1881: w L^3 = 7.84 E I, here a sag of 0.98 / n of a cube), at 1.2 one under a large mass
            (Euler: P L^2 = pi^2 / 4 E I). Runs: ten cubes stand at a sag of 8 % and fall at 11, where it says 9.8; thirty at
            3.2 and 4.0, where it says 3.3; 10 t on 1 kg leans over in 20 s at 220 substeps of 1/24 s, where it says 220.
"""

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry.rotation import quaternion_to_matrix
from wsim.scene import Scene

if TYPE_CHECKING:
    from wsim.simulation.predicted.touching import TouchingPairs

STEEP = 0.05           # cosine of a normal to gravity, below which nothing is borne along it
LEVEL = 0.7            # from which what it bears may be set upright by it
BUCKLES = 1.2          # D (h / (h w))^2
BALANCED = 0.02        # p over c, below which a body stands on its edge: no substeps keep it from falling
LINE = 1e-3            # least over largest p, below which points lie on a line: it sets a body upright only along itself
ROUNDS = 4             # of leaving out contacts that pull
SOLVED = 1e-6          # residual of the net over its load


class BearingBodies:
    """Bodies of a scene as the net has them: (n,) arrays of bodies, (groups,) of what joints hold together.

    group   number of the group of a body         held     whether joints hold a group to the world
    load    weight and force of a group, down [N] center   height of what a group weighs at [m]
    paths   of the first body of a group
    height  of a body along gravity [m]           width    its least extent [m]; inf: it touches nothing
    """

    def __init__(self, scene: Scene, g: np.ndarray):
        from wsim.physics.rigid.mass import body_inertia
        from wsim.simulation.predicted.touching import touching_pairs
        self.bodies = scene.things("Body")
        self.g = float(np.linalg.norm(g))
        self.up = -g / self.g
        self.masses = [body_inertia(body) for body in self.bodies]
        self.solids, self.touches = touching_pairs(scene, self.bodies)
        self.group, self.held = groups_of_bodies(scene, self.bodies)
        down = [m.mass * self.g - body.force @ self.up for m, body in zip(self.masses, self.bodies, strict=True)]
        self.load = np.maximum(np.bincount(self.group, down, len(self.held)), 0.0)
        first = np.unique(self.group, return_index=True)[1]
        self.paths = [self.bodies[k].path for k in first]
        self.frames = np.array([body.motion.at(0.0) for body in self.bodies])
        mass = np.array([m.mass for m in self.masses])
        self.x = np.einsum("nij,nj->ni", self.frames[:, :3, :3], [m.center for m in self.masses]) + self.frames[:, :3, 3]
        self.center = np.bincount(self.group, mass * (self.x @ self.up)) / np.bincount(self.group, mass)
        self.height = self.extents(np.tile(self.up, (len(self.frames), 1, 1)))[:, 0]
        self.width = self.extents(np.swapaxes(self.frames[:, :3, :3], 1, 2)).min(axis=1)

    def extents(self, L: np.ndarray) -> np.ndarray:
        """Extents (n, k) [m] of bodies along unit vectors L (n, k, 3); inf where a body touches nothing."""
        mine = np.flatnonzero(self.solids.body >= 0)
        body = self.solids.body[mine]
        low, high = np.full(L.shape[:2], inf), np.full(L.shape[:2], -inf)
        ends = self.solids.intervals_along(mine, L[body])
        np.minimum.at(low, body, ends[0])
        np.maximum.at(high, body, ends[1])
        return np.where(low < high, high - low, inf)

    def touches_after_fall(self, falls: np.ndarray) -> "TouchingPairs":
        """The pairs that touch, and those that do once bodies (n,) have fallen straight down."""
        from wsim.simulation.predicted.touching import touching_after_fall
        return self.touches.joined(touching_after_fall(self.solids, falls, self.up))

    def compliance(self, t: "TouchingPairs") -> np.ndarray:
        """A of each patch [1/kg], of its points side by side."""
        s = self.solids
        w = np.array([1.0 / m.mass for m in self.masses])
        turns = self.frames[:, :3, :3] @ quaternion_to_matrix(np.array([m.axes for m in self.masses]))
        inverse = turns / np.array([m.moments for m in self.masses])[:, None] @ np.swapaxes(turns, 1, 2)
        A = np.zeros(t.points.shape[:2])
        for shape in (t.a, t.b):
            body = np.where(shape >= 0, s.body[shape], -1)
            on = np.flatnonzero(body >= 0)
            b = body[on]
            turn = np.cross(t.points[on] - self.x[b][:, None], t.n[on][:, None])
            A[on] += w[b][:, None] + np.einsum("pci,pij,pcj->pc", turn, inverse[b], turn)
        return 4.0 / t.count / (1.0 / A).sum(axis=1)


def groups_of_bodies(scene: Scene, bodies: list) -> tuple[np.ndarray, np.ndarray]:
    """Number of the group of each body (n,), and which groups joints hold to the world (groups,)."""
    number = {body.path: k for k, body in enumerate(bodies)}
    ends = [(number.get(j.body0, -1), number.get(j.body1, -1)) for j in scene.things("Joint") if j.enabled]
    label, world = np.arange(len(bodies) + 1), len(bodies)
    pairs = np.array([(a if a >= 0 else world, b if b >= 0 else world) for a, b in ends], int).reshape(-1, 2)
    while True:                                                   # the least number of all that hang together
        before = label.copy()
        np.minimum.at(label, pairs[:, 0], before[pairs[:, 1]])
        np.minimum.at(label, pairs[:, 1], before[pairs[:, 0]])
        label = label[label]
        if np.array_equal(label, before):
            break
    found, group = np.unique(label[:-1], return_inverse=True)
    return group, found == label[world]


@dataclass
class BearingNet:
    """Springs between groups of bodies along gravity, (m,); the number behind the last group is what stands.

    stiffness   [kg], at h / (h w) = 1: a force [N] over it is a depth [m/s^2]
    size        least height of the two bodies of a spring [m]
    rise        n . up
    points      of its patch (m, 4, 3) [m]
    """

    lower: np.ndarray
    upper: np.ndarray
    stiffness: np.ndarray
    size: np.ndarray
    rise: np.ndarray
    points: np.ndarray
    groups: int

    @classmethod
    def of(cls, bodies: BearingBodies, t: "TouchingPairs") -> "BearingNet":
        n = len(bodies.held)
        group = np.append(np.where(bodies.held[bodies.group], n, bodies.group), n)     # of body -1: what stands
        body_a, body_b = bodies.solids.body[t.a], np.where(t.b >= 0, bodies.solids.body[t.b], -1)
        height = np.append(bodies.height, inf)
        rise = t.n @ bodies.up
        a, b = group[body_a], group[body_b]
        lower, upper = np.where(rise > 0.0, b, a), np.where(rise > 0.0, a, b)
        keep = (np.abs(rise) > STEEP) & (lower != upper) & (upper < n)
        size, stiffness = np.minimum(height[body_a], height[body_b]), rise**2 / bodies.compliance(t)
        return cls(lower[keep], upper[keep], stiffness[keep], size[keep], np.abs(rise)[keep], t.points[keep], n)

    def settled(self, load: np.ndarray) -> tuple["BearingNet", np.ndarray, np.ndarray]:
        """The part of the net that bears a load [N], depths u (groups,) [m/s^2] under it, and which groups rest."""
        net, u = self, np.zeros(self.groups)
        for _ in range(ROUNDS):
            rests = net.borne()
            net = net.part(rests[net.upper] & rests[net.lower])
            u = net.solved(np.where(rests[:-1], load, 0.0))
            at = np.append(u, 0.0)
            pulls = at[net.upper] < at[net.lower] - SOLVED * u.max(initial=0.0)
            if not pulls.any():
                break
            net = net.part(~pulls)
        return net, u, net.borne()[:-1]

    def part(self, keep: np.ndarray) -> "BearingNet":
        names = ("lower", "upper", "stiffness", "size", "rise", "points")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def borne(self) -> np.ndarray:
        """True for groups that rest, by others, on what stands; (groups + 1,)."""
        found = np.arange(self.groups + 1) == self.groups
        while True:
            more = self.upper[found[self.lower] & ~found[self.upper]]
            if not len(more):
                return found
            found[more] = True

    def solved(self, load: np.ndarray) -> np.ndarray:
        """Depths under a load of what rests: conjugate gradients with the diagonal, to SOLVED."""
        n = self.groups
        diagonal = (np.bincount(self.upper, self.stiffness, n + 1) + np.bincount(self.lower, self.stiffness, n + 1))[:n]
        inverse = np.divide(1.0, diagonal, out=np.zeros(n), where=diagonal > 0.0)
        u, r = np.zeros(n), load.copy()
        p = z = inverse * r
        for _ in range(4 * n):
            if np.abs(r).sum() <= SOLVED * np.abs(load).sum():
                break
            full = np.append(p, 0.0)
            pull = self.stiffness * (full[self.upper] - full[self.lower])
            q = (np.bincount(self.upper, pull, n + 1) - np.bincount(self.lower, pull, n + 1))[:n]
            before, step = r @ z, (r @ z) / (p @ q)
            u, r = u + step * p, r - step * q
            z = inverse * r
            p = z + (r @ z) / before * p
        return u

    def least(self) -> np.ndarray:
        """Least height (groups,) [m] of a body on the way down from each group, itself included."""
        found = np.full(self.groups + 1, inf)
        for _ in range(self.groups):
            before = found.copy()
            np.minimum.at(found, self.upper, np.minimum(self.size, before[self.lower]))
            if np.array_equal(found, before):
                break
        return found[:-1]

    def leans(self, u: np.ndarray, load: np.ndarray, center: np.ndarray, up: np.ndarray) -> np.ndarray:
        """D (groups,) [1/s^2] of depths u [m/s^2] under a load [N], whose centres are `center` high [m]."""
        at, n = np.append(u, 0.0), self.groups
        borne = self.stiffness * (at[self.upper] - at[self.lower])
        F = np.bincount(self.upper, borne, n + 1)
        per = np.divide(1.0, F, out=np.zeros(n + 1), where=F > 0.0)
        own = np.append(load * center, 0.0)
        high = self.passed(lambda c: (own + np.bincount(self.lower, borne * c[self.upper], n + 1)) * per)
        stiff, radius, base = self.footing_of_groups(up)
        arm = np.maximum(high - base, 0.0)
        tips = radius > BALANCED * arm
        tipped = np.divide(F * arm, stiff * radius**2, out=np.zeros(n + 1), where=tips & (stiff > 0.0))
        return self.passed(lambda D: tipped + np.bincount(self.upper, borne * D[self.lower], n + 1) * per)[:-1]

    def levels(self) -> np.ndarray:
        """Number of groups on the longest way down from each, itself included, (groups,); inf where ways are endless."""
        found = np.zeros(self.groups + 1)
        for _ in range(self.groups + 1):
            before = found.copy()
            np.maximum.at(found, self.upper, 1.0 + before[self.lower])
            if np.array_equal(found, before):
                return found[:-1]
        return np.full(self.groups, inf)

    def passed(self, step) -> np.ndarray:
        """The values that `step` leaves as they are, handed on from group to group; (groups + 1,), of what stands 0."""
        found = np.zeros(self.groups + 1)
        for _ in range(self.groups + 1):
            before, found = found, step(found)
            found[-1] = 0.0
            if np.allclose(found, before, rtol=SOLVED, atol=0.0):
                break
        return found

    def footing_of_groups(self, up: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness [kg] of the level contacts below a group, least radius of gyration and height of their points [m],
        (groups + 1,)."""
        from wsim.simulation.predicted.touching import upright_axes
        n, level = self.groups, self.rise > LEVEL
        upper, k, x = self.upper[level], self.stiffness[level], self.points[level]
        stiff = np.bincount(upper, k, n + 1)
        per = np.divide(1.0, stiff, out=np.zeros(n + 1), where=stiff > 0.0)
        y = x @ upright_axes(up).T
        mean = np.stack([np.bincount(upper, k * y[..., i].mean(axis=1), n + 1) * per for i in range(3)], axis=1)
        d = (y - mean[upper][:, None])[..., 1:]
        xx, xy, yy = (np.bincount(upper, k * (d[..., i] * d[..., j]).mean(axis=1), n + 1) * per
                      for i, j in ((0, 0), (0, 1), (1, 1)))
        half, off = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
        radius, along = np.sqrt(np.maximum(half - off, 0.0)), np.sqrt(half + off)
        return stiff, np.where(radius > LINE * along, radius, along), mean[:, 0]
