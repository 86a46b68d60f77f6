"""A stage is one named pass of a frame; a method is the owner of some stages.

The phases stand in the order of PHASES within a substep; solve repeats `iterations` times; stages of a phase run in the
order in which methods were added, contacts last. A stage launches kernels and nothing else: no allocation, no read of a
device array, no branch on one, so that a frame can be captured.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from wsim.model.ports import Ports as Ports
from wsim.model.ports import join_offered_ports
from wsim.model.status import FrameStatus
from wsim.scene.integrator import Integrator
from wsim.scene.samples import ContactPoints, Sample

PHASES = ("pose", "predict", "collide", "solve", "finish", "deform")
OVER = 1.3     # spring cloth of 64 x 64 points, BDF2, 16 x 16: error at 0.25 s 2.2e-4 at 1, 1.2e-4 at 1.3, 8e-5 at 1.5; with
               # 32 x 16 1.7e-5, 1.2e-5, 2.2e-5. With every sweep at 1.7, 16 x 16 errs by 6.9e-4
# status words that more than one method has: an integrator that needs a small residual was left a larger one; an edge is more
# than twice its rest length (explicit steps: it may have been thrown); for each body by how much [%], see
# `wsim.simulation.measure.exceeded`; for each system by how much its residual is above 1 [%]
MISSED, THROWN, LONG, STRETCHED = "residual missed", "edge thrown", "edge too long", "edges too long, by body"
UNSOLVED = "residual left, by system"
FREE, MET = "without contacts", "with contacts"          # frames that a stage belongs to; "": to all


@dataclass
class Clock:
    """The place in a frame while its stages are launched. h in [s]. What is solved for once is a substep: a step of sdirk3
    takes two. integrator: the one that steps now, backward Euler where one that needs its residual has given way."""

    dt: float                     # frame step
    substeps: int
    iterations: int
    integrator: Integrator
    k: int = 0                    # substep of the frame
    i: int = 0                    # iteration of the substep
    j: int = 0                    # step of a method that takes several in a substep
    starting: bool = True         # no history yet: the first substep of a run is backward Euler
    free: bool = False            # the frame has no contacts, see `wsim.physics.contact.free_flight_test`
    after_free: bool = False      # the frame before had none, or left nothing near: no half step to go on from
    fresh: bool = False           # masses and gravity of points change between frames: none goes on from a step before it
    touching: bool = False        # every frame has contacts: what one world does must not depend on what others touch
    loop: Any = None  # `wsim.model.launches.SubstepLoop` in whose body launches stand: then k is none's in particular
    apart: bool = False  # what would change the steps of all worlds for one raises `measure.checks.lost.FixedStepsError`
    open: bool = False           # of such worlds: alone, each would take more substeps where a check asks for them

    @property
    def h(self) -> float:
        return self.dt / self.substeps

    def read_rows(self, table: Any, k: int, count: int = 1) -> tuple[Any, int]:
        """A table with a row for each substep and the row k of this one, as kernels read them: `count` rows from there on."""
        return (self.loop.rows(table, count), 0) if self.loop else (table, k)

    @property
    def halved(self) -> bool:
        """True if leapfrog begins with half a kick, from the velocity where the frame begins."""
        return self.starting or self.after_free or self.fresh

    @property
    def form(self) -> str:
        return FREE if self.free else MET

    @property
    def steps(self) -> int:
        """Number of steps of a frame."""
        return self.substeps // self.integrator.solves

    @property
    def ends(self) -> bool:
        """True if a step ends with this substep."""
        return (self.k + 1) % self.integrator.solves == 0

    @property
    def watched(self) -> bool:
        """True if the integrator may go on only while its residual is met."""
        return self.integrator.watched

    @property
    def carries_history(self) -> bool:
        """True if this very substep carries on the one before."""
        return self.integrator.memory > 0.0 and not ((self.starting or self.fresh) and self.k == 0)

    @property
    def omega(self) -> float:
        """Over-relaxation of this iteration: the first and the last sweep are plain XPBD."""
        return OVER if 0 < self.i < self.iterations - 1 else 1.0

    @property
    def effective_step(self) -> float:
        """Effective step g [s]: v = (d - a) / g, and compliance enters as alpha / g^2."""
        m = self.integrator
        return self.h if m.explicit or (m.memory and not self.carries_history) else m.g * m.solves * self.h

    @property
    def part(self) -> float:
        """Part of the substep at which the solved positions are, a stage's before or behind it."""
        m = self.integrator
        return 1.0 if m.explicit else m.solves * m.nodes[self.k % m.solves] - self.k % m.solves

    def moments(self, ends: bool) -> np.ndarray:
        """Times [s] in a frame for which targets of pins are kept, a row each: where positions are solved for or, if ends, at
        the ends of substeps; then of a step of several solves all its nodes too, and of an explicit one those of stages."""
        m = self.integrator
        if m.explicit and ends:
            return ((np.arange(self.substeps)[:, None] + np.array(m.moments)) * self.h).ravel()
        if m.solves == 1:
            return (np.arange(self.substeps) + (1.0 if ends or m.explicit else m.nodes[0])) * self.h
        return ((np.arange(self.steps)[:, None] + np.array([*m.nodes] + [1.0] * ends)) * (m.solves * self.h)).ravel()

    def acting(self) -> np.ndarray:
        """Times [s] in a frame at which forces are evaluated: where an implicit integrator solves, a row a substep; of explicit
        ones every half of a substep."""
        return self.moments(False) if not self.integrator.explicit else 0.5 * self.h * np.arange(2 * self.substeps + 1)


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
    frames: str = ""              # FREE, MET: only of such frames


class CallPort(list):
    """A place where other methods are called: they append functions, which are called in that order."""

    def __call__(self, *given) -> None:
        for each in self:
            each(*given)


@dataclass
class Remedy:
    """The reason why a frame does not hold, and what makes it hold.

    doubt     an edge was thrown by explicit steps: another solver where the scene leaves it open, else the frame holds
    refine    more substeps; `row` of `part` is not finite
    room      as `grow`, of a list that held nothing for lack of room: nothing else that the frame has said counts
    grow      `act` makes room for what overflowed, and says so in words ("" if nothing was lacking)
    again     the frame is repeated with the same launches, by other words on the device
    give way  an integrator that needs small residuals goes on as backward Euler; `why` where it is not for a residual
    stop      no other step would do: the frame is given up, the simulation stands where it began, and `why` is said of `row`
    meet      contacts: a point could reach a collider in a frame that had none
    check     the frame is whole and a figure of it is bad, as `why` says: more substeps where the scene leaves them open.
              `steps`: substeps a frame that are enough; 0: not known
    """

    kind: str
    act: Callable[[], str] | None = None
    part: str = ""
    row: int = 0
    why: str = ""
    steps: int = 0
    worlds: tuple[int, ...] = () # that a check is of
    keeps: bool = False          # graphs stay valid: kernels read what has grown by `wsim.model.structs.PlacedStruct`


@dataclass(frozen=True)
class ByWorld:
    """A live value of every world, (worlds,) or (worlds, 3)."""

    values: np.ndarray

    def rows(self, model, path: str) -> np.ndarray:
        """Values for `Model.rows(path)`."""
        found = [b for b in model.bodies if path in ("/", b.path)]
        return np.repeat(self.values[[b.world for b in found]], [b.count if model.by_point else 1 for b in found], axis=0)


def value_of_world(value, world: int):
    """A live value as one world has it."""
    return float(value.values[world]) if isinstance(value, ByWorld) else value


@dataclass
class Method:
    """Stages of one method, and what it offers around a frame. Every hook may stay as it is."""

    name: str
    stages: list[Stage] = field(default_factory=list)
    subdivide: int = 1                                         # steps of its own in a substep, each all its phases
    moved: bool = False                                        # a frame has other launches than its graph from now on
    remade: bool = False                                       # kernels that are not compiled yet, since a value was set
    offers: Ports = field(default_factory=Ports)               # what others may ask for
    by_world: bool = False                                     # `set` takes a `ByWorld` too

    measures_worlds = False                                    # `indicators` can be of one world
    alike = False                                              # launches of substeps but the first and the last are the same

    @cached_property
    def evaluates(self) -> dict[str, list[str]]:
        """Things that NumPy evaluates before every frame, and the prims they are of."""
        return {}

    def choose_frame_form(self, clock: Clock) -> None:
        """A frame begins that has not been tried yet: which form it takes first."""

    def before_frame(self, time: float, clock: Clock) -> None:
        """Uploads what is known on the host about the frame that starts at `time` [s]."""

    def connect_ports(self, others: "Methods") -> None:
        """Connects itself with what other methods of the plan offer, when all are made."""

    def lengthen_lists(self) -> None:
        """Makes lists longer than they begin, so that they do not run out while somebody watches: see `Simulation.prepare`."""

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        """Remedies for what the frame that has just ended lacked, by this method's own words of the status; none: it holds."""
        return []

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        """Warnings of a frame that holds: (what they are of, a number, words in which {worst} stands for the greatest)."""
        return []

    def kept_distances(self) -> list[dict]:
        """Distances [m] that colliders keep from bodies where the scene leaves them open: collider, body, thickness."""
        return []

    def samples(self, world: int = 0) -> list[Sample]:
        """Samples for results of this method, now, of one world."""
        return []

    def contact_points(self, clock: Clock) -> list[ContactPoints]:
        """Contacts at the end of the frame, of all worlds, with forces of its last substep."""
        return []

    def prepare_restart(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        """Makes room for what an earlier run has left, by path and name, before it is put into the state."""

    def forget_worlds(self, worlds: set[int]) -> None:
        """Worlds begin again: lists that are of all forget what is theirs. Raises SceneError where that cannot be."""

    def resume_run(self, time: float) -> None:
        """A run goes on exactly where an earlier one has ended; its last frame began at `time` [s]."""

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """Error indicators from positions [m] (relative to the objects' origins) and velocities [m/s], solver order. Methods
        with `measures_worlds` take a world too, and give what is measured of that one alone."""
        return {}

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """Takes a live parameter of one world, or of all (None), within the bounds of its row in `wsim.scene.values.table`;
        False if it is none of this method's."""
        return False


class Methods(list[Method]):
    """The methods of a plan, in order."""

    @property
    def ports(self) -> Ports:
        """What methods offer: who needs something asks for the port, not for the method that has it."""
        return join_offered_ports(self)

    def prepare_restart(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        """`Method.prepare_restart` of each."""
        for each in self:
            each.prepare_restart(fields)
