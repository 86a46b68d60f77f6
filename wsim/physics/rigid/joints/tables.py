"""Joints on the device: their tables, the part "joints" of the state, the poses of what they are fixed to."""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.rigid.joint import tables
from wsim.model.stage import Clock
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.aims import DriveTargets, varying_drive_targets
from wsim.physics.rigid.joints.device_rows import (
    device_rows,
    drop_cone,
    inverse_cone_angles,
    joint_form_code,
    joint_row_columns,
    rename_twist_axis,
)
from wsim.physics.rigid.joints.islands import elimination_order
from wsim.physics.rigid.joints.joint import AXES, LIVE, Joint
from wsim.physics.rigid.joints.joint import DISTANCE as LENGTH

FIELDS = (StateField("quarters", "", True, "quarter turns of the twist, counted on", "int"),
          StateField("broken", "", True, "1: it broke", "int"))
SWEEPS = 4                  # at least: of the places that velocities lead to, which are not linear in them
ONE = np.array([0.0, 0.0, 0.0, 1.0])


class DeviceJoints:
    """The joints of a method (wsim/physics/rigid/method.py): `linked` is the struct, `islands` how many there are."""

    reduced = False                                           # True: coordinates are those of joints

    def __init__(self, b, method):
        self.model, self.method, self.device = b.model, method, b.model.device
        self.given = [joint for joint in b.scene.things("Joint") if joint.enabled]
        rows = {body.path: k for k, body in enumerate(b.scene.things("Body"))}
        parts = [(k, part, rename_twist_axis(part)) for k, joint in enumerate(self.given)
                 for part in device_rows(drop_cone(joint))]
        self.every = [(k, j, dict(zip(part.drives, j.drives, strict=True))) for k, part, j in parts]     # drives by new names
        pairs = np.array([[rows.get(j.body0, -1), rows.get(j.body1, -1)] for _, j, _ in self.every], int).reshape(-1, 2)
        one = elimination_order(pairs, len(rows))
        self.order_of = one.joint
        self.joints, self.pairs = [self.every[k][1] for k in one.joint], pairs[one.joint]
        self.closed, self.single = one.closed(self.pairs), one.single()
        worlds = b.model.worlds
        self.order = one.repeat_for_worlds(worlds, len(rows))
        self.count, self.islands = len(self.joints) * worlds, len(self.order.first_joint) - 1
        self.part = StatePart.allocate("joints", FIELDS, self.count, b.model.real, self.device, max(1, self.count))
        path, n = b.scene.things("Body")[0].written, len(self.joints)             # joints have no samples: they go with a body
        self.part.rows = {(path, world): np.arange(n) + world * n for world in range(worlds)}
        self.sweeps = max(SWEEPS, b.scene.iterations)
        self._tables(worlds)
        self.known: tuple = ()
        self.ignored = ""                                     # said once: what these coordinates cannot have
        self.settle: Any = None
        self.aims = DriveTargets(self, found) if (found := varying_drive_targets(b.scene)) else None
        self.actuators: Any = None
        if any(a.joint in {joint.path for joint in self.given} for a in b.scene.things("Actuator")):
            from wsim.physics.rigid.joints.actuators.controls import DeviceActuators
            self.actuators = DeviceActuators(self, b.scene)
            self.actuators.enter(self.linked)

    @property
    def followed(self) -> set[tuple[str, str]] | None:
        """(path, name) of values that follow curves in each substep."""
        return {name for each in (self.aims, self.actuators) if each for name in each.names} or None

    def _to_device(self, values, dtype):
        values = np.ascontiguousarray(values, np.int32 if dtype is int else np.float64)
        return self.model.upload(values, dtype) if values.size else wp.zeros(values.shape[:1], dtype=dtype, device=self.device)

    def _tables(self, worlds: int) -> None:
        up, order, n = self._to_device, self.order, len(self.joints)
        joints, pairs = (self.joints, self.pairs) if n else ([Joint("")], np.array([[-1, -1]]))     # a row, which is not read
        Joints, Linked = tables.joint_table_structs()
        origin, masses, bodies = self.method.origin, self.method.masses, len(self.method.bodies)
        per = bodies // worlds

        def tiled(values, dtype):
            return up(np.concatenate([np.asarray(values)] * worlds), dtype)
        sides = self.side_frames(masses) or [(np.zeros(3), ONE)] * 2
        self.anchor = np.array([_anchor_origin(j) for j in joints])
        from_to = [[origin[row] if row >= 0 else self.anchor[k] for row in pair] for k, pair in enumerate(pairs)]
        body = [np.where(pairs[:, s] < 0, -1, pairs[:, s] + per * w) for w in range(worlds) for s in (0, 1)]
        rows = [joint_row_columns(j) for j in joints]
        shape = {name: tiled([r[name] for r in rows], int if name in ("kind", "drive") else wp.float64) for name in rows[0]}
        lists = {name: up(getattr(order, name), int)
                 for name in ("first_joint", "first_body", "body", "first_near", "near", "first_target")}
        t = fill_struct(Joints, a=up(np.concatenate(body[0::2]), int), b=up(np.concatenate(body[1::2]), int),
                        at_a=tiled([s[0] for s in sides[0::2]], wp.vec3d), at_b=tiled([s[0] for s in sides[1::2]], wp.vec3d),
                        turn_a=tiled([s[1] for s in sides[0::2]], wp.quatd),
                        turn_b=tiled([s[1] for s in sides[1::2]], wp.quatd), apart=tiled([b - a for a, b in from_to], wp.vec3d),
                        form=tiled([joint_form_code(j) for j in joints], int), closed=tiled(self.closed, int),
                        alone=tiled(self.single, int), cone=tiled([inverse_cone_angles(j) for j in joints], wp.vec2d),
                        breaking=tiled([(j.force, j.torque) for j in joints], wp.vec2d),
                        w=up([1.0 / m.mass for m in masses], wp.float64),
                        linked=up(np.isin(np.arange(bodies), np.concatenate(body)), int), target_block=up(order.target, int),
                        **shape, **lists)
        self.linked = fill_struct(Linked, t=t, quarters=self.part.arrays["quarters"], broken=self.part.arrays["broken"],
                                  **self._allocate_joint_work(n * worlds, bodies))

    def side_frames(self, masses: list) -> list[tuple[np.ndarray, np.ndarray]]:
        """Frames of all joints of the first world on a, then b, one joint after the other."""
        return [_joint_frame_in_body(j, k, masses, row) for j, pair in zip(self.joints, self.pairs, strict=True)
                for k, row in enumerate(pair)]

    def weigh(self, masses: list, changed: set[int]) -> None:
        """Other masses, moments and principal axes of the bodies, in the worlds that have changed."""
        t, worlds = self.linked.t, self.model.worlds
        t.w.assign(np.array([1.0 / m.mass for m in masses]))
        every = [self.side_frames(masses[w * len(masses) // worlds:]) for w in range(worlds)]
        for k, name in enumerate(("a", "b")):
            getattr(t, f"at_{name}").assign(np.array([s[0] for sides in every for s in sides[k::2]]))
            getattr(t, f"turn_{name}").assign(np.array([s[1] for sides in every for s in sides[k::2]]))

    def set_value(self, path: str, name: str, value, world: int | None) -> bool:
        """Stiffness, damping, target or speed of the drives of a joint; the control of an actuator."""
        if self.actuators and self.actuators.set_value(path, name, value, world):
            return True
        rows = self.drives(path, world) if name in (*LIVE, "speed") else []
        if rows:
            array = getattr(self.linked.t, name)
            values = np.array(array.numpy())
            before, each = values.copy(), np.broadcast_to(np.asarray(value, np.float64), len(rows[0]))
            for row in rows:
                values[tuple(np.array(row).T)] = each
            array.assign(values)
            if self.aims:
                self.aims.leave(path, name, world)
            if self.method.sleep:
                self.method.sleep.drive(before, values)
        return bool(rows)

    def drives(self, path: str, world: int | None = None) -> list[list[tuple[int, int]]]:
        """(joint, coordinate) of the drives of a joint, in the order of `Joint.driven`, of a world or of all."""
        every = (*AXES, LENGTH)
        one = sorted((every.index(name), j, 0 if of == LENGTH else AXES.index(of)) for j, k in enumerate(self.order_of)
                     if self.every[k][1].path == path for name, of in self.every[k][2].items())
        n, worlds = len(self.joints), range(self.model.worlds) if world is None else [world]
        return [[(j + w * n, row) for _, j, row in one] for w in worlds] if one else []

    def _allocate_joint_work(self, n: int, bodies: int) -> dict[str, Any]:
        def zeros(shape, dtype=wp.float64):
            return wp.zeros(shape, dtype=dtype, device=self.device)
        found = {name: zeros((n, 6)) for name in ("now", "hold", "push", "soft", "give", "limit", "rhs", "under", "over",
                                                  "much", "change", "turned", "ease")}
        found |= {name: zeros((n, 6), wp.vec2d) for name in ("early", "beside")} | {"late": zeros((n, 6), wp.vec4d)}
        found |= {name: zeros(bodies, wp.vec3d) for name in ("X", "p", "L", "dp", "dL", "P", "T")}
        found |= {name: zeros(n, wp.mat33d) for name in ("axis", "turn")}
        return found | {"Q": zeros(bodies, wp.quatd), "S": zeros(bodies, wp.mat33d), "touched": zeros(bodies, int),
                        "r_a": zeros(n, wp.vec3d), "r_b": zeros(n, wp.vec3d), "given": zeros(n),
                        **{name: zeros((n, 6), int) for name in ("active", "next")}, "block": zeros(36 * self.order.blocks)}

    def before_frame(self, time: float, clock: Clock) -> None:
        """Uploads the poses of anchors at the substeps of a frame; still ones once; what drives are asked for."""
        if not self.joints:
            return
        for each in filter(None, (self.aims, self.actuators)):
            each.before_frame(time, clock)
        self.method.evaluates["anchors"] = [j.path for j in self.joints if j.motion.moves]
        moves = bool(self.method.evaluates["anchors"])
        known = (clock.substeps, tuple(id(j.motion) for j in self.joints))
        if self.known == known and not moves:
            return
        rows, h, n = clock.substeps + 1 if moves else 1, clock.h, len(self.joints)
        M = np.array([j.motion.sampled(time + h * np.arange(rows + moves)) for j in self.joints]).swapaxes(0, 1)
        local = [(j.at0, j.turn0) if a < 0 else (j.at1, j.turn1) for j, (a, _) in zip(self.joints, self.pairs, strict=True)]
        q = rotation.quat_product(rotation.matrix_quat(M[:, :, :3, :3]), np.array([turn for _, turn in local]))
        x = np.einsum("knij,nj->kni", M[:, :, :3, :3], np.array([at for at, _ in local])) + M[:, :, :3, 3] - self.anchor
        v, omega = np.zeros_like(x), np.zeros_like(x)
        if moves:
            v, omega = (x[1:] - x[:-1]) / h, rotation.angular_velocity_between(q[:-1], q[1:], h)
        worlds = self.model.worlds
        values = [np.tile(each[:rows], (1, worlds, 1)) for each in (x, q, v, omega)]
        t, names = self.linked.t, ("anchor_x", "anchor_q", "anchor_v", "anchor_o")
        if self.method.sleep:
            if self.known not in ((), known):
                self.method.sleep.wake_bodies()
            self.method.sleep.hung(np.tile(v, (1, worlds, 1)), np.tile(omega, (1, worlds, 1)))
        if self.known != known:
            t.moving = int(moves)
            for name, dtype in zip(names, (wp.vec3d, wp.quatd, wp.vec3d, wp.vec3d), strict=True):
                setattr(t, name, wp.zeros((rows, n * worlds), dtype=dtype, device=self.device))
            self.linked.t = t
            self.known = known
        for name, value in zip(names, values, strict=True):
            getattr(t, name).assign(np.ascontiguousarray(value))

    def renew_velocities(self, changed: set[int]) -> None:
        """Momenta of bodies were set, in the worlds that have changed."""

    def prepare_restart(self, fields: dict[str, np.ndarray]) -> None:
        """Goes on from fields of the first body."""

    def colour_nodes(self, rows: np.ndarray) -> np.ndarray:
        """Of rows of bodies those whose colours their contacts share."""
        return rows.astype(np.int32)

    def contact_form(self, contacts) -> Any:
        """The `ContactPassForm` that these joints need, None: any."""
        return None

    def contact_arrays(self, room: int) -> dict[str, Any]:
        """What these joints' kernels note of so many manifolds, by name in their table."""
        return {}

    def with_contacts(self, work) -> Any:
        """`linked`, knowing which bodies contacts have touched."""
        self.linked.touched = work.touched
        return self.linked

    def alone(self):
        """Kernel of islands whose bodies touch nothing."""
        from wsim.kernels.rigid.joint.steps import joint_substep_kernel
        self.settle = self.method.sleep.alone() if self.method.sleep else None
        return joint_substep_kernel(self.model.real, self.model.module)

    def advance(self, kernel, clock: Clock, bodies, now) -> None:
        """All substeps of a frame by that kernel."""
        steps = wp.vec3i(0, clock.substeps, self.sweeps)
        asleep = self.settle(clock.dt, bodies, self, now) if self.settle else None
        self.model.launch(kernel, self.islands, [steps, clock.h, bodies, self.linked, asleep], [now])

    def passes(self):
        """Function (name, what is given, contacts) that launches a pass of the islands (kernels/rigid/joint/passes.py)."""
        from wsim.kernels.rigid.joint.passes import MODULES, joint_pass_kernels
        kernels = joint_pass_kernels(self.model.real, *map(self.model.shared_module, MODULES))

        def launch_joint_pass(name: str, given, contacts) -> None:
            given = given if isinstance(given, tuple) else (given,)
            self.model.launch(kernels[name], self.islands, [*given, contacts.rig(), self.with_contacts(contacts.work)], [])
        return launch_joint_pass

    def stored_energy(self, world: int = 0) -> float:
        """Kinetic energy [J] of a world that bodies do not have."""
        return 0.0

    def frame_warnings(self) -> list[tuple[tuple, float, str]]:
        said, self.ignored = self.ignored, ""                 # once
        return [(("joints", "ignored"), 0.0, said)] if said else []

    @property
    def what(self) -> str:
        linked = int((np.diff(self.order.first_joint) > 0).sum())
        return f"{self.count} joints in {linked} islands"

    def of_world(self, rows: np.ndarray, world: int | None) -> np.ndarray:
        """The rows of one world, world behind world; None: all."""
        each = len(rows) // self.model.worlds
        return rows if world is None else rows[world * each:(world + 1) * each]

    def indicators(self, world: int | None = None) -> dict[str, float]:
        shift, turn = self.error(world)
        broken = int(self.of_world(self.linked.broken.numpy(), world).sum())
        return {"joint_error": shift, "joint_angle_error": turn} | ({"joints_broken": float(broken)} if broken else {})

    def error(self, world: int | None = None) -> tuple[float, float]:
        """Error of locked coordinates now, at most: [m], [rad]; of one world, or of all."""
        now, kind, low = (self.of_world(a.numpy(), world) for a in (self.linked.now, self.linked.t.kind, self.linked.t.low))
        off = np.where(kind == int(tables.LOCKED), np.abs(now - low), 0.0)
        whole = self.of_world(self.linked.broken.numpy(), world) == 0
        return float(off[whole, :3].max(initial=0.0)), float(off[whole, 3:].max(initial=0.0))


def _anchor_origin(joint: Joint) -> np.ndarray:
    """What places of an anchor are measured from: where its frame is at the start."""
    M = joint.motion.at(0.0)
    at = joint.at0 if not joint.body0 else joint.at1
    return M[:3, :3] @ at + M[:3, 3]


def _joint_frame_in_body(joint: Joint, side: int, masses: list, row: int) -> tuple[np.ndarray, np.ndarray]:
    """(place from the centre of mass, quaternion) in principal axes."""
    at, q = (joint.at0, joint.turn0) if side == 0 else (joint.at1, joint.turn1)
    if row < 0:
        return np.zeros(3), ONE
    back = rotation.quat_conjugate(masses[row].axes)
    return rotation.quat_rotate(back, at - masses[row].center), rotation.unit_quat(rotation.quat_product(back, q))
