"""A run checks its own energy: the method that balances it at the end of every frame, on the device.

Energy may be lost, by contacts, damping and numerical damping. It may not come from nowhere: kinetic and stored energy, less
the work of gravity, loads, colliders that move, wind and drives, rise by no more than PART of the largest kinetic energy so
far, and a floor: the work of the weights over FLOOR of the sizes (what contacts push apart, what float32 rounds). Equations:
kernels/math/ledger.py.

Where something works whose work is not known, the frame is left open: the balance begins anew behind it. `OpenFrameReasons`
lists what that is.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math import ledger
from wsim.model.stage import Clock, Method, Ports, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.simulation.measure.checks.lost import TOLD
from wsim.simulation.measure.checks.reasons import STILL, OpenFrameReasons
from wsim.simulation.measure.checks.rise import FIRST, left_open
from wsim.simulation.measure.checks.terms import EnergyTerms
from wsim.simulation.measure.checks.works import WorkOfSubsteps

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

PART = 0.01            # of the largest kinetic energy so far
FLOOR = 1e-3           # of the size of an object, over which its weight may work
CREEP = 1e-4           # of the size of an object a frame: a speed that is none
APART = "; if shapes overlap where the run starts, move them apart"
WORD, MOVES = "energy gained", "pin that moves"
FIELDS = (StateField("balance_lowest", "J", True, "least energy so far, with the work done since", "double"),
          StateField("balance_most", "J", True, "largest kinetic energy so far", "double"),
          StateField("balance_substeps", "", True, "substeps of a frame where some was repeated with more, else 0", "double"),
          StateField("balance_rises", "", True, "how often checks have raised them", "double"),
          StateField("balance_rolled", "", True, "facets or radians passed by rolling bodies in successive frames", "double"))
FIELDS_OF = ("balance_lowest", "balance_most")


def build_energy_balance(b: Build) -> EnergyBalance | None:
    """None where nothing moves whose energy is known."""
    works = WorkOfSubsteps(b)
    terms = EnergyTerms(b.model, b.state, b.methods, b.choice.solver, works.given)
    return EnergyBalance(b, terms, works) if terms.each else None


class EnergyBalance(Method):
    alike = True

    def __init__(self, b: Build, terms: EnergyTerms, works: WorkOfSubsteps):
        super().__init__("balance")
        self.model, self.status, self.terms, self.clock = b.model, b.status, terms, b.clock
        self.works, self.reasons, self.iterates = works, OpenFrameReasons(b, works), b.choice.solver in ("xpbd", "implicit")
        device, n = b.model.device, b.model.worlds
        self.part = StatePart.allocate("energy balance", FIELDS, n, b.model.real, device)
        path = b.state.paths()[0]
        self.part.rows = {(path, world): np.array([world]) for world in range(n)}
        b.state.add(self.part)
        b.status.reserve(WORD, n)
        b.status.reserve(MOVES)
        self.ledger = fill_struct(ledger.EnergyLedger, gift=wp.zeros(n, dtype=wp.float64, device=device),
                                  floor=wp.array(np.full(n, floor_of(b)), dtype=wp.float64, device=device),
                                  peak=wp.zeros(n, dtype=wp.float64, device=device),
                                  rise=wp.zeros(n, dtype=wp.vec4d, device=device),
                                  **{name.removeprefix("balance_"): self.part.arrays[name] for name in FIELDS_OF})
        self.offers = Ports(balance=self)
        self.given = wp.full(n, -1.0, dtype=wp.float64, device=device)       # `gift` by what the host knows
        self.figures: Any = None
        if terms.rigid:
            from wsim.simulation.measure.checks.figures import RigidFigures
            self.figures = RigidFigures(b, terms.rigid, self.part.arrays["balance_rolled"])
            for kernel in self.figures.kernels:
                b.model.modules[kernel.module.name] = b.model.block if device.is_cuda else 1
        b.model.modules[ledger.close_frame.module.name] = b.model.block if device.is_cuda else 1
        self.begun, self.fresh, self.gift, self.mass = True, True, -1.0, free_mass_of_world(b)
        self.surfaces = False                                # collide with themselves
        self.planned = b.clock.substeps
        self.rises, self.why, self.worst = 0, list[str](), dict[int, tuple[float, str]]()
        self.frames, self.opens = 0, dict[str, int]()       # frames so far, and of those left open by reason
        self.stages += works.stages
        self.stages.append(Stage("energy balance", "deform", self.check, len(terms.each) + 2, terms.rows.capacity, "frame",
                                 "what may not rise"))

    def connect_ports(self, others) -> None:
        self.surfaces = others.ports.self_contact is not None

    def choose_frame_form(self, clock: Clock) -> None:
        self.begun = False

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        self.fresh = True
        self.reasons.set_value(path, name, value)
        return False

    def before_frame(self, time: float, clock: Clock) -> None:
        """Begins anew where something was set; leaves the frame open where something works whose work is not known."""
        if self.raised or clock.substeps > self.planned:
            for name, value in (("balance_substeps", clock.substeps), ("balance_rises", self.rises)):
                self.part.arrays[name].fill_(value)
        self.begun, self.fresh = self.begun or self.fresh or clock.starting, False
        if self.begun:
            self.ledger.gift.fill_(inf)
            self.take_balance_snapshot()
            self.close(begins=True)
        self.why, speed = self.reasons.reasons_of_frame(time, clock.dt)
        gift = 2.0 * self.mass * speed**2 if self.why else -1.0
        if gift != self.gift:
            self.given.fill_(gift)
        self.gift = gift

    def prepare_restart(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        """Goes on with the substeps that an earlier run was raised to, by checks or by surfaces that met too fast."""
        kept = fields.get(next(iter(self.part.rows))[0], {})
        if "balance_rises" not in kept:
            return
        substeps, rises = int(kept["balance_substeps"][0]), int(kept["balance_rises"][0])
        if rises > 0 and left_open(self.model.scene):
            self.rises, self.clock.substeps = rises, substeps
        elif rises == 0:
            self.clock.substeps = max(self.clock.substeps, substeps)

    def resume_run(self, time: float) -> None:
        """The balance goes on with what is kept of it."""
        self.fresh = False

    def take_balance_snapshot(self) -> None:
        """The snapshot that the terms compare with: of what stands now."""
        for part in (self.terms.state.parts.get(name) for name in ("points", "bodies")):
            if part is not None:
                wp.copy(part.aside, part.every)

    def check(self, clock: Clock) -> None:
        """Launches all checks of a frame."""
        self.model.launch(ledger.open_frame, self.model.worlds, [self.reasons.speeds, STILL, self.mass, self.given],
                          [self.ledger.gift, self.status.word(MOVES)])
        self.close()
        if self.figures:
            self.figures.launch(clock)

    def close(self, begins: bool = False) -> None:
        """Launches the terms and the balance. begins: where a frame begins."""
        self.terms.launch(self.clock.h, begins)
        lanes = 32 if self.model.device.is_cuda else 1
        self.model.launch(ledger.close_frame, lanes * self.model.worlds,
                          [self.terms.rows, len(self.terms.each), lanes, PART, self.ledger], [self.status.word(WORD)])

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        """More substeps; or backward Euler, where surfaces collide by an integrator that damps nothing of what it does not
        resolve: crumpled sheets are full of that."""
        gained, found = status.said(WORD).any(), []          # type: Any, list[Remedy]
        if gained and self.clock.integrator.beyond and self.surfaces:
            found.append(Remedy("give way", why=f"{self.clock.steps} substeps do not resolve what happens"))
        elif gained:
            found.append(Remedy("check", why="energy gained", worlds=status.worlds_that_said(WORD)))
        return found + (self.figures.find_remedies(status, self.clock.steps) if self.figures else [])

    @property
    def raised(self) -> bool:
        """True if there are more substeps than the plan had."""
        return self.rises > 0

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        """The warning of frames that hold though energy rose: of the worst its prim, how much, and what helps."""
        self.frames += 1
        moves = int(status.said(MOVES)[0])
        for why in self.why or [f"{path} moves" for path in self.reasons.paths[moves - 1:moves]]:
            self.opens[why] = self.opens.get(why, 0) + 1
        found = self.figures.frame_warnings(status, self.clock.steps, self.advice_at_start) if self.figures else []
        return [*found, *(each for world in status.worlds_that_said(WORD)[:TOLD]
                          for each in self.gains(status.said(WORD)[world], world))]

    @property
    def advice_at_start(self) -> str:
        """The advice of the first frames besides."""
        return APART * (self.frames <= FIRST)

    def gains(self, said: int, world: int) -> list[tuple[tuple, float, str]]:
        """Warnings of the energy of a world. said: its word."""
        found = self.found(world)
        most = float(self.part.arrays["balance_most"].numpy()[world])
        gained, more = found["gained"], "substeps or iterations" if self.iterates else "substeps"
        only = any(body.source.is_particles for body in self.model.bodies)                 # implicit steps have no particles
        other = ', or solver "implicit" if sweeps do not converge' * (self.terms.solver == "xpbd" and not only)
        now = f"(now {self.clock.steps} substeps)"
        if said == 2:
            return [(("speeds", world), most, f"{self.gaining_path(world)} is faster than what moves it can make it; give it "
                                              f"more {more} {now}")]
        if gained >= self.worst.get(world, (0.0, ""))[0]:
            self.worst[world] = gained, (f"{self.gaining_path(world)} gained energy that nothing gave it, {{worst}} J where "
                                         f"the largest kinetic energy so far is {most:.3g} J; give it more {more} {now}{other}"
                                         f"{self.advice_at_start}")
        return [(("energy", world), gained, self.worst[world][1])]

    def gaining_path(self, world: int) -> str:
        """Path of the prim of a world that gained most. It takes all places to the host, unless there is one prim alone."""
        from wsim.simulation.measure.checks.gains import gains_by_prim
        rigid = self.terms.rigid.bodies if self.terms.rigid else []
        paths = [b.path for b in self.model.bodies if b.world == world] + [b.path for b, of in rigid if of == world]
        each = gains_by_prim(self, world) if len(paths) > 1 else dict.fromkeys(paths, 0.0)
        return max(each, key=lambda name: each[name]) + self.model.of_world(world)

    def report(self) -> dict[str, Any]:
        """The part of a report: frames, those left open by reason, the largest rise over the largest kinetic energy; strained:
        True where what sweeps leave strained is not counted in it."""
        peak, most = (a.numpy() for a in (self.ledger.peak, self.ledger.most))
        return {"frames": self.frames, "left_open": dict(self.opens), "rise": float((peak / np.maximum(most, 1e-300)).max()),
                "strained": self.terms.solver == "xpbd" and bool(self.model.bodies)}

    def found(self, world: int = 0) -> dict[str, Any]:
        """The last rise of a world: gained, allowed, kinetic, work [J]."""
        rise = self.ledger.rise.numpy()[world]
        return dict(zip(("gained", "allowed", "kinetic", "work"), map(float, rise), strict=True))


def free_mass_of_world(b) -> float:
    """Mass [kg] of what moves freely in a world."""
    rigid, own = b.ports.bodies, [body for body in b.model.bodies if body.world == 0]
    return sum(float(body.masses.sum()) for body in own) + (
        sum(m.mass for m in rigid.masses) / b.model.worlds if rigid else 0.0)


def floor_of(b) -> float:
    """Energy [J] of a world that may come from where contacts push apart, from soft ones under a stack, or from rounding."""
    g, found = float(np.linalg.norm(b.scene.gravity)), b.choice.need.rebound_energy(b.clock.h)

    def add_floor_energy(mass: float, size: float) -> None:
        nonlocal found
        found += mass * (g * FLOOR * size + 0.5 * (CREEP * size * b.scene.fps)**2)
    for body in b.model.bodies:
        if body.world == 0:
            add_floor_energy(float(body.masses.sum()), float(np.ptp(body.places, axis=0).max(initial=0.0)))
    rigid = b.ports.bodies
    for (_, world), inertia in zip(rigid.bodies, rigid.masses, strict=True) if rigid else ():
        if world == 0:
            add_floor_energy(inertia.mass, 2.0 * float(np.sqrt(2.5 * np.max(inertia.moments) / inertia.mass)))
    return found
