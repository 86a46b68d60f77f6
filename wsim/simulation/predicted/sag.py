"""Depth by which rigid bodies sink into each other at rest, and the substeps a frame that keep it small.

A contact is soft (kernels/rigid/soft_step.py). A point that bears the impulse P in each substep of h rests where
bias + A_jj P / a_2 = 0, so that at a force F = P / h it has given way by

    d = A_jj F h^2 / (h w)^2,      h w = pi / 2,      A_jj = w_a + w_b + (r_a x n) I_a^-1 (r_a x n) + the same of b   [1/kg]

whatever the damping and the sweeps: it is a spring of (h w)^2 / (h^2 A_jj). The points of a patch bear side by side: A of the
patch is 1 / sum (1 / A_jj), which is w_a + w_b of cubes on each other and 1.25 times that of two thin discs. The top of a
column of n equal cubes sinks by

    (h / (h w))^2 g n^2,    as the k-th contact from below bears n - k + 1 of them and has A = 2 / m, the lowest 1 / m

which depends on n alone: 6.9 mm for ten of them and h = 1/240 s, 43 % of a cube of 16 mm. Mass matters by its ratio: M on top
of m gives g M / m for each contact of m.

Bodies that touch where the scene starts, and what stands, are a net of such springs (`wsim.simulation.predicted.bearing`). A
column that is slender buckles before it has sunk far: n cubes from a sag of 0.98 / n of one on, thirty from 3.3 %.

What falls lands on what is straight below it, and is looked at as if it stood there. Where it does not stay so but lies in a
heap, of N bodies, it is under about N^(1/3) others, whatever their masses: 2 g N^(1/3) in place of the above.

Measured over this (24 fps, 10 to 186 substeps x 4): 1.00 in columns of cubes, slabs and cylinders of 2 to 30 bodies, 1 mm to
10 m, mass ratios to 1e4, and in a tower of 54 blocks; 0.9 in arches of 17 stones, t / R 0.12; 0.98 to 1.1 in a pyramid, a house
of cards and under a lintel; 0.7 to 0.9 among balls, logs and turned cubes, whose normals or patches are taken coarsely; 1.3 in
a wall whose last bricks lie at the edge of falling.

Where nobody named the substeps of a scene, `set_rigid_substeps` gives it as many before its first frame as keep the sag at GOOD
of the least height of a body on the way down and the load at UPRIGHT of what buckles a stack, MOST at most. It costs what
substeps cost, in proportion. Stiffer contacts take more sweeps, and are no cheaper (CPU time of a frame, ten cubes of 16 mm; a
tower of 54 blocks):

    33 substeps x 4 sweeps                  0.93 ms, sag 4.0 %        15 ms, 5.7 %
    40 x 2                                  0.76 ms, 2.7 %            13 ms, 3.9 %, creeps by 2e-5 of a block a second
    33 x 1                                  0.52 ms, 4.0 %            falls
    h w = pi, 10 x 20; 10 x 4               0.91 ms, 10.8 %; falls    17 ms, 15.6 %; falls
    h w = 6, 10 x 20                        1.03 ms, 3.0 %            falls

Bodies that roll or spin on others at the start need substeps too: `wsim.simulation.predicted.rolling`.

Sweeps stay the scene's. Where somebody named the substeps, or something else decides, a run in which bodies sink by more than
BAD, or bear more than LEANS, says so.
"""

from dataclasses import dataclass, replace
from math import ceil, inf
from typing import TYPE_CHECKING

import numpy as np

from wsim.scene import Scene
from wsim.scene.bodies import DefaultCount
from wsim.simulation.predicted.rolling import FEW, MANY, RollingBody, fastest_rolling_body

if TYPE_CHECKING:
    from wsim.simulation.predicted.bearing import BearingBodies, BearingNet

TURN = 0.5 * np.pi     # h w of kernels/rigid/soft_step.py
GOOD, BAD = 0.04, 0.1  # part of a body's height that it may sink by; from which a run says so
PILED = 0.25           # the same of what falls: how many it will lie under is not known
UPRIGHT, LEANS = 0.65, 0.85             # of the load under which a stack buckles, likewise
TALL = 16              # bodies that may come to stand on one another as they fall; more collapse
MOST, FALLEN = 600, 100                # substeps that are chosen, and for what may fall elsewhere: a small body under a
                                       # mountain would make a scene stand still


@dataclass(frozen=True)
class SubstepNeed:
    """The substeps that the rigid bodies of a scene want, and why.

    path        prim path of the body that sinks most, over its size
    rate        s: it sinks by s (h / (h w))^2 of its size [1/s^2]
    size        of that size [m]
    falls       True: not yet, but once it lies in a pile
    slender     prim path of the body that is nearest to leaning over
    tips        its stack bears tips (h / (h w))^2 of the load under which it buckles [1/s^2]
    work        of all weights over their sags, times (h / (h w))^2 [J/s^2]
    roll        the body that passes the most facets or radians a second as it rolls
    """

    path: str = ""
    rate: float = 0.0
    size: float = inf
    falls: bool = False
    slender: str = ""
    tips: float = 0.0
    work: float = 0.0
    roll: RollingBody = RollingBody()

    def part(self, h: float) -> float:
        """Sag over the size, at substeps of h [s]."""
        return self.rate * (h / TURN)**2

    def rebound_energy(self, h: float) -> float:
        """Energy [J] that contacts may give back: a stack that starts without its sag goes on to twice that at most, where they
        hold k (2 d)^2 / 2, twice the work of the weights over it."""
        return 2.0 * self.work * (h / TURN)**2

    @property
    def rates(self) -> dict[str, float]:
        """Substeps a second that keep the sag at GOOD, that keep stacks upright, and that resolve rolling; by cause."""
        return {"sinks": (self.rate / GOOD)**0.5 / TURN, "leans": (self.tips / UPRIGHT)**0.5 / TURN,
                "rolls": self.roll.rate / FEW}

    def substeps(self, fps: float) -> int:
        """Substeps a frame that are enough for all causes."""
        return max(1, ceil(max(self.rates.values()) / fps - 1e-9))

    @property
    def cause(self) -> str:
        """The cause that needs the most substeps: sinks, leans or rolls."""
        return max(self.rates, key=lambda name: self.rates[name])

    def figure(self, fps: float, n: int) -> str:
        """The figure of that cause with n substeps a frame, in words."""
        if self.cause == "rolls":
            return f"{self.roll.rate / fps / n:.2g}"
        return f"{100.0 * (self.tips if self.cause == 'leans' else self.rate) / (TURN * fps * n)**2:.3g} %"

    def describe_substeps(self, fps: float, n: int) -> str:
        """Words of what n substeps a frame leave."""
        if self.cause == "rolls":
            return self.roll.describe_substeps(1.0 / fps / n)
        if self.cause == "leans":
            return f"{self.slender} and what is below it bear {self.figure(fps, n)} of the load under which they lean over"
        where = "a body there, once it has fallen" if self.falls else "the least height of a body on the way down"
        depth = format_length(self.part(1.0 / fps / n) * self.size)
        return f"{self.path} sinks at rest by about {depth}, {self.figure(fps, n)} of {format_length(self.size)} ({where})"

    def told(self, scene: Scene, n: int) -> str:
        """Reason of n substeps, where they are those that were chosen for the bodies; else ""."""
        least = Scene().substeps
        if not isinstance(scene.substeps, DefaultCount) or not n == scene.substeps > least:
            return ""
        return (f"{n} substeps for rigid bodies, about {n / least:.2g} times the time of {least}: "
                f"{self.describe_substeps(scene.fps, n)}; "
             f"by {least} it would be {self.figure(scene.fps, least)}")

    def warnings(self, scene: Scene, n: int) -> list[str]:
        """A warning where n substeps a frame are too few."""
        h, good = 1.0 / scene.fps / n, self.substeps(scene.fps)
        if (self.part(h) <= (PILED if self.falls else BAD) and self.tips * (h / TURN)**2 <= LEANS
                and self.roll.rate * h <= MANY):
            return []
        path = {"sinks": self.path, "leans": self.slender, "rolls": self.roll.path}[self.cause]
        other = "leave out wsim:substeps"
        if isinstance(scene.substeps, DefaultCount):
            other = "lower its angular velocity" if self.cause == "rolls" else "smaller ratios of mass"
        return [f"warning: {path}: {n} substeps a frame are few for rigid bodies: {self.describe_substeps(scene.fps, n)}; give "
                f"--substeps {good}, or {other}"]


def format_length(value: float) -> str:
    """[m] in words."""
    return f"{value:.3g} m" if value >= 1.0 else f"{1e3 * value:.3g} mm"


def set_rigid_substeps(scene: Scene) -> SubstepNeed:
    """Gives a checked scene the substeps that its rigid bodies want, in place, where nobody named them; what they want."""
    found = need_of_rigid_bodies(scene)
    if isinstance(scene.substeps, DefaultCount):
        scene.substeps = DefaultCount(max(scene.substeps, min(found.substeps(scene.fps), FALLEN if found.falls else MOST)))
    return found


def rigid_body_substeps(scene: Scene) -> int:
    """Substeps of a checked scene as `set_rigid_substeps` has them."""
    own = replace(scene)
    set_rigid_substeps(own)
    return int(own.substeps)


def need_of_rigid_bodies(scene: Scene) -> SubstepNeed:
    """The need of the rigid bodies of a checked scene; none where there is no gravity, or nothing to touch."""
    g = _strongest_gravity(scene)
    if not (scene.things("Body") and g.any()):
        return SubstepNeed()
    from wsim.physics.rigid.solids import has_rigid_contacts
    from wsim.simulation.predicted.bearing import BearingBodies, BearingNet
    if not has_rigid_contacts(scene):
        return SubstepNeed()
    bodies = BearingBodies(scene, g)
    net, u, rests = BearingNet.of(bodies, bodies.touches).settled(bodies.load)
    found = [SubstepNeed(), _need_of_resting(bodies, net, u, rests)]
    falls = ~(rests | bodies.held)
    if (falls[bodies.group] & (bodies.width < inf)).any():
        found += [_need_of_heap(bodies, falls[bodies.group]), _need_of_landed(bodies, falls)]
    return replace(max(found, key=lambda n: (n.substeps(scene.fps), n.rate)), roll=fastest_rolling_body(bodies))


def _need_of_resting(bodies: "BearingBodies", net: "BearingNet", u: np.ndarray, rests: np.ndarray) -> SubstepNeed:
    from wsim.simulation.predicted.bearing import BUCKLES
    if not rests.any():
        return SubstepNeed()
    least = net.least()
    rates = np.where(rests, u / least, 0.0)
    leans = np.where(rests, net.leans(u, bodies.load, bodies.center, bodies.up) / BUCKLES, 0.0)
    sinks, tips = int(np.argmax(rates)), int(np.argmax(leans))
    return SubstepNeed(bodies.paths[sinks], float(rates[sinks]), float(least[sinks]), False, bodies.paths[tips],
                       float(leans[tips]), float(bodies.load[rests] @ u[rests]))


def _need_of_heap(bodies: "BearingBodies", falls: np.ndarray) -> SubstepNeed:
    """The need of bodies (n,) that come to lie in a heap."""
    falls = falls & (bodies.width < inf)
    layers = len(np.unique(bodies.group[falls]))**(1.0 / 3.0)
    thin = int(np.argmin(np.where(falls, bodies.width, inf)))
    size = float(bodies.width[thin])
    return SubstepNeed(bodies.bodies[thin].path, 2.0 * bodies.g * layers / size, size, True)


def _need_of_landed(bodies: "BearingBodies", falls: np.ndarray) -> SubstepNeed:
    """The need of groups that come to stand on what is straight below them, TALL at most."""
    from wsim.simulation.predicted.bearing import BearingNet
    net, u, rests = BearingNet.of(bodies, bodies.touches_after_fall(falls[bodies.group])).settled(bodies.load)
    least = net.least()
    rates = np.where(rests & falls & (net.levels() <= TALL), u / least, 0.0)
    worst = int(np.argmax(rates))
    return SubstepNeed(bodies.paths[worst], float(rates[worst]), float(least[worst]), True)


def _strongest_gravity(scene: Scene) -> np.ndarray:
    """Gravity [m/s^2], where it varies the strongest."""
    keys = [np.reshape(v.curve.values, (-1, 3)) for v in scene.varying if (v.path, v.name) == ("/", "gravity")]
    every = np.concatenate([np.reshape(scene.gravity, (1, 3)), *keys]).astype(np.float64)
    return every[np.argmax(np.linalg.norm(every, axis=1))]
