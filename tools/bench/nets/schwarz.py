"""Newton's method on the shirt hung by its upper edge, solved by domains beside block Jacobi: iterations and time of a solve
with the matrices after some frames, and time and residual of a frame.

    python tools/bench/nets/schwarz.py [--device cuda:0|cpu] [--substeps 2,8,32] [--frames 2] [--integrator bdf2]
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import wsim  # noqa: E402
from wsim.physics.solver.schwarz import solver  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

UPPER = 0.02           # [m] from the top that are held


def hung(substeps: int, integrator: str):
    """The shirt without its dummy."""
    scene = replace(wsim.load("scenes/shirt.usda"), colliders=[], solver="implicit", integrator=integrator, substeps=substeps,
                    iterations=3)
    cloth = scene.cloths[0]
    height = np.asarray(cloth.points, float)[:, 1]
    scene.pin("/collar", cloth.path, np.flatnonzero(height > height.max() - UPPER))
    return scene


def seconds(work, times: int = 3) -> float:
    """Time of one call of several, on the device."""
    work()
    wp.synchronize()
    began = perf_counter()
    for _ in range(times):
        work()
    wp.synchronize()
    return (perf_counter() - began) / times


def row(device: str, substeps: int, frames: int, integrator: str, domains: bool) -> str:
    """One line of the table."""
    solver.PAYS = dict.fromkeys(solver.PAYS, (0, 0.0) if domains else (10**9, 0.0))
    sim = Simulation(hung(substeps, integrator), device=device)
    sim.run(frames)
    found, said = sim.plan.ports.newton_assembly, sim.indicators()
    found.linearise(1.0 / sim.plan.clock.effective_step)
    cells = [f"{substeps:3d}", "domains" if domains else "jacobi ", f"{1e3 * seconds(sim.step, 2):9.2f}"]
    found.linearise(1.0 / sim.plan.clock.effective_step)
    for tolerance in (1e-2, 1e-6):
        found.system.count.zero_()
        found.solve(found.f, tolerance, 5000)
        count = int(found.system.count.numpy().max())
        cells.append(f"{count:6d} {1e3 * seconds(lambda t=tolerance: found.solve(found.f, t, 5000)):9.2f}")
    return "  ".join([*cells, f"{said['residual']:.2g}", sim.plan.integrator])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--substeps", default="2,8,32")
    parser.add_argument("--frames", type=int, default=2)
    parser.add_argument("--integrator", default="backward_euler")
    given = parser.parse_args()
    print("substeps, solver, ms a frame, iterations and ms to 1e-2, to 1e-6, residual, integrator at the end")
    for n in map(int, given.substeps.split(",")):
        for domains in (True, False):
            print(row(given.device, n, given.frames, given.integrator, domains), flush=True)


if __name__ == "__main__":
    main()
