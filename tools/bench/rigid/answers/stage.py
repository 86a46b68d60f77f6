"""A scene in axes of its own, z up, that stands at any turn in the world; and the motion of its bodies in those axes.

A lane is a place of a scene where nothing else is: one scene measures many speeds and offsets, so that they share kernels.
"""

import time
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
import warp as wp

from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

G = 9.81
RATES = ((24.0, 10), (60.0, 8), (240.0, 2), (960.0, 1))           # fps, substeps: a stage's own first
NONE = np.eye(3)


def turned(axis, degrees: float) -> np.ndarray:
    """Rotation (3, 3) about an axis."""
    x, y, z = np.array(axis, float) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + sin(radians(degrees)) * K + (1.0 - cos(radians(degrees))) * K @ K


def framed(at=(0.0, 0.0, 0.0), turn=NONE) -> np.ndarray:
    """Transform (4, 4) of a place and a rotation (3, 3)."""
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = turn, at
    return M


@dataclass
class Track:
    """Frames of a run, the start first, in the axes of its stage: t [s], (k,); x [m], v [m/s], w [rad/s], (k, n, 3), of centres
    of mass; R, (k, n, 3, 3); cpu [s], processor time of all threads in frames after the first; warnings of the run."""

    t: np.ndarray
    x: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    row: dict[str, int]
    cpu: float
    warnings: list[str]

    def until(self, seconds: float) -> slice:
        """Frames up to a time."""
        return slice(0, 1 + int(np.searchsorted(self.t, seconds * (1.0 + 1e-9), side="right") - 1))


class Stage:
    """turn: rotation of the own axes to the world; more: fields of `Scene`."""

    def __init__(self, fps: float = 24.0, substeps: int = 10, turn=NONE, gravity: float = G, lean: float = 0.0, **more):
        """lean [degrees]: slope down along x."""
        self.turn = np.array(turn)
        down = gravity * np.array([sin(radians(lean)), 0.0, -cos(radians(lean))])
        self.scene = Scene(up="Z", gravity=tuple(self.turn @ down), fps=fps, substeps=substeps, **more)

    def world(self, M: np.ndarray) -> np.ndarray:
        return framed(turn=self.turn) @ M

    def collider(self, path: str, shape, at=(0.0, 0.0, 0.0), turn=NONE, rub: float = 0.5, rest: float = 0.0) -> None:
        self.scene.collider(path, shape, motion=Motion.still(self.world(framed(at, turn))), static_friction=rub,
                            dynamic_friction=rub, restitution=rest)

    def carrier(self, path: str, shape, times, frames, rub: float = 0.5) -> None:
        """A collider that moves through frames (k, 4, 4) at times [s]."""
        values = np.array([self.world(M) for M in frames])
        self.scene.collider(path, shape, motion=Motion(times, values), static_friction=rub, dynamic_friction=rub)

    def body(self, path: str, shapes, at, turn=NONE, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), *, rub: float = 0.5,
             rest: float = 0.0, **more) -> Body:
        """shapes: one, or pairs (shape, frame in the body (4, 4))."""
        parts = shapes if isinstance(shapes, list) else [(shapes, np.eye(4))]
        own = [Collider(f"{path}/s{k}", each, Motion.still(M), rub, rub, restitution=rest) for k, (each, M) in enumerate(parts)]
        v, w = (self.turn @ np.array(each, float) for each in (velocity, spin))
        return self.scene.add(Body(path, own, Motion.still(self.world(framed(at, turn))), v, w, **more))

    def run(self, seconds: float, precision: str = "float32") -> Track:
        wp.config.log_level = wp.LOG_WARNING
        sim = Simulation(self.scene, device="cpu", precision=precision)
        sim.load()
        method, frames, cpu = sim.plan.method("rigid"), max(2, round(seconds * self.scene.fps)), 0.0
        center = np.array([m.center for m in method.masses])

        def seen() -> tuple:
            M, back = method.poses(), self.turn.T
            x = M[:, :3, 3] + np.einsum("nij,nj->ni", M[:, :3, :3], center)
            return x @ back.T, back @ M[:, :3, :3], method.velocities() @ back.T, method.spins() @ back.T
        states = [seen()]
        for k in range(frames):
            began = time.process_time()
            sim.step()
            cpu += (time.process_time() - began) * (k > 0)
            states.append(seen())
        x, R, v, w = (np.array(each) for each in zip(*states, strict=True))
        return Track(np.arange(frames + 1) / self.scene.fps, x, R, v, w, {b.path: k for k, (b, _) in enumerate(method.bodies)},
                     cpu, sim.warnings)
