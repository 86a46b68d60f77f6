"""A stage is one named pass of a frame; a method is the owner of some stages.

The phases stand in the order of PHASES within a substep; solve repeats `iterations` times; stages of a phase run in the
order in which methods were added, contacts last. A stage launches kernels and nothing else: no allocation, no read of a
device array, no branch on one, so that a frame can be captured.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wsim.model.status import Status
from wsim.scene.integrator import GAMMA
from wsim.scene.samples import Sample

PHASES = ("pose", "predict", "collide", "solve", "finish", "deform")
OVER = 1.3     # spring cloth of 64 x 64 points, BDF2, 16 x 16: error at 0.25 s 2.2e-4 at 1, 1.2e-4 at 1.3, 8e-5 at 1.5; with
               # 32 x 16 1.7e-5, 1.2e-5, 2.2e-5. With every sweep at 1.7, 16 x 16 errs by 6.9e-4
# status words that more than one method has: an integrator that needs a small residual was left a larger one; an edge is more
# than twice its rest length (explicit steps: it may have been thrown); for each body by how much [%], see
# `wsim.simulation.measure.exceeded`; for each system by how much its residual is above 1 [%]
MISSED, THROWN, LONG, STRETCHED = "residual missed", "edge thrown", "edge too long", "edges too long, by body"
UNSOLVED = "residual left, by system"


@dataclass
class Clock:
    """Where a frame is while its stages are launched. h, g in [s]. What is solved for once is a substep: a step of sdirk3
    takes two."""

    dt: float                     # frame step
    substeps: int
    iterations: int
    multistep: bool               # BDF2; False: backward Euler
    beyond: bool = False          # implicit midpoint: solves for the middle of a substep, goes on to its end
    staged: bool = False          # sdirk3: even substeps are the first stage of a step, odd ones the second
    k: int = 0                    # substep of the frame
    i: int = 0                    # iteration of the substep
    j: int = 0                    # step of a method that takes several in a substep
    starting: bool = True         # no history yet: the first substep of a run is backward Euler

    @property
    def h(self) -> float:
        return self.dt / self.substeps

    @property
    def steps(self) -> int:
        """Of a frame."""
        return self.substeps // 2 if self.staged else self.substeps

    @property
    def scheme(self) -> tuple[bool, bool, bool]:
        """What an integrator that gives way changes."""
        return self.multistep, self.beyond, self.staged

    @scheme.setter
    def scheme(self, value: tuple[bool, bool, bool]) -> None:
        self.multistep, self.beyond, self.staged = value

    @property
    def watched(self) -> bool:
        """Whether the integrator may go on only while its residual is met."""
        return any(self.scheme)

    @property
    def bdf2(self) -> bool:
        """Whether this very substep is one of BDF2."""
        return self.multistep and not (self.starting and self.k == 0)

    @property
    def omega(self) -> float:
        """Over-relaxation of this iteration: the first and the last sweep are plain XPBD."""
        return OVER if 0 < self.i < self.iterations - 1 else 1.0

    @property
    def g(self) -> float:
        """Effective step: v = (d - a) / g and compliance enters as alpha / g^2."""
        if self.staged:
            return 2.0 * GAMMA * self.h
        return self.h * self.part if self.beyond else self.h * (2.0 / 3.0) if self.bdf2 else self.h

    @property
    def part(self) -> float:
        """At which part of the substep the solved positions are, a stage's before or behind it."""
        if self.staged:
            return 1.0 - 2.0 * GAMMA if self.k % 2 else 2.0 * GAMMA
        return 0.5 if self.beyond else 1.0

    def moments(self, ends: bool) -> np.ndarray:
        """Times [s] in a frame for which targets of pins are kept, a row each: where positions are solved for or, if ends, at
        the ends of substeps. Of sdirk3: both stages of a step and, if ends, its end."""
        k = np.arange(self.substeps)
        if not self.staged:
            return (k + (1.0 if ends else self.part)) * self.h
        stages = np.array([GAMMA, 1.0 - GAMMA] + [1.0] * ends)
        return ((np.arange(self.steps)[:, None] + stages) * (2.0 * self.h)).ravel()


@dataclass
class Stage:
    """`launch(clock)` issues `launches` kernels that move about `bytes` of device memory."""

    name: str
    phase: str
    launch: Callable[[Clock], None]
    launches: int
    bytes: int
    rate: str = "substep"         # "frame", "substep" or "iteration"
    what: str = ""                # how many of what, in words


class Port(list):
    """Where other methods are called: they append functions, which are called in that order."""

    def __call__(self, *given) -> None:
        for each in self:
            each(*given)


@dataclass
class Remedy:
    """Why a frame does not hold, and what makes it hold.

    doubt     an edge was thrown by explicit steps: another solver where the scene leaves it open, else the frame holds
    refine    more substeps; `row` of `part` is not finite
    grow      `act` makes room for what overflowed, and says so in words ("" if nothing was lacking)
    give way  an integrator that needs small residuals goes on as backward Euler; `why` where it is not for a residual
    """

    kind: str
    act: Callable[[], str] | None = None
    part: str = ""
    row: int = 0
    why: str = ""


@dataclass
class Method:
    """Stages of one method, and what it offers around a frame. Every hook may stay as it is."""

    name: str
    stages: list[Stage] = field(default_factory=list)
    subdivide: int = 1                                         # steps of its own in a substep, each all its phases
    remade: bool = False                                       # kernels that are not compiled yet, since a value was set

    def before_frame(self, time: float, clock: Clock) -> None:
        """Uploads what is known on the host about the frame that starts at `time` [s]."""

    def meet(self, others: dict[str, "Method"]) -> None:
        """Connects itself with other methods of the plan, by name, when all are made."""

    def carriers(self) -> dict[str, Any]:
        """What contacts can push of this method, by name (`wsim.physics.carrier.carriers`); asked for by methods that push."""
        return {}

    def retry(self, status: Status) -> list[Remedy]:
        """What the frame that has just ended lacked, by this method's own words of the status; none: it holds."""
        return []

    def samples(self, world: int = 0) -> list[Sample]:
        """What results hold of this method, now, of one world."""
        return []

    def accept(self, path: str, name: str, value):
        """A value that `set` may be given for a path of this method's own objects, as it is then. Raises SceneError."""
        return value

    def restored(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        """Makes room for what an earlier run has left, by path and name, before it is put into the state."""

    def resumed(self, time: float) -> None:
        """A run goes on exactly where an earlier one has ended; its last frame began at `time` [s]."""

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """Error indicators from positions [m] (relative to the objects' origins) and velocities [m/s], solver order."""
        return {}

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        """Takes a live parameter of one world, or of all (None); False if it is none of this method's."""
        return False
