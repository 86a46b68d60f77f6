"""Rigid bodies in contact: milliseconds a frame beside the error, of columns, piles and pyramids.

    python tools/bench/rigid/speed.py [--device cuda:0] [--scenes column,pile] [--boxes 1000] [--rows 100] [--frames 60]
                                      [--settle 120] [--substeps 8] [--sweeps 4] [--form coloured] [--sleep] [--json FILE]

column    ten boxes of 1 m: sag [mm]
heavy     100 kg on nine boxes of 1 kg: sag
pile      `boxes` boxes that fall on each other, each layer between those below, after `settle` frames: still in motion
settled   `boxes` boxes in columns of ten, at rest and awake
pyramid   of `rows` rows of boxes in one plane: 100 rows have 5050

Frames are of 1/60 s. A frame is timed as a whole `Simulation.step`; the median and the least of `frames` are shown, and where
the device counts them, CPU milliseconds of this process. sag is what the highest box has sunk, speed the largest of all boxes
at the end, overlap the deepest point of a manifold. The host's time to build and compile is shown apart.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from tools.bench.speed import hardware  # noqa: E402
from wsim.physics.rigid import forms  # noqa: E402
from wsim.physics.rigid.contacts.measure import contact_overlap  # noqa: E402
from wsim.physics.rigid.objects import Body  # noqa: E402
from wsim.scene import Box, Collider, Plane, Scene  # noqa: E402
from wsim.scene.curve import Motion  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

UP = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])       # own z to y


def world(places, substeps: int, sweeps: int, masses=None) -> Scene:
    """Boxes of 1 m over the plane y = 0."""
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, substeps=substeps, iterations=sweeps)
    scene.collider("/ground", Plane(), motion=Motion.still(UP), static_friction=0.5, dynamic_friction=0.5)
    for k, at in enumerate(places):
        shape = Collider(f"/box{k}/shape", Box((0.5, 0.5, 0.5)), static_friction=0.5, dynamic_friction=0.5)
        scene.add(Body(f"/box{k}", [shape], Motion.at_place(at), mass=None if masses is None else masses[k]))
    return scene


def column(args) -> Scene:
    return world([(0.0, 0.5 + k, 0.0) for k in range(10)], args.substeps, args.sweeps)


def heavy(args) -> Scene:
    return world([(0.0, 0.5 + k, 0.0) for k in range(10)], args.substeps, args.sweeps, [1.0] * 9 + [100.0])


def pile(args) -> Scene:
    side = max(2, round((args.boxes / 2.0) ** (1.0 / 3.0)))
    rng = np.random.default_rng(0)
    layer, place = np.divmod(np.arange(args.boxes), side * side)
    shift = 0.55 * (layer % 2)
    grid = np.stack([1.1 * (place % side) + shift, 0.6 + 1.1 * layer, 1.1 * (place // side) + shift], axis=1)
    return world(grid + rng.uniform(-0.04, 0.04, grid.shape), args.substeps, args.sweeps)


def settled(args) -> Scene:
    side = ceil((args.boxes / 10.0) ** 0.5)
    places = [(1.5 * (k // 10 % side), 0.5 + k % 10, 1.5 * (k // 10 // side)) for k in range(args.boxes)]
    return world(places, args.substeps, args.sweeps)


def pyramid(args) -> Scene:
    places = [(k + 0.5 * row, 0.5 + row, 0.0) for row in range(args.rows) for k in range(args.rows - row)]
    return world(places, args.substeps, args.sweeps)


SCENES = {"column": column, "heavy": heavy, "pile": pile, "settled": settled, "pyramid": pyramid}


def measure(name: str, args, device) -> dict:
    scene = replace(SCENES[name](args), sleep_speed=0.05 * args.sleep)
    began = time.perf_counter()
    sim = Simulation(scene, device=device)
    sim.load()
    ready = time.perf_counter() - began
    method = sim.plan.method("rigid")
    top = int(np.argmax(method.poses()[:, 1, 3]))
    before = method.poses()[top, 1, 3]
    sim.run(args.settle)
    times, cpu = [], time.process_time()
    for _ in range(args.frames):
        start = time.perf_counter()
        sim.step()
        times.append(1e3 * (time.perf_counter() - start))
    cpu = (time.process_time() - cpu) / args.frames
    contacts, seen = method.contacts, method.poses()
    standing = name != "pile"
    return {"scene": name, "device": str(device), "bodies": len(method.bodies), "form": contacts.form.name,
            "substeps": sim.plan.clock.substeps, "sweeps": contacts.sweeps, "median_ms": float(np.median(times)),
            "least_ms": min(times), "cpu_ms": 1e3 * cpu, "ready_s": ready, "pairs": int(contacts.broad.first.numpy()[-1]),
            "manifolds": int((contacts.list.count.numpy() > 0).sum()), "colours": int(contacts.work.colours.numpy()[0]),
            "in_turn": contacts.in_turn, "sag_mm": 1e3 * float(before - seen[top, 1, 3]) if standing else None,
            "speed_m_s": float(np.linalg.norm(method.velocities(), axis=1).max()),
            "overlap_mm": 1e3 * contact_overlap(contacts),
            "finite": bool(np.isfinite(seen).all()), "warnings": sim.warnings}


def line(row: dict) -> str:
    sag = "" if row["sag_mm"] is None else f"{row['sag_mm']:9.3f}"
    return (f"{row['scene']:8} {row['device']:7} {row['bodies']:6} {row['form']:9} {row['substeps']:3} x {row['sweeps']:<3} "
            f"{row['median_ms']:9.3f} {row['least_ms']:9.3f} {row['cpu_ms']:9.3f} {row['manifolds']:9} {row['colours']:7} "
            f"{sag:>9} {row['speed_m_s']:9.1e} {row['overlap_mm']:9.3f} {row['ready_s']:7.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--form", choices=("listed", "coloured", "block", "cluster", "launches"))
    parser.add_argument("--boxes", type=int, default=1000)
    for name, value in (("rows", 10), ("frames", 60), ("settle", 120), ("substeps", 8), ("sweeps", 4)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--sleep", action="store_true", help="bodies slower than 0.05 m/s fall asleep")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    if args.form:
        forms.choose_pass_form = lambda device, shapes: forms.form_by_name(args.form, device)
    device, rows = wp.get_device(args.device), []
    print(hardware(device))
    print(f"{'scene':8} {'device':7} {'bodies':>6} {'form':9} {'steps':>7} {'median':>11} {'least':>9} {'cpu ms':>9} "
          f"{'manifolds':>9} {'colours':>7} {'sag mm':>9} {'m/s':>9} {'overlap':>9} {'ready s':>7}")
    for name in args.scenes.split(","):
        rows.append(measure(name, args, device))
        print(line(rows[-1]), flush=True)
    if args.json:
        args.json.write_text(json.dumps({"hardware": hardware(device), "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
