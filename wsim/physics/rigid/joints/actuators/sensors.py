"""Readings of a method's bodies and joints in all worlds, as arrays on the device (kernels/rigid/joint/actuation/sensors.py).

Kernels are compiled when first asked for. What is read is not copied to the host.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.rigid.joint.actuation import sensors
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.actuators.controls import actuated_axis
from wsim.physics.rigid.joints.device_rows import device_rows, drop_cone
from wsim.physics.rigid.joints.joint import AXES


class RigidSensors:
    """Sensors of `wsim.physics.rigid.method.RigidMethod`."""

    def __init__(self, method):
        self.method, self.model, self.worlds = method, method.model, method.model.worlds
        self.module = f"{method.model.module}_sensors"
        self.kernels: dict[str, Any] = {}
        self.known: Any = None                                   # masses of which the arrays of bodies are
        self.coordinates: list[tuple[str, str]] = []             # (joint, axis) of each column
        if method.joints:
            self._find_coordinates()

    def _kernel(self, make) -> Any:
        if make.__name__ not in self.kernels:
            self.kernels[make.__name__] = make(self.model.real, self.module)
        return self.kernels[make.__name__]

    def _zeros(self, n: int, dtype) -> wp.array:
        return wp.zeros(n, dtype=dtype, device=self.model.device)

    def _launch(self, kernel, n: int, *given) -> None:
        wp.launch(kernel, n, [*given], device=self.model.device)

    def _find_coordinates(self) -> None:
        joints = self.method.joints
        place, rows = {k: at for at, k in enumerate(joints.order_of)}, []
        for number, joint in enumerate(joints.given):
            part = device_rows(drop_cone(joint))[0]
            own = place[next(k for k, (of, _, _) in enumerate(joints.every) if of == number)]
            for name in (axis for axis in AXES if not part.locked(axis)):
                self.coordinates.append((joint.path, name))
                rows.append((own, actuated_axis(part, name)))
        per = len(joints.joints)
        every = np.concatenate([np.array(rows).reshape(-1, 2) + (per * w, 0) for w in range(self.worlds)])
        self.rows = wp.array(every.astype(np.int32), dtype=wp.vec2i, device=self.model.device)

    def joints(self, clock: Clock) -> tuple[wp.array, wp.array]:
        """Coordinates and rates of all joints (worlds, coordinates), doubles."""
        method, n = self.method, len(self.rows)
        place, read = self._kernel(sensors.joint_reading_kernels)
        found = [self._zeros(n, wp.float64) for _ in range(2)]
        joints, now = method.joints, method.moving()
        if not joints.known:                                     # anchors of a run that has not begun
            joints.before_frame(0.0, clock)
        k = clock.substeps if joints.linked.t.moving else 0
        self._launch(place, joints.islands, k, method.table, now, joints.linked)
        self._launch(read, n, k, self.rows, now, joints.linked, *found)
        return found[0].reshape((self.worlds, -1)), found[1].reshape((self.worlds, -1))

    def links(self, h: float) -> dict[str, wp.array]:
        """place, rotation, velocity, spin, contact_force of all bodies (worlds, bodies)."""
        method, n, device = self.method, len(self.method.bodies), self.model.device
        if self.known != list(map(id, method.masses)):
            columns = [np.array(values) for values in (method.origin, [m.center for m in method.masses],
                                                       [m.axes for m in method.masses])]
            self.frames = [wp.array(value, dtype=dtype, device=device)
                           for value, dtype in zip(columns, (wp.vec3d, wp.vec3d, wp.quatd), strict=True)]
            self.known = list(map(id, method.masses))
        poses, rates = self._kernel(sensors.link_reading_kernel)
        place, turn, velocity, spin, force = (self._zeros(n, wp.quatd if k == 1 else wp.vec3d) for k in range(5))
        self._launch(poses, n, method.table, method.moving(), *self.frames, place, turn)
        self._launch(rates, n, method.table, method.moving(), self.frames[1], turn, velocity, spin)
        if method.contacts and method.contacts.poses_of:
            self._launch(self._kernel(sensors.contact_force_kernel), n, h, self.worlds, method.contacts.rig(), force)
        found = {"place": place, "rotation": turn, "velocity": velocity, "spin": spin, "contact_force": force}
        return {name: array.reshape((self.worlds, -1)) for name, array in found.items()}

    def unit(self, body: int, at: np.ndarray, turn: np.ndarray, dt: float) -> tuple[wp.array, wp.array]:
        """Specific force and angular velocity (worlds,) of an inertial unit in the frame of a body of the first world."""
        method, mass = self.method, self.method.masses[body]
        Unit, kernel = self._kernel(sensors.inertial_unit_kernel)
        back = rotation.quat_conjugate(mass.axes)
        unit = fill_struct(Unit, first=body, each=len(method.bodies) // self.worlds, dt=dt,
                           at=wp.vec3d(*rotation.quat_rotate(back, at - mass.center).tolist()),
                           turn=wp.quatd(*rotation.quat_product(back, turn).tolist()),
                           gravity=wp.array(method.gravity, dtype=wp.vec3d, device=self.model.device))
        before = fill_struct(method.Moving, **{name: method.part.snapshot_of(name) for name in ("x", "e", "q", "o", "p", "L")})
        found = [self._zeros(self.worlds, wp.vec3d) for _ in range(2)]
        self._launch(kernel, self.worlds, unit, method.table, before, method.moving(), *found)
        return found[0], found[1]
