"""Abuse of smoke and liquids, with every scheme that they have: finite, and no more energy than the row can give.

    python -m tools.stress.fluid [--device cpu] [--only NAME ...] [--json FILE]

Held at every frame: all arrays finite; energy at most that of the start and what `Row.gives` says, LOOSE more; smoke within the
range of what was put in; particles within the domain. Exit code 1 if a row does not hold. Rows and their bounds: rows.py.
"""

import argparse
import json
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp

from tools.bench.speed import hardware
from tools.stress.fluid.rows import ROWS, Row
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation

LOOSE = 1.05
HEAD = f"{'row':<34} {'scheme':<24} {'speed':>9} {'energy':>9} {'smoke':>16} {'steps':>5} {'ms':>8}  verdict"


@dataclass
class Record:
    row: str
    scheme: str
    device: str
    speed: float = 0.0                             # [m/s] greatest of all frames
    energy: float = 0.0                            # greatest, over its bound
    smoke: tuple[float, float] = (0.0, 0.0)
    steps: float = 0.0                             # in a frame, most
    ms: float = 0.0                                # a frame after the first
    frames: int = 0
    faults: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        return "; ".join(self.faults) or "held" + (f", says: {self.said[0]:.90}" if self.said else "")


def case(row: Row, scheme: str, device=None) -> Record:
    """Runs to the end, or to the first fault."""
    record = Record(row.name, scheme, str(device))
    try:
        sim = Simulation(row.scene(scheme), device=device)
    except SceneError as error:
        record.said = [f"refused: {error}"]
        record.faults += record.said
        return record
    start, began = sim.indicators(), 0.0
    for frame in range(sim.scene.frames):
        at = perf_counter()
        sim.step()
        began += perf_counter() - at if frame else 0.0
        record.frames += 1
        hold(sim, row, record, start)
        if record.faults:
            break
    record.ms = 1e3 * began / max(record.frames - 1, 1)
    record.said = list(sim.warnings)
    return record


def hold(sim: Simulation, row: Row, record: Record, start: dict[str, float]) -> None:
    now, kind = sim.indicators(), "fluid" if sim.scene.things("Fluid") else "liquid"
    method = sim.plan.method(kind)
    arrays = method.arrays(0) if kind == "fluid" else method.particles(0)
    record.speed = max(record.speed, now[f"{kind}_speed"])
    record.steps = max(record.steps, now[f"{kind}_steps"])
    if not all(np.isfinite(values).all() for values in arrays.values()):
        record.faults.append(f"not finite in frame {record.frames}")
        return
    before, energy = start[f"{kind}_energy"], now[f"{kind}_energy"]
    bound = LOOSE * (before + row.gives) + 1e-9
    record.energy = max(record.energy, energy / bound)
    if energy > bound:
        record.faults.append(f"energy of {energy:.3g} J in frame {record.frames}, bound {bound:.3g}")
    if kind == "liquid":
        (liquid,) = sim.scene.things("Liquid")
        x = arrays["x"][:, liquid.axes]
        low, high = liquid.low[list(liquid.axes)], liquid.high[list(liquid.axes)]
        if len(x) and not (np.all(x >= low - 1e-5) and np.all(x <= high + 1e-5)):
            record.faults.append(f"particles outside of the tank in frame {record.frames}")
    elif "smoke" in arrays:
        record.smoke = (min(record.smoke[0], float(arrays["smoke"].min())), max(record.smoke[1], float(arrays["smoke"].max())))
        if record.smoke[0] < 0.0 or record.smoke[1] > row.smoke * (1.0 + 1e-4):
            record.faults.append(f"smoke of {record.smoke[0]:.3g} to {record.smoke[1]:.3g} in frame {record.frames}")


def line(r: Record) -> str:
    return (f"{r.row:<34} {r.scheme:<24} {r.speed:>9.3g} {r.energy:>9.2g} {f'{r.smoke[0]:.2g} to {r.smoke[1]:.2g}':>16} "
            f"{r.steps:>5.0f} {r.ms:>8.1f}  {'FAILS: ' if r.faults else ''}{r.verdict}")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tools.stress.fluid", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--only", nargs="+", default=[], help="rows whose name contains one of these")
    parser.add_argument("--json", default=None)
    args = parser.parse_args(arguments)
    wp.config.log_level = 40
    head = {"device": hardware(wp.get_device(args.device)), "warp": wp.config.version}
    print(f"{head['device']}\n{HEAD}", flush=True)
    found = []
    for row in (r for r in ROWS if not args.only or any(name in r.name for name in args.only)):
        for scheme in row.schemes:
            found.append(case(row, scheme, args.device))
            print(line(found[-1]), flush=True)
            if args.json:
                results = [asdict(r) | {"held": not r.faults} for r in found]
                Path(args.json).write_text(json.dumps(head | {"results": results}, indent=1))
    failed = sum(bool(r.faults) for r in found)
    print(f"{len(found) - failed} of {len(found)} hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
