"""Surfaces that touch themselves and each other: contact rows among the constraints of a solver, and behind them the guarantee
that no substep ends with an intersection that it did not begin with.

XPBD takes SWEEPS of the contact rows in each of its iterations; behind explicit steps they come as impulses, BEHIND of them,
and more while a pair would end at less than half of its distance: what is light between what is heavy takes hundreds. Newton's
method solves for them (rows/newton_rows.py): sweeps move points by their masses alone, and the stretch of that gained energy;
they come behind it for what strands push, and for pairs that are left too near. By leapfrog only where there are neither
colliders nor strands: what is read behind half a kick is given half of what pairs push, which has no bound where a collider
pushes against them. The guarantee is the same behind each solver: it changes displacements before velocities are made of them.
The implicit midpoint goes on to the end of its steps before (wsim/physics/contact/selfcontact/prolonged.py), by XPBD too, with
colliders or without; sdirk3, which solves twice a step, is refused by the check.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.contact.selfcontact import pairs, rows, step_clamp
from wsim.kernels.motion.points import point_states
from wsim.model.stage import MET, Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact import fast
from wsim.physics.contact.selfcontact.apart import SurfaceFreeFlight
from wsim.physics.contact.selfcontact.guarantee import LOSS, StepGuarantee, frame_warnings
from wsim.physics.contact.selfcontact.modules import contact_sweep_module
from wsim.physics.contact.selfcontact.near import NearPairList
from wsim.physics.contact.selfcontact.rows.sweeps import SurfaceSweeps
from wsim.physics.contact.selfcontact.start import report_start_state
from wsim.physics.contact.selfcontact.surfaces import ContactSurfaces
from wsim.physics.contact.selfcontact.velocity_solve import VelocitySolve
from wsim.scene.values.table import FRICTION

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

SAID = "self-contact"  # status words, see kernels/contact/selfcontact/step_clamp.py
SWEEPS, BEHIND, LAST = 3, 24, 24 # of contact rows: in an iteration of XPBD, behind another solver, behind XPBD's last
LONGER = 16  # blocks of more sweeps (kernels/contact/selfcontact/rows.py), at most, while pairs would end too near
ROUNDS, MORE = 16, 3             # projections of what is not certified, at most; times as many in a frame that lost too much
ANEW = 4                         # sweeps of XPBD over the same pairs; behind another solver each looks: what rests is calm


def build(b: Build) -> SelfContactMethod:
    return SelfContactMethod(b)


class SelfContactMethod(Method):
    """Stages of the list, the rows and the guarantee."""

    def __init__(self, b: Build):
        super().__init__("selfcontact")
        self.model, self.state, self.status, self.clock = b.model, b.state, b.status, b.clock
        self.points = b.ports.points
        self.contact: Any = None         # colliders, `wsim.physics.contact.method.ContactMethod`
        self.bounce: Any = None          # what they throw back with, `wsim.physics.contact.restitution.RestitutionStage`
        self.solved: Any = None          # `rows.newton_rows.NewtonContactRows`, where Newton's method solves for rows
        self.start = self.arrivals = None    # type: Any   # e where substeps begin, if bodies change it; balls that come and go
        self.prolonged = getattr(b.ports.contact, "prolonged", None)
        b.status.reserve(SAID, step_clamp.SAID)
        self.fast = fast.SubstepShortening(b.model, b.clock)
        self.strands = b.ports.strands
        self.alike, self.steady = not self.strands, False      # steady: x, e, a stay as in `find` until a substep ends
        self.surfaces = ContactSurfaces(b.model, self.points.constants.w, b.ports.contacts, self.strands)
        self.obstacles = self.surfaces.obstacles
        if self.surfaces.state:                          # what moves one moves the other
            b.state.points.arrays["d"] = self.surfaces.state.d[:b.model.points]
        start = report_start_state(b.model, self.surfaces)
        self.within = within = b.choice.solver == "xpbd" and not b.clock.integrator.beyond
        turns = within and not b.model.device.is_cuda
        self.near = NearPairList(b.model, self.surfaces, turns)
        self.guarantee = StepGuarantee(b.model, self.near, b.clock.integrator.beyond)  # far from where normals of before are
        self.total, self.frames, self.repeats, self.run = np.zeros(step_clamp.SAID, np.int64), 0, 0, 0
        self.swept = self.taken = 0.0    # sum of m |d|^2 h of all substeps [kg m^2 s], and what cuts took of m |d|^2
        self.often, self.fresh, self.stopped, self.sized = False, True, False, list[Any]()   # sized: with room as the list has
        self.sweeps = SWEEPS if within else BEHIND
        real, module = b.model.real, contact_sweep_module(b.model, turns)
        self.nearer, self.further = rows.near_pair_flag_kernel(real, module), rows.sweep_count_kernel(module)
        self.sweeper = SurfaceSweeps(self, turns)
        what = f"{len(self.surfaces.triangles)} triangles, {len(self.surfaces.edges)} edges; where a point leaves its tube"
        for owner, each, name in ((self.obstacles, "triangles", "colliders"), (self.strands, "edges", "strands")):
            what += f"; {len(getattr(owner, each))} {each} are {name}'" if owner else ""
        self.stages = [Stage("near pairs", "collide", self.find, 1, 0, what=what),
            Stage("self-contact", "solve", self.touch, 3 * self.sweeps, 0, "iteration" if within else "substep", "near pairs"),
            Stage("guarantee", "solve", self.keep, 8, 0, what="proof; projections and cuts of what lacks one")]
        for stage in self.stages:
            stage.frames = MET
        if b.ports.arrivals and len(self.surfaces.balls):
            from wsim.physics.contact.selfcontact.rows.presence import BallPresence
            self.arrivals = BallPresence(self, b.ports.arrivals)
        self.settle = self._settle()
        self.apart = SurfaceFreeFlight(self, b, module)
        self.stages += self.apart.stages
        self.offers = Ports(free_flight=self.apart, self_contact=self, start_warnings=start)

    def _settle(self) -> VelocitySolve:
        if self.clock.integrator.beyond:
            from wsim.physics.contact.selfcontact.prolonged import MidpointContacts
            return MidpointContacts(self)
        return VelocitySolve(self)

    @property
    def said(self):
        """Words of a frame, on the device."""
        return self.status.word(SAID)

    def own(self):
        """State of the points, as a launch reads it."""
        s = self.state
        return fill_struct(point_states(self.model.real), x=s.x, e=s.e if self.start is None else self.start, d=s.d,
                           a=self.points.anchor)

    def connect_ports(self, others: Methods) -> None:
        self.contact, self.bounce = others.ports.contact, others.ports.restitution
        self.sweeper.meet()
        if self.sweeper.fits():
            next(stage for stage in self.stages if stage.name == "self-contact").launches = 1
        self.steady = self.within and not self.strands and not (self.contact and self.contact.movers)
        self.start = self.contact.movers.starts() if self.contact and self.contact.movers else None
        self.settle.connect_ports(others)
        if (terms := others.ports.newton_terms) is not None:
            from wsim.physics.contact.selfcontact.rows.newton_rows import NewtonContactRows
            self.solved = NewtonContactRows(self, others.ports.newton_assembly)
            terms.insert(0, self.solved)                 # before colliders bear what rows push

    def at(self):
        """The same, with strands and colliders."""
        return self.surfaces.state or self.own()

    def borrow(self, begins: bool = False) -> None:
        if self.surfaces.state and (begins or not self.steady):
            self.surfaces.borrow(self.model, self.own())

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """static_friction, dynamic_friction of a body or a collider."""
        return name in FRICTION and self.surfaces.rub(path, FRICTION.index(name), value, world)

    def find(self, clock: Clock) -> None:
        """Makes the list if it does not hold on, and looks at where its pairs are."""
        import warp as wp
        if self.obstacles:
            self.obstacles.move(clock)
        if self.strands:
            self.strands.lend()
        if self.arrivals:
            self.arrivals.update()
        self.borrow(begins=True)
        at = self.settle.expected(clock)
        wp.capture_if(self.near.word(pairs.SOON), lambda: self.near.search(at, begins=1))
        self.guarantee.begin(at)

    def touch(self, clock: Clock) -> None:
        import warp as wp
        last = not self.within or clock.i == clock.iterations - 1
        if not self.solved or self.strands:
            self.press(clock, self.sweeps)
        if self.within and last:
            self.press(clock, LAST)
        if last and self.going and LONGER:
            self.look(clock, 1)
            wp.capture_while(self.near.word(pairs.NEARER), lambda: self.more(clock))
        if last:
            if self.contact:
                self.contact.behind(clock)
            self.settle.gather(clock)

    def press(self, clock: Clock, count: int) -> None:
        """Sweeps, if there are pairs: one launch sees that there are none faster than a condition."""
        import warp as wp
        if self.sweeper.fits():
            return self.sweep(clock, count)
        wp.capture_if(self.near.word(pairs.NEAR), lambda: self.sweep(clock, count))

    @property
    def going(self) -> bool:
        """Whether sweeps go on while a pair would end too near."""
        return len(self.clock.integrator.steps) != 2 or not (self.contact or self.obstacles or self.strands)

    def look(self, clock: Clock, first: int) -> None:
        """Launches the test whether sweeps go on; before the first, no word says so."""
        self.borrow()
        if not first:
            self.near.word(pairs.NEARER).zero_()
        inputs = [self.at(), rows.RECOVERY * clock.h, first, self.near.threads, self.near.table]
        self.model.launch(self.nearer, self.near.threads, inputs, [self.near.words])
        if not first:
            self.go_on()

    def go_on(self) -> None:
        """Counts a block of sweeps, and ends them behind LONGER."""
        self.model.launch(self.further, 1, [LONGER], [self.near.words])

    def more(self, clock: Clock) -> None:
        self.sweep(clock, rows.MORE, True)
        self.look(clock, 0)

    def sweep(self, clock: Clock, count: int, leads: bool = False) -> None:
        """Sweeps over the pairs that push, each before one of the contacts of points with colliders, which what is pushed rests
        on."""
        self.borrow()
        self.sweeper.sweep(clock, count, leads, 1 if leads or not self.within else ANEW, 1 if count == SWEEPS else -1)

    def keep(self, clock: Clock) -> None:
        def relist_solved_pairs() -> None:
            self.near.search(self.at(), solved=True)
            self.guarantee.begin(self.at(), solved=True)
        self.borrow()
        if self.strands:
            self.strands.pushes()
        self.guarantee.keep(self.at(), self.at().d, relist_solved_pairs, self.said)
        self.settle.settle(clock)
        if self.contact and clock.integrator.memory:
            if self.bounce:
                self.bounce.settled(self.contact.settle, clock)
            else:
                self.contact.settle(clock)

    # around a frame

    def choose_frame_form(self, clock: Clock) -> None:
        self.often, self.fresh, self.stopped = False, not self.stopped, False
        self.apart.choose_frame_form(clock)

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.fresh:
            first = self.near.age == 0 and not self.surfaces.state
            self.near.build(*((self.own(), clock.h * self.state.v.numpy()) if first else ()))
            self.room()
        else:
            self.near.anew()
        self.surfaces.weigh(self.points.constants.w)
        if self.obstacles:
            self.obstacles.before_frame(time, clock)
        self.near.set_projection_rounds(ROUNDS * MORE if self.often else ROUNDS)
        self.fresh = False

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        said = status.said(SAID)
        wanted = int(said[step_clamp.WANTED])
        if self.clock.free:
            self.apart.vain = bool(said[step_clamp.BUSY] or wanted)
            return [Remedy("meet")] if self.apart.vain else []
        if wanted:
            return [Remedy("room", lambda: self.grow(wanted), keeps=True)]
        if self.fast.must_shorten_substeps(said):
            return [Remedy("grow", lambda: self.fast.shorten(said))]
        if (said[step_clamp.LOST] > LOSS or said[step_clamp.PINCHED]) and not self.often:
            self.often = True
            self.repeats += 1
            return [Remedy("again")]
        if said[step_clamp.PINCHED] and (self.model.worlds == 1 or self.clock.apart):
            self.total[step_clamp.PINCHED] += said[step_clamp.PINCHED]
            self.stopped = True
            why = self.guarantee.pinch.words(said)
            return [Remedy("stop", part="points", row=int(said[step_clamp.WHERE]) - 1, why=why)]
        return []

    def lengthen_lists(self) -> None:
        if self.near.widen(self.near.capacity):
            self.room()

    def grow(self, wanted: int) -> str:
        before = self.near.capacity
        if wanted <= before:
            return ""
        self.near.grow(wanted)
        self.room()
        return f"{wanted} pairs of surfaces were near each other, and there was room for {before}"

    def room(self) -> None:
        """Arrays of others for as many pairs as the list has room for."""
        for each in (self.settle, *self.sized):
            each.room()

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        said = status.said(SAID)
        self.total, self.run = self.total + said, max(self.run, int(said[step_clamp.RUN]))
        self.near.running = int(said[step_clamp.RUNNING])
        moved, taken = said[[step_clamp.MOVED, step_clamp.TAKEN]].astype(np.int32).view(np.float32)
        self.swept, self.taken = self.swept + float(moved) * self.clock.h, self.taken + float(taken)
        self.frames += 1
        self.apart.end(self.clock, said[step_clamp.BUSY] > 1 or bool(said[step_clamp.NEARBY]))
        if self.near.widen(int(said[step_clamp.LISTED])):
            self.room()
        return frame_warnings(self, said)

    def resume_run(self, time: float) -> None:
        self.apart.resume_run()

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """Those of the list, `NearPairList.told`; searches, projected and cut substeps, held ones, of all frames; repeated:
        frames, for what cuts took; cut_energy: what they took of the kinetic energy a second [1/s]; cut_run: most substeps
        running in which a point lost more than 5 %."""
        words = (("searches", step_clamp.SEARCHES), ("projected", step_clamp.PROJECTED), ("cut", step_clamp.CUT),
                 ("held", step_clamp.STAYED), *[("pinched", step_clamp.PINCHED)][:bool(self.obstacles)])
        total = {name: float(self.total[k]) for name, k in words}
        return {**self.near.told(self.clock.free), **total, "repeated": float(self.repeats),
                "cut_energy": self.taken / self.swept if self.swept else 0.0, "cut_run": float(self.run)}
