"""Graph-coloured XPBD over all bodies: one batch a kind of constraint, a launch a colour or a sweep. See
kernels/solver/xpbd.py.

Colours are found once per body and shared by its copies in other worlds; bodies do not touch, so colour c of the scene is the
union of the bodies' colours c. Inside a colour constraints stand in the order of their points. Multipliers are zeroed each
substep and kept through its iterations; with one iteration they do not exist.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.motion.points import point_states
from wsim.model import kernel_cache
from wsim.model.model import Model
from wsim.model.stage import MISSED, Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.state import SimulationState
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.cloth.constraints import Constraints, apply_live_value, coloured_constraints
from wsim.physics.cloth.kind import SPRINGS, named_kinds
from wsim.physics.solver.batch import ColouredBatch

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


def build(b: Build) -> Xpbd:
    return Xpbd(b.model, b.state, b.ports.points, b.status, b.clock,
                b.model.constraints if b.choice.solver == "xpbd" else b.kept(soft=False))


class Xpbd(Method):
    """Stages solve: one per kind, each a launch a colour; before them, once a substep, the multipliers are zeroed."""

    alike = True

    def __init__(self, model: Model, state: SimulationState, points, status: FrameStatus, clock: Clock,
                 rows: list[Constraints]):
        """rows: constraints of all bodies."""
        super().__init__("xpbd", by_world=True)
        self.model, self.state, self.points, self.status, self.clock = model, state, points, status, clock
        self.watched: list[ColouredBatch] = []
        self.muscles: Any = None
        coloured_constraints(rows)
        self.batches = [ColouredBatch(kind.name, [r for r in rows if r.kind == kind.name], model, clock)
                        for kind in named_kinds({r.kind for r in rows})]
        self.offers = Ports(xpbd_batches=self.batches, constraint_rows=[r for b in self.batches for r in b.rows])
        if any(b.row.gather == SPRINGS for b in self.batches):
            self.offers.spring_tables = self.spring_tables
        if any(b.multipliers for b in self.batches):
            size = sum(b.lam.capacity for b in self.batches)
            self.stages.append(Stage("multipliers", "collide", self.zero, len(self.batches), size, what="zeroed"))
        for batch in self.batches:
            batch.data.w = points.constants.w
            colours = len(batch.starts) - 1
            launches = (1 if batch.fused else colours) + 3 * (batch.curvature is not None)
            self.stages.append(Stage(
                batch.kind, "solve", partial(self.project, batch), launches, batch.bytes, "iteration",
                f"{batch.size} constraints in {colours} colours"))
        if clock.watched and not all(b.hard for b in self.batches):
            self.watch()

    def spring_tables(self) -> list:
        from wsim.physics.cloth.nets.springs import SpringTable
        return [SpringTable(b.rows, b.data.rest, b.order, b.given) for b in self.batches
                if b.row.gather == SPRINGS]

    def connect_ports(self, others: Methods) -> None:
        """The energy is that of the rest lengths at the end of a frame. Explicit steps may take tethers: see
        kernels/motion/fused/hold.py."""
        if "xpbd" in (others.ports.fused_effects or ()):
            self.stages.clear()
        self.muscles = others.ports.muscles

    def watch(self) -> None:
        """BDF2 gains energy where sweeps leave too much: the last substep of a frame is measured. The midpoint's way to the end
        of a substep doubles what they leave: each is."""
        from wsim.kernels.solver.sweeps.residual import residual_verdict_kernel
        model = self.model
        self.status.reserve(MISSED)
        self.watched = [b for b in self.batches if not b.hard]
        self.largest = wp.zeros(len(self.watched), dtype=model.real, device=model.device)
        self.look_kernels = self.residual_kernels(model.module)
        self.judge = residual_verdict_kernel(model.real, model.module)
        self.stages.append(Stage("residual", "solve", self.look, len(self.watched) + 1, 0,
                                 what=f"{self.points.integrator.name}'s, in "
                                      f"{'every' if self.clock.integrator.beyond else 'the last'} substep of a frame"))

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        return [Remedy("give way")] if self.watched and status.said(MISSED)[0] else []

    def residual_kernels(self, module: str, few: bool = True) -> list:
        """Kernels by batch; few: also of those that the host can look at."""
        from wsim.kernels.solver.sweeps.residual import xpbd_residual_kernel
        return [xpbd_residual_kernel(b.row.equation, real=self.model.real, module=module, uniform=b.uniform) if few
                or not b.few else None
                for b in self.batches if not b.hard]

    def look(self, clock: Clock) -> None:
        """Residual of every batch after the last substep's sweeps, of the midpoint after each (it damps nothing of what one of
        them leaves), and whether the integrator may go on."""
        if not clock.watched or (clock.k < clock.substeps - 1 and not clock.integrator.beyond):
            return
        model, s, tape = self.model, self.state, self.model.tape
        x, d = (tape.read(s.x), tape.read(s.d)) if tape else (s.x, s.d)
        lam = [b.adjoint.last if tape and b.adjoint else b.lam for b in self.watched]

        def judge_sweeps() -> None:
            before, model.tape = model.tape, None        # looks, and changes nothing
            self.largest.zero_()
            self.measure(self.look_kernels, x, d, lam, self.largest)
            model.launch(self.judge, len(lam), [self.largest, clock.integrator.met[1]], [self.status.word(MISSED)])
            model.tape = before
        tape.do(judge_sweeps) if tape else judge_sweeps()

    def measure(self, kernels_: list, x: wp.array, d: wp.array, lam: list[wp.array], largest: wp.array) -> None:
        soft = [b for b in self.batches if not b.hard]
        for row, (batch, kernel, own) in enumerate(zip(soft, kernels_, lam, strict=True)):
            batch.aim(x, d, x, 0.0)                      # what damping asks for is left out
            if kernel:
                self.model.launch(kernel, batch.size, [batch.data, x, d, own, 1.0 / self.clock.effective_step, row], [largest])

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """elastic_energy [J]; residual: what the last substep's sweeps left, see kernels/solver/sweeps/residual.py (strain,
        radians). A single iteration keeps no multipliers and has no residual. Kernels of their own module, compiled when asked
        for; few constraints are looked at on the host. Beside explicit steps, which have what is soft, nothing."""
        soft = [b for b in self.batches if not b.hard]
        if not soft:
            return {}
        looked = any(b.multipliers for b in soft) and not self.clock.integrator.beyond
        module = kernel_cache.report_module(self.model, f"xpbd {looked}", *sorted({f"{b.kind} {b.uniform}" for b in soft}))
        looks = self.residual_kernels(module, False) if looked else []
        for b in soft:
            if not b.few:
                b.energy_kernels(module)
        if self.muscles:
            self.muscles.finish()
        found = {"elastic_energy": sum((b.energy(self.state, module) for b in soft), 0.0)}
        if any(b.multipliers for b in soft):
            if self.clock.integrator.beyond:                        # the end of a substep is not where the multipliers are
                largest = self.largest
            else:
                largest = wp.zeros(len(soft), dtype=self.model.real, device=self.model.device)
                for kernel in (k for k in looks if k):
                    kernel_cache.load_module_of_kernel(kernel, self.model)
                self.measure(looks, self.state.x, self.state.e, [b.lam for b in soft], largest)
            hosts = [b for b, kernel in zip(soft, looks, strict=True) if not kernel] if looks else []
            found["residual"] = max([float(largest.numpy().max())] + [
                b.left(self.state.x, self.state.e, 1.0 / self.clock.effective_step) for b in hosts])
        return found

    def zero(self, clock: Clock) -> None:
        for batch in self.batches if not self.model.tape else ():
            self.model.zero(batch.lam)

    def project(self, batch: ColouredBatch, clock: Clock) -> None:
        s, a = self.state, self.points.anchor if batch.damped else None
        if self.model.tape and batch.adjoint:
            batch.adjoint.record(self.model.tape, s.x, a, s.d, clock)
            return
        omega = batch.omega(clock)
        batch.aim(s.x, s.d, a, 1.0 / clock.effective_step)
        at = fill_struct(point_states(self.model.real), x=s.x, d=s.d, a=a)
        if batch.fused:
            self.model.sweep(batch.kernel, [batch.data, at, batch.colours, 1.0 / clock.effective_step, omega, batch.lam],
                             [s.d, batch.lam], batch.worlds)
            return
        for first, last in zip(batch.starts[:-1], batch.starts[1:], strict=True):
            self.model.launch(batch.kernel, int(last - first),
                              [batch.data, at, int(first), 1.0 / clock.effective_step, omega, batch.lam], [s.d, batch.lam])

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """stretch, weft, shear, bend, poisson, strain_limit of a cloth, stiffness of a spring net, damping [s] of either; what
        a rest shape and rest lengths change."""
        hit = any([apply_live_value(self.model, batch.rows, path, name, value, world, batch.damped) for batch in self.batches])
        for batch in self.batches:
            batch.refresh()
        if any(batch.remade for batch in self.batches):
            self.remade = True
            if self.watched:
                self.look_kernels = self.residual_kernels(self.model.module)
        return hit

    @property
    def constraints(self) -> int:
        return sum(b.size for b in self.batches)
