"""Whether XPBD gains by warm-started multipliers, Chebyshev's acceleration or Anderson's: error at equal numbers of sweeps.

    python -m tools.bench.choice.accelerated [--scene sheet] [--frames 6] [--json FILE]

A substep of M sweeps maps z = (d, lambda) to itself M times; d are displacements, lambda multipliers. Between sweeps is tried:

plain      over-relaxed sweeps from lambda = 0, as simulations run them
warm       from the multipliers of the substep before, whose displacements w G lambda are applied first (Mueller et al. 2007,
           Tomcin 2014); `warm 0.9`: times 0.9. One more pass over the constraints, counted as a sweep
chebyshev  z_k+1 = omega_k (z~ - z_k-1) + z_k-1, omega_k+1 = 4 / (4 - rho^2 omega_k) (Wang 2015), rho given, of plain sweeps
anderson   of the last three (Anderson 1965), least squares in d times the root of the mass, on the host

Error: RMS over points and the frames [m], from leapfrog in float64. Scenes: the cotton sheet of
hanging_cloth.usda, without damping and drag; the shirt of scenes/shirt.usda hung by its collar (tools/bench/nets/garments.py).
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from scenes.examples.live import shirt
from tools.bench.choice.misses import frame_seconds, track
from tools.bench.nets.garments import sheet
from tools.bench.speed import hardware
from wsim.bench.track import all_world_positions, rms_point_distance
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation

STIFF = 1e15           # compliance over that of the material, with which a pass gives up its multipliers and nothing else
PAST = 3               # iterates that Anderson's method mixes
EARLY = 2              # sweeps before Chebyshev's method begins


def made(name: str) -> Scene:
    scene = sheet() if name == "sheet" else replace(shirt(), fps=24.0)
    for cloth in scene.cloths:
        cloth.drag = cloth.lift = 0.0
    return replace(scene, air_drag=0.0)


class Accelerated:
    """A simulation whose sweeps are launched one by one, with something between them."""

    def __init__(self, scene: Scene, substeps: int, sweeps: int, how: str):
        self.sim = Simulation(replace(scene, solver="xpbd", integrator="backward_euler", substeps=substeps,
                                      iterations=sweeps), device="cpu")
        self.name, _, factor = how.partition(" ")
        self.factor = float(factor or 1.0)
        plan = self.plan = self.sim.plan
        self.batches = plan.ports.xpbd_batches if isinstance(plan.ports.xpbd_batches, list) else plan.ports.xpbd_batches
        self.kept = [np.zeros_like(b.lam.numpy()) for b in self.batches]
        self.root = np.sqrt(np.where(plan.ports.constants.w.numpy() > 0.0, plan.model.stack("masses"), 0.0))[:, None]
        plan.substep = self.substep                        # type: ignore[method-assign]

    def substep(self, k: int | None = None) -> None:
        plan, clock = self.plan, self.plan.clock
        clock.k = clock.k if k is None else k
        for phase in ("pose", "predict", "collide"):
            for stage in plan.stages(phase, "substep"):
                stage.launch(clock)
        if self.name == "warm":
            self.warm(clock)
        past, omega = [self.state()], 1.0
        for i in range(clock.iterations):
            clock.i = i
            for stage in plan.stages("solve", "iteration"):
                stage.launch(clock)
            if self.name == "chebyshev" and i >= EARLY:
                omega = 2.0 / (2.0 - self.factor**2) if i == EARLY else 4.0 / (4.0 - self.factor**2 * omega)
                self.put([omega * (now - two) + two for now, two in zip(self.state(), past[-2], strict=True)])
            past.append(self.state())
            if self.name == "anderson":
                self.mix(past)
        self.kept = [b.lam.numpy().copy() for b in self.batches]
        for phase in ("solve", "finish", "deform"):
            for stage in plan.stages(phase, "substep"):
                stage.launch(clock)

    def state(self) -> list[np.ndarray]:
        return [self.sim.state.d.numpy().astype(np.float64), *(b.lam.numpy().astype(np.float64) for b in self.batches)]

    def put(self, values: list[np.ndarray]) -> None:
        self.sim.state.d.assign(values[0].astype(np.float32))
        for batch, lam in zip(self.batches, values[1:], strict=True):
            batch.lam.assign(lam.astype(np.float32))

    def warm(self, clock) -> None:
        """Displacements of the multipliers before: a pass with endless compliance turns -lambda into 0 and w G lambda."""
        before = [b.data.alpha.numpy().copy() for b in self.batches]
        for b, lam, alpha in zip(self.batches, self.kept, before, strict=True):
            b.data.alpha.assign(alpha * np.float32(STIFF))
            b.lam.assign(-self.factor * lam)
        clock.i = 0
        for stage in self.plan.stages("solve", "iteration"):
            stage.launch(clock)
        for b, lam, alpha in zip(self.batches, self.kept, before, strict=True):
            b.data.alpha.assign(alpha)
            b.lam.assign(self.factor * lam)

    def mix(self, past: list) -> None:
        """past: z before each sweep and after the last; replaces that by the mix of the last few."""
        made, residual = getattr(self, "made", []), past[-1][0] - past[-2][0]
        made = [(past[-1], residual)] if self.plan.clock.i == 0 else [*made, (past[-1], residual)][-PAST:]
        self.made = made
        if len(made) < 2:
            return
        F = np.stack([((made[-1][1] - r) * self.root).ravel() for _, r in made[:-1]], axis=1)
        gamma = np.linalg.lstsq(F, (made[-1][1] * self.root).ravel(), rcond=1e-8)[0]
        mixed = [z - sum(g * (z - old) for g, old in zip(gamma, olds, strict=True))
                 for z, olds in zip(made[-1][0], zip(*(m[0] for m in made[:-1]), strict=True), strict=True)]
        self.put(mixed)
        past[-1] = mixed

    def track(self, frames: int) -> np.ndarray:
        found = []
        self.sim.load()
        for _ in range(frames):
            self.plan.before_frame(self.sim.time)
            self.plan.frame()
            self.plan.clock.starting = False
            self.sim.frame += 1
            found.append(all_world_positions(self.sim))
        return np.array(found)


def beside(scene: Scene, there: np.ndarray, solver: str, integrator: str, substeps: int, iterations: int) -> dict:
    """A row of a simulation as it is, with the CPU seconds of a frame; XPBD: of substeps x iterations sweeps in all."""
    n = substeps // iterations if solver == "xpbd" else substeps
    sim = Simulation(replace(scene, solver=solver, integrator=integrator, substeps=n, iterations=iterations), device="cpu")
    error = float(rms_point_distance(track(sim, len(there)), there).max())
    seconds = frame_seconds(sim)
    print(f"{solver} {integrator} {n} x {iterations} {1e3 * error:.3g}, {1e3 * seconds:.3g} ms", flush=True)
    return {"how": solver, "integrator": integrator, "substeps": n, "sweeps": iterations, "error": error, "seconds": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools.bench.choice.accelerated", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=("sheet", "shirt"), default="sheet")
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--sweeps", type=int, default=96, help="a frame, of every row")
    parser.add_argument("--ways", default="plain,warm 0.8,warm 0.9,warm,chebyshev 0.9,chebyshev 0.97,chebyshev 0.99,anderson")
    parser.add_argument("--refined", type=int, default=2, help="stable substeps of the reference")
    parser.add_argument("--each", default="2,4,8,16", help="sweeps a substep")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    scene, rows = made(args.scene), []
    exact = replace(scene, solver="explicit", integrator="auto", substeps=1)
    least = Simulation(exact, device="cpu").plan.clock.substeps
    there = track(Simulation(replace(exact, substeps=args.refined * least), device="cpu", precision="float64"), args.frames)
    print(f"{args.scene}, {args.frames} frames, {args.sweeps} sweeps a frame: RMS error [mm]; {hardware(wp.get_device('cpu'))}")
    for sweeps in map(int, args.each.split(",")):
        said = []
        for how in args.ways.split(","):
            each = sweeps + how.startswith("warm")
            if how.startswith("cheb") and sweeps < 4:
                continue
            substeps = max(1, round(args.sweeps / each))
            found = Accelerated(scene, substeps, sweeps, how).track(args.frames)
            error = float(rms_point_distance(found, there).max()) if np.isfinite(found).all() else float("nan")
            rows.append({"how": how, "substeps": substeps, "sweeps": sweeps, "error": error})
            said.append(f"{how} {substeps} x {sweeps} {1e3 * error:.3g}")
        print("; ".join(said), flush=True)
    rows += [beside(scene, there, "xpbd", "backward_euler", args.sweeps, m) for m in (1, 4)]
    rows += [beside(scene, there, "implicit", "bdf2", n, 1) for n in (args.sweeps // 20, args.sweeps // 10)]
    if args.json:
        args.json.write_text(json.dumps({"scene": args.scene, "frames": args.frames, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
