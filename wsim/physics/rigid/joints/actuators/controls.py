"""Actuators on the device: their table, and controls that follow curves or are written live.

Actuators of all worlds stand world behind world. `control` is read by the kernels in place, so a policy may write it on the
device, between frames, without a copy to the host.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.joint.actuation.actuators import actuator_struct
from wsim.kernels.rigid.joint.tables import FORCE, NONE
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.device_rows import device_rows, drop_cone
from wsim.physics.rigid.joints.joint import AXES, Joint

ROWS = 6                     # of a joint


def actuated_axis(joint: Joint, name: str) -> int:
    """Row of a coordinate on the device, which names the twist anew where one other axis turns (device_rows.py)."""
    free = [k for k, axis in enumerate(AXES[3:]) if not joint.locked(axis)]
    turn = free[0] if len(free) == 1 else 0
    k = AXES.index(name)
    return 3 * (k // 3) + (k % 3 - turn) % 3


class DeviceActuators:
    """The actuators of joints (`wsim.physics.rigid.joints.tables.DeviceJoints`)."""

    def __init__(self, joints, scene):
        self.joints, self.worlds = joints, joints.model.worlds
        enabled = {joint.path for joint in joints.given}
        self.each = [a for a in scene.things("Actuator") if a.joint in enabled]
        self.rows = np.array([self._row_of(a) for a in self.each], int).reshape(-1, 2)        # (joint, row) in the first world
        paths = {a.path for a in self.each}
        self.curves = {thing.path: thing.curve for thing in scene.varying if thing.name == "control" and thing.path in paths}
        self.names = {(path, "control") for path in self.curves}
        self.table: Any = None
        self._make_table()

    def _row_of(self, actuator) -> tuple[int, int]:
        at = {k: place for place, k in enumerate(self.joints.order_of)}
        number = next(k for k, joint in enumerate(self.joints.given) if joint.path == actuator.joint)
        parts = device_rows(drop_cone(self.joints.given[number]))
        name = actuator.axis or next(name for name in AXES if not parts[0].locked(name))
        return at[[k for k, (of, _, _) in enumerate(self.joints.every) if of == number][0]], actuated_axis(parts[0], name)

    def _make_table(self) -> None:
        n, per, worlds = len(self.each), len(self.joints.joints), self.worlds
        up = self.joints._to_device
        number = self.rows[:, 0] * ROWS + self.rows[:, 1]
        order = np.argsort(number, kind="stable")
        starts = np.searchsorted(number[order], np.arange(ROWS * per + 1))
        first = np.stack([np.concatenate([starts[ROWS * j:ROWS * (j + 1) + 1] + n * w for j in range(per)]).reshape(per, -1)
                          for w in range(worlds)]).reshape(-1, ROWS + 1)
        entry = np.concatenate([order + n * w for w in range(worlds)])

        def of_worlds(name: str, dtype=wp.float64):
            return up(np.concatenate([np.array([getattr(a, name) for a in self.each])] * worlds), dtype)
        columns = {path: k for k, path in enumerate(self.curves)}
        self.course = np.tile([columns.get(a.path, -1) for a in self.each], worlds)
        self.table = fill_struct(
            actuator_struct(), first=wp.array(first.astype(np.int32), dtype=int, device=self.joints.device),
            entry=up(entry, int), gear=of_worlds("gear"), gain=of_worlds("gain"),
            bias=of_worlds("bias", wp.vec3d),
            control_range=of_worlds("control_range", wp.vec2d), force_range=of_worlds("force_range", wp.vec2d),
            control=wp.array(np.tile([a.control for a in self.each], worlds), dtype=wp.float64, device=self.joints.device),
            course=up(self.course, int),
            courses=wp.zeros((2, max(1, len(columns))), dtype=wp.float64, device=self.joints.device))

    def enter(self, linked) -> None:
        """Takes its place in the struct of joints: rows that it acts on are driven."""
        t = linked.t
        drive = np.array(t.drive.numpy())
        per = len(self.joints.joints)
        for w in range(self.worlds):
            rows = (self.rows[:, 0] + w * per, self.rows[:, 1])
            drive[rows] = np.where(drive[rows] == int(NONE), int(FORCE), drive[rows])
        t.drive.assign(drive)
        t.actuated, t.actuators = 1, self.table
        linked.t = t

    @property
    def stirred(self) -> np.ndarray:
        """Joints of all worlds that never sleep."""
        found = np.zeros(self.joints.count, bool)
        found[(self.rows[:, 0] + len(self.joints.joints) * np.arange(self.worlds)[:, None]).ravel()] = True
        return found

    def before_frame(self, time: float, clock: Clock) -> None:
        """Uploads the curves of a frame."""
        if not self.curves:
            return
        times = time + clock.h * np.arange(clock.substeps + 1)
        values = np.stack([curve.sampled(times).reshape(-1) for curve in self.curves.values()], axis=1)
        linked = self.joints.linked
        if self.table.courses.shape != values.shape:
            t = linked.t
            self.table.courses = wp.zeros(values.shape, dtype=wp.float64, device=self.joints.device)
            t.actuators = self.table
            linked.t = t
        self.table.courses.assign(values)

    def set_value(self, path: str, name: str, value, world: int | None) -> bool:
        """The control of an actuator, which leaves its curve."""
        n = len(self.each)
        rows = [k + w * n for k, a in enumerate(self.each) if a.path == path for w in range(self.worlds) if world in (None, w)]
        if name != "control" or not rows:
            return False
        values = self.table.control.numpy()
        values[rows] = value
        self.table.control.assign(values)
        if (self.course[rows] >= 0).any():
            self.course[rows] = -1
            self.table.course.assign(self.course.astype(np.int32))
        return True
