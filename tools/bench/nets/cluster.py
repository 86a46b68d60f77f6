"""What a further substep costs a cluster of blocks, by size and threads to a point: the figures behind
`wsim.physics.motion.fast_paths.cluster`.

    python tools/bench/nets/cluster.py [--device cuda:0] [--sides 16,32,45,64,80,90] [--json FILE]

The cloth is `reference.spring_cloth`, stepped by leapfrog. `us` is the time of a frame over its substeps; `further_us` what
twice as many substeps more take, each: without a frame's start. `error` as in choice.py. A GPU of compute capability 9.0.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.choice.misses import frame_seconds  # noqa: E402
from tools.bench.nets import reference  # noqa: E402
from tools.bench.speed import hardware, show  # noqa: E402
from wsim.physics.motion import forces  # noqa: E402
from wsim.physics.motion.fast_paths import cluster  # noqa: E402
from wsim.scene import Scene  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402


def plans(n: int, most: int) -> list:
    """The chosen cluster, the others of 16 blocks that fit, and none: launches."""
    chosen, found = cluster.cluster_for(n * n, most), []
    for lanes in (8, 4, 2, 1):
        whole = 32 // lanes
        plan = cluster.SpringCluster(lanes, -(-most // lanes), -(-n * n // (16 * whole)) * whole, 16)
        if plan.threads <= cluster.THREADS and plan.entries <= cluster.ENTRIES and plan != chosen:
            found.append(plan)
    return ([chosen] if chosen else []) + found + [None]


def frame_ms(sim: Simulation) -> float:
    """Milliseconds of a replayed frame."""
    sim.run(3)
    return 1e3 * frame_seconds(sim)


def error(scene: Scene, sim: Simulation) -> float | None:
    """RMS distance [m] after 15 frames from four times the substeps in float64; None of nets beyond 64 x 64 points."""
    if sim.model.points > 64**2:
        return None
    fine = Simulation(replace(scene, substeps=4 * sim.plan.clock.substeps), device=sim.device, precision="float64")
    again = Simulation(scene, device=sim.device)
    for run in (fine, again):
        run.run(15)
    return reference.rms(fine.positions() - again.positions())


def row(n: int, plan, device, first: bool) -> dict:
    """One run with that plan; `chosen` says whether it is the one that a scene gets."""
    forces.cluster_for = lambda *_: plan
    scene = replace(reference.spring_cloth(n), solver="explicit")
    sim = Simulation(scene, device=device)
    substeps, ms = sim.plan.clock.substeps, frame_ms(sim)
    longer = frame_ms(Simulation(replace(scene, substeps=3 * substeps), device=device))
    shape = {"lanes": plan.lanes, "threads": plan.threads, "blocks": plan.size} if plan else {}
    return {"n": n, "chosen": first, **shape, "substeps": substeps, "us": 1e3 * ms / substeps,
            "further_us": 0.5e3 * (longer - ms) / substeps, "error_025": error(scene, sim) if first else None}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="16,32,45,64,80,90", help="points a side")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    device, rows, kept = wp.get_device(args.device), [], forces.cluster_for
    if not device.is_cuda or device.arch < 90:
        sys.exit(f"--device: {device} forms no clusters; a GPU of compute capability 9.0 or more does")
    print(f"{hardware(device)}, warp {wp.config.version}")
    for n in (int(s) for s in args.sides.split(",")):
        for number, plan in enumerate(plans(n, 12)):
            show(rows, row(n, plan, device, number == 0))
    forces.cluster_for = kept
    if args.json:
        head = {"hardware": hardware(device), "warp": wp.config.version}
        Path(args.json).write_text(json.dumps(head | {"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
