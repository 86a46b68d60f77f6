"""A soft walker that learns its gait: a table of jelly on two legs, with muscles along the front and the back of each, stands
on the ground and stays within a centimetre at first. How much each muscle pulls, at six times of a stride of half a second, is
found by the gradient of where the body is after three strides, through contacts and friction: 24 numbers, a run forward and one
backward for each gradient. Then it walks on, for strides that it was not trained for. Where it stood the gradient foresees what
changes of the controls do; at the best gait, where every step is a branch, it does less surely. The search ends where steps
gain next to nothing, and not by the number of gradients.

    python scenes/examples/walker.py [OUT]          # OUT_before.usdc, OUT_after.usdc: result layers, and pictures of both
"""

import sys

import numpy as np

from wsim import Bulk, Curve, Motion, Plane, Recorder, Scene, Simulation
from wsim.fitting.fields.lbfgs import FitPoint, LbfgsDescent
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.gradient.rollout.smoothed import GradientTrust, trust
from wsim.scene import shapes
from wsim.show.picture import Camera, picture

CELL, FPS = 0.05, 24.0         # [m], frames a second
STRIDE, KEYS = 12, 6           # frames of a stride, and keys of the muscles in one
PULL = 0.35                    # by which a muscle shortens or lengthens at most
EFFORT = 2e-3                  # [m] that the mean square of the controls costs
WIDTH = 2e-3                   # [m] of contacts while it learns: they begin without a kink, and bear it 0.1 mm deep
DONE = 3e-4                    # [m] steps that gain less, three in a row, are the last
SPREADS = {"before": 3e-3, "after": 3e-2}      # of factors, by which the detector shakes them
LEGS = (0, 2, 5, 7)            # sides of the legs, in cells from the back


def body() -> tuple[np.ndarray, np.ndarray]:
    """A block of 7 x 4 x 1 cells, 10 cm deep, without the three columns between the legs below."""
    points, tets = shapes.block((7 * CELL, 4 * CELL, 2 * CELL), (7, 4, 1), at=(3.5 * CELL, 2 * CELL, 0.0))
    column, row = np.floor(points[tets].mean(axis=1)[:, :2] / CELL).astype(int).T
    tets = tets[(row >= 2) | (column < LEGS[1]) | (column >= LEGS[2])]
    used, tets = np.unique(tets, return_inverse=True)
    return points[used], tets.reshape(-1, 4)


def muscles(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Springs up the four sides of the legs, three cells high, and the group (side) of each."""
    at = {tuple(p): k for k, p in enumerate(np.round(points / CELL).astype(int).tolist())}
    found = [(at[x, y, z], at[x, y + 1, z], g) for g, x in enumerate(LEGS) for y in range(3) for z in (-1, 1)]
    return np.array(found)[:, :2], np.array(found)[:, 2]


def scene_of(controls: np.ndarray, frames: int, width: float = 0.0) -> Scene:
    """controls (KEYS, 4) of a stride, repeated."""
    scene = Scene(fps=FPS, frames=frames, solver="explicit", substeps=36, contact_width=width)
    points, tets = body()
    soft = scene.soft("/walker", points, tets, material=Bulk(3e4, 0.3, 1e3, damping=3e-3, static_friction=0.8,
                                                             dynamic_friction=0.8))
    edges, group = muscles(points)
    used, edges = np.unique(edges, return_inverse=True)
    count = frames * KEYS // STRIDE + 1
    times = np.arange(count) * STRIDE / KEYS / FPS
    net = scene.net("/muscles", points[used], edges, 2500.0, 1e-6, muscles=group,
                    actuation=Curve(times, factors(controls, count)))
    scene.tie("/tendons", net, range(len(used)), soft, used)
    upright = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1e-3], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    scene.collider("/ground", Plane(), motion=Motion.still(upright), static_friction=0.8, dynamic_friction=0.8)
    return scene


def factors(controls: np.ndarray, count: int) -> np.ndarray:
    """Of rest lengths, at so many keys, (count, 4): between 1 - PULL and 1 + PULL."""
    return 1.0 + PULL * np.tanh(controls)[np.arange(count) % KEYS]


def first() -> np.ndarray:
    """Each muscle swings by a tenth, a quarter of a stride apart."""
    return 0.3 * np.sin(2.0 * np.pi * np.arange(KEYS)[:, None] / KEYS + np.array([0.0, np.pi, 0.5 * np.pi, 1.5 * np.pi]))


class Walk:
    """How far the body's middle comes, as a function of the controls."""

    NAME = "/muscles:actuation"

    def __init__(self, frames: int):
        sim = Simulation(scene_of(first(), frames, WIDTH), device="cpu", precision="float64", gradients=True)
        self.rollout = Rollout(Recording(sim, frames), [self.NAME], [frames])
        self.count, self.gradients = len(self.rollout.values()[self.NAME]), 0
        self.body, self.start = self.rollout.part("/walker"), body()[0][:, 0].mean()

    def far(self, y: np.ndarray) -> float:
        """[m] from a motion."""
        return float(y[0, 0, self.body, 0].mean() - self.start)

    def slope(self, y: np.ndarray) -> np.ndarray:
        seeds = np.zeros_like(y)
        seeds[0, 0, self.body, 0] = 1.0 / len(body()[0])
        return seeds

    def look(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Minus the way [m], and the effort, with their gradients by the controls."""
        u = x.reshape(KEYS, 4)
        y = self.rollout.run({self.NAME: factors(u, self.count)})
        by_keys, by = self.rollout.vjp(self.slope(y))[self.NAME], np.zeros_like(u)
        np.add.at(by, np.arange(self.count) % KEYS, by_keys)
        self.gradients += 1
        return (np.array([-self.far(y), float((u**2).mean())]),
                np.stack([-(by * PULL * (1.0 - np.tanh(u)**2)).ravel(), 2.0 * x / x.size]))

    def learn(self, limit: int) -> tuple[np.ndarray, bool]:
        """Controls, and whether they gain nothing any more."""
        x = first().ravel()
        descent, still = LbfgsDescent(self.look, FitPoint(x, *self.look(x)), np.array([1.0, EFFORT]), radius=0.3), 0
        while self.gradients < limit and still < 3:
            before = descent.value
            still = 3 if not descent.step() else still + 1 if before - descent.value < DONE else 0
        return descent.at.x.reshape(KEYS, 4), still >= 3

    def trust(self, controls: np.ndarray, spread: float, samples: int) -> GradientTrust:
        """Whether the gradient at these controls says what changes of the factors by `spread` do, all together."""
        self.rollout.run({self.NAME: factors(controls, self.count)})
        return trust(self.rollout, self.far, self.slope, spreads={self.NAME: spread}, samples=samples)[0]


def walk(controls: np.ndarray, frames: int, out: str | None = None) -> np.ndarray:
    """Way of the middle [m] after each frame, with hard contacts, in float32."""
    scene = scene_of(controls, frames)
    sim, way = Simulation(scene, device="cpu"), []
    start = sim.positions("/walker")[:, 0].mean()
    recorder = Recorder(scene, f"{out}.usdc") if out else None

    def each(sim: Simulation) -> None:
        way.append(sim.positions("/walker")[:, 0].mean() - start)
        if recorder:
            recorder.append(recorder.time_code(sim.frame), {p: sim.positions(p) for p in ("/walker", "/muscles")})
    sim.run(frames, each)
    if recorder:
        recorder.close()
        side = Camera(np.array([0.95, 0.5, 3.0]), np.array([0.0, -0.13, -1.0]), np.array([0.0, 1.0, 0.0]), 0.42, 0.1)
        picture(f"{out}.usdc", f"{out}.png", sheet=4, size=(1280, 300), camera=side)
    return np.array(way)


def run(limit: int = 150, frames: int = 36, later: int = 96, samples: int = 32, out: str | None = None) -> dict:
    found = Walk(frames)
    controls, converged = found.learn(limit)
    gaits = {"before": first(), "after": controls}
    ways = {name: walk(u, later, f"{out}_{name}" if out else None) for name, u in gaits.items()}
    return {"controls": controls, "ways": ways, "gradients": found.gradients, "converged": converged, "frames": frames,
            "verdicts": {name: found.trust(u, SPREADS[name], samples) for name, u in gaits.items()}}


if __name__ == "__main__":
    r = run(out=sys.argv[1] if len(sys.argv) > 1 else None)
    print(f"{r['gradients']} gradients, {'converged' if r['converged'] else 'NOT converged'}")
    for name, way in r["ways"].items():
        print(f"{name:7s} {100.0 * way[r['frames'] - 1]:6.1f} cm after {r['frames'] / FPS:.1f} s, {100.0 * way[-1]:6.1f} cm "
              f"after {len(way) / FPS:.0f} s; {r['verdicts'][name]}")
    print("rest lengths of the four muscles through a stride:")
    print(np.round(factors(r["controls"], KEYS).T, 2))
