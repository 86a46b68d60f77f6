"""Bodies of a recording: poses and velocities after each frame, and the gradient of a loss of them with respect to what bodies
begin with and are made of. Steps are those of kernels/rigid/motion.py, whose adjoints the tape runs; what stands before
and behind them is here, on the host in float64.

    M = [R A^T, place - R A^T c],  v = p / m,  omega = R J R^T L     R from the principal axes, A from those to the body
    begins with   p = m v,  L = R I R^T omega                           J = I^-1, c the centre of mass in the body's frame

The gradient with respect to a quaternion is that of the turn [theta]x R before it: q' = theta q / 2, so 2 tau q of the
cotangent tau of theta.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import quat_conjugate, quat_product, quat_rotate, quaternion_to_matrix, unit_quat
from wsim.kernels.math.real import types
from wsim.kernels.rigid import motion
from wsim.model.stage import Clock
from wsim.physics.rigid.mass import inertia_axis_directions
from wsim.scene import Problem, SceneError

TABLES = ("w", "inverse", "push", "torque", "drag", "spin_drag")


@dataclass
class RecordedMotions:
    """The motions of all bodies: centres x relative to their start [m], q (n, 4), momenta p, L."""

    x: np.ndarray
    q: np.ndarray
    p: np.ndarray
    L: np.ndarray


def rotation_cotangent(R: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Cotangent (n, 3) of a small turn of rotations, of cotangents (n, 3, 3) of their entries."""
    S = R @ by.transpose(0, 2, 1)
    return np.stack([S[:, 1, 2] - S[:, 2, 1], S[:, 2, 0] - S[:, 0, 2], S[:, 0, 1] - S[:, 1, 0]], axis=1)


class RecordedBodies:
    """Arrays of the method's part as one step reads and writes them, and what frames of a recording leave."""

    whole = False                      # every substep is kept
    left = 0.0                         # [m/s] of the impulses that were differentiated

    def __init__(self, method):
        self.method, self.model, part = method, method.model, method.part
        real, t = self.model.real, types(self.model.real)
        assert part.names == ["x", "e", "p", "L"]
        self.every = part.every
        self.q, self.o = (wp.array(ptr=a.ptr, dtype=t.vec4, shape=a.shape, device=a.device)
                          for a in (part.arrays["q"], part.arrays["o"]))
        self.kernel: Any = None
        if not (method.joints or method.contacts):
            self.kernel = motion.free_step(real, self.model.module)
        self.kept: list[wp.array] = []

    @property
    def arrays(self) -> list[wp.array]:
        return [self.every, self.q, self.o]

    def tables(self) -> list[wp.array]:
        """Tables that are differentiated by."""
        return [getattr(self.method.table, name) for name in TABLES]

    def step(self, clock: Clock) -> None:
        self.model.launch(self.kernel, self.method.part.count, [self.method.table, *self.arrays, clock.h], self.arrays)

    def now(self, path: str, name: str, world: int, begun: list[tuple[wp.array, np.ndarray]]) -> np.ndarray | float:
        """A value of a body; begun: arrays of the state, and what they hold where the recording begins."""
        k, held = self.row(path, world), {array.ptr: values.astype(np.float64) for array, values in begun}
        m = self.method.masses[k]
        if name in ("velocity", "spin"):
            _, _, p, L = held[self.every.ptr].reshape(4, -1, 3)[:, k]
            q = unit_quat(held[self.q.ptr][k] + held[self.o.ptr][k])
            return p / m.mass if name == "velocity" else quat_rotate(q, quat_rotate(quat_conjugate(q), L) / m.moments)
        if name == "inertia":
            return inertia_axis_directions(self.method.bodies[k][0], m)**2 @ m.moments
        table = {"force": self.method.force, "torque": self.method.twist}.get(name)
        return m.mass if name == "mass" else getattr(self.method.table, name).numpy()[k] if table is None else table[k].copy()

    def allot(self, frames: int) -> None:
        self.kept = [wp.zeros((frames + 1, a.size), dtype=a.dtype, device=a.device) for a in self.arrays]

    def keep(self, frame: int) -> None:
        for kept, array in zip(self.kept, self.arrays, strict=True):
            wp.copy(kept[frame], array)

    def motions(self, frame: int) -> RecordedMotions:
        every, q, o = (a[frame].numpy().astype(np.float64) for a in self.kept)
        x, e, p, L = every.reshape(4, -1, 3)
        return RecordedMotions(x + e, unit_quat(q + o), p, L)

    def places(self, path: str, name: str, world: int) -> Any:
        """Places of a value that is none of a body's own; None: nowhere."""
        return None

    def row(self, path: str, world: int = 0) -> int:
        """Raises SceneError where there is no such body."""
        for k, (body, of) in enumerate(self.method.bodies):
            if (body.path, of) == (path, world):
                return k
        raise SceneError(Problem(path, f"is no rigid body of world {world}; there are "
                                 f"{', '.join(dict.fromkeys(body.path for body, _ in self.method.bodies))}"))

    def masses(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) [kg] and moments (n, 3) [kg m^2]."""
        masses = self.method.masses
        return np.array([m.mass for m in masses]), np.array([m.moments for m in masses])

    def axes(self) -> np.ndarray:
        return quaternion_to_matrix(np.array([m.axes for m in self.method.masses]))

    def losses(self, frames: int, poses: dict | None, twists: dict | None) -> "BodyLosses":
        return BodyLosses(self, frames, poses, twists)

    def poses(self, frame: int) -> np.ndarray:
        """Frames of the bodies to the world (n, 4, 4), lengths [m]."""
        s, found = self.motions(frame), np.tile(np.eye(4), (len(self.method.bodies), 1, 1))
        found[:, :3, :3] = quaternion_to_matrix(s.q) @ self.axes().transpose(0, 2, 1)
        center = np.array([m.center for m in self.method.masses])
        found[:, :3, 3] = self.method.origin + s.x - np.einsum("nij,nj->ni", found[:, :3, :3], center)
        return found

    def twists(self, frame: int) -> np.ndarray:
        """Velocities of the centres of mass [m/s] and angular velocities [rad/s], world, (n, 2, 3)."""
        s, (mass, moments) = self.motions(frame), self.masses()
        return np.stack([s.p / mass[:, None], quat_rotate(s.q, quat_rotate(quat_conjugate(s.q), s.L) / moments)], axis=1)


class BodyLosses:
    """Derivatives of a loss by poses and twists, frame by frame on the way back. direct: what they add to the gradients with
    respect to 1/m and 1/I themselves."""

    def __init__(self, recorded: RecordedBodies, frames: int, poses: dict | None, twists: dict | None):
        self.recorded, n = recorded, len(recorded.method.bodies)
        self.poses = {frame: self.dense("poses", frames, frame, given, (4, 4)) for frame, given in (poses or {}).items()}
        self.twists = {frame: self.dense("twists", frames, frame, given, (2, 3)) for frame, given in (twists or {}).items()}
        self.direct = {"w": np.zeros(n), "inverse": np.zeros((n, 3))}

    def dense(self, what: str, frames: int, frame: int, given: Any, shape: tuple[int, int]) -> np.ndarray:
        if not 0 <= frame <= frames:
            raise SceneError(Problem(what, f"found frame {frame}; allowed are 0 to {frames}"))
        found = np.zeros((len(self.recorded.method.bodies), *shape))
        for key, each in (given if isinstance(given, dict) else {self.recorded.method.bodies[0][0].path: given}).items():
            path, world = key if isinstance(key, tuple) else (key, 0)
            each = np.asarray(each, np.float64)
            if each.shape != shape or not np.isfinite(each).all():
                raise SceneError(Problem(path, f"derivatives by {what} must be finite with shape {shape}; found {each.shape}"))
            found[self.recorded.row(path, world)] += each
        return found

    def at(self, frame: int) -> list[tuple[wp.array, np.ndarray]]:
        """(array of the state, what the loss adds to its gradient) after so many frames."""
        if frame not in self.poses and frame not in self.twists:
            return []
        r, s = self.recorded, self.recorded.motions(frame)
        n, (mass, moments), R = len(s.x), r.masses(), quaternion_to_matrix(s.q)
        by = RecordedMotions(np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3)))
        by_R = np.zeros((n, 3, 3))
        if frame in self.poses:
            M = self.poses[frame]
            by.x += M[:, :3, 3]
            center = np.array([m.center for m in r.method.masses])
            by_R += (M[:, :3, :3] - M[:, :3, 3, None] * center[:, None]) @ r.axes()
        if frame in self.twists:
            v, G = self.twists[frame][:, 0], self.twists[frame][:, 1]
            own, own_G = quat_rotate(quat_conjugate(s.q), s.L), quat_rotate(quat_conjugate(s.q), G)
            by.p += v / mass[:, None]
            by.L += quat_rotate(s.q, own_G / moments)
            by_R += G[:, :, None] * (own / moments)[:, None] + s.L[:, :, None] * (own_G / moments)[:, None]
            self.direct["w"] += (s.p * v).sum(1)
            self.direct["inverse"] += own * own_G
        tau = rotation_cotangent(R, by_R)
        by.q = 2.0 * quat_product(np.concatenate([tau, np.zeros((n, 1))], axis=1), s.q)
        return [(r.every, np.concatenate([by.x, np.zeros((n, 3)), by.p, by.L])), (r.q, by.q)]


    def gradient(self, carried: dict[int, np.ndarray], grads: dict[int, np.ndarray]) -> "BodyGradient":
        return BodyGradient(self, carried, grads)


class BodyGradient:
    """Derivatives with respect to what bodies begin with and are made of. carried: those by the state at the start, by array;
    grads: those by tables."""

    def __init__(self, losses: BodyLosses, carried: dict[int, np.ndarray], grads: dict[int, np.ndarray]):
        r = self.recorded = losses.recorded
        n = len(r.method.bodies)
        self.start = r.motions(0)
        self.by_x, _, self.by_p, self.by_L = carried[r.every.ptr].reshape(4, n, 3)
        self.by = {name: grads[table.ptr] + losses.direct.get(name, 0.0)
                   for name, table in zip(TABLES, r.tables(), strict=True)}

    def value(self, path: str, name: str, world: int = 0) -> np.ndarray | float:
        """Gradient with respect to a value of a body; velocity and spin: of where the recording begins, which others leave as
        they are. mass: moments follow it where the scene gives none. inertia: along the axes that the scene gives."""
        k = self.recorded.row(path, world)
        found = getattr(self, name, None)
        return found(k) if found else self.by[{"force": "push"}.get(name, name)][k]

    def velocity(self, k: int) -> np.ndarray:
        return self.by_p[k] * self.recorded.method.masses[k].mass

    def spin(self, k: int) -> np.ndarray:
        s, m = self.start, self.recorded.method.masses[k]
        return quat_rotate(s.q[k], m.moments * quat_rotate(quat_conjugate(s.q[k]), self.by_L[k]))

    def moments(self, k: int) -> np.ndarray:
        """Gradient with respect to the principal moments."""
        s, m = self.start, self.recorded.method.masses[k]
        back = quat_conjugate(s.q[k])
        own = quat_rotate(back, s.L[k]) / m.moments                 # omega
        return quat_rotate(back, self.by_L[k]) * own - self.by["inverse"][k] / m.moments**2

    def mass(self, k: int) -> float:
        r, m = self.recorded, self.recorded.method.masses[k]
        body, world = r.method.bodies[k]
        found = self.by["push"][k] @ r.method.gravity[world] - self.by["w"][k] / m.mass**2
        found += self.by_p[k] @ self.start.p[k] / m.mass
        return float(found + (self.moments(k) @ m.moments / m.mass if body.inertia is None else 0.0))

    def inertia(self, k: int) -> np.ndarray:
        method = self.recorded.method
        return inertia_axis_directions(method.bodies[k][0], method.masses[k])**2 @ self.moments(k)

    def gravity(self, world: int) -> np.ndarray:
        mass, _ = self.recorded.masses()
        own = np.array([of == world for _, of in self.recorded.method.bodies])
        return (mass[:, None] * self.by["push"])[own].sum(axis=0)
