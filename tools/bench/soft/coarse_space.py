"""Soft bodies solved with a coarse space (wsim/physics/solver/coarse_space.py) beside block Jacobi: iterations, time, and what
is left.

    python tools/bench/soft/coarse_space.py [--device cuda:0|cpu] [--tets 25000,200000,1000000] [--hertz 60,240,600] [--parts]

A cube of 1 m, n^3 cells of five tets, E 1e6 Pa, nu 0.3, 1000 kg/m^3, one face held, falls under its weight from rest: ten steps
of 1/hertz s by backward Euler, one Newton step each. ms is the median of the later steps, each waited for; iterations those of
the last; residual that of the last Newton step; apart the largest distance [mm] of the points' ends from those of block Jacobi,
beside how far they went. --parts: ms of what a solve is made of, replayed from graphs.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.soft.substeps import cube  # noqa: E402
from tools.bench.speed import hardware, timed  # noqa: E402
from wsim import Simulation  # noqa: E402
from wsim.physics.solver import coarse_space  # noqa: E402

STEPS = 10


def simulation(cells: int, hertz: float, coarse: bool, device: str) -> Simulation:
    """The cube with a coarse space or without, whatever the rule says."""
    kept = dict(coarse_space.PAYS)
    coarse_space.PAYS |= dict.fromkeys(kept, ((0, 0.0 if coarse else np.inf),))
    scene = cube(cells, "corotational", 1, 1, "backward_euler")
    scene.fps = hertz
    sim = Simulation(scene, device=device)
    coarse_space.PAYS |= kept
    return sim


def row(sim: Simulation, cells: int, hertz: float) -> dict:
    times = []
    for _ in range(STEPS):
        start = time.perf_counter()
        sim.step()
        times.append(1e3 * (time.perf_counter() - start))
    system, found = sim.plan.ports.newton_assembly.system, sim.indicators()
    body = sim.scene.softs[0]
    return {"tets": len(body.tets), "hertz": hertz, "coarse": bool(system.coarse), "ms": float(np.median(times[2:])),
            "iterations": int(found["pcg_iterations"]), "residual": found["residual"],
            "waves": coarse_space.sound_wave_edges(sim.model.bodies[0], 1.0 / hertz),
            "nodes": [level.size for level in system.coarse.levels] if system.coarse else [],
            "moved": 1e3 * float(np.abs(sim.positions() - body.points).max()), "build_s": sim.seconds["build"],
            "compile_s": sim.seconds["compile"]}


def parts(sim: Simulation) -> dict[str, float]:
    """ms of each part of a solve, as it stands after the last step; one pass each."""
    newton, model = sim.plan.ports.newton_assembly, sim.model
    system, coarse, c = newton.system, newton.system.coarse, newton.system.chunks
    device, v, size = wp.get_device(str(model.device)), newton.v, newton.system.chunks.body.size
    c.done.zero_()
    c.going.fill_(1)
    k = system.kernels
    launches = {"multiply": lambda: system.launch(k.multiply, [c, system.rows, system.A, 0, v], [], size),
                "linearise": lambda: newton.linearise(1.0 / sim.plan.clock.effective_step)}
    if coarse:
        at, g = (sim.state.x, sim.state.d), coarse.g
        launches |= {"setup": lambda: coarse.setup(system.rows, system.A, *at),
                     "cycle": lambda: (c.going.fill_(1), coarse.cycle(c.going, v.r, system.launch)),
                     "prolong": lambda: system.launch(coarse.blocks.prolong, [c, g, 0, v], [], size)}
        n, blocks, points = coarse.levels[0].size, len(coarse.levels[0].column), model.points
        s, p, going = coarse.setups, coarse.steps, c.going
        launches |= {" shares": lambda: coarse.launch(s.shares, 6 * points, [system.rows, system.A, g]),
                     " own": lambda: coarse.launch(s.own_points, 6 * n, [0, g]),
                     " pairs": lambda: coarse.launch(s.pairs_points, 6 * blocks, [0, system.rows, system.A, g]),
                     " factor": lambda: coarse.launch(s.factor, n, [0, *at, g]),
                     " gather": lambda: (going.fill_(1), coarse.launch(p.gather, 6 * n, [0, going, v.r, g])),
                     " residual": lambda: (going.fill_(1), coarse.launch(p.residual, 6 * n, [0, going, g]))}
    inner = 10 if device.is_cuda else 1
    return {name: 1e3 * timed(launch, device, 3, inner) for name, launch in launches.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--tets", default="25000,200000,1000000")
    parser.add_argument("--hertz", default="60,240,600")
    parser.add_argument("--parts", action="store_true")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    wp.config.quiet = True
    device, rows = str(wp.get_device(args.device)), []
    print(hardware(wp.get_device(device)))
    print(f"{'tets':>8} {'hertz':>6} {'waves':>6}  {'preconditioner':<15}{'iterations':>11}{'ms':>9}{'residual':>10}"
          f"{'apart mm':>10}{'moved mm':>10}{'build s':>9}{'compile s':>10}  nodes")
    for tets in map(int, args.tets.split(",")):
        cells = max(1, round((tets / 5.0)**(1.0 / 3.0)))
        for hertz in map(float, args.hertz.split(",")):
            ends = []
            for coarse in (False, True):
                sim = simulation(cells, hertz, coarse, device)
                r = row(sim, cells, hertz)
                ends.append(sim.positions())
                r["apart"] = 1e3 * float(np.abs(ends[-1] - ends[0]).max())
                rows.append(r)
                print(f"{r['tets']:>8} {hertz:>6g} {r['waves']:>6.1f}  {'multigrid' if coarse else 'block Jacobi':<15}"
                      f"{r['iterations']:>11}{r['ms']:>9.3f}{r['residual']:>10.1e}{r['apart']:>10.4f}{r['moved']:>10.3f}"
                      f"{r['build_s']:>9.2f}{r['compile_s']:>10.2f}  {r['nodes'] or ''}", flush=True)
            if args.parts:
                r["parts"] = parts(sim)
                print("   ms: " + ", ".join(f"{name.strip()} {ms:.4f}" for name, ms in r["parts"].items()), flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps({"hardware": hardware(wp.get_device(device)), "warp": wp.__version__,
                                               "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
