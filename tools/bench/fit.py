"""How often the truth is inside two error bars of a fit, and what fits cost: many draws of noise on data of three kinds.

    python tools/bench/fit.py [--draws 100] [--only same,net,fine,bar] [--json FILE]

    same    a sheet of 8 x 8 points, observed as the very scheme has it: the error bars themselves
    net     a net of springs, observed as an independent program has it (NumPy, Runge-Kutta of order 4, error below 1e-7 m)
    fine    a sheet of 15 x 15 points, observed as 29 x 29 points are by Runge-Kutta of order 4 with half the step: what a
            coarse mesh makes of its parameters is no noise, and stands apart as bias (of a fit to data without noise)
    bar     E and nu of a soft bar, as `same`

A row: draws inside two error bars of the truth and of the biased value, root mean square of (found - biased) over the error
bar (1: error bars are right), bias, simulations (copies times part of the horizon) in the mean and at most, launches, seconds a
fit.
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tools.bench import reference  # noqa: E402
from wsim import Bulk, Fabric, Scene, Simulation, shapes  # noqa: E402
from wsim.fitting import Settings, Track, fit  # noqa: E402


@dataclass
class Case:
    """A scene, what is seen of it without noise (frames, n, 3) [m], the noise [m], true values, and where fits start."""

    scene: Scene
    x: np.ndarray
    noise: float
    truth: dict[str, float]
    start: dict[str, float]
    frames: np.ndarray

    @property
    def path(self) -> str:
        return self.scene.bodies()[0].path

    def fit(self, seed: int | None):
        noise = 0.0 if seed is None else self.noise * np.random.default_rng(seed).normal(size=self.x.shape)
        track = Track(self.path, self.frames, self.x + noise)
        return fit(self.scene, [track], list(self.truth), start=self.start, settings=Settings(device="cpu"))


def motion(scene: Scene) -> np.ndarray:
    """Positions at frames 1, 2 ..., in float64."""
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(scene.frames, lambda s: found.append(s.positions()))
    return np.array(found)


def sheet(cells: int, substeps: int, frames: int, bend: float, integrator: str = "auto") -> Scene:
    scene = Scene(fps=24, frames=frames, solver="explicit", substeps=substeps, integrator=integrator)
    cloth = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, cells, cells, horizontal=True),
                        material=Fabric(stretch=200.0, shear=60.0, bend=bend, density=200.0))
    scene.pin("/pin", cloth, [0, cells])
    return scene


def same() -> Case:
    scene = sheet(7, 34, 24, 1e-3)
    truth, start = {"stretch": 200.0, "bend": 1e-3}, {"stretch": 400.0, "bend": 5e-4}
    return Case(scene, motion(scene), 1e-3, truth, start, np.arange(1, 25))


def fine() -> Case:
    scene, other = sheet(14, 60, 10, 1e-2), sheet(28, 360, 10, 1e-2, "rk4")
    own = (2 * np.arange(15)[:, None] * 29 + 2 * np.arange(15)).ravel()
    return Case(scene, motion(other)[:, own], 5e-3, {"stretch": 200.0, "bend": 1e-2}, {"stretch": 300.0, "bend": 7e-3},
                np.arange(1, 11))


def net() -> Case:
    scene = reference.spring_cloth(10)
    scene.solver, scene.substeps, scene.frames = "explicit", 64, 18
    frames = np.arange(1, 19)
    x, error = reference.exact(reference.net(scene), (frames / scene.fps).tolist(), tolerance=1e-7)
    assert error < 1e-7
    stiffness = float(scene.springs[0].stiffness.astype(np.float64).mean())
    return Case(scene, x, 1e-3, {"stiffness": stiffness, "gravity_y": scene.gravity[1]}, {"stiffness": 1.5 * stiffness}, frames)


def bar() -> Case:
    scene = Scene(fps=60, frames=24, solver="implicit", integrator="bdf2", substeps=2, iterations=3)
    points, tets = shapes.block((0.6, 0.2, 0.2), (6, 2, 2))
    body = scene.soft("/bar", points, tets, material=Bulk(1e5, 0.3, 1e3))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return Case(scene, motion(scene), 1e-3, {"young": 1e5, "poisson": 0.3}, {"young": 2e5, "poisson": 0.4}, np.arange(1, 25))


CASES: dict[str, Callable[[], Case]] = {"same": same, "net": net, "fine": fine, "bar": bar}


def study(case: Case, draws: int) -> dict:
    """Of each parameter: share inside, spread, bias; and the cost."""
    plain = case.fit(None)
    truth, biased = np.array(list(case.truth.values())), np.array(list(plain.values.values()))
    began, found = perf_counter(), [case.fit(seed) for seed in range(draws)]
    values, errors = (np.array([list(getattr(f, name).values()) for f in found]) for name in ("values", "errors"))
    return {"parameters": list(case.truth), "bias": ((biased - truth) / truth).tolist(),
            "error": (np.mean(errors, axis=0) / np.abs(truth)).tolist(),
            "inside": np.mean(np.abs(values - truth) < 2.0 * errors, axis=0).tolist(),
            "inside_biased": np.mean(np.abs(values - biased) < 2.0 * errors, axis=0).tolist(),
            "spread": np.sqrt(np.mean(((values - biased) / errors)**2, axis=0)).tolist(),
            "simulations": float(np.mean([f.simulations for f in found])), "most": max(f.simulations for f in found),
            "launches": float(np.mean([f.launches for f in found])), "converged": float(np.mean([f.converged for f in found])),
            "seconds": (perf_counter() - began) / draws}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--json", metavar="FILE")
    args = parser.parse_args()
    rows = {}
    print(f"{'case':<6}{'parameter':<11}{'inside':>8}{'of biased':>11}{'spread':>8}{'error bar':>11}{'bias':>10}"
          f"{'simulations':>14}{'most':>7}{'launches':>10}{'s a fit':>9}")
    for name in args.only.split(","):
        row = rows[name] = study(CASES[name](), args.draws)
        for k, parameter in enumerate(row["parameters"]):
            print(f"{name:<6}{parameter:<11}{row['inside'][k]:>8.2f}{row['inside_biased'][k]:>11.2f}{row['spread'][k]:>8.2f}"
                  f"{100 * row['error'][k]:>10.3f}%{100 * row['bias'][k]:>9.3f}%{row['simulations']:>14.1f}{row['most']:>7.1f}"
                  f"{row['launches']:>10.1f}{row['seconds']:>9.2f}", flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
