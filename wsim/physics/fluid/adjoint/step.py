"""Adjoint of a step of a fluid (`wsim.physics.fluid.grid.domain.FluidDomain`), and of a frame of them, the last step first.

    u' = P y,  y = V(A(u1) v1 + h/2 a(s')),  u1 = 2 w - u,  v1 = 2 w - v,  s' = A(w) s,
    w = P v,  v = V(A(u) u + h/2 a(s))

All of it is undone from left to right: P and V by the solves that they were (projection.py), A by transport.py, the forces a by
forces.py, then the sources. Velocities before and behind the first projection are those that the frame has left (trace.py);
what costs no solve is made once more.
"""

from typing import Any

import warp as wp

from wsim.kernels.fluid.adjoint import reflection
from wsim.physics.fluid.adjoint.forces import ForcesAdjoint
from wsim.physics.fluid.adjoint.launches import AdjointLaunches
from wsim.physics.fluid.adjoint.obstacles import ObstaclesAdjoint
from wsim.physics.fluid.adjoint.projection import ProjectionAdjoint, ViscosityAdjoint
from wsim.physics.fluid.adjoint.sources import SourcesAdjoint
from wsim.physics.fluid.adjoint.trace import Trace
from wsim.physics.fluid.adjoint.transport import TransportAdjoint
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.transport import THIRD


class DomainAdjoint:
    """by, by_scalars: cotangents of the state, of the end of a frame before `frame` and of its begin behind it."""

    def __init__(self, domain: Any):
        self.domain = domain
        self.launches = run = AdjointLaunches(domain)
        real, module, threads = run.real, run.module, domain.threads
        self.by, self.by_scalars = domain.faces(), {name: threads.zeros(q.size) for name, q in domain.scalars.items()}
        self.projection = ProjectionAdjoint(run)
        self.viscosity = ViscosityAdjoint(run) if domain.viscosity else None
        self.sources = SourcesAdjoint(run, self.projection.by_expansion)
        self.forces = ForcesAdjoint(run)
        moving = domain.obstacles is not None and domain.obstacles.moving
        self.obstacles = ObstaclesAdjoint(run, self.projection.by_solid) if moving else None
        self.u, self.v, self.w, self.ahead = (domain.faces() for _ in range(4))
        self.by_v, self.by_w = domain.faces(), domain.faces()
        self.scalars, self.spare = ({name: threads.zeros(q.size) for name, q in domain.scalars.items()} for _ in range(2))
        lost = threads.zeros(max(*domain.sizes, domain.layout.cells))
        self.carry = [TransportAdjoint(run, t, a, not domain.reflects, False, lost) for a, t in enumerate(domain.carry)]
        t = domain.carry_scalar
        self.carry_scalar: Any = TransportAdjoint(run, t, -1, True, THIRD[t.scheme], lost) if t else None
        self.reflect, self.mirror = (reflection.reflection_adjoint_kernel(real, module),
                                     reflection.mirror_velocity_kernel(real, module))
        self.last, self.before = reflection.last_step_kernel(real, module), reflection.previous_step_kernel(real, module)

    def frame(self, trace: Trace) -> None:
        """Launches the adjoint of a frame."""
        domain = self.domain
        wp.copy(domain.clock, trace.clock)
        self.launches.over(self.last, 1, [domain.clock], [domain.done, domain.going])
        wp.capture_while(domain.going, lambda: self._step(trace))

    def _step(self, trace: Trace) -> None:
        domain, run = self.domain, self.launches
        run.over(self.before, 1, [], [domain.done, domain.clock, domain.going])
        self._enter(trace)
        if domain.reflects:
            self._step_by_reflection(trace)
        else:
            self._step_by_splitting(trace)
        if self.obstacles:
            self.obstacles.back()
        trace.fetch("u", self.u)
        self._fetch_scalars(trace)
        self.sources.back(self.u, self.scalars, self.by, self.by_scalars)

    def _fetch_scalars(self, trace: Trace) -> None:
        for name, q in self.scalars.items():
            trace.scalar(name, q)

    def _enter(self, trace: Trace) -> None:
        """Velocity and scalars behind the sources of the step."""
        domain, sources = self.domain, self.domain.sources
        trace.fetch("u", self.u)
        self._fetch_scalars(trace)
        if self.obstacles:
            domain.obstacles.update()
            domain.pressure.multigrid.refresh()
            domain.pressure.find_region()
            self.launches.zero(self.projection.by_solid)
        if self.projection.by_expansion is not None:
            self.projection.by_expansion.zero_()
        if sources:
            before, sources.scalars = sources.scalars, self.scalars
            sources.emit(domain.live, domain.clock, self.u)
            sources.scalars = before
        for name, kernel in domain.decay.items():
            q = self.scalars[name]
            self.launches.over(kernel, q.size, [domain.live, domain.clock], [q])

    def _step_by_reflection(self, trace: Trace) -> None:
        run, by, by_v, by_w = self.launches, self.by, self.by_v, self.by_w
        trace.fetch("v", self.v)
        trace.fetch("w", self.w)
        for _, u, v, w in run.each(self.u, self.v, self.w):
            run.over(self.mirror, u.size, [w, v], [v])
            run.over(self.mirror, u.size, [w, u], [u])
        for name, q in self.spare.items():
            trace.scalar(name, q, 1)
        self._pushed_velocity(trace, "y", 0.5, by, self.spare, self.u, self.v)
        run.zero(by_v)
        run.zero(by_w)                                   # of u1 for a while
        self._carried_quantity(self.u, self.v, by, 0.5, by_w, by_v)
        run.copy(by_w, by)
        run.zero(by_w)
        self._carry_scalars(self.w, by_w)
        for _, v, u, w in run.each(by_v, by, by_w):
            run.over(self.reflect, v.size, [], [v, u, w])
        self.projection.project(by_w)
        for _, v, w in run.each(by_v, by_w):
            run.add(w, v)
        self._repeat_sources(trace)
        self._pushed_velocity(trace, "v", 0.5, by_v, self.scalars, self.u, self.u, projected=False)
        self._carried_quantity(self.u, self.u, by_v, 0.5, by, by)

    def _repeat_sources(self, trace: Trace) -> None:
        """u behind the sources."""
        domain = self.domain
        trace.fetch("u", self.u)
        for a, kernel in enumerate(domain.sources.drive if domain.sources else ()):
            out = getattr(self.u, AXES[a])
            self.launches.over(kernel, out.size, [domain.grid, domain.sources.table, domain.clock], [out])

    def _step_by_splitting(self, trace: Trace) -> None:
        run, by, by_v = self.launches, self.by, self.by_v
        trace.fetch("u", self.w, 1)
        self._carry_scalars(self.w, by)
        self._pushed_velocity(trace, "v", 1.0, by, self.scalars, self.u, self.u)
        run.copy(by, by_v)
        run.zero(by)
        self._carried_quantity(self.u, self.u, by_v, 1.0, by, by)

    def _pushed_velocity(self, trace: Trace, name: str, part: float, by: Any, scalars: dict[str, wp.array], u: Any, q: Any,
                         projected: bool = True) -> None:
        """by: cotangent of a projected velocity (else: of the one before), becomes that of q carried along u, before forces."""
        domain = self.domain
        if projected:
            self.projection.project(by)
        if self.viscosity:
            trace.fetch(name, self.ahead)
            self.viscosity.spread(by, self.ahead, part)
        self.projection.sides(by)
        if domain.swirling:
            for a, transport in enumerate(domain.carry):
                transport.carry(u, getattr(q, AXES[a]), domain.clock, part, getattr(self.ahead, AXES[a]))
        if domain.lifts or domain.swirling:
            self.forces.back(by, part, scalars, self.by_scalars, self.ahead)

    def _carried_quantity(self, u: Any, q: Any, by: Any, part: float, u_out: Any, q_out: Any) -> None:
        for a, transport in enumerate(self.carry):
            transport.back(u, getattr(q, AXES[a]), getattr(by, AXES[a]), part, u_out, getattr(q_out, AXES[a]))

    def _carry_scalars(self, u: Any, u_out: Any) -> None:
        """by_scalars of what was carried along u becomes that of what was there."""
        for name, by in self.by_scalars.items():
            out = self.spare[name]
            out.zero_()
            self.carry_scalar.back(u, self.scalars[name], by, 1.0, u_out, out)
            wp.copy(by, out)
