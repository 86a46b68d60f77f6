"""What methods offer to each other: `b.ports.contacts` while methods are made and connected, `plan.ports.contacts` afterwards.

Annotations are those of a port that is there. Where no method offers a port it is None, and empty if it is a list. Whoever
cannot be sure that a scene has the other method tests for that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    import warp as wp

    from wsim.model.stage import CallPort, Clock, Method
    from wsim.physics.animation.method import SkeletonMethod
    from wsim.physics.cloth.air import Aero
    from wsim.physics.cloth.nets.muscles import Muscles
    from wsim.physics.contact.contacts import ColliderContacts
    from wsim.physics.contact.method import ContactMethod
    from wsim.physics.contact.restitution import RestitutionStage
    from wsim.physics.contact.selfcontact.method import SelfContactMethod
    from wsim.physics.fluid.method import Fluids
    from wsim.physics.motion.divergence_monitor import Watch
    from wsim.physics.motion.loads import Loads
    from wsim.physics.motion.pins import Pins
    from wsim.physics.motion.points import FreePoints
    from wsim.physics.rigid.method import RigidMethod
    from wsim.physics.rods.method import RodMethod
    from wsim.physics.solver.newton import Assembly

NONE: Any = None


class NewtonTerm:
    """A term that acts in a Newton step beside the forces of bodies. Every hook may stay as it is; all only launch kernels.

    They are called in this order: `begin_solve`; in each Newton step `add_to_prediction`, `adjust_system`, `solve_step`,
    `complete_step`, `clamp_step`, `extend_line_search`; behind them `take_further_steps` and `end_solve`.
    """

    def add_to_prediction(self, clock: Clock) -> None:
        """Adds to own and b of a prediction."""

    def observe_displacement(self, clock: Clock) -> None:
        """Looks at a d that was moved without it."""

    def adjust_system(self, g: float, fresh: bool) -> None:
        """Changes A and f behind an assembly. g: effective step [s]; fresh: of forces, not of the Newton step before."""

    def solve_step(self, clock: Clock, tolerance: float, cap: int) -> bool:
        """Finds the step y itself; False: it leaves that to the system's own solver."""
        return False

    def complete_step(self) -> None:
        """Adds to y what the step lacks."""

    def clamp_step(self, g: float) -> None:
        """Takes from y what is not allowed."""

    def extend_line_search(self, trial, g: float, rows: int) -> None:
        """Adds its energy to those that a line search compares."""

    def unbalanced_forces(self, f: wp.array) -> wp.array:
        """Forces that nothing balances, of forces f, after `adjust_system`."""
        return f

    def begin_solve(self, clock: Clock, back: Callable[[], None], line) -> None:
        """Acts where Newton steps begin. back: launches the way back to where the substep began; line: the line search."""

    def take_further_steps(self, clock: Clock, again: Callable[[], None], measure: Callable[[], wp.array]) -> None:
        """Acts behind the scene's Newton steps of a substep. again: launches a further one; measure: the residual."""

    def end_solve(self, clock: Clock) -> None:
        """Acts behind all Newton steps of a substep."""


@dataclass
class Ports:
    """One field a port. The first lines are of points, then come solvers, explicit steps, contacts, and other things."""

    points: FreePoints = NONE
    constants: Any = NONE                               # of points: inverse masses, gravity ...
    densities: dict[int, float] = NONE                  # that were set live, by body
    pins: Pins = NONE
    hard_pins: Pins = NONE
    soft_pins: Pins = NONE
    muscles: Muscles = NONE
    loads: Loads = NONE
    air: Any = NONE                                     # struct of kernels/cloth/air.py
    wind: Aero = NONE
    stretch_watch: Watch | None = NONE
    constraint_rows: list = field(default_factory=list)     # constraints as a solver has them
    xpbd_batches: list = field(default_factory=list)
    tet_tables: list = field(default_factory=list)
    newton_tables: list = field(default_factory=list)
    spring_tables: Callable[[], list] = NONE            # where rest lengths stand
    force_gather: Any = NONE                            # `wsim.physics.motion.forces.ForceGather`
    newton_assembly: Assembly = NONE
    newton_terms: list[NewtonTerm] = NONE                           # what acts in a Newton step beside the forces of bodies
    newton_sweeps: list[Callable[[Clock], None]] = NONE             # what moves points by impulses before each Newton step
    line_search_lanes: Any = NONE
    solve_adjoint: Any = NONE
    stable_substeps: Any = NONE                         # function of explicit steps: how many substeps are stable
    upload_constraints: Callable = NONE
    target_stride: Any = NONE                           # function: rows of pin targets a substep
    predicted_copies: Callable[[], tuple] = NONE        # what explicit steps predict
    half_step: Callable[[], tuple] = NONE
    before_forces: CallPort = NONE                      # called before forces are evaluated
    before_half_kick: CallPort = NONE                   # called before the last half kick
    earlier_change: Callable[[], Any] = NONE            # of velocities by others, in the last substep but one [m/s]
    whole_frames: Any = NONE                            # True: a frame is one launch
    fused_effects: frozenset[str] = NONE                # names of what blocks that share sheets take along
    edge_watch: Any = NONE                              # of named explicit steps that bear little tension: how long edges are
    contact: ContactMethod = NONE
    contacts: ColliderContacts = NONE
    restitution: RestitutionStage | None = NONE
    self_contact: SelfContactMethod = NONE
    free_flight: Any = NONE                             # frames that cannot touch
    start_warnings: list = field(default_factory=list)  # said of how a scene starts
    bodies: RigidMethod = NONE
    arrivals: Any = NONE                                # particles that come and go: which points are there
    particle_searches: list = field(default_factory=list)   # who is near whom, `wsim.physics.position_based.neighbours`
    shape_matching: Any = NONE                          # clusters that are projected behind Newton steps
    energy_terms: list = field(default_factory=list)    # functions (threads a world) that make one (rows) for the balance
    moving_bodies: Any = NONE                           # rigid bodies that points push
    recorded_bodies: Any = NONE
    drive_targets: Any = NONE                           # (path, name) of targets that drives follow in each substep
    bones: SkeletonMethod = NONE
    rods: RodMethod = NONE
    strands: Any = NONE                                 # that meet surfaces in their substeps
    strand_reactions: Any = NONE
    grid_reactions: Any = NONE                          # of pins of material points: `paths`, `takes`, `of`
    fluids: Fluids = NONE
    recorded_fluids: Any = NONE
    recorded_points: Any = NONE                         # material points
    balance: Any = NONE


NAMES = frozenset(f.name for f in fields(Ports))
LISTS = frozenset(f.name for f in fields(Ports) if f.default_factory is list)


class JoinedPorts:
    """Ports of several methods: of each the first that is offered, of lists all entries. Raises AttributeError for a name that
    is none of a port's, also where there are no methods."""

    def __init__(self, methods: Sequence[Method]):
        self.methods = methods

    def __getattr__(self, name: str) -> Any:
        if name not in NAMES:
            raise AttributeError(f"no port is named {name!r}")
        offered = (getattr(method.offers, name) for method in self.methods)
        if name in LISTS:
            return [entry for found in offered for entry in found]
        return next((port for port in offered if port is not None), None)


def join_offered_ports(methods: Sequence[Method]) -> Ports:
    """What methods offer by now."""
    return cast("Ports", JoinedPorts(methods))
