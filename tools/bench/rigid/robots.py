"""Robots of MuJoCo files beside MuJoCo: masses, moments, and the paths of bodies for a second after a kick of all joints.

    python -m tools.bench.rigid.robots FILE.xml ... [--frames 40] [--substeps 20] [--contacts]

Needs the environment of `wsim new robot` (WSIM_ROBOTS). MuJoCo steps by RK4, 0.05 ms, with neither contacts nor actuators;
armature and dry friction are off, and so are wsim's colliders. Both begin with joint speeds 0.5 sin(1 + k) of the k-th.

    mass    largest relative departure of a mass or a moment of inertia from MuJoCo's
    off     largest distance of a body's frame from MuJoCo's in any frame [m];  way: how far bodies move [m];  off / way

--contacts: both fall from rest and collide, MuJoCo with steps of 0.5 ms. off and way are of frames before its first contact.
Two more columns:

    lies    largest difference of a body's height from MuJoCo's in the last frame [m]
    speed   of the fastest body of wsim then [m/s]
    ms      milliseconds of a frame of wsim on this CPU, float64, without the first
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from wsim.physics.rigid.mass import body_inertia  # noqa: E402
from wsim.scene import SceneError  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402
from wsim.usd import load  # noqa: E402
from wsim.usd.new.robot import author_robot, find_converter  # noqa: E402

FREE, TOUCHING = 5e-5, 5e-4          # [s] steps of MuJoCo
MUJOCO = """
import json, sys
import mujoco, numpy as np
file, out, frames, fps, step, contacts = sys.argv[1], sys.argv[2], *(float(word) for word in sys.argv[3:])
m = mujoco.MjModel.from_xml_path(file)
kind = mujoco.mjtIntegrator.mjINT_IMPLICITFAST if contacts else mujoco.mjtIntegrator.mjINT_RK4
m.opt.timestep, m.opt.integrator, m.opt.viscosity, m.opt.density = step, kind, 0, 0
m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
if not contacts:
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
m.dof_armature[:] = 0
m.dof_frictionloss[:] = 0
d = mujoco.MjData(m)
if not contacts:
    d.qvel[:] = 0.5 * np.sin(1.0 + np.arange(m.nv))
mujoco.mj_forward(m, d)
speeds = []
for k in range(m.nbody):
    v = np.zeros(6)
    mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_BODY, k, v, 0)
    speeds.append(v.tolist())
places, met = [d.xpos.tolist()], int(frames)
for frame in range(int(frames)):
    for _ in range(round(1.0 / fps / step)):
        mujoco.mj_step(m, d)
        if d.ncon:
            met = min(met, frame)
    places.append(d.xpos.tolist())
found = {"speeds": speeds, "places": places, "met": met, "mass": m.body_mass.tolist(), "moments": m.body_inertia.tolist()}
json.dump(found, open(out, "w"))
"""


def compare(file: str, frames: int, substeps: int, contacts: bool) -> str:
    """A row of the table."""
    with tempfile.TemporaryDirectory() as place:
        author_robot(file, f"{place}/robot.usda")
        python = find_converter("mujoco-usd-converter").parent / "python"
        step = TOUCHING if contacts else FREE
        subprocess.run([python, "-c", MUJOCO, file, f"{place}/o.json", str(frames), "40", str(step), str(int(contacts))],
                       check=True, capture_output=True, env={}, cwd=place)
        true = {k: np.array(v) for k, v in json.loads(Path(f"{place}/o.json").read_text(encoding="utf-8")).items()}
        scene = load(f"{place}/robot.usda")
    bodies = scene.things("Body")
    start = np.array([body.motion.at(0.0)[:3, 3] for body in bodies])
    row = []                                       # MuJoCo's bodies, in the same order; some without mass are none here
    for x in start:
        row.append(next(k for k in range(1 + (row[-1] if row else 0), len(true["mass"]))
                        if true["mass"][k] > 0.0 and np.abs(true["places"][0, k] - x).max() < 1e-3))
    mass = max(max(abs(body_inertia(b).mass / true["mass"][k] - 1.0),
                   np.abs(np.sort(body_inertia(b).moments) / np.sort(true["moments"][k]) - 1.0).max())
               for b, k in zip(bodies, row, strict=True))
    for body, k in zip(bodies, row, strict=True):
        body.spin, body.velocity = true["speeds"][k, :3], true["speeds"][k, 3:]
        for collider in body.colliders:
            collider.meets = contacts
    sim = Simulation(replace(scene, fps=40.0, frames=frames, substeps=substeps), device="cpu", precision="float64")
    off, way, speed, spent, before = 0.0, 0.0, 0.0, [], start
    for frame in range(1, frames + 1):
        began = perf_counter()
        sim.run(1)
        spent.append(perf_counter() - began)
        poses, places = sim.poses(), true["places"][frame, row]
        found = np.array([poses[b.path][:3, 3] for b in bodies])
        speed = 40.0 * float(np.linalg.norm(found - before, axis=1).max())
        before = found
        if frame <= true["met"]:
            off = max(off, float(np.linalg.norm(found - places, axis=1).max()))
            way = max(way, float(np.linalg.norm(places - true["places"][0, row], axis=1).max()))
    ms = 1e3 * float(np.mean(spent[1:]))
    more = f" {np.abs(found - places)[:, 2].max():.1e} | {speed:.1e} |" if contacts else ""
    way = max(way, 1e-9)
    return f"| {Path(file).stem} | {len(bodies)} | {mass:.1e} | {off:.1e} | {way:.2g} | {off / way:.1e} | {ms:.1f} |{more}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--substeps", type=int, default=20)
    parser.add_argument("--contacts", action="store_true")
    args = parser.parse_args()
    more = ("", "") if not args.contacts else (" lies | speed |", "---|---|")
    print(f"| robot | bodies | mass | off | way | off / way | ms |{more[0]}\n|---|---|---|---|---|---|---|{more[1]}")
    for file in args.files:
        try:
            print(compare(file, args.frames, args.substeps, args.contacts), flush=True)
        except SceneError as error:
            print(f"| {Path(file).stem} | {str(error)[:150]} |", flush=True)


if __name__ == "__main__":
    main()
