"""Paths of pins and colliders as inputs of a recording: what a motion by keys (`wsim.scene.curve.Motion`) is made of.

    /World/Pin:keys          (keys, 3) [m], the places of its keys, in the world
    /World/Pin:tangents      (2, keys, 3) [m/s], slopes before and behind them, of kinds hermite and bezier
    /World/Pin:handles       (pieces, 4) [1], (x1, y1, x2, y2) of an eased motion whose pieces all have handles
    /World/Pin:turns         (keys, 3) [rad], rotation vectors behind the rotations that its keys have when asked for

and of a collider likewise; worlds share their colliders. Exact: what a pin or a collider does in each substep is pulled through
the formula of its curve (`Curve.pulled`). Of turns, the derivatives of slerp and squad by a key are differences of order 8 of
those formulas alone, in float64 over 0.02 rad: right to 1e-11; eight evaluations of the curve for each of their components.
"""

import numpy as np

from wsim.geometry import rotation
from wsim.gradient.inputs.base import RecordingInput
from wsim.scene import Problem, SceneError
from wsim.scene.curve import Curve, Motion
from wsim.scene.curve.easing import easing_handles

STEP = 1e-4                      # [m], [m/s], [1], [rad] by which one of them changes
TURN = 0.02                      # [rad] steps of differences of order 8, and their weights
WEIGHTS = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)


def controls_of_path(path: Curve, what: str) -> np.ndarray | None:
    """The keys, tangents or handles of a path; None where it has none."""
    if what == "keys":
        return path.values.copy()
    if what == "tangents":
        return np.stack([path.how["arrive"], path.how["leave"]]) if "leave" in path.how else None
    each = [easing_handles(e) for e in path.how.get("easing", [])]
    return np.array(each) if each and None not in each else None


def motion_with_controls(motion: Motion, what: str, value: np.ndarray) -> Motion:
    """The motion with other keys, tangents or handles."""
    M = motion.values.copy()
    if what == "keys":
        M[:, :3, 3] = value
        return motion.replaced(M)
    if what == "turns":
        return motion_with_turns(motion, value)
    four = [tuple(each) for each in value.tolist()] if what == "handles" else None
    how: dict = {"arrive": value[0], "leave": value[1]} if what == "tangents" else {"easing": four}
    return motion.replaced(M, **how)


def motion_with_turns(motion: Motion, value: np.ndarray) -> Motion:
    """The motion with rotation vectors (keys, 3) [rad] behind the rotations of its keys."""
    M = motion.values.copy()
    R, S = rotation.polar_decomposition(M[:, :3, :3])
    M[:, :3, :3] = R @ rotation.quaternion_to_matrix(rotation.quaternion_exponential(value)) @ S
    return motion.replaced(M)


def by_turns(motion: Motion, times: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Gradient by rotation vectors behind the keys, (keys, 3), from those by small turns in world axes at times (n,) [s]."""
    def orientations_at_times(each: Motion) -> np.ndarray:
        return rotation.matrix_quat(rotation.polar_decomposition(each.sampled(times)[:, :3, :3])[0])
    back, found = rotation.quat_conjugate(orientations_at_times(motion)), np.zeros((len(motion.times), 3))
    for key, axis in np.ndindex(found.shape):
        for k, weight in enumerate(WEIGHTS, 1):
            for sign in (1.0, -1.0):
                step = np.zeros_like(found)
                step[key, axis] = sign * k * TURN
                way = rotation.quaternion_logarithm(rotation.quat_product(orientations_at_times(motion_with_turns(motion,
                                                                                                                  step)), back))
                found[key, axis] += sign * weight / TURN * float((turn * way).sum())
    return found


def pull_back_to_controls(motion: Motion, what: str, times: np.ndarray, by: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Gradient from those with respect to the places and to small turns about them, (n, 3) each, at times (n,) [s]. Handles say
    how turns go on too."""
    found = motion.path.pulled(times, by)
    if what == "keys":
        return found["values"]
    if what == "tangents":
        return np.stack([found["arrive"], found["leave"]])
    if what == "turns":
        return by_turns(motion, times, turn)
    inside, rate = motion.turns.by_pace(times)
    return found["easing"] + motion.turns.pace.pulled(inside, (turn * rate).sum(axis=1))["easing"]


class PathInput(RecordingInput):
    """Keys, tangents, handles or turns of a pin or a collider."""

    def __init__(self, recording, name: str):
        super().__init__(recording, name)
        self.shared = self.row.owner == "Collider"
        self.base = [self.motion(world) for world in range(self.sim.worlds)]       # which turns are put behind

    def motion(self, world: int = 0) -> Motion:
        """Raises SceneError for what is no motion by keys."""
        if self.shared:
            found = next(c for c in self.sim.plan.ports.contacts.rows.colliders if c.path == self.path).motion
        else:
            found = self.pin(world).motion
        if not isinstance(found, Motion) or not hasattr(found, "path") or found.kind == "stack":
            raise SceneError(Problem(self.name, "its motion is not by keys of its own: it hangs below what is animated, or was "
                                     "given by other inputs; give it a Motion with keys"))
        return found

    def pin(self, world: int):
        pins = self.recording.parameters.pins
        return next(p for group in pins.groups.values() for p in group if p.pin.path == self.path and p.body.world == world)

    def read_value(self, world: int = 0) -> np.ndarray:
        motion = self.motion(world)
        if self.what == "turns":
            before, now = (rotation.polar_decomposition(m.values[:, :3, :3])[0] for m in (self.base[world], motion))
            return rotation.quaternion_logarithm(rotation.matrix_quat(before.swapaxes(1, 2) @ now))
        found = controls_of_path(motion.path, self.what)
        if found is None:
            need = {"tangents": "kinds hermite and bezier have slopes", "handles": "kind eased has them, where each piece has "
                    "(x1, y1, x2, y2)"}[self.what]
            raise SceneError(Problem(self.name, f"its motion is of kind {motion.kind}, which has no {self.what}; {need}"))
        return found

    def write_value(self, value) -> None:
        if self.shared and np.shape(value) != self.read_value().shape:
            raise SceneError(Problem(self.name, f"found shape {np.shape(value)}; allowed is {self.read_value().shape}: worlds "
                                     "share their colliders"))
        super().write_value(value)

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        if self.shared and world:
            return
        try:
            new = motion_with_controls(self.base[world] if self.what == "turns" else self.motion(world), self.what, value)
        except ValueError as wrong:
            raise SceneError(Problem(self.name, f"{wrong}")) from None
        if self.shared:
            self.sim.plan.ports.contacts.move(self.path, new)
        else:
            self.pin(world).motion = new
            self.recording.parameters.pins.changed = True
            self.sim.graphs.forget("pins move otherwise")

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        times, by, turn = self.ways(gradient, world)
        found = pull_back_to_controls(self.motion(world), self.what, times.ravel(), by.reshape(-1, 3), turn.reshape(-1, 3))
        if self.what == "turns":
            from wsim.physics.animation.skinning_adjoint import right_rotation_jacobian
            return np.einsum("kmi,km->ki", right_rotation_jacobian(self.read_value(world)), found)
        return found

    def ways(self, gradient, world: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times [s], (frames, moments), and gradients by the place then and by a turn about it, (frames, moments, 3)."""
        r, clock, fps = self.recording, self.sim.plan.clock, self.sim.scene.fps
        start = (r.start + np.arange(r.frames)) / fps
        if self.shared:
            by, turn = gradient.touched(self.path).places(self.path, world)
            return start[:, None] + clock.dt * np.arange(by.shape[1]) / (by.shape[1] - 1), by, turn
        by, pin = gradient.targets(self.path, world), self.pin(world)
        times = start[:, None] + clock.moments(not np.isfinite(pin.pin.stiffness))
        arms = pin.locals @ pin.motion.sampled(times.ravel())[:, :3, :3].swapaxes(1, 2)
        return times, by.sum(axis=2), np.cross(arms.reshape(by.shape), by).sum(axis=2)

    def difference_scale(self) -> float:
        return STEP
