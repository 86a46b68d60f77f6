"""What of contacts a recording reads by name (`wsim.gradient.inputs.by_name`).

    /World/Ball:static_friction, :dynamic_friction, :restitution, :thickness [m]     () of a collider; friction of a body too
    /World/Ball:shift        (frames + 1, 3) [m], what is added to where a collider is at each frame, linear in between; worlds
                             share it, and its gradient in one world is that of the points of that world
"""

import numpy as np

from wsim.gradient.inputs.base import PART, RecordingInput
from wsim.scene import Problem, SceneError
from wsim.scene.curve import Motion
from wsim.scene.values.table import FRICTION


class ContactInput(RecordingInput):
    """Friction of a body or a collider, restitution and thickness of a collider."""

    def read_value(self, world: int = 0) -> np.ndarray:
        if (bodies := self.recording.bodies) and bodies.places(self.path, self.what, world):
            return np.asarray(bodies.now(self.path, self.what, world, []))
        contacts, bounce = self.sim.plan.ports.contacts, self.sim.plan.ports.restitution
        objects = [k for k, b in enumerate(self.model.bodies) if b.world == world]
        rows = contacts.rows.of(self.path, objects) if contacts else []
        if not rows and (self.what not in FRICTION or not contacts or self.path not in [b.path for b in self.model.bodies]):
            raise SceneError(Problem(self.name, f"there is nothing of that path with {self.what} among contacts"))
        if self.what in FRICTION and not rows:
            every, k = contacts.points.friction.numpy(), FRICTION.index(self.what)
            return np.array(float(every[self.model.body(self.path, world).first, k]))
        if self.what in FRICTION:
            return np.array(contacts.friction[rows[0], FRICTION.index(self.what)])
        if self.what == "thickness":
            return np.array(contacts.gap[rows[0]])
        if not bounce:
            raise SceneError(Problem(self.name, "no collider throws back, so nothing of that runs; give one a restitution > 0"))
        return np.array(bounce.of(rows[0], self.model.bodies[objects[0]].first))

    def difference_scale(self) -> float:
        return PART * max(float(self.read_value()), 1e-3)


class ShiftedMotion(Motion):
    """A motion with shifts at the frames of a recording on top, linear in between and held outside."""

    def __init__(self, own: Motion, shift: np.ndarray, start: int, fps: float):
        super().__init__(own.times, own.values)
        self.own, self.shift, self.start, self.fps = own, shift, start, fps

    @property
    def moves(self) -> bool:
        return True

    def at(self, t: float) -> np.ndarray:
        M, f = self.own.at(t).copy(), t * self.fps - self.start
        M[:3, 3] += [np.interp(f, np.arange(len(self.shift)), axis) for axis in self.shift.T]
        return M

    def sampled(self, t) -> np.ndarray:
        return np.stack([self.at(one) for one in np.atleast_1d(t)])


class ShiftInput(RecordingInput):
    """The shift and turn that is added to a collider's motion."""

    shared = True

    def collider(self):
        return next(c for c in self.sim.plan.ports.contacts.rows.colliders if c.path == self.path)

    def read_value(self, world: int = 0) -> np.ndarray:
        motion, r = self.collider().motion, self.recording
        here = isinstance(motion, ShiftedMotion) and motion.start == r.start and len(motion.shift) == r.frames + 1
        return motion.shift.copy() if here else np.zeros((r.frames + 1, 3))

    def write_value(self, value) -> None:
        if np.shape(value) != self.read_value().shape:
            raise SceneError(Problem(self.name, f"found shape {np.shape(value)}; allowed is {self.read_value().shape}: worlds "
                                     "share their colliders"))
        self.set_world_value(self.values_by_world(value)[0], 0)

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        motion = self.collider().motion
        own = motion.own if isinstance(motion, ShiftedMotion) else motion
        self.sim.plan.ports.contacts.move(
            self.path, ShiftedMotion(own, value.copy(), self.recording.start, self.sim.scene.fps))

    def difference_scale(self) -> float:
        return 1e-4
