"""Grains that turn: what the contacts of grains and of colliders do then. Equations: kernels/position_based/rolling/law.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.contact.project import read_type
from wsim.kernels.math.real import types
from wsim.kernels.position_based.rolling import law, walls
from wsim.kernels.position_based.rolling import pairs as kernels
from wsim.model.stage import Clock, Methods, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct
from wsim.physics.position_based.neighbours import ParticleLaunches

if TYPE_CHECKING:
    from wsim.physics.position_based.grains import GrainContacts
    from wsim.simulation.methods import Build

FIELDS = (StateField("spin", "rad/s", True, "angular velocity"),)


class RollingContacts:
    """`table`: turns of all points of the state. `pairs`: those of grains, and torques between them."""

    torque = StateField("torque", "N", True, "torque of a contact on the grain over the radius of rolling")

    def __init__(self, grains: GrainContacts, b: Build):
        model, real, n = b.model, b.model.real, b.model.points
        self.grains, self.model = grains, model
        launches = self.launches = ParticleLaunches(model, "rolling")
        t, own = types(real), np.tile([0.0, -1.0, 0.0], (n, 1))
        self.turning = [body for body in grains.bodies if body.source.rolling_friction is not None]
        for body in self.turning:
            own[body.first:body.last] = law.SPHERE, body.source.rolling_friction, 0.0
            own[body.first:body.last, 2] = body.reach
        self.part = StatePart.allocate("grain spin", FIELDS, n, real, model.device)
        self.part.rows = {(body.path, body.world): body.index for body in self.turning}
        b.state.add(self.part)
        zeros = launches.zeros
        self.table = fill_struct(law.roll_type(real), own=model.upload(own.astype(model.dtype), t.vec3),
                                 spin=self.part.arrays["spin"], phi=zeros(n, t.vec3), q=zeros(1, t.vec3), wall=zeros(1, t.vec3),
                                 swing=zeros(1, t.vec3))
        self.pairs: Any = fill_struct(kernels.rolling_type(real), phi=zeros(grains.count, t.vec3),
                                      own=zeros(grains.count, t.vec3))
        makers = {"motion": kernels.roll_motion_kernel, "solve": kernels.roll_solve_kernel, "warm": kernels.roll_warm_kernel,
                  "torque": kernels.roll_force_kernel, "begin": law.roll_begin_kernel, "end": law.roll_end_kernel,
                  "energy": law.spin_energy_kernel}
        self.kernels: dict[str, Any] = {name: make(real, launches.module) for name, make in makers.items()}
        self.contacts = self.movers = self.surfaces = None       # type: Any      # movers: bodies that grains push
        self.room_for = 0                # contacts with colliders
        grains.offers.energy_terms = [self.make_energy_term]
        grains.stages.append(Stage("rolling", "predict", self.begin, 1, 24 * n, what="grains that turn"))

    def make_room(self, room: int, torque: Any) -> None:
        """Torques of so many contacts of each grain. torque: those that last."""
        n = room * self.grains.count
        self.pairs.q, self.pairs.torque = self.launches.zeros(n, types(self.model.real).vec3), torque
        self.pairs.arm = self.launches.zeros(n)

    def connect_ports(self, others: Methods) -> None:
        """Contacts with colliders turn grains, too, and those with surfaces and strands."""
        surfaces = others.ports.self_contact
        if surfaces is not None and any(body in surfaces.surfaces.bodies for body in self.turning):
            from wsim.physics.position_based.rolling_surfaces import RollingSurfaces
            self.surfaces = RollingSurfaces(self, surfaces)
        if (contact := others.ports.contact) is None:
            return
        real, module = self.model.real, self.model.shared_module("rolling_walls")
        self.contacts, self.movers = contact.contacts, contact.movers
        self.contacts.project_kernel, self.contacts.spins = walls.rolling_projection_kernel(real, module), (self.table,)
        self.kernels["walls"] = walls.roll_wall_kernel(real, module)
        contact.stages.append(Stage("rolling contacts", "collide", self.find, 1, self.model.points * 12, what="turning walls"))

    def make_energy_term(self, threads: int) -> Any:
        """Function (rows) that launches the energy of spins, for the balance, of so many threads a world."""
        def sum_spin_energy(rows: Any) -> None:
            inputs = [self.table, self.grains.points.constants.w, self.model.worlds]
            self.launches.launch(self.kernels["energy"], self.model.worlds * threads, inputs, [rows])
        return sum_spin_energy

    # stages

    def begin(self, clock: Clock) -> None:
        """Turns by what grains have."""
        self.launches.launch(self.kernels["begin"], self.model.points, [self.table, clock.h], [])

    def find(self, clock: Clock) -> None:
        """Turns of colliders, behind the search for contacts."""
        at = fill_struct(read_type(self.model.real), **({"now": clock.loop.number} if clock.loop else {"k": clock.k}))
        self.model.launch(self.kernels["walls"], self.model.points, [self.contacts.table, self.contacts.slots, at, self.table],
                          [])

    def start(self, clock: Clock) -> None:
        """Torques of the substep before."""
        own = self.grains
        self._run("warm", [own.search.rows, own.search.cells, own.table, own.touched, own.forces, self.pairs, self.table,
                           clock.h], [])

    def solve(self, clock: Clock) -> None:
        """One iteration of all contacts of grains."""
        own, d = self.grains, self.grains.state.d
        rows, cells = own.search.rows, own.search.cells
        self._run("motion", [rows, cells, own.table, self.pairs, self.table, d, own.points.anchor], [])
        self._run("solve", [rows, cells, own.table, own.touched, self.pairs, self.table], [d])

    def keep(self, clock: Clock) -> None:
        """Angular velocities, and torques for the next substep."""
        own = self.grains
        self.launches.launch(self.kernels["end"], self.model.points, [self.table, clock.h], [])
        self._run("torque", [own.search.cells, own.touched, self.pairs, clock.h], [])

    def _run(self, name: str, inputs: list, outputs: list) -> None:
        self.launches.launch(self.kernels[name], self.grains.count, inputs, outputs)

    def before_frame(self) -> None:
        """Torques of as many contacts with colliders as there is room for."""
        if self.contacts and self.room_for < (room := self.contacts.slots.points * self.contacts.slots.capacity):
            self.room_for = room
            for name in ("q", "wall", "swing"):
                setattr(self.table, name, self.launches.zeros(room, types(self.model.real).vec3))
            if self.movers:
                self.movers.roll = self.table
                self.movers.room()
