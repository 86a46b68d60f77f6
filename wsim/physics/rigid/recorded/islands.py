"""Bodies of a recording that joints and contacts move: each substep is launched in parts, between which its state is kept on
the host, and its adjoint (wsim/physics/rigid/recorded/substep.py) runs there, in float64.

Kept are some 60 numbers a body, 60 a joint and 40 a point of contact for each substep. Frames of such a recording are not
replayed as graphs. `left` is the largest residual of what was differentiated: gradients are as right as it is small.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from wsim.geometry.rotation import quat_conjugate, quat_product, unit_quat
from wsim.model.stage import Clock
from wsim.physics.rigid.joints.joint import LIVE
from wsim.physics.rigid.meetings import read_surface_value, shape_rows_of_path
from wsim.physics.rigid.objects import SURFACE
from wsim.physics.rigid.recorded.aside import record_host_step
from wsim.physics.rigid.recorded.bodies import TABLES, BodyGradient, BodyLosses, RecordedBodies
from wsim.physics.rigid.recorded.substep import BodyCotangents, RecordedBodyValues


def small_turn_cotangent(q: np.ndarray, by_q: np.ndarray) -> np.ndarray:
    """Cotangent (n, 3) of a small turn before q, of that of q (n, 4)."""
    return 0.5 * quat_product(by_q, quat_conjugate(q))[:, :3]


def quaternion_cotangent(q: np.ndarray, tau: np.ndarray) -> np.ndarray:
    return 2.0 * quat_product(np.concatenate([tau, np.zeros((len(tau), 1))], axis=1), q)


class BodyStateCopy:
    """The state of all bodies: pose q (n, 4), x (n, 3), momentum (n, 6)."""

    def __init__(self, arrays: list, n: int):
        every, q, o = (a.numpy().astype(np.float64) for a in arrays)
        x, e, p, L = every.reshape(4, n, 3)
        self.x, self.q, self.momentum = x + e, q + o, np.concatenate([p, L], axis=1)


class RecordedIslands(RecordedBodies):
    """The recording of bodies in islands, as `RecordedBodies`; parts: what joints and contacts do
    (`wsim.physics.rigid.recorded.joints.RecordedJoints` and others)."""

    whole = True

    def __init__(self, method):
        super().__init__(method)
        self.parts: Any = None
        if method.contacts:
            from wsim.physics.rigid.recorded.contacts import RecordedContacts
            self.parts = RecordedContacts(self)
        else:
            from wsim.physics.rigid.recorded.joints import RecordedJoints
            self.parts = RecordedJoints(self)
        self.left = 0.0
        self.begin()

    def begin(self) -> None:
        """Begins a backward pass."""
        self.total, self.left = BodyCotangents(np.zeros(0), np.zeros(0)), 0.0

    def step(self, clock: Clock) -> None:
        tape, now, kept = self.model.tape, replace(clock), {}
        if tape is None:
            self.parts.step(now, None)
            return

        def step_forward_recorded() -> None:
            self.model.tape, before = None, self.model.tape
            kept.clear()
            kept["begin"] = self.state()
            self.parts.step(now, kept)
            kept["end"] = self.state()
            self.model.tape = before
        record_host_step(tape, self.arrays, step_forward_recorded, lambda grads: self.back(now.h, kept, grads), kept)

    def state(self) -> BodyStateCopy:
        return BodyStateCopy(self.arrays, self.method.part.count)

    def bodies(self, begin: BodyStateCopy, end: BodyStateCopy, placing: np.ndarray, placed: np.ndarray) -> RecordedBodyValues:
        t = {name: getattr(self.method.table, name).numpy().astype(np.float64) for name in TABLES}
        return RecordedBodyValues(begin.q, end.q, begin.momentum, placing, t["w"], t["inverse"], t["push"], t["torque"],
                                  t["drag"], t["spin_drag"], placed)

    def back(self, h: float, kept: dict, grads: list[np.ndarray]) -> list[np.ndarray]:
        """Gradients of x, e, p, L; q; o where a substep begins, of those behind it."""
        n, begin, end = self.method.part.count, kept["begin"], kept["end"]
        every, q, o = (g.astype(np.float64) for g in grads)
        x, e, p, L = every.reshape(4, n, 3)
        cot = BodyCotangents(np.concatenate([x, small_turn_cotangent(unit_quat(end.q), q)], axis=1),
                             np.concatenate([p, L], axis=1))
        self.parts.back(h, kept, cot)
        for name, more in cot.bodies.items():
            self.total.add(name, more)
        for (kind, name), more in cot.by.items():
            self.total.add_by(kind, name, more)
        x, tau = cot.pose[:, :3], cot.pose[:, 3:]
        by = np.concatenate([x, x, cot.momentum[:, :3], cot.momentum[:, 3:]])
        return [by, quaternion_cotangent(unit_quat(begin.q), tau), np.zeros((n, 4))]

    def places(self, path: str, name: str, world: int) -> tuple[str, Any] | None:
        """(table, rows) of a value of a joint's drives, or of the surfaces of a body or a collider; None: it is none."""
        joints, contacts = self.method.joints, self.method.contacts
        drives = joints.drives(path, world) if joints and name in LIVE else []
        if drives:
            return f"joint {name}", tuple(np.array(drives[0]).T)
        rows = shape_rows_of_path(contacts, path, name, world) if contacts else []
        return (name, np.array(rows)) if rows else None

    def now(self, path: str, name: str, world: int, begun: list) -> np.ndarray | float:
        if (at := self.places(path, name, world)) is None:
            return super().now(path, name, world, begun)
        table, rows = at
        if table in SURFACE:
            return float(read_surface_value(self.method.contacts, name)[rows[0]])
        found = getattr(self.method.joints.linked.t, name).numpy()[rows]
        return float(found[0]) if len(found) == 1 else found

    def losses(self, frames: int, poses: dict | None, twists: dict | None) -> BodyLosses:
        self.begin()
        return IslandLosses(self, frames, poses, twists)


def _body_table_column(values: np.ndarray, n: int) -> np.ndarray:
    """As tables of bodies have it: (n,) or (n, 3)."""
    return values.reshape(n) if values.size == n else values


class IslandLosses(BodyLosses):
    def gradient(self, carried: dict[int, np.ndarray], grads: dict[int, np.ndarray]) -> BodyGradient:
        r: Any = self.recorded
        total = r.parts.collected(r.total)
        n = len(self.direct["w"])
        self.direct = {name: self.direct.get(name, 0.0) + _body_table_column(total[name], n) for name in TABLES}
        return IslandGradient(self, carried, grads, total)


class IslandGradient(BodyGradient):
    """The gradient with those by drives of joints, friction and restitution. more: by tables of joints (joints, 6) and of
    shapes."""

    def __init__(self, losses: BodyLosses, carried: dict[int, np.ndarray], grads: dict[int, np.ndarray], more: dict):
        super().__init__(losses, carried, grads)
        self.more = more

    def value(self, path: str, name: str, world: int = 0) -> np.ndarray | float:
        r: Any = self.recorded
        if (at := r.places(path, name, world)) is None:
            return super().value(path, name, world)
        table, rows = at
        found = self.more[table][rows] if table in self.more else np.zeros(len(rows))
        return float(found.sum()) if table in SURFACE else float(found[0]) if len(found) == 1 else found
