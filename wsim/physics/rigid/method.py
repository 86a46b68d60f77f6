"""Rigid bodies on the device: the part "bodies", whose rows are the bodies of every world, and the steps of a frame.

All substeps of a frame are one launch where nothing can meet (kernels/rigid/motion.py). Else: `wsim.physics.rigid.contacts`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry import rotation
from wsim.kernels.rigid import motion
from wsim.model.stage import Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.rigid import solids
from wsim.physics.rigid.mass import Inertia, body_inertia, reweigh_inertia
from wsim.physics.rigid.objects import Body
from wsim.scene.methods import driving_bodies
from wsim.scene.samples import Sample, TransformSample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

FIELDS = (StateField("x", "m", True, "centre of mass relative to where it was at the start"),
          StateField("e", "m", True, "rounding remainder of x"), StateField("p", "kg m/s", True, "momentum"),
          StateField("L", "kg m^2/s", True, "angular momentum about the centre of mass"),
          StateField("q", "", True, "orientation of the principal axes, (x, y, z, w)", "quat"),
          StateField("o", "", True, "rounding remainder of q", "quat"))
LIVE = ("velocity", "spin", "force", "torque", "drag", "spin_drag", "mass", "inertia")


def build(b: "Build") -> Method:
    return RigidMethod(b)


class RigidMethod(Method):
    """`bodies`: (body, world), a row of the part each; `masses` of them."""
    measures_worlds = True

    def __init__(self, b: "Build"):
        super().__init__("rigid")
        self.model, scene = b.model, b.scene
        if b.model.gradients:
            from wsim.physics.rigid.recorded.begin import refuse_contacts
            refuse_contacts(scene)
        worlds = range(b.model.worlds)
        self.bodies: list[tuple[Body, int]] = [(body, world) for world in worlds for body in scene.things("Body")]
        of = {id(body): body_inertia(body) for body in scene.things("Body")}
        self.masses: list[Inertia] = [of[id(body)] for body, _ in self.bodies]
        frames = np.array([body.motion.at(0.0) for body, _ in self.bodies])
        self.origin = np.array([M[:3, :3] @ m.center + M[:3, 3] for M, m in zip(frames, self.masses, strict=True)])
        self.gravity = np.tile(np.asarray(scene.gravity, np.float64), (b.model.worlds, 1))
        self.force, self.twist = (np.array([getattr(body, name) for body, _ in self.bodies]) for name in ("force", "torque"))
        self._allocate(b)
        self._begin(frames)
        self.sleep: Any = None
        if solids.bodies_may_sleep(scene) and not (b.model.gradients and solids.enabled_joints(scene)):      # not if recorded
            from wsim.physics.rigid.sleep import RigidSleep
            self.sleep = RigidSleep(b, self)
        self.Bodies, self.Moving = motion.body_structs(b.model.real)
        self.table = self.given = self._tables()
        from wsim.physics.rigid.joints.trees.choose import make_joints
        self.joints: Any = make_joints(b, self) if solids.enabled_joints(scene) or solids.has_soft_contacts(scene) else None
        self.offers = Ports(bodies=self)
        if self.joints:
            self.offers.drive_targets = self.joints.followed
            if self.sleep:
                self.sleep.join(self.joints)
        self._add_rigid_stages(b)

    def _allocate(self, b) -> None:
        fields = (*FIELDS, *solids.star_fields(b))
        self.part = StatePart.allocate("bodies", fields, len(self.bodies), b.model.real, b.model.device)
        rows: dict[tuple[str, int], list[int]] = {}
        for k, (body, world) in enumerate(self.bodies):
            rows.setdefault((body.written, world), []).append(k)
        self.part.rows = {key: np.array(own) for key, own in rows.items()}
        b.state.add(self.part)

    def _add_rigid_stages(self, b) -> None:
        self.contacts = self.recorded = self.touch = None      # type: Any    # touch: `touch.substeps.RigidSubsteps`, if others push
        what, launches = f"{len(self.bodies)} bodies, all substeps" + (f", {self.joints.what}" if self.joints else ""), 1
        points, strands = solids.bodies_touch_points(b.scene), bool(solids.bodies_met_by_strands(b.scene))
        if points or strands or solids.has_rigid_contacts(b.scene):
            from wsim.physics.rigid.contacts import RigidContactTables
            self.contacts = RigidContactTables(b, self)
            what += f", {self.contacts.shapes} shapes that can meet, {self.contacts.form.what}"
            launches = self.contacts.launches(b.clock)
        elif not b.model.gradients:
            self.kernel = self.joints.alone() if self.joints else motion.free_flight_kernel(b.model.real, b.model.module)
        if b.model.gradients:
            from wsim.physics.rigid.recorded.begin import make_recorder
            self.recorded = self.offers.recorded_bodies = make_recorder(self)
        if points or strands:
            from wsim.physics.rigid.touch.others import make_pushed_substeps
            self.touch = make_pushed_substeps(b, self, points)
            self.stages = self.touch.stages
            self.offers.moving_bodies = self.touch if points else None
            return
        rate, phase = "substep" if self.recorded else "frame", "pose" if driving_bodies(b.scene) else "predict"    # followers
        self.stages.append(Stage("rigid bodies", phase, self.advance, launches, self.part.bytes, rate, what))

    def _begin(self, frames: np.ndarray) -> None:
        q = rotation.quat_product(rotation.matrix_quat(frames[:, :3, :3]), np.array([m.axes for m in self.masses]))
        spin = np.array([body.spin for body, _ in self.bodies])
        self.put_turns(rotation.unit_quat(q))
        self.put("p", np.array([m.mass * body.velocity for m, (body, _) in zip(self.masses, self.bodies, strict=True)]))
        self.put("L", self.momentum(rotation.unit_quat(q), spin))

    def put_turns(self, q: np.ndarray, rows=slice(None)) -> None:
        self.put("q", q.astype(self.model.dtype), rows)
        self.put("o", q - q.astype(self.model.dtype), rows)

    def momentum(self, q: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Angular momentum (n, 3) [kg m^2/s] of angular velocities [rad/s]."""
        moments = np.array([m.moments for m in self.masses])
        return rotation.quat_rotate(q, moments * rotation.quat_rotate(rotation.quat_conjugate(q), spin))

    def put(self, name: str, values: np.ndarray, rows=slice(None)) -> None:
        for array, given in ((self.part.arrays.get(name), values), (self.part.arrays.get(f"{name}h"), 0.0 * values)):
            if array is not None:
                now = array.numpy()
                now[rows] = given[rows]
                array.assign(now)

    def read(self, name: str) -> np.ndarray:
        """p or L at the end of a frame, where points are read half a step on too (kernels/rigid/touch/half_step.py)."""
        return self.get(name) + (self.get(f"{name}h") if f"{name}h" in self.part.arrays else 0.0)

    def get(self, name: str) -> np.ndarray:
        """A field of all bodies, float64."""
        return self.part.arrays[name].numpy().astype(np.float64)

    def turns(self) -> np.ndarray:
        """Quaternions (n, 4) from principal axes to the world now."""
        return rotation.unit_quat(self.get("q") + self.get("o"))

    def _tables(self) -> Any:
        m, dtype, real, vec3 = self.model, self.model.dtype, self.model.real, self.part.arrays["x"].dtype
        mass, moments = (np.array([getattr(one, name) for one in self.masses]) for name in ("mass", "moments"))
        columns = {name: np.array([getattr(body, name) for body, _ in self.bodies]) for name in ("drag", "spin_drag")}
        table = fill_struct(self.Bodies, w=m.upload((1.0 / mass).astype(dtype), real),
                            inverse=m.upload((1.0 / moments).astype(dtype), vec3),
                            **{name: m.upload(value.astype(dtype), real) for name, value in columns.items()})
        table.push, table.torque = (m.upload(value.astype(dtype), vec3) for value in (self._push(), self.twist))
        return table

    def lend(self) -> Any:
        """The table without what fluids add to `table` in each frame."""
        from wsim.physics.rigid.touch.own_forces import own_force_table
        self.given = own_force_table(self) if self.given is self.table else self.given
        return self.given

    def _push(self) -> np.ndarray:
        """Weight and force [N], (n, 3)."""
        return np.array([m.mass for m in self.masses])[:, None] * self.gravity[[of for _, of in self.bodies]] + self.force

    def moving(self) -> Any:
        return fill_struct(self.Moving, **{name: self.part.arrays[name] for name in ("x", "e", "q", "o", "p", "L")})

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.joints:
            self.joints.before_frame(time, clock)
        if self.contacts:
            self.contacts.before_frame(time, clock)
        if self.touch:
            self.touch.before_frame()

    def connect_ports(self, others: Methods) -> None:
        if self.touch:
            self.touch.connect_ports(others)

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        foreseen = self.touch.foreseen.find_remedies(self.touch.clock) if self.touch and self.touch.foreseen else []
        return [*(self.contacts.find_remedies(status) if self.contacts else []), *foreseen]

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        return [w for each in (self.contacts, self.joints) if each for w in each.frame_warnings()]

    def prepare_restart(self, fields) -> None:
        own = fields.get(self.bodies[0][0].written, {})
        if self.joints:
            self.joints.prepare_restart(own)
        if self.contacts and len(own.get("a", ())) > self.contacts.room:
            self.contacts.grow(len(own["a"]))

    def forget_worlds(self, worlds: set[int]) -> None:
        if self.contacts:
            self.contacts.broad.forget_contacts(worlds)

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
        back = rotation.quat_conjugate(np.array([m.axes for m in self.masses]))
        R = rotation.quaternion_to_matrix(rotation.quat_product(self.turns(), back))
        found, center = np.tile(np.eye(4), (len(R), 1, 1)), np.array([m.center for m in self.masses])
        found[:, :3, :3] = R
        found[:, :3, 3] = self.origin + self.get("x") + self.get("e") - np.einsum("nij,nj->ni", R, center)
        return found

    def placed(self, path: str) -> np.ndarray:
        """Poses as `poses` has them, of one body in every world."""
        return self.poses()[[body.path == path for body, _ in self.bodies]]

    def spins(self) -> np.ndarray:
        """Angular velocities now, world (n, 3) [rad/s]."""
        q, moments = self.turns(), np.array([m.moments for m in self.masses])
        return rotation.quat_rotate(q, rotation.quat_rotate(rotation.quat_conjugate(q), self.read("L")) / moments)

    def velocities(self) -> np.ndarray:
        """Velocities of the centres of mass now, (n, 3) [m/s]."""
        return self.read("p") / np.array([m.mass for m in self.masses])[:, None]

    def weigh(self, rows: np.ndarray, name: str, value) -> None:
        """Another mass or inertia of bodies, which go on as fast as they are, linear and angular."""
        poses, v, spins = self.turns(), self.velocities(), self.spins()
        for k in rows:
            before = self.masses[k]
            self.masses[k] = now = reweigh_inertia(self.bodies[k][0], before, name, value)
            poses[k] = rotation.quat_product(poses[k], rotation.quat_product(rotation.quat_conjugate(before.axes), now.axes))
        q = rotation.unit_quat(poses)
        self.put_turns(q, rows)
        self.put("p", np.array([m.mass for m in self.masses])[:, None] * v, rows)
        self.put("L", self.momentum(q, spins), rows)
        self.table.w.assign(np.array([1.0 / m.mass for m in self.masses], self.model.dtype))
        self.table.inverse.assign(np.array([1.0 / m.moments for m in self.masses], self.model.dtype))
        self.given.push.assign(self._push().astype(self.model.dtype))
        if self.joints:
            self.joints.weigh(self.masses, {self.bodies[k][1] for k in rows})

    def contact_points(self, clock: Clock) -> list:
        from wsim.physics.rigid.contacts.contact_points import rigid_contact_points
        return [rigid_contact_points(self.contacts, clock.h)] if self.contacts else []

    def samples(self, world: int = 0) -> list[Sample]:
        poses = self.poses()
        for k, (body, _) in enumerate(self.bodies):
            if body.stretch is not None:
                poses[k, :3, :3] = poses[k, :3, :3] @ body.stretch
        own = [(k, body) for k, (body, of) in enumerate(self.bodies) if of == world]
        found: list[Sample] = [TransformSample(body.path, poses[k]) for k, body in own if not body.instancer]
        if len(found) < len(own):
            from wsim.physics.rigid.joints.instances.samples import instancer_samples
            found += instancer_samples(self, poses, [k for k, body in own if body.instancer])
        return found

    def indicators(self, x, v, world: int | None = None) -> dict[str, float]:
        from wsim.physics.rigid.contacts.measure import rigid_indicators
        return rigid_indicators(self, world)

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        hit = np.array([k for k, (body, of) in enumerate(self.bodies) if path in ("/", body.path) and world in (None, of)], int)
        if self.sleep and name in (*LIVE, "gravity"):
            self.sleep.wake_bodies(None if path == "/" else hit)
        if path == "/" and name == "gravity":
            self.gravity[slice(None) if world is None else world] = value
            self.given.push.assign(self._push().astype(self.model.dtype))
            if self.contacts:
                self.contacts.work.g.assign(solids.fall_accelerations(self.gravity).astype(self.model.dtype))
            return True
        if path == "/" or not len(hit) or name not in LIVE:
            return any([other.set_value(path, name, value, world) for other in (self.joints, self.contacts) if other])
        if name in ("velocity", "spin"):
            field = "p" if name == "velocity" else "L"
            now = self.get(field)
            every, mass = np.tile(value, (len(now), 1)), np.array([m.mass for m in self.masses])[:, None]
            now[hit] = (mass * every if field == "p" else self.momentum(self.turns(), every))[hit]
            self.put(field, now, hit)
            if self.joints:
                self.joints.renew_velocities({self.bodies[k][1] for k in hit})
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
    joined = [b.scene.coordinates] if solids.enabled_joints(b.scene) else []
    if not (solids.bodies_touch_points(b.scene) or solids.has_rigid_contacts(b.scene)):
        return ["joints", *joined, *["sleep"] * solids.bodies_may_sleep(b.scene)] if joined else []
    from wsim.physics.rigid.meetings import contact_signature
    return contact_signature(b) + joined
