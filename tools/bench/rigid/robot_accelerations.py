"""Accelerations of robots of MJCF and URDF files: MuJoCo's own load of a file beside the scene that `wsim new robot` makes.

    python -m tools.bench.rigid.robot_accelerations FILE.xml FILE.urdf ...

Needs `pip install mujoco`, and the environment of `wsim new robot` (WSIM_ROBOTS). Three poses within the limits: that of the
file, and two random ones with random speeds. Contacts, limits, couplings and dry friction are off (MuJoCo's `qacc_smooth`);
springs, dampers, rotors and actuators with a control of 0 are on. Compared are the second derivatives of places and rotation
matrices of all bodies, by differences of order 6 along the motion, so that it does not matter which coordinates a program has.

    off     largest difference, over the largest acceleration of a place (g at least), or of a matrix (1 rad/s^2 at least)
"""

import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import wsim  # noqa: E402
from wsim.geometry import rotation  # noqa: E402
from wsim.scene import SceneError  # noqa: E402
from wsim.usd.new.robot import author_robot  # noqa: E402

STEP, STENCIL = 4e-3, {0: -49 / 18, 1: 3 / 2, 2: -3 / 20, 3: 1 / 90}       # [s], of the second derivative
SEEDS, NEAR = 3, 1e-4                                                          # [m] between the same body in both programs


def second_derivative(path) -> np.ndarray:
    return sum(c * (path(k * STEP) + path(-k * STEP)) / (1 + (k == 0)) for k, c in STENCIL.items()) / STEP**2


def mujoco_model(file: str) -> mujoco.MjModel:
    """MuJoCo's model; of a URDF file without its meshes, which are seldom there."""
    if file.endswith(".xml"):
        model = mujoco.MjModel.from_xml_path(file)
    else:
        root = ElementTree.parse(file).getroot()
        for link in root.iter("link"):
            for part in [*link.findall("visual"), *(c for c in link.findall("collision") if c.find(".//mesh") is not None)]:
                link.remove(part)
        ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", fusestatic="false")
        model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root).decode())
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return model


def wsim_scene(file: str, place: str) -> wsim.Scene:
    """What is compared of it: nothing touches, and couplings are off."""
    author_robot(file, f"{place}/robot.usda")
    scene = wsim.load(f"{place}/robot.usda")
    for joint in scene.things("Joint"):
        joint.mimics = {}
    for body in scene.things("Body"):
        for collider in body.colliders:
            collider.meets = False
    return replace(scene, coordinates="reduced", colliders=[])


class MujocoRobot:
    """A robot in MuJoCo, at random coordinates and speeds."""

    def __init__(self, model: mujoco.MjModel, generator, still: bool):
        self.model, self.data, self.other = model, mujoco.MjData(model), mujoco.MjData(model)
        way = generator.normal(size=model.nv) * (0.0 if still else 0.3)
        for j in np.flatnonzero(model.jnt_limited) if not still else ():
            if model.jnt_type[j] >= int(mujoco.mjtJoint.mjJNT_SLIDE):
                way[model.jnt_dofadr[j]] = generator.uniform(*model.jnt_range[j]) - model.qpos0[model.jnt_qposadr[j]]
        mujoco.mj_integratePos(model, self.data.qpos, way, 1.0)
        self.data.qvel[:] = 0.0 if still else generator.normal(size=model.nv)
        mujoco.mj_forward(model, self.data)

    def frames(self, data) -> np.ndarray:
        """Places and rotations of bodies (bodies, 3, 4)."""
        return np.concatenate([data.xpos[:, :, None], data.xmat.reshape(-1, 3, 3)], 2)

    def path(self, t: float) -> np.ndarray:
        self.other.qpos[:] = self.data.qpos
        mujoco.mj_integratePos(self.model, self.other.qpos, self.data.qvel * t + 0.5 * self.data.qacc_smooth * t * t, 1.0)
        mujoco.mj_kinematics(self.model, self.other)
        return self.frames(self.other)

    def velocity(self, k: int) -> np.ndarray:
        """Spin and velocity of the centre of mass of body k (6,)."""
        found = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, k, found, 0)
        return found


def rows_of_bodies(scene: wsim.Scene, model: mujoco.MjModel) -> list[int]:
    """MuJoCo's number of each body: by name where names agree, else by place. Raises ValueError where there is none."""
    data, found = mujoco.MjData(model), list[int]()
    mujoco.mj_kinematics(model, data)
    for body in scene.things("Body"):
        at = body.motion.at(0.0)[:3, 3]
        near = [k for k in range(1, model.nbody) if k not in found and np.abs(data.xpos[k] - at).max() < NEAR]
        named = [k for k in near if model.body(k).name == body.path.rpartition("/")[2]]
        if not near:
            raise ValueError(f"no body of MuJoCo stands where {body.path} does")
        found.append((named or near)[0])
    return found


def moved_scene(scene: wsim.Scene, robot: MujocoRobot, rows: list[int]) -> wsim.Scene:
    """The scene with bodies as MuJoCo's stand and move."""
    frames, bodies = robot.frames(robot.data), []
    for body, k in zip(scene.things("Body"), rows, strict=True):
        M, v = np.eye(4), robot.velocity(k)
        M[:3, 3], M[:3, :3] = frames[k][:, 0], frames[k][:, 1:]
        bodies.append(replace(body, motion=wsim.Motion.still(M), spin=v[:3], velocity=v[3:]))
    return replace(scene, objects={**scene.objects, "Body": bodies})


def wsim_accelerations(scene: wsim.Scene) -> tuple[list[str], np.ndarray]:
    """(paths of links, second derivatives of their frames (links, 3, 4))."""
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    trees = simulation.plan.method("rigid").joints
    trees._project_momenta()
    tree, links = wsim.JointTree(scene), trees.links
    q, qd, qdd = tree.start, trees.qd.numpy().copy(), trees.accelerations().copy()

    def path(t: float) -> np.ndarray:
        step, found = qd * t + 0.5 * qdd * t * t, q.copy()
        for link, slides in enumerate(links.slides):
            c, d = links.first_coordinate[link], links.first_dof[link]
            n = slides if links.ball[link] else links.first_dof[link + 1] - d
            found[c:c + n] += step[d:d + n]
            if links.ball[link]:
                turn = rotation.quaternion_exponential(step[d + n:d + n + 3])
                found[c + n:c + n + 4] = rotation.quat_product(q[c + n:c + n + 4], turn)
        poses = tree.poses(found)
        return np.array([poses[name][0, :3][:, [3, 0, 1, 2]] for name in tree.bodies])
    return tree.bodies, second_derivative(path)


def compare(file: str) -> str:
    model = mujoco_model(file)
    with tempfile.TemporaryDirectory() as place:
        scene = wsim_scene(file, place)
    rows, generator, worst = rows_of_bodies(scene, model), np.random.default_rng(1), 0.0
    number = {body.path: k for body, k in zip(scene.things("Body"), rows, strict=True)}
    for seed in range(SEEDS):
        robot = MujocoRobot(model, generator, still=seed == 0)
        names, mine = wsim_accelerations(moved_scene(scene, robot, rows))
        theirs = second_derivative(robot.path)[[number[name] for name in names]]
        scale = np.array([max(np.abs(theirs[:, :, 0]).max(), 9.81), *[max(np.abs(theirs[:, :, 1:]).max(), 1.0)] * 3])
        worst = max(worst, float((np.abs(mine - theirs) / scale).max()))
    return f"| {Path(file).stem} | {len(rows)} | {model.nv} | {worst:.1e} |"


def main() -> None:
    print("| robot | bodies | degrees of freedom | off |\n|---|---|---|---|")
    for file in sys.argv[1:]:
        try:
            print(compare(file), flush=True)
        except (SceneError, ValueError) as error:
            print(f"| {Path(file).stem} | {str(error)[:150]} |", flush=True)


if __name__ == "__main__":
    main()
