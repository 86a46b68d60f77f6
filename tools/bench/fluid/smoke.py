"""Fluids: time of a step beside error and divergence, for each size, in one run.

    python tools/bench/fluid/smoke.py [--device cuda:0|cpu] [--sizes 32,64,128] [--problems plume,ball] [--steps 10]
                                 [--precision float32] [--json FILE]

    plume      smoke that rises in an open box: reflection, 1e-4, pressure direct where the plan takes it so
    cycle      the same by multigrid
    ball       the same past a ball, by multigrid with openings
    abc        Beltrami flow in a periodic box, 1 s at CFL 1: root mean square error of the velocity
    pressure   iterations of a random velocity to 1e-6, with and without a ball, and what divergence is left

ms: of a step, the median of `--steps` frames of one step each; cpu_ms: of the process. Sizes are cells along each edge.
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
from wsim import Scene, Simulation  # noqa: E402
from wsim.physics.fluid.measure import fluid_cell_divergence  # noqa: E402
from wsim.physics.fluid.objects import Fluid, Source  # noqa: E402
from wsim.scene import Motion, Sphere  # noqa: E402


def smoke(n: int, *, ball: bool = False, pressure: str = "auto") -> Scene:
    """A cube of 1 m, a source of warm smoke below; one step a frame of 1/48 s."""
    scene = Scene(fps=48.0, frames=1)
    scene.add(Fluid("/air", (0, 0, 0), (1, 1, 1), 1.0 / n, steps=1, pressure=pressure))
    scene.add(Source("/fire", Sphere(0.1), smoke=2.0, temperature=300.0, motion=Motion.at_place((0.5, 0.15, 0.5))))
    if ball:
        scene.collider("/ball", Sphere(0.15), at=(0.5, 0.55, 0.5))
    return scene


def timed(sim: Simulation, steps: int) -> dict:
    """Median of frames of one step, after two that compile and capture."""
    for _ in range(2):
        sim.step()
    wall, cpu = [], []
    for _ in range(steps):
        began = time.perf_counter(), time.process_time()
        sim.step()
        wp.synchronize_device(sim.device)
        wall.append(time.perf_counter() - began[0])
        cpu.append(time.process_time() - began[1])
    return {"ms": 1e3 * float(np.median(wall)), "cpu_ms": 1e3 * float(np.median(cpu)), "compile_s": sim.seconds["compile"]}


def rises(n: int, args, **more) -> dict:
    sim = Simulation(smoke(n, **more), device=args.device, precision=args.precision)
    row = timed(sim, args.steps)
    said = sim.indicators()
    return row | {"iterations": said["fluid_iterations"], "MB": sim.state.bytes / 1e6,
                  "divergence": said["fluid_divergence"] / n / max(said["fluid_speed"], 1e-12), "warnings": sim.warnings}


def beltrami(axis: int, x, y, z):
    return (np.sin(z) + np.cos(y), np.sin(x) + np.cos(z), np.sin(y) + np.cos(x))[axis]


def abc(n: int, args) -> dict:
    size = 2.0 * np.pi
    steps = round(2.0 * n / size)
    scene = Scene(fps=float(steps), frames=steps, gravity=(0.0, 0.0, 0.0))
    fluid = scene.add(Fluid("/air", (0, 0, 0), (size,) * 3, size / n, ("periodic",) * 6, steps=1, tolerance=1e-5))
    fluid.velocity = np.zeros((*fluid.shape, 3))
    sim = Simulation(scene, device=args.device, precision=args.precision)
    method = sim.plan.method("fluid")
    layout = method.layouts[0]
    places = [np.meshgrid(*(fluid.cell * (np.arange(m) + 0.5 * (b != a)) for b, m in enumerate(layout.faces(a))), indexing="ij")
              for a in range(3)]
    for a in range(3):
        method.field(0, "uvw"[a]).assign(beltrami(a, *places[a]).ravel().astype(sim.model.dtype))
    began = time.perf_counter()
    sim.run()
    now = method.arrays(0)
    wrong = sum(np.mean((now["uvw"[a]] - beltrami(a, *places[a])) ** 2) for a in range(3))
    return {"ms": float(np.median(sim.milliseconds[2:])), "error": float(np.sqrt(wrong)), "steps": steps,
            "seconds": time.perf_counter() - began}


def pressure(n: int, args, ball: bool) -> dict:
    sim = Simulation(smoke(n, ball=ball, pressure="multigrid"), device=args.device, precision=args.precision)
    sim.load()
    method = sim.plan.method("fluid")
    method.before_frame(0.0, sim.plan.clock)
    domain, layout, rng = method.domains[0], method.layouts[0], np.random.default_rng(0)
    domain.pressure.tolerance = 1e-6
    for a in range(3):
        method.field(0, "uvw"[a]).assign(rng.standard_normal(layout.faces(a)).ravel().astype(sim.model.dtype))
    before = np.linalg.norm(fluid_cell_divergence(domain.fluid, layout, method.arrays(0), domain.obstacles))
    domain.pressure.solve(domain.u)
    domain.pressure.project(domain.u, domain.u)
    after = np.linalg.norm(fluid_cell_divergence(domain.fluid, layout, method.arrays(0), domain.obstacles))
    return {"iterations": int(domain.words["solves"].numpy()[1]), "missed": int(domain.words["missed"].numpy()[0]),
            "left": float(after / before)}


PROBLEMS = {"plume": lambda n, args: rises(n, args), "cycle": lambda n, args: rises(n, args, pressure="multigrid"),
            "ball": lambda n, args: rises(n, args, ball=True), "abc": abc, "pressure": lambda n, args: pressure(n, args, False),
            "pressure_ball": lambda n, args: pressure(n, args, True)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--sizes", default="32,64")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--precision", default="float32")
    parser.add_argument("--json")
    args = parser.parse_args()
    rows = []
    for name in args.problems.split(","):
        for n in map(int, args.sizes.split(",")):
            try:
                found = PROBLEMS[name](n, args)
            except Exception as failed:  # noqa: BLE001  # a row that fails is told, and the others go on
                found = {"failed": str(failed)[:300]}
            rows.append({"problem": name, "n": n, "device": args.device, **found})
            shown = {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in found.items()}
            print(f"{name:14} {n:4}^3  {shown}", flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
