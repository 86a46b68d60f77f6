"""What joints do in each substep of a recording, and its adjoint (wsim/physics/rigid/recorded/joint_formulas.py)."""

from dataclasses import fields

import numpy as np
import warp as wp

from wsim.kernels.rigid.joint.parts import jointed_parts
from wsim.kernels.rigid.joint.tables import BOTTOM, DRIVEN, FORCE, HELD, HIGHEST, LIMITED, LOCKED, LOWEST, TOP
from wsim.model.stage import Clock
from wsim.physics.rigid.joints.joint import LIVE
from wsim.physics.rigid.recorded.joint_formulas import JointSubstep, RecordedJointTables
from wsim.physics.rigid.recorded.local import complex_derivatives, residual_values
from wsim.physics.rigid.recorded.rotation import complex_damped_kick
from wsim.physics.rigid.recorded.substep import BodyCotangents, CouplingElements, RecordedBodyValues, substep_vjp, velocity_vjp
from wsim.scene.values.coverage import gradient_refusal


class RecordedJointRows:
    """Tables of joints as the host has them, and their rows in a substep; `recorded` knows the bodies."""

    def __init__(self, recorded):
        self.recorded, self.joints = recorded, recorded.method.joints
        t = self.joints.linked.t
        self.pairs = np.stack([t.a.numpy(), t.b.numpy()], axis=1)
        own = {name: getattr(t, name).numpy() for name in ("apart", "form", "closed", "alone", "cone", "kind", "drive", "low",
                                                           "high", "speed", "most")}
        assert {f.name for f in fields(RecordedJointTables)} == {*own, "at", "turn", "still"}
        self.t = RecordedJointTables(at=(t.at_a.numpy(), t.at_b.numpy()), turn=(t.turn_a.numpy(), t.turn_b.numpy()),
                                     still=self.pairs < 0, **own)

    def read(self, *names: str) -> dict[str, np.ndarray]:
        return {name: getattr(self.joints.linked, name).numpy().copy() for name in names}

    def anchor_poses(self, k: int) -> dict[str, np.ndarray]:
        t = self.joints.linked.t
        return {name: getattr(t, f"anchor_{name}").numpy()[k * t.moving] for name in ("x", "q", "v", "o")}

    def sides(self, values: np.ndarray, still: np.ndarray) -> list[np.ndarray]:
        """Values of a and of b, of numbers of bodies; of sides that are no body those of `still` (joints, size)."""
        return [np.where(side[:, None] >= 0, values[side], still) for side in self.pairs.T]

    def both(self, values: np.ndarray) -> np.ndarray:
        """(joints, 12) of numbers (bodies, 6)."""
        return np.concatenate(self.sides(values, np.zeros((len(self.pairs), 6))), axis=1)

    def pose(self, x: np.ndarray, anchors: dict) -> np.ndarray:
        zero = np.zeros_like(x)
        a, b = self.sides(np.concatenate([x, zero], axis=1), np.concatenate([anchors["x"], 0.0 * anchors["x"]], axis=1))
        return np.concatenate([a, b], axis=1)

    def mass(self, b: RecordedBodyValues) -> np.ndarray:
        table = np.concatenate([b.w[:, None], b.inverse], axis=1)
        return np.concatenate(self.sides(table, np.zeros((len(self.pairs), 4))), axis=1)

    def given(self, anchors: dict) -> np.ndarray:
        """(v, omega) of sides that are no body."""
        v = np.concatenate([anchors["v"], anchors["o"]], axis=1)
        return np.concatenate([np.where(self.t.still[:, s:s + 1], v, 0.0) for s in (0, 1)], axis=1)

    def acting(self, mid: dict, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Rows that act in the end, and those that give all that they have. Raises SceneError for a drive at a limit."""
        t, whole = self.t, mid["broken"][:, None] == 0
        acts = np.where((t.kind == int(LOCKED)) & whole, int(HELD), 0)
        ends = (t.kind == int(LIMITED)) & whole
        acts = np.where(ends & (mid["hold"] > 0.0), int(LOWEST), np.where(ends & (mid["hold"] < 0.0), int(HIGHEST), acts))
        drives = (t.drive >= int(FORCE)) & whole
        full = drives & (np.abs(mid["push"]) >= (0.5 - 1.0e-12) * h * t.most)
        if (both := drives & (acts > 0)).any():
            j = self.joints.joints[int(np.argwhere(both)[0, 0]) % len(self.joints.joints)]
            raise gradient_refusal("driven", j.path)
        return np.where(drives & ~full, int(DRIVEN), acts), full

    def constants(self, h: float, kept: dict, acts: np.ndarray, full: np.ndarray) -> JointSubstep:
        first, last = kept["anchors"]
        q = self.sides(kept["begin"].q, first["q"])
        Q = self.sides(kept["end"].q, last["q"])
        return JointSubstep(self.t, h, (q[0], q[1]), (Q[0], Q[1]), kept["mid"]["quarters"], self.given(first), acts, full)

    def held(self, h: float, kept: dict, b: RecordedBodyValues) -> CouplingElements:
        mid, t = kept["mid"], self.joints.linked.t
        acts, full = self.acting(mid, h)
        one = self.constants(h, kept, acts, full)
        values = {"pose": self.pose(kept["begin"].x, kept["anchors"][0]), "then": self.pose(kept["end"].x, kept["anchors"][1]),
                  "momentum": self.both(kept["momentum"]), "placing": self.both(b.placing), "f": mid["hold"] + mid["push"],
                  "begun": self.both(kept["begin"].momentum), "mass": self.mass(b),
                  **{name: getattr(t, name).numpy() for name in LIVE}}
        self.look(residual_values(one.held, values)[acts != int(DRIVEN)])
        return CouplingElements(self.pairs, complex_derivatives(one.held, values))

    def loosed(self, h: float, kept: dict, b: RecordedBodyValues) -> CouplingElements:
        mid, last, t = kept["mid"], kept["last"], self.joints.linked.t
        full = (self.t.kind == int(LIMITED)) & (mid["hold"] != 0.0) & (last["hold"] == 0.0)
        held = np.isin(last["active"], (int(HELD), int(LOWEST), int(HIGHEST))) & ~full
        acts = np.where(held, int(HELD), np.where(last["active"] == int(DRIVEN), int(DRIVEN), 0))
        one = self.constants(h, kept, acts, full | np.isin(last["active"], (int(TOP), int(BOTTOM))))
        before = mid["hold"] + mid["push"]
        values = {"then": self.pose(kept["end"].x, kept["anchors"][1]), "momentum": self.both(kept["end"].momentum),
                  "f": last["hold"] + last["push"] - before, "before": before, "mass": self.mass(b),
                  "origin": self.pose(kept["begin"].x, kept["anchors"][0]), "begun": self.both(kept["begin"].momentum),
                  **{name: getattr(t, name).numpy() for name in LIVE}}
        self.look(residual_values(one.loosed, values))
        return CouplingElements(self.pairs, complex_derivatives(one.loosed, values))

    def look(self, left: np.ndarray) -> None:
        self.recorded.left = max(self.recorded.left, float(np.abs(left).max(initial=0.0)))

    def collected(self, total: BodyCotangents) -> dict[str, np.ndarray]:
        """Gradients by tables of bodies, and by "joint stiffness" and others (joints, 6)."""
        found = dict(total.bodies)
        for name in ("held", "loosed"):
            mass = total.by.get((name, "mass"))
            if mass is not None:
                for s in (0, 1):
                    on = self.pairs[:, s] >= 0
                    found["w"] = found["w"].reshape(-1).copy()
                    np.add.at(found["w"], self.pairs[on, s], mass[on, 4 * s])
                    found["inverse"] = found["inverse"].copy()
                    np.add.at(found["inverse"], self.pairs[on, s], mass[on, 4 * s + 1:4 * s + 4])
        return found | {f"joint {name}": total.by["held", name] + total.by["loosed", name]
                        for name in LIVE if ("held", name) in total.by}


class RecordedJoints(RecordedJointRows):
    """Substeps of joints alone."""

    def __init__(self, recorded):
        super().__init__(recorded)
        self.held_kernel, self.loosed_kernel = jointed_parts(recorded.model.real, recorded.model.module)

    def step(self, clock: Clock, kept: dict | None) -> None:
        """A substep; kept: what its adjoint asks for, or None."""
        r = self.recorded
        given = [wp.vec3i(clock.k, clock.k + 1, self.joints.sweeps), clock.h, r.method.table, self.joints.linked]
        now = r.method.moving()
        r.model.launch(self.held_kernel, self.joints.islands, given, [now])
        if kept is not None:
            kept["momentum"] = r.state().momentum
            kept["mid"] = self.read("hold", "push", "broken", "quarters")
        r.model.launch(self.loosed_kernel, self.joints.islands, given, [now])
        if kept is not None:
            kept["last"] = self.read("hold", "push", "active")
            kept["anchors"] = self.anchor_poses(clock.k), self.anchor_poses(clock.k + 1)

    def back(self, h: float, kept: dict, cot: BodyCotangents) -> None:
        r = self.recorded
        n = r.method.part.count
        b = r.bodies(kept["begin"], kept["end"], kept["momentum"], np.ones(n))
        b.placing = kept["momentum"] + half_kick_difference(b, h)
        f = velocity_vjp({"loosed": self.loosed(h, kept, b)}, n, cot)["loosed"]
        first = substep_vjp({"held": self.held(h, kept, b)}, b, h, cot, {"held": f})
        cot.pose += first
        for kind in ("held", "loosed"):
            for name, into in (("origin", cot.pose), ("begun", cot.momentum)):
                if (more := cot.by.pop((kind, name), None)) is not None:
                    for s in (0, 1):
                        on = self.pairs[:, s] >= 0
                        np.add.at(into, self.pairs[on, s], more[on, 6 * s:6 * s + 6])


def half_kick_difference(b: RecordedBodyValues, h: float) -> np.ndarray:
    """Part of the kick of the forces that bodies are not placed by (n, 6)."""
    p, L = b.momentum[:, :3], b.momentum[:, 3:]
    parts = [complex_damped_kick(p, b.push, b.drag, t)
             for t in (0.5 * h, h)] + [complex_damped_kick(L, b.torque, b.spin_drag, t) for t in (0.5 * h, h)]
    return b.placed[:, None] * np.concatenate([parts[0] - parts[1], parts[2] - parts[3]], axis=1)
