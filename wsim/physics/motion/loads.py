"""Loads: forces on points and tractions on triangles over time, put beside gravity where a substep begins. See
kernels/motion/load.py.

A table holds the values of a frame at the times when forces are evaluated (`Clock.acting`), as that of
`wsim.physics.cloth.nets.muscles` does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import load as kernels
from wsim.model.model import Model, PointBody
from wsim.model.stage import Clock, Method, Methods, Ports, Stage
from wsim.model.vjp import beside
from wsim.scene import Load, Problem, SceneError
from wsim.scene.nodal.loads import given_curve, nodal_load_shares

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


class BorneLoad:
    """A load of one world: its curve, its column of the table, and who bears it."""

    def __init__(self, load: Load, body: PointBody, model: Model):
        self.load, self.body, self.curve = load, body, load.curve
        places, self.parts = nodal_load_shares(load, body)
        self.places = model.shared(places)


def build(b: Build) -> Loads:
    return Loads(b.model, b.clock, b.ports.points)


class Loads(Method):
    """Gravity of the points that bear a load. `act` puts that of a row of the table."""

    def __init__(self, model: Model, clock: Clock, points):
        """points: the method that owns gravity and inverse masses."""
        super().__init__("loads")
        self.blocks: Any = None          # `wsim.physics.motion.fused.domain_decomposition.ClusterSheets` that take loads along
        self.model, self.clock, self.points, self.changed, self.time = model, clock, points, True, -clock.dt
        self.borne = [BorneLoad(load, b, model) for load in model.scene.loads for b in model.bodies if b.path == load.body]
        real, t, module = model.real, types(model.real), model.module
        self.gravity = points.constants.gravity
        self.tables(t)
        self.bear = kernels.load_bearing_kernel(real, module)
        self.adjoint = beside(model, "wsim.physics.motion.points", "LoadsAdjoint", self)
        self.offers = Ports(loads=self)
        self.make(clock)
        if not points.integrator.explicit:               # which asks for rows by itself
            self.stage()

    def connect_ports(self, others: Methods) -> None:
        if "loads" in (others.ports.fused_effects or ()):
            self.blocks = others.ports.force_gather.domains
            self.blocks.bear(self)
        if self.points.integrator.explicit:              # which asks for rows by itself
            others.ports.before_forces.append(self.act)

    def tables(self, t) -> None:
        """Entries by point and by load."""
        model, c = self.model, kernels.load_entries(self.model.real)()
        owner = np.concatenate([b.places for b in self.borne])
        order = np.argsort(owner, kind="stable")
        load = np.repeat(np.arange(len(self.borne)), [len(b.places) for b in self.borne])[order]
        share, owner = np.concatenate([b.parts for b in self.borne])[order], owner[order]
        self.point, first = np.unique(owner, return_index=True)
        by_load = np.argsort(load, kind="stable")
        for name, values in (("point", self.point), ("first", [*first, len(owner)]), ("load", load), ("item", by_load),
                             ("begin", np.searchsorted(load[by_load], np.arange(len(self.borne) + 1))), ("owner", owner)):
            setattr(c, name, model.upload(np.asarray(values, np.int32), int))
        c.share, c.w = model.upload(share, t.scalar), self.points.constants.w
        self.entries = c
        self.own = model.upload(self.gravity.numpy()[self.point], t.vec3)      # gravity alone, of those points

    def make(self, clock: Clock) -> None:
        self.value = wp.zeros((len(clock.acting()), len(self.borne)), dtype=types(self.model.real).vec3,
                              device=self.model.device, requires_grad=self.model.gradients)
        if self.blocks:
            self.blocks.bear(self)

    def stage(self) -> None:
        """Stage for solvers whose forces of a substep are at one time."""
        def act_at_substep(clock: Clock) -> None:
            self.act(clock.k)
        size = len(self.point) * 40 + self.entries.load.size * 16
        self.stages.append(Stage("loads", "pose", act_at_substep, 1, size, what=f"{len(self.point)} points"))

    def act(self, row: int) -> None:
        """Accelerations of a row, see `Clock.acting`."""
        if self.model.tape:
            self.model.tape.put(self.name, lambda: self.put(row), lambda: self.adjoint.take(row))
        else:
            self.put(row)

    def put(self, row: int) -> None:
        self.launch(self.bear, len(self.point), [self.entries, self.own, self.value, row], [self.gravity])

    def launch(self, kernel, dim: int, inputs: list, outputs: list) -> None:
        """Launches a kernel, not by the model, whose tape would give gravity, which stands in structs, another version."""
        how: dict = {"block_dim": self.model.block} if self.model.device.is_cuda else {}
        wp.launch(kernel, dim, inputs, outputs, device=self.model.device, **how)

    # around a frame

    def before_frame(self, time: float, clock: Clock) -> None:
        self.time = time
        if self.value.shape[0] != len(clock.acting()):
            self.make(clock)
            self.changed = True
        if not (self.changed or any(b.curve.moves for b in self.borne)):
            return
        self.changed = False
        table = np.stack([b.curve.table(self.times) for b in self.borne], axis=1)
        self.value.assign(table.astype(self.model.dtype))

    @property
    def times(self) -> np.ndarray:
        """[s] of the rows."""
        return self.time + self.clock.acting()

    def by_keys(self) -> list[np.ndarray]:
        """Derivatives by the curves' values, (keys, 3) of each load and world, from those by the values of this frame, which
        are zeros then."""
        by = self.value.grad.numpy().astype(np.float64)
        self.value.grad.zero_()
        return [b.curve.pulled(self.times, by[:, k])["values"] for k, b in enumerate(self.borne)]

    def find(self, path: str | None, world: int = 0) -> int:
        """Number of a load; None: the only one. Raises SceneError."""
        found = [k for k, b in enumerate(self.borne) if path in (None, b.load.path) and b.body.world == world]
        if len(found) == 1:
            return found[0]
        have = ", ".join(dict.fromkeys(b.load.path for b in self.borne))
        raise SceneError(Problem(path or "loads", f"is no load of world {world}; there are {have}"))

    # forces as they are

    def forces(self, time: float) -> np.ndarray:
        """F of every point at a time [N], (points, 3): what pinned ones hand to their pins."""
        found = np.zeros((self.model.points, 3))
        for b in self.borne:
            np.add.at(found, b.places, b.parts[:, None] * b.curve.at(time))
        return found

    def transposed(self, p: np.ndarray, time: float) -> list[np.ndarray]:
        """Derivative of p . `forces` by the keys of each load, (keys, 3)."""
        return [b.curve.pulled(time, (b.parts[:, None] * p[b.places]).sum(axis=0)[None])["values"] for b in self.borne]

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """force [N] or traction [Pa] of a load: a `Curve`, values of the present keys (keys, 3), or one for all times (3,); and
        gravity of what bears any, which `wsim.physics.motion.points` sets with it."""
        if name == "gravity":
            own, rows = self.own.numpy(), np.isin(self.point, self.model.rows(path, world))
            own[rows] = value
            self.own.assign(own)
            return False
        hit = [b for b in self.borne if b.load.path == path and b.load.name == name and world in (None, b.body.world)]
        for b, curve in [(b, given_curve(b.load, b.curve, value)) for b in hit]:
            b.curve = curve
        self.changed |= bool(hit)
        return bool(hit)
