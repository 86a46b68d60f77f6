"""Adjoint of `wsim.physics.fluid.grid.sources.SmokeSources`, and of decay where nothing is emitted:
kernels/fluid/adjoint/sources.py, driving.py."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.adjoint import covering, driving
from wsim.kernels.fluid.adjoint import sources as kernels
from wsim.kernels.fluid.forces import COOLING, SMOKE_DECAY
from wsim.physics.fluid.adjoint.launches import TIMED, AdjointLaunches
from wsim.physics.fluid.grid.multigrid import AXES

RATES = {"smoke": SMOKE_DECAY, "heat": COOLING}


class SourcesAdjoint:
    """numbers: of each source, summed over the steps of a frame: rows of `covering.NUMBERS`, float64."""

    def __init__(self, launches: AdjointLaunches, expansion: wp.array | None):
        self.launches, domain = launches, launches.domain
        self.domain, self.sources = domain, domain.sources
        dim, real, module, self.by_expansion = domain.layout.dim, launches.real, launches.module, expansion
        self.numbers = None
        if self.sources is None:
            self.decay = {name: kernels.decay_adjoint_kernel(RATES[name], real, module) for name in domain.scalars}
            return
        kinds = self.sources.shapes.kinds
        carried = "_".join(name for name in ("smoke", "heat") if name in domain.scalars) or "nothing"
        self.Emitted = kernels.emitted_states(real)
        self.emit_kernel = kernels.emission_adjoint_kernel(dim, kinds, carried, real, module)
        self.emitted = kernels.source_number_kernel(dim, kinds, carried, expansion is not None, real, module)
        self.driven = [driving.driven_adjoint_kernels(dim, a, kinds, real, module) for a in range(len(self.sources.drive))]
        self.gather = covering.number_sum_kernel(module)
        self.part = domain.threads.zeros(launches.parts, covering.Numbers)
        self.numbers = domain.threads.zeros(len(self.sources.sources), covering.Numbers)

    def back(self, u: Any, scalars: dict[str, wp.array], by: Any, by_scalars: dict[str, wp.array]) -> None:
        """u, scalars: as the step has found them. by, by_scalars: cotangents behind the sources, become those before."""
        run, domain = self.launches, self.domain
        if self.sources is None:
            for name, kernel in self.decay.items():
                run.over(kernel, by_scalars[name].size, [domain.live, domain.clock], [by_scalars[name]])
        else:
            self._driven_adjoint(u, by)
            if self.sources.emits:
                self._emitted_adjoint(scalars, by_scalars)
        for name, q in scalars.items():
            run.dot(q, by_scalars[name], TIMED, -1.0, RATES[name])

    def _driven_adjoint(self, u: Any, by: Any) -> None:
        run, domain, table = self.launches, self.domain, self.sources.table
        for a, (drive, driven) in enumerate(self.driven):
            now, out = getattr(u, AXES[a]), getattr(by, AXES[a])
            for k in range(len(self.sources.sources)):
                run.blocks(driven, run.parts, [domain.grid, table, k, domain.clock, now, out], [self.part])
                run.over(self.gather, 1, [self.part, k], [self.numbers])
            run.over(drive, out.size, [domain.grid, table, domain.clock], [out])

    def _emitted_adjoint(self, scalars: dict[str, wp.array], by: dict[str, wp.array]) -> None:
        run, domain, table = self.launches, self.domain, self.sources.table
        e = run.struct(self.Emitted, smoke=scalars.get("smoke"), heat=scalars.get("heat"), by_smoke=by.get("smoke"),
                       by_heat=by.get("heat"), by_expansion=self.by_expansion)
        for k in range(len(self.sources.sources)):
            run.blocks(self.emitted, run.parts, [domain.grid, table, k, e, domain.live, domain.clock], [self.part])
            run.over(self.gather, 1, [self.part, k], [self.numbers])
        if by:
            run.over(self.emit_kernel, domain.layout.cells, [domain.grid, table, e, domain.live, domain.clock],
                     [by.get("smoke"), by.get("heat")])
