"""Scenes of rigid bodies with known answers, as plain data that any engine can be given, and what judges its motion.

A scene is a dictionary, z is up, SI units, quaternions (x, y, z, w):

    gravity (3,)    fps    frames    keep: "all" frames or the "last"    friction, restitution: of everything
    ground: [point (3,), unit normal (3,)] of a plane, or None
    bodies: [{shape: "box" | "sphere" | None, size: half extents (3,) or [radius], at (3,), turn (4,), velocity (3,), spin (3,)
             (world), mass [kg], moments (3,) [kg m^2] along its own axes}]
    joints: [{bodies: [a, b] (a: -1 is the world), point (3,) in the world at the start}], ball joints

    judge(scene, states) -> errors;  states: x (k, n, 3), q (k, n, 4), v, w (k, n, 3) of the frames that were kept
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tools.bench.rigid import judges

G = 9.81
Judge = Callable[[dict, dict], dict[str, float]]


@dataclass(frozen=True)
class Problem:
    """make: the scene; judge: its errors; key: the error that a table shows first, with its unit; sizes: of the scene's
    option, for a CPU and beyond it for a GPU."""

    name: str
    make: Callable[[], dict]
    judge: Judge
    key: str
    unit: str
    gpu: bool = False


def scene(bodies: list[dict], seconds: float, *, friction: float = 0.5, restitution: float = 0.0, gravity=(0.0, 0.0, -G),
          keep: str = "last", ground=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), fps: float = 60.0, **more) -> dict:
    return {"gravity": list(gravity), "fps": fps, "frames": round(seconds * fps), "keep": keep, "friction": friction,
            "restitution": restitution, "ground": ground, "bodies": bodies, "joints": [], **more}


def body(shape: str | None, size, at, mass: float, moments=None, **more) -> dict:
    if moments is None:
        a = np.array(size, float)
        moments = mass / 3.0 * ((a * a).sum() - a * a) if shape == "box" else [0.4 * mass * a[0]**2] * 3
    return {"shape": shape, "size": list(size), "at": list(at), "turn": [0.0, 0.0, 0.0, 1.0], "velocity": [0.0] * 3,
            "spin": [0.0] * 3, "mass": mass, "moments": list(map(float, moments))} | more


def box(at, half=0.5, density: float = 1000.0, **more) -> dict:
    a = (half,) * 3 if np.isscalar(half) else half
    return body("box", a, at, density * 8.0 * float(np.prod(a)), **more)


def column(weights: list[float], seconds: float = 10.0) -> dict:
    """Boxes of 1 m, one on the other, of these densities from below."""
    return scene([box((0.0, 0.0, 0.5 + k), density=d) for k, d in enumerate(weights)], seconds)


def pyramid(rows: int, seconds: float) -> dict:
    """Boxes of 1 m in a wall that narrows by a box a row."""
    return scene([box((k + 0.5 * (row + 1 - rows), 0.0, row + 0.5)) for row in range(rows) for k in range(rows - row)], seconds)


def pile(columns: int, layers: int, seconds: float) -> dict:
    """Boxes of 20 cm, each out of place and turned a little, fall on each other from a loose lattice."""
    rng = np.random.default_rng(5)
    found = []
    for k in range(columns * columns * layers):
        place = np.array([k % columns, k // columns % columns, k // columns**2]) * (0.24, 0.24, 0.24)
        axis, angle = rng.normal(size=3), rng.uniform(0.0, 0.3)
        turn = [*(np.sin(0.5 * angle) * axis / np.linalg.norm(axis)), np.cos(0.5 * angle)]
        found.append(box((place + rng.uniform(-0.01, 0.01, 3) + (0.0, 0.0, 0.2)).tolist(), 0.1, turn=list(map(float, turn))))
    return scene(found, seconds)


def racket() -> dict:
    """A body of moments 1, 2, 3 kg m^2, spun at 10 rad/s about its middle axis, nearly; 10 s in frames of 1/60 s."""
    spun = body(None, [0.1], (0.0, 0.0, 0.0), 2.0, (1.0, 2.0, 3.0), spin=[0.01, 10.0, 0.01])
    return scene([spun], 10.0, gravity=(0.0, 0.0, 0.0), ground=None, keep="all")


def bounces() -> dict:
    """A ball of 0.5 m falls by 1 m; restitution 0.8."""
    return scene([body("sphere", [0.5], (0.0, 0.0, 1.5), 500.0)], 3.6, restitution=0.8, keep="all")


def sliding() -> dict:
    """A flat box at 5 m/s on a floor with friction 0.5."""
    return scene([box((0.0, 0.0, 0.25), (0.5, 0.5, 0.25), velocity=[5.0, 0.0, 0.0])], 2.0)


def chain(links: int = 5) -> dict:
    """Rods of 1 m, 1 kg, hung level one from the other by ball joints, swing in a plane."""
    rods = [body("box", (0.5, 0.05, 0.05), (0.5 + k, 0.0, 0.0), 1.0) for k in range(links)]
    joints = [{"bodies": [k - 1, k], "point": [float(k), 0.0, 0.0]} for k in range(links)]
    return scene(rods, 2.0, ground=None, keep="all", joints=joints, touch=False)


PROBLEMS = {p.name: p for p in (
    Problem("column of ten", lambda: column([1000.0] * 10), judges.stack, "sag", "mm"),
    Problem("100 kg on nine", lambda: column([1.0] * 9 + [100.0]), judges.stack, "sag", "mm"),
    Problem("pyramid of 10 rows", lambda: pyramid(10, 5.0), judges.stack, "sag", "mm"),
    Problem("pile of 1000", lambda: pile(10, 10, 4.0), judges.pile, "overlap", "mm"),
    Problem("tennis racket", racket, judges.racket, "angle", "degrees"),
    Problem("three bounces", bounces, judges.bounces, "height", "%"),
    Problem("sliding box", sliding, judges.sliding, "distance", "%"),
    Problem("chain of 5", chain, judges.chain, "place", "mm"),
    Problem("pyramid of 100 rows", lambda: pyramid(100, 2.0), judges.stack, "sag", "mm", gpu=True),
    Problem("pile of 10000", lambda: pile(25, 16, 4.0), judges.pile, "overlap", "mm", gpu=True),
)}
