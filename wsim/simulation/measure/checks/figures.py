"""Figures of rigid bodies that are bad at the end of a frame: joints that gape, shapes that overlap, bodies that roll too fast.

Bounds are relative to the sizes of the bodies (kernels/rigid/checks.py). Which prims they are of is found on the host, for a
warning alone."""

from __future__ import annotations

import numpy as np
import warp as wp

from wsim.kernels.rigid import checks
from wsim.model.stage import Clock, Remedy
from wsim.model.status import FrameStatus
from wsim.physics.rigid.contacts.measure import points_of_world
from wsim.scene import Box, Capsule, Surface
from wsim.simulation.measure.checks.lost import TOLD
from wsim.simulation.measure.checks.rolling import RollingCheck

GAPS, OVERLAPS = "joints that gape", "shapes that overlap"


class RigidFigures:
    """rigid: the method of bodies (`wsim.physics.rigid.method.RigidMethod`)."""

    def __init__(self, b, rigid, rolled: wp.array):
        self.model, self.rigid, self.status = b.model, rigid, b.status
        self.kernels: list = []
        self.launches = 0
        joints, contacts, device = rigid.joints, rigid.contacts, b.model.device
        if joints and joints.count:
            b.status.reserve(GAPS, b.model.worlds)
            sizes = size_of(rigid)
            a, c = (np.asarray(each.numpy()) for each in (joints.linked.t.a, joints.linked.t.b))
            each = np.minimum(np.where(a >= 0, sizes[a], np.inf), np.where(c >= 0, sizes[c], np.inf))
            self.size = wp.array(each, dtype=wp.float64, device=device)
            self.kernels.append(checks.check_joints)
        if contacts:
            b.status.reserve(OVERLAPS, b.model.worlds)
            widths = [width_of(c.shape) for *_, c in contacts.owners] + [np.inf] * (contacts.shapes - len(contacts.owners))
            self.width = wp.array(np.array(widths, np.float32), dtype=float, device=device)
            self.check_overlap = checks.overlap_check_kernel(b.model.real)
            self.kernels.append(self.check_overlap)
        self.rolling = RollingCheck(b, rigid, rolled) if RollingCheck.wanted(rigid) else None
        self.kernels += self.rolling.kernels if self.rolling else []

    def launch(self, clock: Clock) -> None:
        """Launches the checks."""
        joints, contacts = self.rigid.joints, self.rigid.contacts
        if joints and joints.count:
            self.model.launch(checks.check_joints, joints.count, [joints.linked, self.size, self.model.worlds],
                              [self.status.word(GAPS)])
        if contacts:
            self.model.launch(self.check_overlap, contacts.room, [contacts.rig(), clock.h, self.width],
                              [self.status.word(OVERLAPS)])
        if self.rolling:
            self.rolling.launch(clock)

    def find_remedies(self, status: FrameStatus, steps: int) -> list[Remedy]:
        found = [Remedy("check", why=name, worlds=status.worlds_that_said(name)) for name in (GAPS, OVERLAPS)
                 if status.said(name).any()]
        return found + (self.rolling.find_remedies(status, steps) if self.rolling else [])

    def frame_warnings(self, status: FrameStatus, steps: int, at_start: str) -> list[tuple[tuple, float, str]]:
        """Warnings: prims, the figure, what helps. steps: substeps now; at_start: what helps in the first frames besides."""
        found = []
        for world in status.worlds_that_said(GAPS)[:TOLD]:
            path, gap, angle = self.worst_joint(world)
            what, unit = (gap, "m") if gap > 0.0 else (angle, "rad")
            found.append(((GAPS, world), what, f"{path}{self.model.of_world(world)} gapes by {{worst}} {unit}; give more "
                          f"substeps (now {steps}), or bodies of masses that are more alike"))
        for world in status.worlds_that_said(OVERLAPS)[:TOLD]:
            one, other, deep = self.worst_overlap(world)
            found.append(((OVERLAPS, world), deep, f"{one} and {other}{self.model.of_world(world)} overlap by {{worst}} m; "
                          f"give more substeps (now {steps}), or masses that are more alike{at_start}"))
        return found + (self.rolling.frame_warnings(status, steps) if self.rolling else [])

    def worst_joint(self, world: int) -> tuple[str, float, float]:
        """Path, gap [m] and angle [rad] of the joint of a world that is worst, the figure that is not 0."""
        joints = self.rigid.joints
        now, kind, low, broken, size = (joints.of_world(np.asarray(a.numpy()), world) for a in (
            joints.linked.now, joints.linked.t.kind, joints.linked.t.low, joints.linked.broken, self.size))
        off = np.where((kind == int(checks.LOCKED)) & (broken == 0)[:, None], np.abs(now - low), 0.0)
        gap, angle = off[:, :3].max(axis=1), off[:, 3:].max(axis=1)
        of_gap, of_angle = gap / (float(checks.GAP) * size), angle / float(checks.ANGLE)
        k = int(np.argmax(np.maximum(of_gap, of_angle)))
        path = joints.joints[k % len(joints.joints)].path
        return (path, float(gap[k]), 0.0) if of_gap[k] >= of_angle[k] else (path, 0.0, float(angle[k]))

    def worst_overlap(self, world: int) -> tuple[str, str, float]:
        """Paths of the two of a world that overlap most for their size, and the depth [m]."""
        c = self.rigid.contacts
        used = points_of_world(c, world)
        deep = np.where(used, -c.work.now.numpy().reshape(-1, 4), 0.0).max(axis=1)
        width, a, b = self.width.numpy(), c.list.a.numpy(), c.list.b.numpy()
        k = int(np.argmax(deep / np.minimum(width[a], width[b])))
        return c.named[a[k]][0], c.named[b[k]][0], float(deep[k])


def size_of(rigid) -> np.ndarray:
    """Size of each body [m]: the diameter of a ball of its mass and largest moment."""
    return np.array([2.0 * np.sqrt(2.5 * np.max(m.moments) / m.mass) for m in rigid.masses])


def width_of(shape) -> float:
    """Least width of a shape [m]."""
    if isinstance(shape, Surface):
        return float(np.ptp(shape.points, axis=0).min())
    if isinstance(shape, Box):
        return 2.0 * float(np.min(shape.half))
    sizes = [getattr(shape, name) for name in ("radius", "half_height") if hasattr(shape, name)]
    return 2.0 * float(sizes[0] if isinstance(shape, Capsule) else min(sizes, default=np.inf))
