"""MuJoCo on a scene of problems.py, on a CPU: PEER_PYTHON tools/bench/rigid/run_mujoco.py SCENE.json SETTING.json OUT.npz

Setting: steps a frame; integrator, cone, solref [s, 1] and iterations where they are not MuJoCo's own. Restitution is what its
contacts have: a spring and damper of the ratio that throws back e of the speed, `solref` of negative numbers, twenty steps to a
period.
"""

import sys
from math import log, pi
from pathlib import Path

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from tools.bench.rigid.clock import main  # noqa: E402


def numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def bouncing(e: float, h: float) -> list[float]:
    """solref of restitution e."""
    zeta, w = -log(e) / (pi**2 + log(e)**2) ** 0.5, 2.0 * pi / (20.0 * h)
    return [-w * w, -2.0 * zeta * w]


def document(scene: dict, setting: dict) -> str:
    h = 1.0 / (scene["fps"] * setting["steps"])
    solref = setting.get("solref") or (bouncing(scene["restitution"], h) if scene["restitution"] else None)
    own = {name: setting[name] for name in ("integrator", "cone", "iterations") if name in setting}
    ground = ""
    if scene["ground"]:
        ground = '<geom type="plane" size="0 0 1" pos="{}" zaxis="{}"/>'.format(*map(numbers, scene["ground"]))
    bodies, joints = [], []
    for k, b in enumerate(scene["bodies"]):
        x, y, z, w = b["turn"]
        contype = "" if scene.get("touch", True) else ' contype="0" conaffinity="0"'
        shape = f'<geom type="{b["shape"]}" size="{numbers(b["size"])}"{contype}/>' if b["shape"] else ""
        bodies.append(f'<body name="b{k}" pos="{numbers(b["at"])}" quat="{numbers((w, x, y, z))}"><freejoint/>'
                      f'<inertial pos="0 0 0" mass="{b["mass"]!r}" diaginertia="{numbers(b["moments"])}"/>{shape}</body>')
    for j in scene["joints"]:
        a, b = j["bodies"]
        anchor = np.array(j["point"]) - scene["bodies"][b]["at"]
        other = "world" if a < 0 else f"b{a}"
        joints.append(f'<connect body1="b{b}" body2="{other}" anchor="{numbers(anchor)}"/>')
    return (f'<mujoco><option timestep="{h!r}" gravity="{numbers(scene["gravity"])}"'
            + "".join(f' {name}="{value}"' for name, value in own.items()) + "/>"
            f'<default><geom friction="{scene["friction"]} 0 0"' + (f' solref="{numbers(solref)}"' if solref else "")
            + f"/></default><worldbody>{ground}{''.join(bodies)}</worldbody><equality>{''.join(joints)}</equality></mujoco>")


class Run:
    def __init__(self, scene: dict, setting: dict, device: str):
        self.model = mujoco.MjModel.from_xml_string(document(scene, setting))
        self.data, self.steps, n = mujoco.MjData(self.model), setting["steps"], len(scene["bodies"])
        self.data.qvel.reshape(n, 6)[:, :3] = [b["velocity"] for b in scene["bodies"]]
        self.data.qvel.reshape(n, 6)[:, 3:] = [turned(np.array(b["turn"]) * (-1, -1, -1, 1), np.array(b["spin"]))
                                               for b in scene["bodies"]]
        self.n, self.facts = n, {"version": mujoco.__version__, "precision": "float64"}

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data, self.steps)

    def state(self) -> dict:
        q, v = self.data.qpos.reshape(self.n, 7).copy(), self.data.qvel.reshape(self.n, 6).copy()
        turn = q[:, [4, 5, 6, 3]]
        spins = np.array([turned(a, b) for a, b in zip(turn, v[:, 3:], strict=True)])
        return {"x": q[:, :3], "q": turn, "v": v[:, :3], "w": spins}


def turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    t = 2.0 * np.cross(q[:3], v)
    return v + q[3] * t + np.cross(q[:3], t)


if __name__ == "__main__":
    main(Run)
