"""Muscles of spring nets: factors of rest lengths over time, put where forces are evaluated. See kernels/cloth/muscle.py.

A table holds the factors of a frame at the times when forces are evaluated (`Clock.acting`): leapfrog's kicks have those of the
beginning of a substep, stages of a Runge-Kutta step theirs, implicit steps and sweeps those of the time that they solve for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from wsim.kernels.cloth import muscle as kernels
from wsim.model.model import Model, PointBody
from wsim.model.stage import Clock, Method, Methods, Ports, Stage
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import SPRINGS
from wsim.physics.cloth.nets.objects import Springs
from wsim.scene import Problem, SceneError
from wsim.scene.curve import Curve

if TYPE_CHECKING:
    from wsim.simulation.methods import Build



class _Muscle:
    """The muscles of one net of one world: their curve, and columns of the table."""

    def __init__(self, body: PointBody, first: int):
        self.body, self.source, self.curve = body, cast(Springs, body.source), cast(Curve, body.source.actuation)
        self.columns = slice(first, first + self.curve.values.shape[1])

    def edges(self, last: int) -> np.ndarray:
        """Column of each spring, `last` of passive ones, (m,)."""
        own = np.zeros(len(self.source.edges), np.int64) if self.source.muscles is None else self.source.muscles
        return np.where(own < 0, last, self.columns.start + own)

    def taken(self, value) -> Curve:
        """A given value as a curve: another one, values of the present keys (keys, groups), or those of all times (groups,)."""
        groups, path = self.curve.values.shape[1], self.body.path
        try:
            values = np.asarray(value.values if isinstance(value, Curve) else value, np.float64)
            if isinstance(value, Curve):
                new = value.flat()
            elif values.ndim < 2:
                new = Curve(np.zeros(1), np.broadcast_to(values, (1, groups)))
            else:
                new = self.curve.replaced(values.reshape(len(values), -1))
            least, most = new.bounds()
        except ValueError as error:
            raise SceneError(Problem(path, f"actuation: {error}; allowed are a Curve, values (keys, groups) or "
                                     "(groups,)")) from None
        if new.values.shape[1] != groups or not (np.isfinite([least, most]).all() and np.min(least) > 0.0):
            raise SceneError(Problem(path, f"actuation has {new.values.shape[1]} groups and values from "
                                     f"{np.min(least):g} to {np.max(most):g}; allowed are {groups} groups and finite "
                                     "factors > 0"))
        return new


class _Site:
    """A table of springs on the device. length: what kernels read; rest: without muscles; column: of each entry."""

    def __init__(self, model: Model, length: wp.array, column: np.ndarray, groups: int):
        self.length, self.rest, self.size = length, wp.clone(length), max(length.size, groups)
        self.column = model.upload(column.astype(np.int32), int)
        self.adjoint = beside(model, __name__, "SiteAdjoint", self, model, column, groups)


def build(b: Build) -> Muscles:
    return Muscles(b.model, b.clock)


class Muscles(Method):
    """Rest lengths of the springs of every table that `join` is given. `act` puts those of a row of the factors."""

    def __init__(self, model: Model, clock: Clock):
        super().__init__("muscles")
        self.model, self.clock, self.muscles, last = model, clock, [], 0
        for b in model.bodies:
            if b.source.actuation is not None:
                self.muscles.append(_Muscle(b, last))
                last = self.muscles[-1].columns.stop
        self.groups, self.sites, self.changed, self.time = last, [], True, -clock.dt
        self.watch: Any = None               # how long edges may become
        self.offers = Ports(muscles=self)
        self.contract = kernels.muscle_contraction_kernel(model.real, model.module)
        self.make(clock)

    def make(self, clock: Clock) -> None:
        self.factor = wp.ones((len(clock.acting()), self.groups + 1), dtype=self.model.real, device=self.model.device,
                              requires_grad=self.model.gradients)

    def join(self, rows: list[Constraints], length: wp.array, entry: np.ndarray) -> wp.array:
        """Takes a table of springs: `length` holds their rest lengths, of number `entry` in the rows, -1: padding. Returns
        where the lengths without muscles are."""
        self.sites.append(self.site(rows, length, entry))
        return self.sites[-1].rest

    def site(self, rows: list[Constraints], length: wp.array, entry: np.ndarray) -> _Site:
        """Site of such a table; one that `join` has taken is found again."""
        known = next((s for s in self.sites if s.length.ptr == length.ptr), None)
        return known or _Site(self.model, length, np.where(entry < 0, self.groups, self.columns(rows)[entry]), self.groups)

    def connect_ports(self, others: Methods) -> None:
        """Takes the springs of the method that solves for them, and who watches edges
        (`wsim.physics.motion.divergence_monitor`)."""
        self.watch = others.ports.stretch_watch
        if self.watch:
            self.watch.follow(self.longest)
        tables = others.ports.spring_tables()
        for table in tables:
            table.given(self.join(table.rows, table.length, table.entry))
        forces = others.ports.before_forces
        if forces is None:
            self.stage(len(tables[-1].entry))
        else:                                            # an explicit integrator asks for rows by itself
            forces.append(self.act)

    def columns(self, rows: list[Constraints]) -> np.ndarray:
        """Column of each spring of the rows."""
        own = {m.body.number: m.edges(self.groups) for m in self.muscles}
        return np.concatenate([own.get(r.body.number, np.full(len(r.ids), self.groups)) if r.body else
                               np.full(len(r.ids), self.groups) for r in rows])

    def stage(self, springs: int) -> None:
        """Stage for solvers whose forces of a substep are at one time."""
        size = np.dtype(self.model.dtype).itemsize

        def act_muscles(clock: Clock) -> None:
            self.act(clock.k)
        self.stages.append(Stage("muscles", "pose", act_muscles, len(self.sites), springs * (4 + 2 * size),
                                 what=f"{self.groups} groups"))

    def act(self, row: int) -> None:
        """Rest lengths of a row, see `Clock.acting`."""
        if self.model.tape:
            self.model.tape.put(self.name, lambda: self.put(row), lambda: self.take(row))
        else:
            self.put(row)

    def put(self, row: int) -> None:
        for s in self.sites:
            self.shorten(s, self.factor, row)

    def take(self, row: int) -> None:
        """Takes the derivatives with respect to the lengths that `put` has left."""
        for s in self.sites:
            s.adjoint.hand(self.launch, self.factor, row)

    def shorten(self, s: _Site, factor: wp.array, row: int) -> None:
        """A table of springs gets the lengths of a row of factors."""
        self.launch(self.contract, s.length.size, [s.column, s.rest, factor, row], [s.length])

    def launch(self, kernel, dim: int, inputs: list, outputs: list) -> None:
        """Launches a kernel, not by the model, whose tape would give lengths in structs another version."""
        how: dict = {"block_dim": self.model.block} if self.model.device.is_cuda else {}
        wp.launch(kernel, dim, inputs, outputs, device=self.model.device, **how)

    # around a frame

    def before_frame(self, time: float, clock: Clock) -> None:
        moves = any(m.curve.moves for m in self.muscles)
        self.time = time
        if self.factor.shape[0] != len(clock.acting()):
            self.make(clock)
            self.changed = True
        if not (moves or self.changed):
            return
        self.changed, table = False, np.ones(self.factor.shape)
        for m in self.muscles:
            table[:, m.columns] = m.curve.table(self.times)
        self.factor.assign(table.astype(self.model.dtype))

    @property
    def times(self) -> np.ndarray:
        """[s] of the rows."""
        return self.time + self.clock.acting()

    def by_keys(self) -> list[np.ndarray]:
        """Derivatives by the curves' values, (keys, groups) of each net, from those by the factors of this frame, which are
        zeros then."""
        return self.keyed(self.factor, self.times)

    def keyed(self, factor: wp.array, times) -> list[np.ndarray]:
        """Gradient as `by_keys` has it, of a table whose rows are at these times [s]."""
        by = factor.grad.numpy().astype(np.float64)
        factor.grad.zero_()
        return [m.curve.pulled(times, by[:, m.columns])["values"] for m in self.muscles]

    def find(self, path: str, world: int = 0) -> int:
        """Number of the muscles of a net. Raises SceneError."""
        for number, m in enumerate(self.muscles):
            if (m.body.path, m.body.world) == (path, world):
                return number
        have = ", ".join(dict.fromkeys(m.body.path for m in self.muscles))
        raise SceneError(Problem(path, f"has no muscles in world {world}; there are {have}"))

    def present(self, rows: list[Constraints], time: float | None = None) -> list[Constraints]:
        """The rows with their rest lengths at a time [s]; None: at the end of the last frame."""
        factor = self.muscle_factors(time)
        return [r if r.row.gather != SPRINGS else replace(r, rest=r.rest * factor[self.columns([r])]) for r in rows]

    def muscle_factors(self, time: float | None = None) -> np.ndarray:
        """Factors of each column, as `present`."""
        found = np.ones(self.groups + 1)
        for m in self.muscles:
            found[m.columns] = m.curve.at(self.time + self.clock.dt if time is None else time)
        return found

    def finish(self) -> None:
        """Puts the lengths at the end of the last frame; its last stage may have had others."""
        for s in self.sites:
            s.length.assign(s.rest.numpy() * self.muscle_factors()[s.column.numpy()].astype(self.model.dtype))

    def longest(self, body: PointBody) -> np.ndarray | float:
        """Largest factor, but at least 1, that each edge of a body ever has, (m,)."""
        for m in self.muscles:
            if m.body is body:
                return np.maximum(1.0, np.append(m.curve.bounds()[1], 1.0)[m.edges(m.columns.stop) - m.columns.start])
        return 1.0

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """actuation: a `Curve`, values of the present keys (keys, groups), or those of all times (groups,)."""
        hit = [m for m in self.muscles if m.body.path == path and world in (None, m.body.world)]
        if name != "actuation" or not hit:
            return False
        for m in hit:
            m.curve = m.taken(value)
        self.changed = True
        if self.watch:
            self.watch.follow(self.longest)
        return True
