"""Colliders of whole frames: where each is when a frame begins, and what clearances lose to its way until the end
(kernels/motion/free_flight_test.py). Frames without contacts ask for nothing else, so that none of their substeps has a pose.

    s >= the way of the ball's centre      S = 2 sin(min(th, pi) / 2), th >= the angle that it turns by      w, W of a substep

by bounds of wsim/scene/curve/speed.py; where these are infinite, s, S, w, W are the greatest of all poses of the frame, as
contacts would have them. A mesh that deforms is as large as the ball about all of its keys, and its points move in a substep by
no more than that ball's diameter, or by their greatest speed.

Frames are worked out many at a time, twice as many as before as long as nothing is set: NumPy takes 0.5 to 3 ms for one, and
hardly more for a hundred. The rows of a frame do not depend on those worked out with it.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import matrix_quat, quat_product, quat_rotate
from wsim.kernels.motion.free_flight_test import SLACK, WIDTH

if TYPE_CHECKING:
    from wsim.physics.contact.contacts import ColliderContacts
    from wsim.scene.curve import Motion

MOST = 128             # frames at a time, and
SAMPLES = 2048         # poses of them that have no bound, and
ROWS = 1 << 16         # rows of all of them


class SweptBounds:
    """Rows (frames, rows, WIDTH) of the frames worked out; `now` (rows * WIDTH,) has those of the present one on the device."""

    def __init__(self, contacts: "ColliderContacts"):
        self.contacts, self.rows = contacts, contacts.rows
        size = len(self.rows.collider) * WIDTH
        self.now = wp.zeros(size, dtype=contacts.real, device=contacts.device)
        self.host: wp.array | None = None
        if contacts.device.is_cuda:
            self.host = wp.zeros(size, dtype=contacts.real, device="cpu", pinned=True)
        self.here = (self.now if self.host is None else self.host).numpy()              # the array itself
        self.sends = self.host is not None and any(c.motion.moves for c in self.rows.colliders)
        self.first = self.count = 0
        self.moving: list[int] = []                      # distinct colliders
        self.found = np.zeros((0, size), contacts.dtype)
        self.known: dict[int, tuple[Motion, Any]] = {}   # of distinct colliders, see `_straight`

    def frame(self, time: float) -> None:
        """The rows of the frame that starts at `time` [s] become those of `now`."""
        c = self.contacts
        if self.count and not (c.redrawn or self.moving):
            return
        number = round(time / c.dt)
        at, whole = number - self.first, abs(time - number * c.dt) < 1e-6 * c.dt
        if c.redrawn or not whole or at not in range(self.count):
            on = whole and not c.redrawn and at == self.count
            self._work_out(number if whole else None, time, 2 * self.count if on else 1)
            at, c.redrawn = 0, False
        self.here[:] = self.found[at]
        if self.host is not None and not self.sends:     # what moves only since it was set
            wp.copy(self.now, self.host)

    def send(self) -> None:
        """Brings the rows to a GPU, within a frame, where colliders moved from the start."""
        if self.sends and self.host is not None:
            wp.copy(self.now, self.host)

    def _work_out(self, number: int | None, time: float, count: int) -> None:
        """number: of the frame; None: it begins between two."""
        c, rows = self.contacts, self.rows
        self.moving = [k for k, collider in enumerate(rows.colliders) if collider.motion.moves]
        count = max(1, min(count, MOST, ROWS // max(len(rows.collider), 1))) if self.moving else 1
        times = np.array([time, time + c.dt]) if number is None else c.dt * (number + np.arange(count + 1))
        way = np.zeros((count, len(rows.colliders), 4))
        for k in self.moving:
            way[:, k] = self._bounded_frame_motion(k, times)
        endless = np.flatnonzero(~np.isfinite(way).all(axis=(0, 2)))
        if len(endless):
            count = max(1, min(count, SAMPLES // c.substeps))
            times, way = times[:count + 1], way[:count]
            for k in endless.tolist():
                self._sample_frame_motion(k, times, way[:, k])
        self.first, self.count = -2 if number is None else number, count
        self.found = self._table(times[:-1], way).reshape(count, -1).astype(c.dtype)

    def _straight(self, k: int) -> Any:
        """`wsim.scene.curve.speed.LinearMotion` of a distinct collider's motion; None: it is not linear."""
        motion = self.rows.colliders[k].motion
        if k not in self.known or self.known[k][0] is not motion:
            from wsim.scene.curve.speed import LinearMotion
            self.known[k] = motion, LinearMotion(motion) if motion.plain else None
        return self.known[k][1]

    def _bounded_frame_motion(self, k: int, times: np.ndarray) -> np.ndarray:
        """(s, S, w, W) in frames between times, (frames, 4), of a distinct collider; infinite where there is no bound."""
        motion = self.rows.colliders[k].motion
        from wsim.scene.curve.speed import motion_speed_bounds
        line, center = self._straight(k), self.rows.centers()[k]
        way = line.fastest(times, center) if line else motion_speed_bounds(motion, times, center)
        way[:, 2:] = np.minimum(way[:, :2], way[:, 2:] * (self.contacts.dt / self.contacts.substeps))
        off = np.abs(np.swapaxes(motion.values[:, :3, :3], 1, 2) @ motion.values[:, :3, :3] - np.eye(3)).max()
        known = np.isfinite(way[:, 1::2])                # as rigid as keys are
        way[:, 1::2] = np.where(known, 2.0 * np.sin(0.5 * np.minimum(way[:, 1::2], np.pi)) + 4.0 * off, np.inf)
        return way

    def _sample_frame_motion(self, k: int, times: np.ndarray, way: np.ndarray) -> None:
        """The same for frames that have no bound, (frames, 4), by all poses of their substeps."""
        there, n = np.flatnonzero(~np.isfinite(way).all(axis=1)), self.contacts.substeps
        each = times[there, None] + self.contacts.dt * np.arange(n + 1) / n
        M = self.rows.colliders[k].motion.sampled(each.ravel()).reshape(len(there), n + 1, 4, 4)
        q, c = matrix_quat(M[..., :3, :3]), M[..., :3, :3] @ self.rows.centers()[k] + M[..., :3, 3]

        def largest_pose_change(a: slice, b: slice):
            turned = quat_product(q[:, b], q[:, a] * np.array([-1.0, -1.0, -1.0, 1.0]))
            return (np.linalg.norm(c[:, b] - c[:, a], axis=-1).max(axis=1),
                    2.0 * np.linalg.norm(turned[..., :3], axis=-1).max(axis=1))
        way[there] = np.stack([*largest_pose_change(slice(0, 1), slice(1, None)),
                               *largest_pose_change(slice(0, -1), slice(1, None))], axis=1)

    def _table(self, times: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Rows (frames, rows, WIDTH): translation, quaternion; loss, constant [m] and times the distance from the centre; the
        centre. way: (frames, distinct, 4)."""
        rows, of = self.rows, self.rows.collider
        p, q = self._collider_frame_poses(times)
        center = (quat_rotate(q, rows.centers()) + p)[:, of] - rows.origin
        s, S, w, W = np.moveaxis(way, -1, 0)
        ball = np.isfinite(rows.radius)
        size = np.where(ball, rows.radius, 0.0)
        moved = s + S * np.where(ball, size, s) + 2.0 * (w + W * s)
        h = self.contacts.dt / self.contacts.substeps
        moved += [0.0 if m is None or not m.moves else min(m.fastest * h, 2.0 * m.radius) for m in rows.meshes]
        slope = 4.0 * W + np.where(ball, 0.0, 2.0 * S) + SLACK
        rounded = SLACK * (np.linalg.norm(center, axis=-1) + np.where(ball, size, 1.0)[of])
        loss = np.stack([moved[:, of] + self.contacts.gap + rounded, slope[:, of]], axis=-1)
        return np.concatenate([p[:, of] - rows.origin, q[:, of], loss, center], axis=-1)

    def _collider_frame_poses(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (frames, distinct, 3) [m] and quaternions (frames, distinct, 4)."""
        M = np.stack([collider.motion.values[0] for collider in self.rows.colliders])          # of what does not move
        p, q = (np.repeat(x[None], len(times), axis=0) for x in (M[:, :3, 3], matrix_quat(M[:, :3, :3])))
        for k in self.moving:
            line, motion = self._straight(k), self.rows.colliders[k].motion
            if line:
                p[:, k], q[:, k] = line.at(times)
            else:
                M = motion.sampled(times)
                p[:, k], q[:, k] = M[:, :3, 3], matrix_quat(M[:, :3, :3])
        return p, q
