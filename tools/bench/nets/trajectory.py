"""How far a simulated spring cloth is from its exact trajectory, beside the time of a frame; chains against closed forms.

    python tools/bench/nets/trajectory.py [--device cuda:0] [--sides 24,32,64] [--quick] [--cache FOLDER] [--json FILE]

The cloth is `reference.spring_cloth` (1 m, structural, diagonal and weak cross springs, one edge pinned, starting
horizontal), its exact trajectory float64 Runge-Kutta of order 4 with a known error. Errors are RMS distances over the points
[m] at 0.25 s and 0.5 s; ms are the median frame from the third on, replayed from a graph, with what the host does around it.

    table     integrators and substeps x iterations in float32 and float64, as Simulation runs them: where BDF2 missed its
              residual the row says so, and from there on it was backward Euler
    far       the same cloth 1 km from the origin, float32
    fine      256 substeps, float32 against float64
    orders    slope of the error at 0.25 s over 8, 16, 32 substeps with sweeps enough, float64
    chain     static stretch of each spring and first frequency of hanging chains, relative errors
"""

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.nets import reference  # noqa: E402
from wsim.scene import Scene  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

TIMES = (0.25, 0.5)                          # [s]
SETTINGS = ((4, 16), (8, 16), (16, 16), (32, 16), (16, 4))       # substeps x iterations
FINE = (256, 4)
ORDERS = ((8, 64), (16, 64), (32, 64))       # sweeps enough that the integrator alone is seen
INTEGRATORS = ("backward_euler", "bdf2")
AWAY = (1000.0, 0.0, 0.0)                    # [m]


@dataclass
class Cloth:
    """The cloth of n by n points and where it is at TIMES, (2, n^2, 3) [m], with the error of that [m]."""

    n: int
    where: np.ndarray
    error: float
    device: wp.Device

    def run(self, part: str, integrator: str, setting: tuple[int, int], precision: str = "float32",
            at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict:
        """One run: its errors [m], ms a frame, and the frame from which BDF2 was given up (None: never)."""
        scene = replace(reference.spring_cloth(self.n, at=at), substeps=setting[0], iterations=setting[1],
                        integrator=integrator)
        sim = Simulation(scene, device=self.device, precision=precision)
        errors, gave_up = [], None
        for k, time in enumerate(TIMES):
            while sim.frame < round(time * scene.fps):
                sim.step()
                if integrator == "bdf2" and gave_up is None and not sim.plan.clock.watched:
                    gave_up = sim.frame
            errors.append(reference.rms(sim.positions() - self.where[k] - np.asarray(at)))
        return {"part": part, "n": self.n, "integrator": integrator, "substeps": setting[0], "iterations": setting[1],
                "precision": precision, "error_025": errors[0], "error_05": errors[1],
                "ms": float(np.median(sim.milliseconds[2:])), "gave_up": gave_up}


def exact_cloth(n: int, device: wp.Device, cache: str | None, tolerance: float = 1e-7) -> Cloth:
    """The cloth with its exact trajectory; a cache folder keeps that between runs."""
    where, error = reference.exact(reference.net(reference.spring_cloth(n)), TIMES, tolerance, folder=cache)
    return Cloth(n, where, error, device)


def runs(cloth: Cloth) -> Iterable[dict]:
    """Every run of one cloth."""
    for precision in ("float32", "float64"):
        for integrator in INTEGRATORS:
            for setting in SETTINGS:
                yield cloth.run("table", integrator, setting, precision)
    for integrator in INTEGRATORS:
        yield cloth.run("far", integrator, (16, 16), at=AWAY)
        for precision in ("float32", "float64"):
            yield cloth.run("fine", integrator, FINE, precision)
        for setting in ORDERS:
            yield cloth.run("orders", integrator, setting, "float64")


def goals(rows: list[dict]) -> list[dict]:
    """What was wanted of one cloth beside what its runs found."""
    def of(part, integrator, precision="float32", setting=None):
        return [r for r in rows if r["part"] == part and r["integrator"] == integrator and r["precision"] == precision
                and setting in (None, (r["substeps"], r["iterations"]))]

    found, n = [], rows[0]["n"]
    wanted = (1e-4 if n < 64 else 2e-4, 2e-3)
    for integrator in INTEGRATORS:
        near, far = of("table", integrator, setting=(16, 16))[0], of("far", integrator)[0]
        single, double = of("fine", integrator)[0], of("fine", integrator, "float64")[0]
        for key, limit in zip(("error_025", "error_05"), wanted, strict=True):
            if integrator == "bdf2":
                found.append((f"16 x 16 float32 {key} [m]", near[key], limit))
            found.append((f"1 km away over near, {key}", far[key] / near[key], 2.0))
            found.append((f"{FINE[0]} substeps float32 over float64, {key}", single[key] / double[key], 1.1))
        series = of("orders", integrator, "float64")
        slope = -np.polyfit(np.log([r["substeps"] for r in series]), np.log([r["error_025"] for r in series]), 1)[0]
        order = INTEGRATORS.index(integrator) + 1
        found.append((f"observed order, away from {order}", abs(float(slope) - order), 0.2))
        found = [(f"{integrator}: {name}" if ":" not in name else name, value, limit) for name, value, limit in found]
    return [{"part": "goal", "n": n, "goal": name, "found": value, "limit": limit, "met": bool(value <= limit)}
            for name, value, limit in found]


def hanging_chain(n: int, stiffness: float, mass: float, **more) -> Scene:
    """n springs of 0.1 m [N/m] and masses [kg] hanging from a pinned point."""
    points = np.zeros((n + 1, 3))
    points[:, 1] = -0.1 * np.arange(n + 1)
    scene = Scene(solver="xpbd", fps=60.0, **more)
    net = scene.net("/chain", points, [[i, i + 1] for i in range(n)], [stiffness], [mass])
    scene.pin("/pin", net, [0])
    return scene


def height(sim: Simulation) -> np.ndarray:
    """y of every point [m]."""
    return np.asarray(sim.positions())[:, 1]


def stretch(n: int, device: wp.Device, precision: str) -> dict:
    """Largest relative error of the static stretch of a spring, after 5 s in thick air."""
    sim = Simulation(hanging_chain(n, 200.0, 0.01, substeps=10, iterations=20, air_drag=6.0), device=device,
                     precision=precision)
    sim.run(300)
    wanted = reference.chain_stretch(np.full(n, 200.0), np.full(n, 0.01))
    error = np.abs((-np.diff(height(sim)) - 0.1) / wanted - 1.0).max()
    return {"part": "goal", "n": n, "goal": f"chain: static stretch, {precision}", "found": float(error), "limit": 1e-3,
            "met": bool(error < 1e-3), "ms": float(np.median(sim.milliseconds[2:]))}


def frequency(n: int, device: wp.Device, precision: str) -> dict:
    """Relative error of the first frequency, from the tip's upward zero crossings over 2.5 s in the first mode."""
    sim = Simulation(hanging_chain(n, 200.0, 0.01, substeps=64, iterations=12, integrator="bdf2", gravity=(0.0,) * 3),
                     device=device, precision=precision)
    velocity = np.zeros((n + 1, 3))
    velocity[:, 1] = 1e-2 * np.sin(np.arange(n + 1) * np.pi / (2 * n + 1))
    sim.set("/chain", "velocities", velocity)
    start, tip = height(sim)[-1], []
    sim.run(150, lambda s: tip.append(height(s)[-1] - start))
    y, t = np.array(tip), np.arange(1, 151) / 60.0
    up = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    zeros = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    wanted = reference.chain_frequency(np.full(n, 200.0), np.full(n, 0.01)) / (2.0 * np.pi)
    error = abs((len(zeros) - 1) / (zeros[-1] - zeros[0]) / wanted - 1.0)
    return {"part": "goal", "n": n, "goal": f"chain: first frequency, {precision}", "found": float(error), "limit": 5e-3,
            "met": bool(error < 5e-3), "ms": float(np.median(sim.milliseconds[2:]))}


def line(row: dict) -> str:
    if row["part"] == "goal":
        return (f"  {'met   ' if row['met'] else 'MISSED'}  n {row['n']:<3} {row['goal']}: {row['found']:.3g}, at most "
                f"{row['limit']:g}" + (f", {row['ms']:.2f} ms/frame" if "ms" in row else ""))
    note = f"  backward Euler from frame {row['gave_up']}" if row["gave_up"] else ""
    return (f"{row['n']:>4}  {row['part']:<7}{row['integrator']:<15}{row['substeps']:>4} x {row['iterations']:<3}"
            f"{row['precision']:<9}{row['error_025']:>10.2e}{row['error_05']:>10.2e}{row['ms']:>10.2f}{note}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="24,32,64", help="points a side of each cloth")
    parser.add_argument("--quick", action="store_true", help="one cloth of 12 points a side")
    parser.add_argument("--cache", default=None, help="folder that keeps exact trajectories")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    device = wp.get_device(args.device)
    print(f"{device.name}, warp {wp.config.version}\n   n  part   integrator     substeps x it. precision   0.25 s [m]"
          f"  0.5 s  ms/frame", flush=True)
    rows: list[dict] = []
    for n in (12,) if args.quick else (int(s) for s in args.sides.split(",")):
        cloth, own = exact_cloth(n, device, args.cache), []
        for row in runs(cloth):
            print(line(row), flush=True)
            own.append(row)
        rows += own + goals(own)
        print(f"  exact to {cloth.error:.0e} m", *map(line, goals(own)), sep="\n", flush=True)
    for n in (6, 20):
        for precision in ("float32", "float64"):
            for row in (stretch(n, device, precision), frequency(min(n, 8), device, precision)):
                rows.append(row)
                print(line(row), flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps({"device": device.name, "warp": wp.config.version, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
