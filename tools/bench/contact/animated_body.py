"""A cloth with self-contact on an animated body, wsim beside Newton's VBD. A capsule lies under a square cloth, turns about the
vertical and sways, so that the cloth winds about itself.

    python -m tools.bench.contact.animated_body [--device cuda:0] [--points 10000] [--seconds 2]
        [--solvers xpbd,auto] [--peer-python X/bin/python] [--json FILE] [--states FILE.npz]

One table: ms of a frame (median and most, of whole `Simulation.step` calls), seconds of the first frame, and how good it is:
`crossings`, the most pairs of triangles that intersect after any tenth of a second (exact test on float32 values, where
triangles share no point); `deep`, how far the deepest point is inside the capsule [m]; strain of edges, RMS and most.
X as tools/bench/nets/peers.py says. Both get the same mesh, energy near rest, density, friction and thickness, and the same
motion in each substep. Newton's settings are substeps and iterations of its examples.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import warp as wp

from tools.bench.contact import twists
from tools.bench.contact.self_contact import judged, stepped
from tools.bench.speed import hardware, show
from tools.bench.suite import commit, write
from wsim.scene import Capsule, Motion, Scene, shapes
from wsim.scene.fabric import isotropic_fabric
from wsim.simulation.simulation import Simulation

FPS, RADIUS, HALF = 60.0, 0.12, 0.25                 # frames a second; of the capsule, along x at first [m]
RATE, SWAY, GENTLE = 0.75, 0.1, 0.5                  # turns a second, [m] along z once a second, [s] to start
THICKNESS, FRICTION, HEIGHT = 2.0e-3, 0.5, 0.125     # [m], of cloth and capsule, [m] of the cloth over the axis at first
PEER = ((10, 4), (10, 10), (20, 10))                 # substeps and iterations of VBD
MARK = 6                                             # frames between states that are judged
SOLVERS = {"xpbd": {"solver": "xpbd", "integrator": "backward_euler"}, "leapfrog": twists.SOLVERS["leapfrog"], "auto": {}}


def path(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], angle [rad] about y, and place [m] along z of the capsule."""
    t = np.linspace(0.0, seconds, round(4 * FPS * seconds) + 1)
    gentle = np.clip(t / GENTLE, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t / GENTLE, 0.0, 1.0))
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (gentle[1:] + gentle[:-1]) * np.diff(t))]) * 2.0 * np.pi * RATE
    return t, angle, SWAY * gentle * np.sin(2.0 * np.pi * t)


def turns(angle: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4), real part last: the capsule's own z along x, turned about y."""
    half = 0.5 * (angle + 0.5 * np.pi)
    return np.stack([0.0 * half, np.sin(half), 0.0 * half, np.cos(half)], axis=1)


def cloth(points: int) -> tuple[np.ndarray, np.ndarray]:
    side = round(np.sqrt(points))
    place, _, indices = shapes.sheet(1.0, 1.0, side - 1, side - 1, horizontal=True)
    place = np.asarray(place, np.float64)
    place += (0.0, HEIGHT, 0.0) - np.array([1.0, 0.0, 1.0]) * place.mean(axis=0)
    return place, np.asarray(indices).reshape(-1, 3)


def scene(points: int, seconds: float, **more) -> Scene:
    made = Scene(fps=FPS, air_drag=1.0, **more)
    place, triangles = cloth(points)
    fabric = isotropic_fabric(twists.STRETCH / THICKNESS, twists.POISSON, THICKNESS, twists.DENSITY / THICKNESS, damping=1e-4,
                              static_friction=FRICTION, dynamic_friction=FRICTION)
    made.cloth("/cloth", place, np.full(len(triangles), 3), triangles, material=fabric, self_collision=True)
    t, angle, z = path(seconds)
    motion = Motion.through(t, np.stack([0.0 * z, 0.0 * z, z], axis=1), turns(angle), "linear")
    made.collider("/body", Capsule(RADIUS, HALF), motion=motion, static_friction=FRICTION, dynamic_friction=FRICTION)
    return made


def deep(x: np.ndarray, angle: float, z: float) -> float:
    """How far the deepest point is inside the capsule [m]."""
    y = np.asarray(x, np.float64) - (0.0, 0.0, z)
    along = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    s = np.clip(y @ along, -HALF, HALF)
    return float(max(RADIUS - np.linalg.norm(y - s[:, None] * along, axis=1).min(), 0.0))


def summed(row: dict, states: list[np.ndarray], frames: list[int], points: int, seconds: float) -> dict:
    """The row of a run, with what its states say."""
    place, triangles = cloth(points)
    t, angle, z = path(seconds)
    finite = all(np.isfinite(x).all() for x in states)
    if finite:
        crossings = max(each["crossings"] for each in judged([{}] * len(states), triangles, states))
        strains = [twists.strain(place, triangles, x.astype(np.float64)) for x in states]
        depths = [deep(x, np.interp(f / FPS, t, angle), np.interp(f / FPS, t, z)) for x, f in zip(states, frames, strict=True)]
        row |= {"crossings": crossings, "deep": max(depths), "strain_rms": max(s[0] for s in strains),
                "strain_most": max(s[1] for s in strains)}
    return row | {"finite": finite}


def measure(name: str, points: int, seconds: float, device) -> tuple[dict, np.ndarray]:
    sim = Simulation(scene(points, seconds, **SOLVERS[name]), device=device)
    began = time.perf_counter()
    sim.step()
    wp.synchronize_device(sim.device)
    first, ms, states, frames = time.perf_counter() - began, [], [], []
    for frame in range(2, round(FPS * seconds) + 1):
        ms.append(stepped(sim))
        if frame % MARK == 0:
            states.append(np.array(sim.positions(), np.float32))
            frames.append(frame)
    row: dict = {"side": "wsim", "solver": name, "points": len(states[0]), "substeps": sim.plan.clock.substeps,
           "iterations": sim.plan.clock.iterations, "ms": float(np.median(ms)), "ms_most": max(ms), "first_s": first}
    return summed(row, states, frames, points, seconds), states[-1]


def peer(args) -> list[dict]:
    place, triangles = cloth(args.points)
    t, angle, z = path(args.seconds)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "problem.npz", points=place, triangles=triangles, times=t, angle=angle, z=z, frame=1.0 / FPS,
                 frames=round(FPS * args.seconds), mark=MARK, density=twists.DENSITY, stretch=twists.STRETCH, air_drag=1.0,
                 poisson=twists.POISSON, thickness=THICKNESS, friction=FRICTION, radius=RADIUS, half=HALF,
                 bend=twists.fabric().bend * (THICKNESS / twists.THICKNESS) ** 2)
        (folder / "settings.json").write_text(json.dumps(PEER))
        subprocess.run([args.peer_python, str(Path(__file__).with_name("peer_animated_body.py")), name, *(
            ["--device", args.device] if args.device else [])], check=True,
            env=os.environ | {"WARP_CACHE_PATH": str(Path(wp.config.kernel_cache_dir).parent / "peer")})
        rows = json.loads((folder / "rows.json").read_text())
        with np.load(folder / "states.npz") as found:
            return [summed(row, list(found[f"x{k}"]), row.pop("frames"), args.points, args.seconds)
                    for k, row in enumerate(rows)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--points", type=int, default=10000)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--solvers", default="xpbd,auto")
    parser.add_argument("--peer-python", default=None, help="left out: wsim alone")
    parser.add_argument("--json", default=None)
    parser.add_argument("--states", default=None, help="file.npz for the last states of wsim")
    args = parser.parse_args()
    wp.config.quiet = True
    wp.init()
    device, found, last = wp.get_device(args.device), [], {}
    head = {"hardware": hardware(device), "warp": wp.config.version, "wsim": commit()}
    print(head, flush=True)
    for name in args.solvers.split(","):
        row, last[name] = measure(name, args.points, args.seconds, device)
        show(found, row)
    for row in peer(args) if args.peer_python else []:
        show(found, row)
    if args.json:
        write(args.json, head | {"rows": found})
    if args.states:
        np.savez(args.states, triangles=cloth(args.points)[1], **last)


if __name__ == "__main__":
    main()
