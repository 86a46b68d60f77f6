"""What a substep of each solver costs by size: the figures behind `wsim.choice.COSTS`, with the error of each run beside it.

    python tools/bench/choice.py [--device cuda:0] [--sides 16,32,45,64,100,320,1000] [--json FILE]

The cloth is `reference.spring_cloth`; a frame is replayed from its graph, 20 times in a row without a wait between them, best
of three. `error` is the RMS distance [m] after 0.25 s from the run with four times the substeps, in float64 where the side is
64 or less (else not measured). Leapfrog is timed both in one launch a frame (`cluster`: small nets) and by launches.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import warp as wp

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tools.bench import reference  # noqa: E402
from tools.bench.speed import hardware, show  # noqa: E402
from wsim import gather  # noqa: E402
from wsim.scene import Scene  # noqa: E402
from wsim.simulation import Simulation  # noqa: E402

REPEATS = 20


def frame_ms(sim: Simulation) -> float:
    """Milliseconds of a replayed frame."""
    for _ in range(3):
        sim.step()
    best = float("inf")
    for _ in range(3):
        wp.synchronize_device(sim.device)
        began = perf_counter()
        for _ in range(REPEATS):
            wp.capture_launch(sim.graph)
        wp.synchronize_device(sim.device)
        best = min(best, 1e3 * (perf_counter() - began) / REPEATS)
    return best


def error(scene: Scene, sim: Simulation) -> float | None:
    """See the head of this file."""
    if sim.model.points > 64**2:
        return None
    fine = Simulation(replace(scene, substeps=4 * sim.plan.clock.substeps), device=sim.device, precision="float64")
    again = Simulation(scene, device=sim.device)
    for run in (fine, again):
        run.run(15)
    return reference.rms(fine.positions() - again.positions())


def row(n: int, device, how: str, **settings) -> dict:
    """One run."""
    scene = replace(reference.spring_cloth(n), **settings)
    sim = Simulation(scene, device=device)
    ms, clock = frame_ms(sim), sim.plan.clock
    springs = len(scene.springs[0].edges)
    return {"n": n, "solver": how, "substeps": clock.substeps, "iterations": clock.iterations, "springs": springs,
            "frame_ms": ms, "substep_us": 1e3 * ms / clock.substeps, "error_025": error(scene, sim)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="16,32,45,64,100,320,1000", help="points a side")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    device, rows = wp.get_device(args.device), []
    print(f"{hardware(device)}, warp {wp.config.version}")
    for n in (int(s) for s in args.sides.split(",")):
        kept = gather.cluster_of
        for how, cluster_of in (("cluster", kept), ("launches", lambda *_: None)):
            gather.cluster_of = cluster_of
            show(rows, row(n, device, f"leapfrog, {how}", solver="explicit"))
        gather.cluster_of = kept
        show(rows, row(n, device, "xpbd", solver="xpbd", substeps=4, iterations=4))
        if n <= 320:
            show(rows, row(n, device, "implicit", solver="implicit", substeps=4, iterations=1))
    if args.json:
        Path(args.json).write_text(json.dumps({"device": hardware(device), "warp": wp.config.version, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
