"""Particles that come out of a cup in a 3-D tank, for walls from a tenth of a cell to three cells.

    python -m tools.bench.fluid.cups [--kinds box,mesh,sheet] [--cells 0.1,0.25,1,3] [--ways still,tilted,diagonal]
                                     [--off 0,0.3] [--seconds 10] [--edge 16]

    box, mesh, sheet    five boxes; one closed mesh; one open mesh, whose wall has no thickness (its cells are 0)
    still               it stands
    tilted              it tilts by 30 degrees in two seconds, then stands so
    diagonal            it leans by 45 degrees, turned by 30 about its own axis: no wall is along the grid

The tank is a cube of 1 m with `edge` cells along each axis. `off` shifts the cup off the grid's planes, in cells. Columns:
particles; how many are beyond the middle of a wall, over the rim, or gone, at the worst frame; how far their middle is from
that of a level surface, in cells, at the end (on the diagonal: not known); CPU seconds.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tests.make.physics.fluid.liquid.cups import FPS, KINDS, Cup, pose, still, tilted  # noqa: E402
from wsim.scene import SceneError  # noqa: E402


def diagonal(t: float, at: np.ndarray) -> np.ndarray:
    """Turned by 30 degrees about its own axis, which leans by 45."""
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    turn = np.eye(4)
    turn[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    return pose(45.0, at + [0.1, 0.15, 0.0]) @ turn


# path, degrees at the end (None: not known), room within [m], depth of the filling [m], on the diagonal so little that what
# falls into the corner splashes over no rim
WAYS = {"still": (still(0.0), 0.0, (0.4, 0.5), 0.2), "tilted": (tilted(2.0), 30.0, (0.4, 0.5), 0.2),
        "diagonal": (diagonal, None, (0.4, 0.6), 0.06)}


def row(kind: str, cells: float, way: str, off: float, seconds: float, edge: int) -> list[str]:
    path, degrees, size, fill = WAYS[way]
    begun = time.process_time()
    try:
        cup = Cup(KINDS[kind], cells, off, path, dim=3, n=edge, size=size, fill=fill, frames=round(seconds * FPS))
    except SceneError as broken:
        return [kind, f"{cells:g}", way, f"{off:g}", "", str(broken), "", ""]
    high = "" if degrees is None else f"{(cup.center() - cup.stands(degrees)) * edge:+.3f}"
    return [kind, f"{cells:g}", way, f"{off:g}", str(cup.count), str(cup.most), high, f"{time.process_time() - begun:.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("kinds", "box,mesh,sheet"), ("cells", "0.1,0.25,1,3"), ("ways", ",".join(WAYS)), ("off", "0,0.3")):
        parser.add_argument(f"--{name}", default=default)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--edge", type=int, default=16)
    given = parser.parse_args()
    print("| kind | cells | way | off | particles | outside | middle, cells | CPU-s |\n|---|---|---|---|---|---|---|---|")
    for kind in given.kinds.split(","):
        for cells in [0.0] if kind == "sheet" else [float(v) for v in given.cells.split(",")]:
            for off in (float(v) for v in given.off.split(",")):
                for way in given.ways.split(","):
                    print("|", " | ".join(row(kind, cells, way, off, given.seconds, given.edge)), "|", flush=True)


if __name__ == "__main__":
    main()
