"""Rigid bodies on the device: the part "bodies", whose rows are the bodies of every world, and the steps of a frame.

All substeps of a frame are one launch where nothing can meet: a thread moves one body (kernels/rigid/motion.py). Else
wsim/physics/rigid/contacts.py.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry import rotation
from wsim.kernels.rigid import motion
from wsim.model.stage import Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.state import Field, Part
from wsim.model.status import Status
from wsim.model.structs import filled
from wsim.physics.rigid.mass import Inertia, inertia, weighed
from wsim.physics.rigid.objects import Body
from wsim.physics.rigid.solids import acting, kept, meet, meeting, met_by_strands, sleeps, standing, touches
from wsim.scene.methods import dressed
from wsim.scene.samples import Sample, Transform

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

FIELDS = (Field("x", "m", True, "centre of mass relative to where it was at the start"),
          Field("e", "m", True, "rounding remainder of x"), Field("p", "kg m/s", True, "momentum"),
          Field("L", "kg m^2/s", True, "angular momentum about the centre of mass"),
          Field("q", "", True, "orientation of the principal axes, (x, y, z, w)", "quat"),
          Field("o", "", True, "rounding remainder of q", "quat"))
LIVE = ("velocity", "spin", "force", "torque", "drag", "spin_drag", "mass", "inertia")


def build(b: "Build") -> Method:
    return Rigid(b)


class Rigid(Method):
    """`bodies`: (body, world), a row of the part each; `masses` of them."""

    def __init__(self, b: "Build"):
        super().__init__("rigid")
        self.model, scene = b.model, b.scene
        if b.model.gradients:
            from wsim.physics.rigid.recorded.begin import refuse_contacts
            refuse_contacts(scene)
        worlds = range(b.model.worlds)
        self.bodies: list[tuple[Body, int]] = [(body, world) for world in worlds for body in scene.things("Body")]
        of = {id(body): inertia(body) for body in scene.things("Body")}
        self.masses: list[Inertia] = [of[id(body)] for body, _ in self.bodies]
        frames = np.array([body.motion.at(0.0) for body, _ in self.bodies])
        self.origin = np.array([M[:3, :3] @ m.center + M[:3, 3] for M, m in zip(frames, self.masses, strict=True)])
        self.gravity = np.tile(np.asarray(scene.gravity, np.float64), (b.model.worlds, 1))
        self.force, self.twist = (np.array([getattr(body, name) for body, _ in self.bodies]) for name in ("force", "torque"))
        self._allocate(b)
        self._begin(frames)
        self.sleep: Any = None
        if sleeps(scene) and not (b.model.gradients and acting(scene)):          # what is recorded does not sleep
            from wsim.physics.rigid.sleep import Sleep
            self.sleep = Sleep(b, self)
        self.Bodies, self.Moving = motion.structs(b.model.real)
        self.table = self.given = self._tables()
        self.offers, self.joints = Ports(bodies=self), None        # type: Ports, Any
        if acting(scene):
            from wsim.physics.rigid.joints.tables import Joints
            self.joints = Joints(b, self)
            self.offers.drive_targets = self.joints.aims.names if self.joints.aims else None
            if self.sleep:
                self.sleep.join(self.joints)
        self._stages(b)

    def _allocate(self, b) -> None:
        self.part = Part.allocate("bodies", (*FIELDS, *kept(b)), len(self.bodies), b.model.real, b.model.device)
        rows: dict[tuple[str, int], list[int]] = {}
        for k, (body, world) in enumerate(self.bodies):
            rows.setdefault((body.written, world), []).append(k)
        self.part.rows = {key: np.array(own) for key, own in rows.items()}
        b.state.add(self.part)

    def _stages(self, b) -> None:
        self.contacts = self.recorded = self.touch = None      # type: Any    # touch: `touch.substeps.Substeps`, if others push
        what, launches = f"{len(self.bodies)} bodies, all substeps" + (f", {self.joints.what}" if self.joints else ""), 1
        points, strands = touches(b.scene), bool(met_by_strands(b.scene))
        if points or strands or meet(b.scene):
            from wsim.physics.rigid.contacts import Contacts
            self.contacts = Contacts(b, self)
            what += f", {self.contacts.shapes} shapes that can meet, {self.contacts.form.what}"
            launches = self.contacts.launches(b.clock)
        elif not b.model.gradients:
            self.kernel = self.joints.alone() if self.joints else motion.free(b.model.real, b.model.module)
        if b.model.gradients:
            from wsim.physics.rigid.recorded.begin import recorded
            self.recorded = self.offers.recorded_bodies = recorded(self)
        if points or strands:
            from wsim.physics.rigid.touch.others import pushed
            self.touch = pushed(b, self, points)
            self.stages = self.touch.stages
            self.offers.moving_bodies = self.touch if points else None
            return
        rate, phase = "substep" if self.recorded else "frame", "pose" if dressed(b.scene) else "predict"   # before followers
        self.stages.append(Stage("rigid bodies", phase, self.advance, launches, self.part.bytes, rate, what))

    def _begin(self, frames: np.ndarray) -> None:
        q = rotation.multiply(rotation.quaternion(frames[:, :3, :3]), np.array([m.axes for m in self.masses]))
        spin = np.array([body.spin for body, _ in self.bodies])
        near = rotation.normalized(q).astype(self.model.dtype)
        self.put("q", near)
        self.put("o", rotation.normalized(q) - near)
        self.put("p", np.array([m.mass * body.velocity for m, (body, _) in zip(self.masses, self.bodies, strict=True)]))
        self.put("L", self.momentum(rotation.normalized(q), spin))

    def momentum(self, q: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Angular momentum (n, 3) [kg m^2/s] of angular velocities [rad/s]."""
        moments = np.array([m.moments for m in self.masses])
        return rotation.rotate(q, moments * rotation.rotate(rotation.conjugate(q), spin))

    def put(self, name: str, values: np.ndarray) -> None:
        self.part.arrays[name].assign(np.ascontiguousarray(values, self.model.dtype))
        if f"{name}h" in self.part.arrays:
            self.part.arrays[f"{name}h"].zero_()

    def read(self, name: str) -> np.ndarray:
        """p or L at the end of a frame, where points are read half a step on too (kernels/rigid/touch/half.py)."""
        return self.get(name) + (self.get(f"{name}h") if f"{name}h" in self.part.arrays else 0.0)

    def get(self, name: str) -> np.ndarray:
        """A field of all bodies, float64."""
        return self.part.arrays[name].numpy().astype(np.float64)

    def turns(self) -> np.ndarray:
        """Quaternions (n, 4) from principal axes to the world now."""
        return rotation.normalized(self.get("q") + self.get("o"))

    def _tables(self) -> Any:
        m, dtype, real = self.model, self.model.dtype, self.model.real
        mass = np.array([one.mass for one in self.masses])
        moments = np.array([one.moments for one in self.masses])
        columns = {name: np.array([getattr(body, name) for body, _ in self.bodies]) for name in ("drag", "spin_drag")}
        vec3 = self.part.arrays["x"].dtype
        table = filled(self.Bodies, w=m.upload((1.0 / mass).astype(dtype), real),
                       inverse=m.upload((1.0 / moments).astype(dtype), vec3),
                       **{name: m.upload(value.astype(dtype), real) for name, value in columns.items()})
        table.push, table.torque = (m.upload(value.astype(dtype), vec3) for value in (self._push(), self.twist))
        return table

    def lend(self) -> Any:
        """The table without what fluids add to `table` in each frame."""
        from wsim.physics.rigid.touch.lent import lent
        self.given = lent(self) if self.given is self.table else self.given
        return self.given

    def _push(self) -> np.ndarray:
        """Weight and force [N], (n, 3)."""
        worlds = [world for _, world in self.bodies]
        return np.array([m.mass for m in self.masses])[:, None] * self.gravity[worlds] + self.force

    def moving(self) -> Any:
        return filled(self.Moving, **{name: self.part.arrays[name] for name in ("x", "e", "q", "o", "p", "L")})

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.joints:
            self.joints.before_frame(time, clock)
        if self.contacts:
            self.contacts.before_frame(time, clock)
        if self.touch:
            self.touch.before_frame()

    def meet(self, others: Methods) -> None:
        if self.touch:
            self.touch.meet(others)

    def retry(self, status: Status) -> list[Remedy]:
        found = self.contacts.retry(status) if self.contacts else []
        return found + (self.touch.foreseen.retry(self.touch.clock) if self.touch and self.touch.foreseen else [])

    def notes(self, status: Status) -> list[tuple[tuple, float, str]]:
        return self.contacts.notes() if self.contacts else []

    def restored(self, fields) -> None:
        pairs = fields.get(self.bodies[0][0].written, {}).get("a")
        if self.contacts and pairs is not None and len(pairs) > self.contacts.room:
            self.contacts.grow(len(pairs))

    def advance(self, clock: Clock) -> None:
        if self.contacts or self.recorded:
            return (self.recorded.step if self.recorded else self.contacts.advance)(clock)
        now = self.moving()
        if self.joints:
            return self.joints.advance(self.kernel, clock, self.table, now)
        asleep = self.part.arrays["asleep"] if self.sleep else None
        self.model.launch(self.kernel, self.part.count, [self.table, now, asleep, clock.substeps, clock.h], [now])

    def poses(self) -> np.ndarray:
        """Frames of the bodies to the world now, (n, 4, 4) float64 [m]."""
        axes = np.array([m.axes for m in self.masses])
        R = rotation.matrix(rotation.multiply(self.turns(), rotation.conjugate(axes)))
        found = np.tile(np.eye(4), (len(R), 1, 1))
        center = np.array([m.center for m in self.masses])
        found[:, :3, :3] = R
        found[:, :3, 3] = self.origin + self.get("x") + self.get("e") - np.einsum("nij,nj->ni", R, center)
        return found

    def placed(self, path: str) -> np.ndarray:
        """Poses as `poses` has them, of one body in every world."""
        return self.poses()[[k for k, (body, _) in enumerate(self.bodies) if body.path == path]]

    def spins(self) -> np.ndarray:
        """Angular velocities now, world (n, 3) [rad/s]."""
        q, moments = self.turns(), np.array([m.moments for m in self.masses])
        return rotation.rotate(q, rotation.rotate(rotation.conjugate(q), self.read("L")) / moments)

    def velocities(self) -> np.ndarray:
        """Velocities of the centres of mass now, (n, 3) [m/s]."""
        return self.read("p") / np.array([m.mass for m in self.masses])[:, None]

    def weigh(self, rows: np.ndarray, name: str, value) -> None:
        """Another mass or inertia of bodies, which go on as fast as they are, linear and angular."""
        poses, v, spins = self.turns(), self.velocities(), self.spins()
        for k in rows:
            before, body = self.masses[k], self.bodies[k][0]
            self.masses[k] = now = weighed(body, before, name, value)
            poses[k] = rotation.multiply(poses[k], rotation.multiply(rotation.conjugate(before.axes), now.axes))
        q = rotation.normalized(poses)
        near = q.astype(self.model.dtype)
        self.put("q", near)
        self.put("o", q - near)
        self.put("p", np.array([m.mass for m in self.masses])[:, None] * v)
        self.put("L", self.momentum(q, spins))
        self.table.w.assign(np.array([1.0 / m.mass for m in self.masses], self.model.dtype))
        self.table.inverse.assign(np.array([1.0 / m.moments for m in self.masses], self.model.dtype))
        self.given.push.assign(self._push().astype(self.model.dtype))
        if self.joints:
            self.joints.weigh(self.masses)

    def samples(self, world: int = 0) -> list[Sample]:
        poses = self.poses()
        for k, (body, _) in enumerate(self.bodies):
            if body.stretch is not None:
                poses[k, :3, :3] = poses[k, :3, :3] @ body.stretch
        own = [(k, body) for k, (body, of) in enumerate(self.bodies) if of == world]
        found: list[Sample] = [Transform(body.path, poses[k]) for k, body in own if not body.instancer]
        if len(found) < len(own):
            from wsim.physics.rigid.joints.instances.samples import moved
            found += moved(self, poses, [k for k, body in own if body.instancer])
        return found

    def indicators(self, x, v) -> dict[str, float]:
        """Kinetic energy and that in gravity [J] of all bodies of the first world, and what contacts say."""
        first, places = np.array([world == 0 for _, world in self.bodies]), self.origin + self.get("x")
        mass = np.array([m.mass for m in self.masses])
        kinetic = 0.5 * ((self.read("p") * self.velocities()).sum(1) + (self.read("L") * self.spins()).sum(1))
        found = {"rigid_energy": float((kinetic - mass * (places @ self.gravity[0]))[first].sum())}
        for each in filter(None, (self.contacts, self.touch)):
            found |= each.indicators()
        return found | (self.joints.indicators() if self.joints else {})

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        hit = np.array([k for k, (body, of) in enumerate(self.bodies) if path in ("/", body.path) and world in (None, of)], int)
        if self.sleep and name in (*LIVE, "gravity"):
            self.sleep.wake(None if path == "/" else hit)
        if path == "/" and name == "gravity":
            self.gravity[slice(None) if world is None else world] = value
            self.given.push.assign(self._push().astype(self.model.dtype))
            return True
        if path == "/" or not len(hit) or name not in LIVE:
            return any([other.set(path, name, value, world) for other in (self.joints, self.contacts) if other])
        if name in ("velocity", "spin"):
            field = "p" if name == "velocity" else "L"
            now = self.get(field)
            q, every = self.turns(), np.tile(value, (len(now), 1))
            mass = np.array([m.mass for m in self.masses])[:, None]
            now[hit] = (mass * every if field == "p" else self.momentum(q, every))[hit]
            self.put(field, now)
            return True
        if name in ("mass", "inertia"):
            self.weigh(hit, name, value)
            return True
        if (rows := {"force": self.force, "torque": self.twist}.get(name)) is not None:
            rows[hit] = value
            array, values = (self.given.push, self._push()) if name == "force" else (self.given.torque, rows)
        else:
            array = getattr(self.table, name)
            values = array.numpy()
            values[hit] = value
        array.assign(values.astype(self.model.dtype))
        return True


def signature(b) -> list:
    points = touches(b.scene)
    if not (points or meet(b.scene)):
        return ["joints", *["sleep"] * sleeps(b.scene)] if acting(b.scene) else []
    from wsim.physics.rigid.forms import chosen
    from wsim.physics.rigid.meetings import bounces, kinds, seams
    own = [c for body in b.scene.things("Body") for c in meeting(body)]
    form = chosen(b.model.device, b.model.worlds * len(own) + len(standing(b.scene.colliders)))
    filtered = any(b.scene.things(name) for name in ("Group", "FilteredPairs"))
    said = [sorted(kinds(b.scene.things("Body"), b.scene.colliders)), sorted(seams(b.scene)), bounces(b.scene),
            form.name, form.blocks, sleeps(b.scene), filtered, bool(acting(b.scene)), b.scene.contact_tolerance > 0.0]
    return said + [sorted({type(c.shape).__name__ for c in own}), any(c.restitution > 0.0 for c in own)] * points
