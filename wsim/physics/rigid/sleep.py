"""Sleep of rigid bodies (kernels/rigid/graph/sleep.py), where a scene asks for it by `sleep_speed` or has some that start so.

A frame in which everything sleeps is not stepped on a CPU, where no collider moves and no joint ever stirs; on a GPU its lists
are made, and its passes have nothing to do. A joint stirs while what it hangs on moves, or where its drive has a speed; another
target, stiffness or damping of a drive wakes its bodies. Scenes with points do not sleep: what wakes bodies there is not known
here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.graph import sleep
from wsim.model.state import StateField, StatePart

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

FIELDS = (StateField("calm", "s", True, "how long the body has been slow, at most what sleep takes", "scalar"),
          StateField("asleep", "", True, "1: it sleeps", "int"))
AWAKE = (StateField("awake", "", True, "0 while every body sleeps", "int"),)
STIRS = 1e-9                 # [m/s], [rad/s] of what joints hang on: slower, it stands, but for rounding


class RigidSleep:
    """Sleep of the bodies of a method. awake: a word on the device, 0 while all sleep; stirs: whether a joint ever does."""

    def __init__(self, b: Build, method):
        self.model, self.part, self.speed = b.model, method.part, b.scene.sleep_speed
        begins = np.array([body.asleep for body, _ in method.bodies])
        values = (begins * float(sleep.CALM), begins)
        for what, value in zip(FIELDS, values, strict=True):
            kind = b.model.dtype if what.type == "scalar" else np.int32
            method.part.take(what, wp.array(value.astype(kind), dtype=what.dtype(b.model.real), device=b.model.device))
        for array, aside in method.part.saved.values():
            wp.copy(aside, array)
        word = StatePart.allocate("rigid sleep", AWAKE, 1, b.model.real, b.model.device)  # a repeated frame starts from it
        b.state.add(word)
        self.awake = word.arrays["awake"]
        self.awake.fill_(1)
        self.kernel: Any = None
        self.counted: Any = None
        self.meets: Any = None
        self.stirs = False
        self.pairs = np.zeros((0, 2), np.int32)          # bodies of the joints of all worlds, -1 for none
        self.driven = np.zeros(0, bool)                  # of joints: a drive has a speed
        self._upload()

    def _upload(self) -> None:
        self.bond = wp.array(np.ascontiguousarray(self.pairs, np.int32), dtype=wp.vec2i, device=self.model.device)
        self.stir = wp.array(self.driven.astype(np.int32), dtype=int, device=self.model.device)

    def join(self, joints) -> None:
        """Takes the joints of the method into the islands (`wsim.physics.rigid.joints.tables.DeviceJoints`)."""
        t = joints.linked.t
        self.pairs = np.stack([t.a.numpy(), t.b.numpy()], axis=1)
        self.driven = ((t.drive.numpy() > 0) & (t.speed.numpy() != 0.0)).any(axis=1)
        if joints.actuators:                             # what its control asks for is not known here
            self.driven |= joints.actuators.stirred
        self.stirs = bool(self.driven.any()) or any(j.motion.moves for j in joints.joints)
        self._upload()

    def hung(self, v: np.ndarray, omega: np.ndarray) -> None:
        """Takes velocities of what joints hang on, (substeps, joints, 3) [m/s], [rad/s], in the frame that comes."""
        moves = (np.maximum(np.abs(v), np.abs(omega)) > STIRS).any(axis=(0, 2)) & (self.pairs.min(axis=1) < 0)
        self.stir.assign((self.driven | moves).astype(np.int32))

    def drive(self, before: np.ndarray, values: np.ndarray) -> None:
        """Wakes the bodies of joints of which a row, (joints, 6), is another one than before."""
        rows = self.pairs[(before != values).any(axis=1)].ravel()
        if len(rows):
            self.wake_bodies(rows[rows >= 0])

    def alone(self) -> Any:
        """Function (dt, bodies, joints, moving) -> asleep: settles what sleeps of islands of joints that meet nothing."""
        from wsim.kernels.rigid.joint.rest import joint_sleep_kernel
        kernel = joint_sleep_kernel(self.model.real, self.model.module)

        def settle_island_sleep(dt: float, bodies, joints, now) -> wp.array:
            calm, asleep = (self.part.arrays[name] for name in ("calm", "asleep"))
            given = [dt, self.speed, bodies, joints.linked.t, self.stir]
            self.model.launch(kernel, joints.islands, given, [now, calm, asleep])
            return asleep
        return settle_island_sleep

    def make(self, form) -> None:
        """Makes its kernels, as the passes of this form are launched."""
        self.form = form
        module = self.model.shared_module("rigid_sleep", form.blocks, threads=form.sizes["threads"])
        self.kernel = sleep.body_sleep_kernel(self.model.real, module, form.meet, **form.sizes)
        self.counted = sleep.restored_count_kernel(self.model.real, self.model.module)
        self.meets = sleep.met_sleeper_kernel(self.model.real, self.model.module)

    def arrays(self, bodies: int) -> dict[str, wp.array]:
        """Arrays that the kernels work on."""
        own = {name: wp.zeros(bodies, dtype=int, device=self.model.device) for name in ("label", "roused")}
        return own | {"calm": self.part.arrays["calm"], "asleep": self.part.arrays["asleep"], "awake": self.awake}

    def settle(self, k: int, time: float, rig) -> None:
        """Settles what sleeps, behind the making of manifolds for `time` [s] from substep k on."""
        self.form.launch(self.kernel, [self.form.threads, k, time, self.speed, rig, self.bond, self.stir], [])

    def wake_met(self, contacts, time: float, made: tuple) -> None:
        """Within a frame: where a body that is awake comes to one that sleeps, its island wakes in the same substep. time [s]:
        for which pairs are listed; made: what manifolds are made of."""
        self.model.launch(self.meets, contacts.room, [contacts.rig()], [])
        wp.capture_if(contacts.broad.stray, self._wake, contacts=contacts, time=time, made=made)

    def _wake(self, contacts, time: float, made: tuple) -> None:
        contacts.list_anew(made[0], time)
        contacts.make_manifolds(*made)
        self.settle(made[0], 0.0, contacts.rig())

    def end(self, room: int, rig) -> None:
        """Ends a frame, behind the substeps."""
        self.model.launch(self.counted, room, [rig], [])

    def wake_bodies(self, rows: np.ndarray | None = None) -> None:
        """Bodies of these rows (None: all) are not calm, and their islands wake."""
        for name in ("calm", "asleep"):
            array = self.part.arrays[name]
            values = array.numpy()
            values[slice(None) if rows is None else rows] = 0
            array.assign(values)
        self.awake.fill_(1)
