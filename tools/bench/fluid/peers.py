"""Flows with a known answer by wsim and by PhiFlow, in one run: time of a step beside error.

    python tools/bench/fluid/peers.py [--peer-python X/bin/python] [--device cpu|cuda:0] [--json FILE]

X is an environment of PhiFlow's own (python -m venv X; X/bin/pip install phiflow==3.4.0), which runs this file for its rows; it
has NumPy alone there, on the CPU. Without it wsim's rows are all.

    taylor_green    64 x 64 cells, periodic, 2 s at CFL 1, without viscosity
    abc             the flow of Arnold, Beltrami and Childress, 32^3 cells, 1 s at CFL 1

cpu_ms: CPU time of a step, the median; of wsim's frame of one step, behind two that compile and capture (on CUDA ms of the
clock). error: root of the mean square of the velocity less the exact one. Pressure to 1e-5.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
SIZE = 2.0 * np.pi
PROBLEMS = {"taylor_green": (2, 64, 20, 2.0), "abc": (3, 32, 10, 1.0)}          # axes, cells along one, steps, seconds
OURS = ("reflection", "cubic", "maccormack", "linear")
THEIRS = ("semi_lagrangian", "mac_cormack")
TOLERANCE = 1e-5


def velocity(problem: str, axis: int, x):
    """Component at places x[0], x[1], x[2]; any numbers with sin and cos."""
    sin, cos = np.sin, np.cos
    if problem == "abc":
        return sin(x[(axis + 2) % 3]) + cos(x[(axis + 1) % 3])
    return sin(x[0]) * cos(x[1]) if axis == 0 else -cos(x[0]) * sin(x[1])


def wsim(problem: str, scheme: str, device: str) -> dict:
    sys.path.insert(0, str(ROOT))
    import warp as wp

    from wsim import Scene, Simulation
    from wsim.physics.fluid.objects import Fluid
    dim, n, steps, seconds = PROBLEMS[problem]
    scene, cell = Scene(fps=steps / seconds, frames=steps, gravity=(0.0, 0.0, 0.0)), SIZE / n
    box = [SIZE] * dim + [cell] * (3 - dim)
    fluid = scene.add(Fluid("/air", np.zeros(3), np.array(box), cell, ("periodic",) * 6, steps=1, tolerance=TOLERANCE,
                            advection=scheme))
    fluid.velocity = np.zeros((*fluid.shape, 3))
    sim = Simulation(scene, device=device)
    method = sim.plan.method("fluid")
    layout, exact = method.layouts[0], []
    for a in range(dim):
        rows = [cell * (np.arange(m) + (0.0 if b == a else 0.5)) for b, m in enumerate(layout.faces(a))]
        exact.append(velocity(problem, a, np.meshgrid(*rows, indexing="ij")))
        method.field(0, "uvw"[a]).assign(exact[a].ravel().astype(sim.model.dtype))
    clock, took = time.process_time if device == "cpu" else time.perf_counter, []
    for _ in range(steps):
        began = clock()
        sim.step()
        wp.synchronize_device(sim.device)
        took.append(clock() - began)
    now = method.arrays(0)
    wrong = sum(np.mean((now["uvw"[a]] - exact[a]) ** 2) for a in range(dim))
    return {"cpu_ms": 1e3 * float(np.median(took[2:])), "error": float(np.sqrt(wrong))}


def phiflow(problem: str, scheme: str) -> dict:
    from phi.flow import PERIODIC, Box, Solve, StaggeredGrid, advect, fluid, math
    dim, n, steps, seconds = PROBLEMS[problem]
    names = "xyz"[:dim]

    def start(x):
        x = [x.vector[name] for name in names]
        sin, cos = math.sin, math.cos
        if problem == "abc":
            parts = [sin(x[(a + 2) % 3]) + cos(x[(a + 1) % 3]) for a in range(3)]
        else:
            parts = [sin(x[0]) * cos(x[1]), -cos(x[0]) * sin(x[1])]
        return math.vec(**dict(zip(names, parts, strict=True)))
    first = StaggeredGrid(start, PERIODIC, Box(**dict.fromkeys(names, SIZE)), **dict.fromkeys(names, n))
    now, pressure, took = first, None, []
    for _ in range(steps):
        began = time.process_time()
        now = getattr(advect, scheme)(now, now, seconds / steps)
        now, pressure = fluid.make_incompressible(now, (), Solve("CG", TOLERANCE, 0, x0=pressure, max_iterations=1000))
        took.append(time.process_time() - began)
    off = now - first
    wrong = sum(float(np.mean(off.vector[name].values.numpy(",".join(names)) ** 2)) for name in names)
    return {"cpu_ms": 1e3 * float(np.median(took[2:])), "error": float(np.sqrt(wrong))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json")
    parser.add_argument("--row", nargs=2, metavar=("PROBLEM", "SCHEME"), help="PhiFlow's, by its own interpreter")
    args = parser.parse_args()
    if args.row:
        print(json.dumps(phiflow(*args.row)))
        return
    rows = []
    for problem in PROBLEMS:
        for engine, scheme in [("wsim", s) for s in OURS] + [("phiflow", s) for s in THEIRS if args.peer_python]:
            if engine == "wsim":
                found = wsim(problem, scheme, args.device)
            else:
                done = subprocess.run([args.peer_python, __file__, "--row", problem, scheme], capture_output=True, text=True)
                found = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else {"failed": done.stderr[-300:]}
            rows.append({"problem": problem, "engine": engine, "scheme": scheme, **found})
            print(rows[-1], flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
