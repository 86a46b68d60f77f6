"""Colliders of whole frames: where each is when a frame begins, and what clearances lose to its way until the end
(kernels/motion/clearance.py). Frames without contacts ask for nothing else, so that none of their substeps has a pose.

    s = V dt        S = 2 sin(min(Omega dt, pi) / 2)          w, W as s, S of a substep

of bounds V of the speed of the ball's centre and Omega of the angular velocity (wsim/scene/curve/speed.py); where these are
infinite, s, S, w, W are the greatest of all poses of the frame, as contacts would have them. A mesh that deforms is as large as
the ball about all of its keys, and its points move by no more than that ball's diameter, or by their greatest speed.

Frames are worked out many at a time, twice as many as before as long as nothing is set: their arrays cost NumPy 0.5 to 3 ms
however long they are. A frame's row is the same whichever it is worked out with.
"""

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.geometry.rotation import multiply, quaternion
from wsim.kernels.motion.clearance import SLACK, WIDTH
from wsim.scene.curve.speed import fastest

if TYPE_CHECKING:
    from wsim.physics.contact.contacts import Contacts

MOST = 128             # frames at a time, and
SAMPLES = 2048         # poses of them that have no bound, and
ROWS = 1 << 16         # rows of all of them


class Outline:
    """Rows (frames, rows, WIDTH) of the frames worked out; `now` (rows * WIDTH,) has those of the present one on the device."""

    def __init__(self, contacts: "Contacts"):
        self.contacts, self.rows = contacts, contacts.rows
        size = len(self.rows.collider) * WIDTH
        self.now = wp.zeros(size, dtype=contacts.real, device=contacts.device)
        self.here = self.now.numpy() if contacts.device.is_cpu else None                # the array itself
        self.first = self.count = 0
        self.found = np.zeros((0, size), contacts.dtype)
        self.kept: wp.array | None = None                # of `found`, on a GPU

    def frame(self, time: float) -> None:
        """The rows of the frame that starts at `time` [s] become those of `now`."""
        c = self.contacts
        number = round(time / c.dt)
        at = number - self.first if abs(time - number * c.dt) < 1e-6 * c.dt else -1
        anew = c.redrawn or at < 0
        if not anew and not self.rows.moves and self.count:
            return
        if anew or at >= self.count:
            on = not anew and at == self.count
            self._work_out(number if at >= 0 or anew else 0, time, 2 * self.count if on else 1)
            at = 0
        if self.here is not None:
            self.here[:] = self.found[at]
        else:
            wp.copy(self.now, self.kept, 0, at * len(self.now), len(self.now))
        c.redrawn = False

    def _work_out(self, number: int, time: float, count: int) -> None:
        c, rows = self.contacts, self.rows
        whole = abs(time - number * c.dt) < 1e-6 * c.dt
        count = max(1, min(count, MOST, ROWS // max(len(rows.collider), 1))) if whole and rows.moves else 1
        times = c.dt * (number + np.arange(count + 1)) if whole else np.array([time, time + c.dt])
        ways = [self._bounded(k, times) for k in range(len(rows.colliders))]
        endless = [k for k, way in enumerate(ways) if not np.isfinite(way).all()]
        if endless:
            count = max(1, min(count, SAMPLES // c.substeps))
            times, ways = times[:count + 1], [way[:count] for way in ways]
            for k in endless:
                ways[k] = self._sampled(k, times, ways[k])
        self.first, self.count = number if whole else -1, count
        self.found = self._table(times[:-1], np.stack(ways, axis=1)).reshape(count, -1).astype(c.dtype)
        if self.here is None:
            self.kept = wp.array(self.found.ravel(), dtype=c.real, device=c.device)

    def _bounded(self, k: int, times: np.ndarray) -> np.ndarray:
        """(s, S, w, W) in frames between times, (frames, 4), of a distinct collider; infinite where there is no bound."""
        motion = self.rows.colliders[k].motion
        if not motion.moves:
            return np.zeros((len(times) - 1, 4))
        v, omega = fastest(motion, times, self.rows.centers()[k])
        off = np.abs(np.swapaxes(motion.values[:, :3, :3], 1, 2) @ motion.values[:, :3, :3] - np.eye(3)).max()
        dt = np.array([1.0, 1.0 / self.contacts.substeps]) * self.contacts.dt
        turn = 2.0 * np.sin(0.5 * np.minimum(omega[:, None] * dt, np.pi)) + 4.0 * off        # as rigid as keys are
        turn[~np.isfinite(omega)] = np.inf
        return np.stack([v * dt[0], turn[:, 0], v * dt[1], turn[:, 1]], axis=1)

    def _sampled(self, k: int, times: np.ndarray, way: np.ndarray) -> np.ndarray:
        """The same, of frames that have no bound by all poses of their substeps."""
        there, n = np.flatnonzero(~np.isfinite(way).all(axis=1)), self.contacts.substeps
        each = times[there, None] + self.contacts.dt * np.arange(n + 1) / n
        M = self.rows.colliders[k].motion.sampled(each.ravel()).reshape(len(there), n + 1, 4, 4)
        q, c = quaternion(M[..., :3, :3]), M[..., :3, :3] @ self.rows.centers()[k] + M[..., :3, 3]

        def gone(a: slice, b: slice):
            turned = multiply(q[:, b], q[:, a] * np.array([-1.0, -1.0, -1.0, 1.0]))
            return (np.linalg.norm(c[:, b] - c[:, a], axis=-1).max(axis=1),
                    2.0 * np.linalg.norm(turned[..., :3], axis=-1).max(axis=1))
        way[there] = np.stack([*gone(slice(0, 1), slice(1, None)), *gone(slice(0, -1), slice(1, None))], axis=1)
        return way

    def _table(self, times: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Rows (frames, rows, WIDTH): translation, quaternion; loss, constant [m] and times the distance from the centre.
        way: (frames, distinct, 4)."""
        rows, of = self.rows, self.rows.collider
        M = np.stack([m.sampled(times) if m.moves else np.broadcast_to(m.at(0.0), (len(times), 4, 4))
                      for m in (c.motion for c in rows.colliders)], axis=1)
        R, p = M[..., :3, :3], M[..., :3, 3]
        center = ((R @ rows.centers()[:, :, None])[..., 0] + p)[:, of] - rows.origin
        s, S, w, W = np.moveaxis(way, -1, 0)
        ball = np.isfinite(rows.radius)
        size = np.where(ball, rows.radius, 0.0)
        moved = s + S * np.where(ball, size, s) + 2.0 * (w + W * s)
        moved += [0.0 if m is None or not m.moves else min(m.fastest * self.contacts.dt / self.contacts.substeps, 2.0 * m.radius)
                  for m in rows.meshes]
        slope = 4.0 * W + np.where(ball, 0.0, 2.0 * S) + SLACK
        loss = moved[:, of] + self.contacts.gap + SLACK * (np.linalg.norm(center, axis=-1) + np.where(ball, size, 1.0)[of])
        return np.concatenate([p[:, of] - rows.origin, quaternion(R)[:, of], loss[..., None], slope[:, of, None]], axis=-1)
