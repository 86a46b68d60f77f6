"""The line search of Newton steps: of which part of a step the potential Phi is least. Equations:
kernels/solver/line_search.py."""

from collections.abc import Iterable

import numpy as np
import warp as wp

from wsim.kernels.solver import line_search
from wsim.model.ports import NewtonTerm
from wsim.physics.cloth.kind import SHEET
from wsim.physics.solver.assembly import Assembly

MANY = 4096            # lanes of all bodies of a world, up to which each has one thing to look at


class LineSearch:
    """Sums of Phi's changes, one thread for a few of them, and the step of each system."""

    def __init__(self, assembly: Assembly):
        self.assembly, model = assembly, assembly.model
        bodies, real, over, (module, block) = assembly.system.systems, model.real, assembly.system.zeros, model.step_modules
        self.step = over(bodies, wp.float64)
        kinds = {kind: table.first() for kind, table in assembly.tables.items()}
        most = max([int(np.diff(model.starts).max())] + [most for _, most in kinds.values()]
                   + [s.most for s in assembly.solids])
        few = max(32, min(most, MANY * model.worlds // bodies))
        self.lanes = int(np.clip(most // 8, few, 2**16)) if model.device.is_cuda else 1
        self.change = wp.zeros((bodies * self.lanes, 1 + line_search.HALVINGS), dtype=wp.float64, device=model.device)
        firsts = {"": assembly.system.first} | {kind: model.upload(first, int) for kind, (first, _) in kinds.items()}
        firsts |= {s.name: s.first for s in assembly.solids}
        if assembly.bending:
            firsts["curvature"] = assembly.bending.first
        self.trials = {kind: [self.trial(first, begin, end) for begin, end in ((0, 1), (1, 1 + line_search.HALVINGS))]
                       for kind, first in firsts.items()}
        self.inertia, self.move = line_search.inertia_change_kernel(real, module), line_search.line_step_kernel(real, module)
        self.elastic = {kind: line_search.elastic_change_kernel(t.row.equation, real, module)
                        for kind, t in assembly.tables.items()
                        if t.row.gather != SHEET}
        self.choose = line_search.step_choice_kernel(real, block)

    def trial(self, first: wp.array, begin: int, end: int):
        trial = line_search.LineSearchTrial()
        trial.first, trial.lanes, trial.begin, trial.end = first, self.lanes, begin, end
        trial.step, trial.change = self.step, self.change
        return trial

    def search(self, rate: float, *passes: int, terms: Iterable[NewtonTerm] = ()) -> None:
        """d goes along y as far as Phi says: all the way or, after pass 1, a part, or nowhere. terms: what
        else Phi has."""
        m = self.assembly
        s, a, y, system, launch = m.state, m.points.anchor, m.v.y, m.system, m.model.launch
        rows = system.systems * self.lanes
        self.step.fill_(-1.0)
        for which in passes:
            trials = {kind: both[which] for kind, both in self.trials.items()}
            launch(self.inertia, rows, [trials[""], m.A, s.d, m.b, y], [])
            for term in terms:
                term.extend_line_search(trials[""], 1.0 / rate, rows)
            for kind, kernel in self.elastic.items():
                launch(kernel, rows, [trials[kind], m.tables[kind].data, s.x, s.d, a, y, rate], [])
            if m.bending:
                m.bending.search(trials[m.bending.table.kind], trials["curvature"], [s.x, s.d, a, y, rate])
            for solid in m.solids:
                launch(m.stressed[solid.name][1], rows, [trials[solid.name], solid.data, s.x, s.d, a, y, solid.q, rate], [])
            self.choose_step(trials[""], bool(terms))
        launch(self.move, m.model.points, [system.of, self.step, y, s.d], [s.d])

    def choose_step(self, trial, together: bool) -> None:
        """The step of each system. together: of all that are joined by contacts, the same one."""
        system = self.assembly.system

        def choose_alone() -> None:
            system.launch(self.choose, [trial, system.drop], [self.step])
        if together and system.joined:
            system.joined.when_near(lambda: system.joined.choose_step(trial, self.step), choose_alone)
        else:
            choose_alone()
