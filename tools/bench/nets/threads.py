"""CPU threads abreast against one: time of a substep of leapfrog, frame about frame, and whether the bits are the same.

    python tools/bench/nets/threads.py [--threads 1,2] [--sides 32,64,100] [--garment] [--precision float32] [--substeps 55]
                                  [--frames 200] [--alone SECONDS] [--json FILE]

Simulations that differ in nothing but their threads take a frame each in turn, a Python call and a graph's replay included;
`least_us` and `median_us` are over its substeps. Frames are cut short (`--substeps` of the usual length) so that some are
disturbed by nobody. --alone: for so many seconds a row takes only frames at whose start and end no other process wants a core
(Linux); on a shared machine even then a core may be slower than it was, and the least times say most. `joined` are frames
that helpers took part in, `naps` long waits of all threads. A count of threads that the net is not worth, or cannot be cut
into, becomes the next that is.
"""

import argparse
import json
import sys
from dataclasses import replace
from math import ceil
from pathlib import Path
from statistics import median
from time import perf_counter, sleep

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.nets import garment, reference  # noqa: E402
from tools.bench.speed import hardware, show  # noqa: E402
from wsim.kernels.motion.threads import DOOR, FORMED, STALLS  # noqa: E402
from wsim.physics.motion import forces  # noqa: E402
from wsim.scene import Scene  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

SHIRT = 857            # substeps a frame of 1/60 s that keep the garment stable; sheets of n points a side n / 32 times 55


class Walk:
    """A simulation with so many threads at most."""

    def __init__(self, scene: Scene, precision: str, threads: int):
        forces.cores = lambda: threads
        self.sim = Simulation(scene, device="cpu", precision=precision)
        self.team = self.sim.plan.method("explicit").pull.abreast       # type: ignore[union-attr]
        self.times: list[float] = []
        self.joined = self.naps = 0
        self.sim.run(3)

    def step(self, until: float) -> None:
        while crowded() and perf_counter() < until:
            sleep(0.02)
        began = perf_counter()
        self.sim.step()
        spent = perf_counter() - began
        if perf_counter() < until and crowded():
            return
        self.times.append(1e6 * spent / self.sim.plan.clock.substeps)
        if self.team.count > 1 and self.team.words[FORMED] == self.team.words[DOOR] >> 6:
            self.joined, self.naps = self.joined + 1, self.naps + int(self.team.words[STALLS])

    def row(self) -> dict:
        return {"threads": self.team.count, "frames": len(self.times), "joined": self.joined, "naps": self.naps,
                "least_us": min(self.times), "median_us": median(self.times)}


def crowded() -> bool:
    """Whether another process wants a core at this instant."""
    load = Path("/proc/loadavg")
    return load.exists() and load.read_text().split()[3].split("/")[0] != "1"


def compare(name: str, scene: Scene, args: argparse.Namespace, rows: list) -> None:
    """Rows of a scene, the first of one thread; `ratio` is to that one's least time."""
    scene = replace(scene, solver="explicit", integrator="leapfrog", substeps=args.substeps)
    walks = [Walk(scene, args.precision, int(threads)) for threads in args.threads.split(",")]
    until = perf_counter() + args.alone
    for _ in range(args.frames):
        for walk in walks:
            walk.step(until)
    places = [walk.sim.positions() for walk in walks]
    for walk, x in zip(walks, places, strict=True):
        found = walk.row()
        show(rows, {"net": name, "points": len(x)} | found | {"ratio": found["least_us"] / min(walks[0].times),
                                                              "same_bits": bool(np.array_equal(x, places[0]))})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", default="1,2", help="counts, at most")
    parser.add_argument("--sides", default="32,64,100", help="points a side of each sheet; empty: none")
    parser.add_argument("--garment", action="store_true", help="the shirt too")
    parser.add_argument("--precision", default="float32")
    parser.add_argument("--substeps", type=int, default=55)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--alone", type=float, default=0.0, help="[s] a row waits for instants without others")
    parser.add_argument("--json", default=None)
    args, rows = parser.parse_args(), []                     # type: ignore[var-annotated]
    head = {"hardware": hardware(wp.get_device("cpu")), "warp": wp.config.version}
    print(head)
    for n in (int(s) for s in args.sides.split(",") if s):
        scene = reference.spring_cloth(n)
        compare(f"sheet {n}", replace(scene, fps=scene.fps * ceil(n / 32 * 55 / args.substeps)), args, rows)
    if args.garment:
        scene = garment.shirt()
        compare("garment", replace(scene, fps=scene.fps * ceil(SHIRT / args.substeps)), args, rows)
    if args.json:
        Path(args.json).write_text(json.dumps(head | {"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
