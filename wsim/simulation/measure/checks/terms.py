"""Terms of the energy balance: kinetic energy, stored energy and work of each kind of object, launched at the end of a frame.

Each leaves `threads` rows for each world (kernels/math/ledger.py). A kind of object that has energy and no term leaves every
frame open, and says so (`unknown`)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math import ledger
from wsim.model import kernel_cache
from wsim.model.stage import Methods
from wsim.model.structs import fill_struct

THREADS, MOST_THREADS, EACH = 128, 8192, 128   # that sum a world on CUDA, at least and at most; points of each: 14 ms of a
#                                                million points by 128 threads, whose rows one warp then adds up


def threads_of_world(points: int, cuda: bool) -> int:
    """Threads that sum the balance of a world with so many points: a power of two, and 1 on a CPU."""
    threads = THREADS if cuda else 1
    while cuda and threads < MOST_THREADS and threads * EACH < points:
        threads *= 2
    return threads


def field_aside(part, name: str) -> wp.array:
    """The field of a part as it was where the frame began."""
    k = part.names.index(name)
    return part.aside[k * part.capacity:(k + 1) * part.capacity]


class EnergyTerms:
    """All terms of a plan, in one array of rows."""

    def __init__(self, model, state, methods: Methods, solver: str, given: list[wp.array]):
        """given: work that is added up on the way."""
        self.model, self.state, self.solver, self.worlds = model, state, solver, model.worlds
        self.threads = threads_of_world(model.points // max(model.worlds, 1), model.device.is_cuda)
        self.each: list[Any] = []
        self.kernels: list = []
        self.sums: list[wp.array] = []
        if model.bodies:
            self.add_point_terms(methods)
        self.rigid = methods.ports.bodies
        if self.rigid:
            self.add_body_terms()
        for array in given:
            self.add_given_work(array)
        self.rows = wp.zeros(max(len(self.each), 1) * self.size, dtype=wp.vec4d, device=model.device)
        self.own = [self.rows[k * self.size:(k + 1) * self.size] for k in range(len(self.each))]
        for kernel in self.kernels:
            model.modules[kernel.module.name] = model.block if model.device.is_cuda else 1

    @property
    def size(self) -> int:
        """Rows of a term."""
        return self.worlds * self.threads

    def add_point_terms(self, methods: Methods) -> None:
        """Points, and what holds them together."""
        from wsim.kernels.math.point_energy import point_balance_kernel
        model = self.model
        self.points = methods.ports.points
        self.counted = None
        if model.alias is not None:
            counted = np.ones(model.points, np.int32)
            counted[model.gone] = 0
            self.counted = wp.array(counted, dtype=int, device=model.device)
        self.balance_points = point_balance_kernel(model.real)
        self.kernels.append(self.balance_points)
        self.each.append(self.sum_points)
        least = 0.0 if self.solver == "xpbd" else 1.0
        for table in self.stored(methods):
            self.add_stored_energy(table, least)
        for make in methods.ports.energy_terms:
            self.each.append(make(self.threads))
            self.kernels.append(ledger.store_energy)

    def stored(self, methods: Methods) -> list:
        """Tables of what stores elastic energy: of XPBD in one world its own, in the order of colours."""
        if self.solver == "xpbd" and self.worlds == 1:
            found = [b for b in methods.ports.xpbd_batches if not b.hard]
        else:
            from wsim.physics.cloth.table import constraint_table
            kinds = sorted({r.kind for r in self.model.constraints if not r.hard})
            found = [constraint_table(self.model, kind) for kind in kinds]
        return found + [t for t in methods.ports.tet_tables if hasattr(t, "maths")]

    def add_stored_energy(self, table, least: float) -> None:
        """Elements of one kind. least: the part of their energy that counts as there."""
        model, sums = self.model, wp.zeros(self.size, dtype=wp.vec3d, device=self.model.device)
        if hasattr(table, "maths"):
            module = kernel_cache.report_module(model, table.maths.__name__, str(table.material))
            kernel = table.maths.statistics(table.material, real=model.real, module=module)

            def measure_stored_energy() -> None:
                s = self.state
                model.launch(kernel, sums.size, [table.data, table.size, self.worlds, s.x, s.e, table.q], [sums])
            self.kernels.append(kernel)
        else:
            table.add_compliances().bend(apart=True)
            if table.curvature:
                table.curvature.room()
            kernels = table.energy_kernels(kernel_cache.report_module(model, f"{table.kind} {table.uniform}"))
            self.kernels += kernels

            def measure_stored_energy() -> None:
                s, data = self.state, table.data
                if table.curvature:
                    rest = table.lengths or data.rest
                    return table.curvature.sum_energy(kernels, data, rest, s.x, s.e, sums, self.worlds)
                return model.launch(kernels[0], sums.size, [data, s.x, table.size, self.worlds, s.e], [sums])
        self.sums.append(sums)
        self.kernels.append(ledger.store_energy)

        def launch_stored_energy(rows: wp.array) -> None:
            measure_stored_energy()
            model.launch(ledger.store_energy, sums.size, [sums, 0, least], [rows])
        self.each.append(launch_stored_energy)

    def motions(self, part, **more) -> Any:
        """Struct of where a part is and was."""
        from wsim.kernels.math.point_energy import point_motion_type
        return fill_struct(point_motion_type(self.model.real)[0], x=part.arrays["x"], e=part.arrays["e"],
                           x0=field_aside(part, "x"), e0=field_aside(part, "e"), **more)

    def add_given_work(self, given: wp.array) -> None:
        """Work that is added up on the way, equal shares of all worlds."""
        from wsim.kernels.math.point_energy import take_work
        self.kernels.append(take_work)
        self.each.append(lambda rows: self.model.launch(take_work, rows.size, [given, self.worlds], [rows]))

    def sum_points(self, rows: wp.array) -> None:
        s, part = self.state, self.state.points
        at = self.motions(part, v=s.v)
        inputs = [self.points.constants, self.counted, self.worlds, at]
        self.model.launch(self.balance_points, rows.size, inputs, [rows])

    def add_body_terms(self) -> None:
        from wsim.kernels.rigid.checks import body_balance_kernel
        self.balance_bodies = body_balance_kernel(self.model.real)
        self.kernels.append(self.balance_bodies)
        self.each.append(self.sum_bodies)
        if self.rigid.contacts:
            from wsim.kernels.rigid.checks import contact_energy_kernel
            self.balance_contacts = contact_energy_kernel(self.model.real)
            self.kernels.append(self.balance_contacts)
            self.each.append(self.sum_contacts)
        joints: Any = self.rigid.joints
        if joints and (joints.actuators or any(j.drives for j in joints.joints)):
            from wsim.kernels.rigid.checks import balance_drives, joint_place_kernel
            self.balance_drives, self.place_joints = balance_drives, joint_place_kernel(self.model.real)
            self.kernels += [balance_drives, self.place_joints]
            self.each.append(self.sum_drives)

    def sum_bodies(self, rows: wp.array) -> None:
        rigid = self.rigid
        part = rigid.part
        given = rigid.contacts.work.given if rigid.contacts else None
        inputs = [rigid.table, rigid.moving(), part.arrays.get("ph"), part.arrays.get("Lh"), self.worlds,
                  self.motions(part, given=given)]
        self.model.launch(self.balance_bodies, rows.size, inputs, [rows])

    def sum_contacts(self, rows: wp.array) -> None:
        self.model.launch(self.balance_contacts, rows.size, [self.rigid.contacts.rig(), self.h, self.worlds], [rows])

    def sum_drives(self, rows: wp.array) -> None:
        joints: Any = self.rigid.joints
        if self.begins:                                       # a run has no coordinates yet, or they are of another place
            self.model.launch(self.place_joints, joints.islands, [self.rigid.table, self.rigid.moving(), joints.linked], [])
        self.model.launch(self.balance_drives, rows.size, [joints.linked, self.worlds, int(self.begins)], [rows])

    def launch(self, h: float, begins: bool = False) -> None:
        """Launches all of them. h: of the last substep [s]; begins: where a frame begins."""
        self.h, self.begins = h, begins
        for each, rows in zip(self.each, self.own, strict=True):
            each(rows)
