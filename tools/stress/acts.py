"""What is done to a run before a frame. run: `tools.stress.run.Run`; an act says whether it changed anything.

A scatter is a function of the points (n, 3) [m] and random numbers, see `placed`.
"""

from collections.abc import Callable
from math import sqrt

import numpy as np

from tools.stress.scenes import SIDE, G
from wsim.scene.curve import Motion

LAST = 59                             # frame before which abuse of 60 frames ends
NEAR = 1e-6                           # [m] out of a plane or a heap in which forces would balance for ever


def once(change: Callable, run, frame: int) -> bool:
    if frame == 0:
        change(run)
    return frame == 0


def placed(where: Callable, run) -> None:
    """Positions of free points become where(points of the sheet, random numbers)."""
    path, e = run.parts[0]
    x = run.sim.positions(path)
    run.set(path, "positions", np.where(e.weights[:, None] > 0.0, where(x, run.rng), x))


def thrown(speed: float, run) -> None:
    """Every point gets a velocity of its own, of `speed` [m/s] in the mean."""
    path, e = run.parts[0]
    run.set(path, "velocities", run.rng.normal(size=(len(e.masses), 3)) * speed / sqrt(3.0))


def stretched(x, rng):
    top = x[:, 1].max()
    return np.stack([x[:, 0], top + 1.1 * (x[:, 1] - top), x[:, 2]], axis=1)


def one_place(x, rng):
    return np.tile(x.mean(axis=0), (len(x), 1))


def nearly_one_place(x, rng):
    return x.mean(axis=0) + NEAR * rng.normal(size=x.shape)


def scrambled(x, rng):
    return x.mean(axis=0) + SIDE * rng.uniform(-0.5, 0.5, x.shape)


def shaken(x, rng):
    return x + 5e-3 * rng.normal(size=x.shape)


def shuffled(x, rng):
    return x[rng.permutation(len(x))] + NEAR * rng.normal(size=x.shape)


def folded(x, rng):
    """The lower half is turned up onto the upper one. Standing exactly in its plane it would balance there."""
    middle = x[len(x) // 2, 1]
    y = np.where(x[:, 1:2] < middle, x * (1.0, -1.0, 1.0) + (0.0, 2.0 * middle, 0.0), x)
    return y + NEAR * rng.normal(size=x.shape)


def crumpled(x, rng):
    """Folded along both middle lines, twice."""
    low, half = x.min(axis=0), 0.25 * SIDE
    y = x - low
    for axis in (0, 1):
        y[:, axis] = half - np.abs(half - y[:, axis] % (2.0 * half))
    return y + low + NEAR * rng.normal(size=x.shape)


def upside_down(run, frame: int) -> bool:
    run.set("/", "gravity", (0.0, G if frame % 2 == 0 else -G, 0.0) if frame < LAST else (0.0, -G, 0.0))
    return True


def ball(places, run, frame: int) -> bool:
    """The ball is here, then there, five frames each."""
    if frame % 5:
        return False
    run.set("/ball", "motion", Motion.at_place(places[frame // 5 % len(places)]))
    return True


def away(run, frame: int, then: Callable) -> bool:
    if frame == LAST:
        run.set("/ball", "motion", Motion.at_place((0.0, 0.0, 5.0)))
        return True
    return then(run, frame)
