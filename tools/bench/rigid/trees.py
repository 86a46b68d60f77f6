"""Trees of joints in reduced coordinates beside MuJoCo: accelerations, and the time of a frame on a CPU.

    python tools/bench/rigid/trees.py

Needs `pip install mujoco`. The MuJoCo model is built from wsim's float64 values: frames, masses, principal moments. Coordinates
and velocities are random, three times; joints have no springs and nothing touches.

    off     largest difference of an acceleration from MuJoCo's `qacc_smooth`, over the largest acceleration
    ms      CPU time of 20 steps of RK4 of 1/480 s, in both programs, and of a frame of the humanoid that lands, by coordinates
    error   distance [m] of its torso after 12 frames from a run of 160 substeps in reduced coordinates
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

import wsim  # noqa: E402
from wsim.geometry import rotation  # noqa: E402

STEP, FRAMES = 1.0 / 480.0, 48


def words(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def scalar_first(q) -> str:
    return words([q[3], *q[:3]])


def link_joints(trees, frames, link: int) -> str:
    """MJCF of the joint of a link."""
    links, (rotors, rubs) = trees.links, (getattr(trees.trees.t, name).numpy().tolist() for name in ("armature", "friction"))
    if links.joint[link] < 0:
        return "<freejoint/>"
    at, found = words(frames["at_b"][link]), ""
    for k in range(links.first_dof[link], links.first_dof[link + 1]):
        axis = words(rotation.quat_rotate(frames["turn_b"][link], links.axis[k]))
        rotor = f'armature="{rotors[k]!r}" frictionloss="{rubs[k]!r}" solreffriction="1e-3 1" solimpfriction="0.999 0.999 1e-3"'
        turn = k - links.first_dof[link] - links.slides[link]
        if turn < 0:
            found += f'<joint type="slide" axis="{axis}" pos="{at}" {rotor}/>'
        elif not links.ball[link]:
            found += f'<joint type="hinge" axis="{axis}" pos="{at}" {rotor}/>'
        elif turn == 0:
            found += f'<joint type="ball" pos="{at}" {rotor}/>'
    return found


def link_xml(trees, frames, link: int) -> str:
    """MJCF of a link and all behind it; its frame is that of its principal axes."""
    links, mass = trees.links, trees.method.masses[trees.links.body[link]]
    Q = rotation.quat_product(frames["turn_a"][link], rotation.quat_conjugate(frames["turn_b"][link]))
    at = frames["at_a"][link] - rotation.quat_rotate(Q, frames["at_b"][link])
    inside = "".join(link_xml(trees, frames, k) for k, parent in enumerate(links.parent) if parent == link)
    return (f'<body pos="{words(at)}" quat="{scalar_first(Q)}"><inertial pos="0 0 0" mass="{float(mass.mass)!r}" '
            f'diaginertia="{words(mass.moments)}"/>{link_joints(trees, frames, link)}{inside}</body>')


def mujoco_model(trees, gravity):
    frames = trees._link_frames()
    roots = "".join(link_xml(trees, frames, k) for k, parent in enumerate(trees.links.parent) if parent < 0)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian" autolimits="false"/><option gravity="{words(gravity)}" timestep="{STEP!r}" '
        f'integrator="RK4"/><worldbody>{roots}</worldbody></mujoco>')
    return model, mujoco.MjData(model), frames


def compare_accelerations(simulation, seed: int) -> float:
    """off, at random coordinates and velocities."""
    trees = simulation.plan.method("rigid").joints
    model, data, frames = mujoco_model(trees, simulation.scene.gravity)
    links, generator = trees.links, np.random.default_rng(seed)
    q, qd = np.zeros(links.first_coordinate[-1]), generator.normal(size=links.first_dof[-1])
    data.qvel[:], turned = qd, []
    for link in range(len(links.body)):
        c, d = links.first_coordinate[link], links.first_dof[link]
        n = links.slides[link] if links.ball[link] else links.first_dof[link + 1] - d
        q[c:c + n] = data.qpos[c:c + n] = generator.normal(size=n)
        if links.ball[link]:
            own = rotation.unit_quat(generator.normal(size=4))
            b, c, d = frames["turn_b"][link], c + n, d + n
            q[c:c + 4] = own
            theirs = rotation.quat_product(rotation.quat_product(b, own), rotation.quat_conjugate(b))
            data.qpos[c:c + 4] = [theirs[3], *theirs[:3]]
            data.qvel[d:d + 3] = rotation.quat_rotate(b, qd[d:d + 3])
            turned.append((d, b))
    trees.q.assign(q)
    trees.qd.assign(qd)
    trees.stale = False
    found = trees.accelerations()
    mujoco.mj_forward(model, data)
    right = data.qacc_smooth.copy()
    for d, b in turned:
        right[d:d + 3] = rotation.quat_rotate(rotation.quat_conjugate(b), right[d:d + 3])
    return float(np.abs(found - right).max() / np.abs(right).max())


def bare_humanoid() -> wsim.Scene:
    """The example's humanoid, without shapes and springs."""
    scene = replace(wsim.load(ROOT / "scenes/humanoid.usda"), coordinates="reduced")
    scene.colliders.clear()
    for body in scene.things("Body"):
        for collider in body.colliders:
            collider.meets = False
    for joint in scene.things("Joint"):
        joint.drives = {}
    return scene


def bare_chain(kinds, free: bool) -> wsim.Scene:
    """Boxes of 0.5 m, one behind the other; joints have armature."""
    scene = wsim.Scene(coordinates="reduced")
    last = scene.body("/root", wsim.Box((0.1, 0.2, 0.3))) if free else None
    for k, kind in enumerate(kinds):
        body = scene.body(f"/b{k}", wsim.Box((0.25, 0.02, 0.03)), at=(0.25 + 0.5 * k, 0, 0))
        scene.joint(kind, f"/j{k}", last, body, at=(0.5 * k, 0, 0), axis=((0, 0, 1), (0, 0.6, 0.8))[k % 2],
                    armature=0.1 + 0.05 * k)
        last = body
    for body in scene.things("Body"):
        body.colliders[0].meets = False
    return scene


def cpu_ms(call, frames: int) -> float:
    began = time.process_time()
    for _ in range(frames):
        call()
    return (time.process_time() - began) / frames * 1e3


def print_accelerations() -> None:
    scenes = {"humanoid, 27 dofs": bare_humanoid(), "arm of 7 hinges": bare_chain(["revolute"] * 7, False),
              "balls, slides and hinges on a free body": bare_chain(["spherical", "prismatic", "fixed", "revolute"] * 2, True)}
    for name, scene in scenes.items():
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        simulation.load()
        off = max(compare_accelerations(simulation, seed) for seed in range(3))
        print(f"{name:42s} off {off:.1e}")


def print_friction() -> None:
    """Angles of a chain of three hinges with armature and dry friction, which falls for half a second, beside MuJoCo's at a
    hundredth of the step. MuJoCo's friction is soft."""
    def falling(substeps: int):
        scene = replace(bare_chain(["revolute"] * 3, False), fps=60, substeps=substeps)
        for joint in scene.things("Joint"):
            joint.friction = {"rotX": 0.2}
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        simulation.load()
        return simulation
    theirs = falling(4)
    model, data, _ = mujoco_model(theirs.plan.method("rigid").joints, theirs.scene.gravity)
    model.opt.timestep = 1.0 / 24000.0
    for _ in range(12000):
        mujoco.mj_step(model, data)
    for substeps in (4, 8, 16, 64):
        mine = falling(substeps)
        mine.run(30)
        off = np.abs(mine.plan.method("rigid").joints.q.numpy() - data.qpos).max()
        print(f"chain with dry friction, {substeps} substeps: {off:.1e} rad from MuJoCo")


def print_times() -> None:
    simulation = wsim.Simulation(bare_humanoid(), device="cpu", precision="float64")
    simulation.run(2)
    model, data, _ = mujoco_model(simulation.plan.method("rigid").joints, simulation.scene.gravity)
    data.qvel[:] = 0.1
    mine = cpu_ms(simulation.step, FRAMES)
    theirs = cpu_ms(lambda: [mujoco.mj_step(model, data) for _ in range(20)], FRAMES)
    print(f"humanoid in the air, 20 steps of RK4: wsim {mine:.2f} ms, MuJoCo {theirs:.2f} ms")


def print_landing() -> None:
    fine = None
    for coordinates, substeps in (("reduced", 160), ("reduced", 20), ("reduced", 40), ("maximal", 20), ("maximal", 80)):
        scene = replace(wsim.load(ROOT / "scenes/humanoid.usda"), coordinates=coordinates, substeps=substeps)
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        simulation.step()
        ms = cpu_ms(simulation.step, 11)
        torso = simulation.poses()["/World/Humanoid/torso"][:3, 3]
        fine = torso if fine is None else fine
        off = np.linalg.norm(torso - fine)
        print(f"humanoid lands, {coordinates}, {substeps} substeps: {ms:.1f} ms a frame, error {off:.1e} m")


if __name__ == "__main__":
    print_accelerations()
    print_friction()
    print_times()
    print_landing()
