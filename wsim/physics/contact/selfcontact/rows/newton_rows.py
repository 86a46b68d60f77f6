"""Contact rows of surfaces as a term of Newton steps, and the one system that a world is while surfaces are near each other.
Equations: kernels/contact/selfcontact/newton/law.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import pairs, rows
from wsim.kernels.contact.selfcontact.newton import law as laws
from wsim.kernels.contact.selfcontact.newton import solve as solution
from wsim.kernels.math.real import types
from wsim.kernels.solver import line_search, pcg
from wsim.model.ports import NewtonTerm
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact.modules import NEWTON, NEWTON_WORDS, newton_contact_module
from wsim.physics.solver.assembly import Assembly
from wsim.physics.solver.linear import EACH

if TYPE_CHECKING:
    from collections.abc import Callable

    from wsim.model.stage import Clock
    from wsim.physics.contact.selfcontact.method import SelfContactMethod

MOST = 12              # further Newton steps of a substep, at most, while rows are left
SOLVED = 0.005         # residual of a substep: what is left is what friction errs by, and what rigid bodies are pushed by


class NewtonContactRows(NewtonTerm):
    """words: see kernels/contact/selfcontact/newton/law.py. again: the step to come is a further one; looks: none is to
    come."""

    def __init__(self, method: SelfContactMethod, assembly: Assembly):
        self.method, self.assembly, self.model = method, assembly, assembly.model
        self.near, self.surfaces, self.clock = method.near, method.surfaces, method.clock
        system, model = assembly.system, assembly.model
        kinds = assembly.springs, bool(system.A.block)
        real, module = model.real, newton_contact_module(model, *kinds)
        self.kernels: dict[str, Any] = {name: factory(real, module) for name, factory in NEWTON.items()}
        self.kernels |= {name: factory(module) for name, factory in NEWTON_WORDS.items()}
        self.kernels["product"] = solution.joined_product_kernel(real, module, *kinds)
        self.pcg, self.choose = pcg.pcg_chunk_kernels(real, module, *kinds), line_search.step_choice_kernel(real, module)
        self.again, self.looks, self.words = False, False, system.zeros(4, int)
        n, worlds, t = model.points, model.worlds, types(real)
        self.systems = system.systems // worlds                    # of a world
        starts = system.starts[::self.systems]
        self.chunks = system.cut(starts)
        self.starts = model.upload(starts.astype(np.int32), int)   # of worlds, among points
        self.world = model.upload(np.repeat(np.arange(worlds), np.diff(starts)).astype(np.int32), int)      # of points
        self.drop, self.step = (system.zeros(worlds, wp.float64) for _ in range(2))
        self.count = system.zeros(worlds, int)
        self.law = fill_struct(laws.law_type(real), points=n, sum=system.zeros(3 * n, wp.int64),
                               block=system.zeros(6 * n, wp.int64),
                               scale=system.zeros(n, t.scalar), change=system.zeros((worlds, laws.PARTS), wp.int64),
                               unit=system.zeros(worlds, wp.float64))
        self.near.solve()
        system.joined = self

    # launches

    @property
    def given(self) -> list:
        """What kernels over rows read first."""
        return [self.surfaces.data, self.method.at(), self.near.table]

    @property
    def threads(self) -> int:
        return self.near.threads

    def over_rows(self, name: str, inputs: list, outputs: list) -> None:
        self.model.launch(self.kernels[name], self.threads, inputs, outputs)

    def when_near(self, act: Callable[[], None], other: Callable[[], None] | None = None) -> None:
        """Launches what is done where surfaces are near each other, and where they are not."""
        wp.capture_if(self.near.word(pairs.NEAR), act, other)

    # around a Newton step

    def adjust_system(self, g: float, fresh: bool) -> None:
        """Pushes at d, in f and in the diagonal blocks."""
        self.now(g)
        act, self.again = laws.RENEW if self.again else laws.LOOK if self.looks else laws.PRESS, False
        self.when_near(lambda: self.push(act))

    def now(self, g: float) -> None:
        law, clock = self.law, self.clock
        law.climb, law.rate = rows.RECOVERY * clock.h, 1.0 / (g * g)
        law.ahead = self.method.settle.ahead_of(clock)

    def push(self, act: int) -> None:
        A, f, n = self.assembly.A, self.assembly.f, self.model.points
        self.method.borrow()
        self.renew(act)
        self.model.launch(self.kernels["join"], n, [self.assembly.rows.w, self.law], [A])
        self.give(f)

    def give(self, f: wp.array) -> None:
        """Adds what rows push by to forces."""
        self.over_rows("give", [*self.given, self.threads, self.law], [])
        self.model.launch(self.kernels["take"], self.model.points, [self.law, 1.0, f], [f])

    def bear(self, f: wp.array) -> None:
        """Adds pushes at d to forces, behind the last step."""
        def add_pushes_at_end() -> None:
            self.method.borrow()
            self.renew(laws.LOOK)
            self.give(f)
        self.when_near(add_pushes_at_end)

    def renew(self, act: int) -> None:
        self.over_rows("renew", [*self.given, act, self.threads, self.law], [self.words])

    def extend_line_search(self, trial: Any, g: float, lanes: int) -> None:
        """Adds psi to what a line search looks at."""
        def add_search_energy() -> None:
            self.over_rows("change", [*self.given, trial.begin, trial.end, self.threads, self.assembly.v.y, self.law], [])
            self.model.launch(self.kernels["tell"], (self.model.worlds, laws.PARTS), [self.law, trial, self.systems], [])
        self.when_near(add_search_energy)

    def begin_solve(self, clock: Clock, back: Callable[[], None], line: Any) -> None:
        """d goes back to where the substep began, if Phi with psi is less there."""
        def compare_start_energy() -> None:
            self.assembly.linearise(1.0 / clock.effective_step)
            self.method.borrow()
            self.over_rows("stiffen", [*self.given, self.assembly.A, self.threads, self.law], [])
            self.renew(laws.LOOK)
            back()
            self.drop.zero_()
            c, system = self.chunks, self.assembly.system
            system.launch(self.kernels["measure"], [c, self.assembly.A, self.assembly.v.y], [], c.body.size)
            self.model.launch(self.kernels["compare"], self.model.worlds, [c, self.law], [])
            line.search(1.0 / clock.effective_step, 0, terms=[self])
        self.now(clock.effective_step)
        self.when_near(compare_start_energy)

    def take_further_steps(self, clock: Clock, again: Callable[[], None], measure: Callable[[], wp.array]) -> None:
        """Behind the Newton steps of a substep: further ones while a row is wrong, or the residual above `most_left`."""
        self.words.zero_()
        self.when_near(lambda: self.check(0, measure))
        wp.capture_while(self.words[laws.GOING:laws.GOING + 1], lambda: self.further(again, measure))

    def further(self, again: Callable[[], None], measure: Callable[[], wp.array]) -> None:
        self.again = True
        again()
        self.check(1, measure)

    def most_left(self) -> float:
        """Largest residual with which a substep may end."""
        return min(SOLVED, self.clock.integrator.met[0])

    def check(self, steps: int, measure: Callable[[], wp.array]) -> None:
        """Looks for rows whose pushes are wrong, and at the residual."""
        self.method.borrow()
        self.words[laws.WRONG:laws.WRONG + 1].zero_()
        self.words[laws.MOVING:laws.MOVING + 1].zero_()
        self.renew(laws.CHECK)
        bound = self.most_left()
        self.looks = True
        left = measure()
        self.looks = False
        self.model.launch(self.kernels["count"], 1, [left, bound, steps, MOST], [self.words])

    def end_solve(self, clock: Clock) -> None:
        """Pushes that a substep ends with."""
        def store_final_pushes() -> None:
            self.method.borrow()
            self.renew(laws.STORE)
        self.when_near(store_final_pushes)

    # the system of a world

    def subtract(self, z: wp.array, r: wp.array) -> None:
        """Takes from forces r what rows make of z."""
        def subtract_row_products() -> None:
            self.over_rows("multiply", [*self.given, self.threads, z, self.law], [])
            self.model.launch(self.kernels["take"], self.model.points, [self.law, -1.0, r], [r])
        self.when_near(subtract_row_products)

    def solve_joined(self, A: Any, f: wp.array, tolerance: float, cap: int) -> None:
        """y of (A + rows) y = f, by conjugate gradients over all bodies of a world."""
        system, c, v, size = self.assembly.system, self.chunks, self.assembly.v, self.chunks.body.size

        def joined_cg_iterations() -> None:
            for k in range(EACH):
                self.over_rows("multiply", [*self.given, self.threads, v.z, self.law], [])
                system.launch(self.kernels["product"], [c, system.rows, A, self.law, k % 2, v], [], size)
                system.launch(self.pcg.advance, [c, A, tolerance, cap, k % 2, v], [self.drop, self.count], size)
        self.count.zero_()
        system.launch(self.pcg.start, [c, A, f, v], [self.drop], size)
        wp.capture_while(c.going, joined_cg_iterations)
        self.model.launch(self.kernels["spread"], system.systems, [self.systems, self.drop, self.count, self.law],
                          [system.drop, system.count])

    def choose_step(self, trial: Any, step: wp.array) -> None:
        """One step for all bodies of a world."""
        joined = fill_struct(line_search.LineSearchTrial, first=trial.first, lanes=trial.lanes * self.systems,
                             begin=trial.begin, end=trial.end, step=self.step, change=trial.change)
        if trial.begin == 0:
            self.step.fill_(-1.0)
        self.assembly.system.launch(self.choose, [joined, self.drop], [self.step], self.model.worlds)
        self.model.launch(self.kernels["share"], step.size, [self.systems, self.step], [step])
