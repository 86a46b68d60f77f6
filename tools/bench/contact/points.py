"""Points against each kind of collider: time of search and projection, and the motion against the CPU's; many moving spheres.

    python tools/bench/contact/points.py [--device cuda:0] [--points 1000000] [--rows shapes moving] [--json FILE]

Near: every point within a millimetre of the distance that it keeps; far: none within a metre. Times are a substep's,
replayed from a graph, after the first frame, which alone asks whether points start deep inside a mesh. The agreement is
the RMS and the median distance of points after ten frames of falling on the collider.

Moving: spheres of 2 cm with six keys that turn and wander by 10 cm, under a 32 x 32 cloth, 10 substeps a frame. Times are
medians: of what is done about colliders before a frame, and of a whole frame. The error is that of the collider poses against
their evaluation in NumPy, in float64 (metres, parts of a unit quaternion).
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from tools.bench.speed import hardware, show, timed  # noqa: E402
from wsim.geometry.rotation import axis_rotation_matrix  # noqa: E402
from wsim.scene import (  # noqa: E402
    Box,
    Capsule,
    Cone,
    Cylinder,
    Plane,
    Scene,
    Sphere,
    Surface,
    shapes,  # noqa: E402
)
from wsim.scene.curve import Motion  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

SHAPES = {"plane": Plane("Z"), "sphere": Sphere(0.3), "box": Box((0.3, 0.3, 0.3)), "capsule": Capsule(0.2, 0.1),
          "cylinder": Cylinder(0.3, 0.3), "cone": Cone(0.3, 0.3), "mesh": Surface(*shapes.sphere(0.3, 144))}

TIMED = ("plane", "sphere", "box", "mesh")
MOVING = (1, 10, 100, 1000, 5000)


def cloud(shape, n: int, lift: float, seed: int = 0) -> np.ndarray:
    """n points `lift` [m] above the upper half of a plane, sphere or box of 0.3 m; about the other shapes."""
    u = np.random.default_rng(seed).normal(size=(n, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    u[:, 2] = np.abs(u[:, 2])
    if isinstance(shape, Plane):
        return u * (1.0, 1.0, 0.0) + (0.0, 0.0, lift)
    if isinstance(shape, Box):
        return (0.3 + lift) * u / np.abs(u).max(axis=1)[:, None]
    return (0.3 + lift) * u


def simulation(shape, points: np.ndarray, device) -> Simulation:
    """Loose points (each pair on a spring of 1 mN/m) that fall on one collider."""
    n = len(points)
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, substeps=10, iterations=1)
    scene.net("/points", points, np.arange(n).reshape(-1, 2), [1e-3], [1e-3], radius=1e-3)
    scene.collider("/collider", shape)
    return Simulation(scene, device=device)


def cost(name: str, n: int, device) -> dict:
    row: dict = {"shape": name, "points": n}
    for where, lift in (("far", 3.0), ("near", 1.5e-3)):
        sim = simulation(SHAPES[name], cloud(SHAPES[name], n, lift), device)
        sim.run(2)
        sim.state.restore_snapshot()
        contacts, clock = sim.plan.method("contact"), sim.plan.clock
        for stage in sim.plan.stages("predict", "substep"):
            stage.launch(clock)
        row |= {f"{where}_search_us": 1e6 * timed(lambda c=contacts, k=clock: c.search(k), sim.device),
                f"{where}_project_us": 1e6 * timed(lambda c=contacts, k=clock: c.project(k), sim.device)}
    return row


def agreement(name: str, device, n: int = 20_000) -> dict:
    points, ends = cloud(SHAPES[name], n, 0.02), []
    for where in ("cpu", device, device):
        sim = simulation(SHAPES[name], points, where)
        sim.run(10)
        ends.append(sim.positions())
    away = np.linalg.norm(ends[0] - ends[1], axis=1)
    return {"shape": name, "rms_m": float(np.sqrt(np.mean(away**2))), "median_m": float(np.median(away)),
            "same_bits_twice": bool(np.array_equal(ends[1], ends[2])), **sim.plan.method("contact").indicators(None, None)}


def wandering(count: int) -> Scene:
    """So many moving spheres under a cloth."""
    rng = np.random.default_rng(0)
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, substeps=10, iterations=1)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 32, 32, horizontal=True, up="Z"))
    for k in range(count):
        keys = np.tile(np.eye(4), (6, 1, 1))
        for M in keys:
            axis = rng.normal(size=3)
            M[:3, :3] = axis_rotation_matrix(axis / np.linalg.norm(axis), rng.uniform(0.0, 2.0))
        keys[:, :3, 3] = (*rng.uniform(-0.5, 0.5, 2), -0.03) + rng.uniform(-0.05, 0.05, (6, 3))
        scene.collider(f"/{k}", Sphere(0.02), motion=Motion(np.linspace(0.0, 2.0, 6), keys))
    return scene


def median(run, times: int) -> float:
    """Of a call, in milliseconds, until the device has done it."""
    found = []
    for _ in range(times):
        began = time.perf_counter()
        run()
        wp.synchronize()
        found.append(1e3 * (time.perf_counter() - began))
    return float(np.median(found))


def moving(count: int, device) -> dict:
    scene, error = wandering(count), 0.0
    sim = Simulation(scene, device=device)
    sim.run(2)
    contacts = sim.plan.method("contact").contacts
    at = iter(np.arange(2, 1000) / 60.0)
    row = {"moving": count, "before_ms": median(lambda: contacts.prepare(next(at)), 20),
           "frame_ms": median(sim.step, 20)}
    exact = Simulation(scene, device=device, precision="float64")
    exact.run(1)
    contacts = exact.plan.method("contact").contacts
    for start in (0.0, 0.31, 1.1, 1.99):
        contacts.prepare(start)
        pose, step, ball = contacts.rows.poses(start + np.arange(11) / 600.0)
        ball[..., 3] += contacts.gap
        error = max(error, *(float(np.abs(array.numpy() - values).max()) for array, values in (
            (contacts.table.of.pose, pose), (contacts.table.of.step, step), (contacts.table.ball, ball))))
    return row | {"error": error}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--rows", nargs="+", choices=("shapes", "moving"), default=("shapes", "moving"))
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    device = wp.get_device(args.device)
    print(f"{hardware(device)}, warp {wp.config.version}")
    rows: list[dict] = []
    for count in MOVING if "moving" in args.rows else ():
        show(rows, moving(count, device))
    for name in SHAPES if "shapes" in args.rows else ():
        if name in TIMED:
            show(rows, cost(name, args.points, device))
        show(rows, agreement(name, device))
    if args.json:
        Path(args.json).write_text(json.dumps({"device": hardware(device), "warp": wp.config.version, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
