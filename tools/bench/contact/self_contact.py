"""Costs of self-contact: a flat cloth that falls and meets nothing, a cloth that is twisted into a rope, a sheet that is
scrunched, and the twist beside Newton's VBD.

    python -m tools.bench.contact.self_contact [--device cuda:0] [--rows drop,twist,scrunch,peer] [--points 50000] [--turns 10]
        [--seconds 60] [--setting substeps=10,iterations=4] [--peer-python X/bin/python] [--keep FOLDER] [--json FILE]

twists.py has the scenes. Times are whole `Simulation.step` calls, the median of the frames of each turn (drop: the least of
frames that take turns with those of the same cloth without self-collision). `crossed_triangles`: pairs of triangles that
intersect by the exact test, on float32 values as they would be written, after each turn; triangles that share a point are left
out (a minute for 100k of them). Tests run in other processes, behind the timing. A twist ends where --seconds of frames are
over. peer: X as tools/bench/nets/peers.py says; the same mesh, energy near rest, density, ends and frames, and settings of both
that
--turns and --seconds let end. Its contacts get radius and margin that keep our thickness.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import warp as wp

from tests.physics.contact.selfcontact.rig import SOLVERS as SCRUNCHED
from tests.physics.contact.selfcontact.rig import crumple
from tools.bench.contact import twists
from tools.bench.nets.garments import stable
from tools.bench.speed import hardware, show
from tools.bench.suite import commit, write
from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.simulation.simulation import Simulation

ROUNDS, TURN = 6, 5                      # of a drop: rounds, frames of one run before those of the other
SCRUNCH, FRAMES = 71, 24                 # points a side, frames
PEER = ((10, 4), (10, 10), (20, 10))     # substeps and iterations of VBD; the first is the example's of Newton


def crossed(x: np.ndarray, triangles: np.ndarray) -> int:
    return len(crossed_triangles(x.astype(np.float32), triangles, neighbours=False))


def judged(rows: list[dict], triangles: np.ndarray, states: list[np.ndarray]) -> list[dict]:
    """Rows with the crossings of their states. By as many processes as there are cores."""
    with ProcessPoolExecutor(min(os.cpu_count() or 1, max(len(states), 1)), get_context("spawn")) as pool:
        found = pool.map(crossed, states, [triangles] * len(states))
        return [row | {"crossings": count} for row, count in zip(rows, found, strict=True)]


def drop(points: int, device) -> Iterator[dict]:
    for name, setting in twists.SOLVERS.items():
        if name == "leapfrog":
            setting = setting | {"substeps": stable(twists.drop(points, True, **setting), device)}
        sims = {on: Simulation(twists.drop(points, on, **setting), device=device) for on in (False, True)}
        times: dict[bool, list[float]] = {on: [] for on in sims}
        for sim in sims.values():
            sim.run(4)
        for _ in range(ROUNDS):
            for on, sim in sims.items():
                times[on] += [stepped(sim) for _ in range(TURN)]
        alone, ms = min(times[False]), min(times[True])
        yield {"scene": "drop", "solver": name, "points": sims[True].model.points,
               "substeps": sims[True].plan.clock.substeps, "ms_without": alone, "ms": ms, "over": ms / alone - 1.0,
               "medians": [float(np.median(times[on])) for on in times]}


def stepped(sim: Simulation) -> float:
    """Milliseconds of a frame."""
    began = time.perf_counter()
    sim.step()
    wp.synchronize_device(sim.device)
    return 1e3 * (time.perf_counter() - began)


def windows(points: int, turns: float, seconds: float, sim: Simulation) -> tuple[list[dict], list[np.ndarray]]:
    """Rows of a twist, turn by turn, and its states there."""
    rest, triangles, _ = twists.sheet(points)
    rows, states, ms, began = [], [], [], time.perf_counter()
    sim.step()
    first = time.perf_counter() - began
    for frame in range(2, round(twists.FPS * twists.seconds(turns)) + 1):
        ms.append(stepped(sim))
        done = frame / twists.FPS
        whole = round(twists.FPS * twists.seconds(len(rows) + 1)) == frame
        late = time.perf_counter() - began - first > seconds
        if whole or late:
            x = np.asarray(sim.positions(), np.float64)
            said = sim.plan.method("selfcontact").indicators(None, None)
            rms, most = twists.strain(rest, triangles, x)
            rows.append({"scene": "twist", "side": "wsim", "points": len(rest), "turns": float(twists.turns(done)),
                         "ms": float(np.median(ms)), "ms_worst": max(ms), "first_s": first, "strain_rms": rms,
                         "strain_most": most, "pairs_a_point": said["near_pairs"] / len(rest), **said})
            states.append(x.astype(np.float32))
            ms = []
        if late:
            break
    return rows, states


def scrunch(device) -> list[dict]:
    rows = []
    for name in ("xpbd", "newton", "leapfrog"):
        scene = crumple(0, SCRUNCH, 4.0, **SCRUNCHED[name])
        sim = Simulation(scene, device=device)
        sim.step()
        used, began = time.process_time(), time.perf_counter()
        ms = [stepped(sim) for _ in range(FRAMES)]
        wall = (time.perf_counter() - began) / FRAMES
        x, triangles = np.asarray(sim.positions(), np.float32), sim.model.bodies[0].source.indices.reshape(-1, 4)
        triangles = np.concatenate([triangles[:, [0, 1, 2]], triangles[:, [0, 2, 3]]])
        said = sim.plan.method("selfcontact").indicators(None, None)
        rows.append({"scene": "scrunch", "solver": name, "points": len(x), "substeps": sim.plan.clock.substeps,
                     "ms": float(np.median(ms)), "ms_worst": max(ms), "frames_a_second": 1.0 / wall,
                     "cpu_s_a_frame": (time.process_time() - used) / FRAMES, "crossings": crossed(x, triangles), **said})
    return rows


def peer(args) -> list[dict]:
    """Newton's rows of the twist."""
    place, triangles, ends = twists.sheet(args.points)
    frames = round(twists.FPS * twists.seconds(args.turns))
    times = np.arange(frames + 1) / twists.FPS
    angle, y = twists.turned(times, 1.0)
    marks = [round(twists.FPS * twists.seconds(k + 1)) for k in range(int(args.turns))]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "problem.npz", points=twists.buckled(place), triangles=triangles, rest=place, upper=ends[0],
                 lower=ends[1], angle=angle, height=y, frame=1.0 / twists.FPS, marks=marks, density=twists.DENSITY,
                 stretch=twists.STRETCH, poisson=twists.POISSON, thickness=twists.THICKNESS, friction=twists.FRICTION,
                 bend=twists.fabric().bend, seconds=args.seconds)
        (folder / "settings.json").write_text(json.dumps(PEER))
        subprocess.run([args.peer_python, str(Path(__file__).with_name("peer_vbd.py")), name, *(
            ["--device", args.device] if args.device else [])], check=True,
            env=os.environ | {"WARP_CACHE_PATH": str(Path(wp.config.kernel_cache_dir).parent / "peer")})
        rows = json.loads((folder / "rows.json").read_text())
        with np.load(folder / "states.npz") as found:
            states = [found[f"x{k}"] for k in range(len(rows))]
    for row, x in zip(rows, states, strict=True):
        row |= dict(zip(("strain_rms", "strain_most"), twists.strain(place, triangles, x.astype(np.float64)), strict=True))
        row["turns"] = float(twists.turns(row["frame"] / twists.FPS))
    return judged(rows, triangles, states)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--rows", default="drop,twist,scrunch")
    for name, value in (("points", 50000), ("turns", 10.0), ("seconds", 60.0)):
        parser.add_argument(f"--{name}", type=type(value), default=value)
    parser.add_argument("--setting", default="", help="of the scene of the twist: fields and values")
    parser.add_argument("--peer-python", default=sys.executable)
    parser.add_argument("--keep", type=Path, default=None, help="folder for the states of the twist")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    wp.config.quiet = True
    wp.init()
    device, found, wanted = wp.get_device(args.device), [], args.rows.split(",")
    head = {"hardware": hardware(device), "warp": wp.config.version, "wsim": commit()}
    print(head, flush=True)

    def tell(rows: list[dict]) -> None:
        for row in rows:
            show(found, row)
        if args.json:
            write(args.json, head | {"rows": found})
    if "drop" in wanted:
        for row in drop(2 * args.points, device):
            tell([row])
    if "twist" in wanted:
        setting = dict(each.split("=") for each in args.setting.split(",") if each)
        setting = {name: int(value) if value.isdigit() else value for name, value in setting.items()}
        sim = Simulation(twists.twist(args.points, **setting), device=device)
        rows, states = windows(args.points, args.turns, args.seconds, sim)
        for row in rows:
            print({k: v for k, v in row.items() if k in ("turns", "ms", "pairs_a_point", "strain_rms")}, flush=True)
        if args.keep:
            args.keep.mkdir(parents=True, exist_ok=True)
            for row, x in zip(rows, states, strict=True):
                np.save(args.keep / f"twist_{row['turns']:.2f}.npy", x)
        tell(judged([row | setting for row in rows], twists.sheet(args.points)[1], states))
    if "scrunch" in wanted:
        tell(scrunch(device))
    if "peer" in wanted:
        tell(peer(args))


if __name__ == "__main__":
    main()
