"""wsim on a scene of problems.py: python tools/bench/rigid/run_wsim.py SCENE.json SETTING.json OUT.npz [--device cuda:0|cpu]

Setting: substeps and iterations, the scene's own where they are left out; precision.
"""

import sys
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from tools.bench.rigid.clock import main  # noqa: E402
from wsim.geometry.rotation import matrix_quat, quaternion_to_matrix  # noqa: E402
from wsim.physics.rigid.joints.joint import LOCKED, SHIFTS, joint_between  # noqa: E402
from wsim.physics.rigid.objects import Body  # noqa: E402
from wsim.scene import Box, Collider, Plane, Scene, Sphere  # noqa: E402
from wsim.scene.curve import Motion  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402


def frame(at, turn=(0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = quaternion_to_matrix(np.array(turn)), at
    return M


def leaning(n) -> np.ndarray:
    """Rotation (3, 3) of z to n."""
    x = np.cross((0.0, 1.0, 0.0) if abs(n[1]) < 0.9 else (0.0, 0.0, 1.0), n)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(n, x), n], axis=1)


def scene_of(data: dict, setting: dict) -> Scene:
    own = {name: setting[name] for name in ("substeps", "iterations") if name in setting}
    scene = Scene(gravity=tuple(data["gravity"]), up="Z", fps=data["fps"], frames=data["frames"], **own)
    rub = {"static_friction": data["friction"], "dynamic_friction": data["friction"], "restitution": data["restitution"]}
    if data["ground"]:
        at, normal = map(np.array, data["ground"])
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = leaning(normal), at
        scene.collider("/ground", Plane(), motion=Motion.still(M), **rub)
    for k, b in enumerate(data["bodies"]):
        shape = {"box": lambda s: Box(tuple(s)), "sphere": lambda s: Sphere(s[0])}.get(b["shape"])
        meets = data.get("touch", True)
        own_shape = [Collider(f"/body{k}/shape", shape(b["size"]), meets=meets, **rub)] if shape else []
        scene.add(Body(f"/body{k}", own_shape, Motion.still(frame(b["at"], b["turn"])), b["velocity"], b["spin"],
                       mass=b["mass"], center=np.zeros(3), inertia=b["moments"]))
    bodies = scene.things("Body")
    for k, j in enumerate(data["joints"]):
        sides = [bodies[number] if number >= 0 else None for number in j["bodies"]]
        scene.add(joint_between(f"/joint{k}", *sides, at=j["point"], limits=dict.fromkeys(SHIFTS, LOCKED)))
    return scene


class Run:
    def __init__(self, data: dict, setting: dict, device: str):
        wp.config.log_level = wp.LOG_WARNING
        self.sim = Simulation(scene_of(data, setting), device=device, precision=setting.get("precision", "float32"))
        self.method = self.sim.plan.method("rigid")
        self.facts = {"version": wp.config.version, "precision": setting.get("precision", "float32"),
                      "ran": self.sim.plan.clock.substeps, "warnings": self.sim.warnings}

    def step(self) -> None:
        self.sim.step()
        wp.synchronize_device(self.sim.device)

    def state(self) -> dict:
        M = self.method.poses()
        return {"x": M[:, :3, 3], "q": matrix_quat(M[:, :3, :3]), "v": self.method.velocities(), "w": self.method.spins()}


if __name__ == "__main__":
    main(Run)
