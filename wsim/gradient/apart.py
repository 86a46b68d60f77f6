"""How far a recording is from a simulation of the same frames: implicit solves of recordings go on to their residual, a
simulation's take so many Newton steps.

    places      |x_sim - x_rec| at the end [m]
    gradient    |g_sim - g_rec| / |g_rec|, g: gradient with respect to the velocities at the start

Among contacts the second is 4 to 20 times the first over the way: which points touch, and how hard, changes with little of a
residual. With random signs d, (g_sim - g_rec) . d is |g_sim - g_rec| in the rms (Hutchinson 1990), which two directions tell to
a factor 2. Differences are one-sided, and the nearer side counts: on the other one a contact may begin or end.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import warp as wp

MOST = 1e-3            # of how far points move: what a simulation may end from a recording without a warning
POOR = 2e-2            # of a gradient; in float32 differences of runs tell 1e-2
PART = {"float32": 1e-3, "float64": 1e-4}      # of how far points move, by which velocities are changed
DIRECTIONS = 2


class Apart:
    """The distance, of a recording that has run. Warns where that is much; costs a run of a simulation."""

    def __init__(self, recording):
        self.gradient: float | None = None             # among contacts, after the first `backward`
        here, last = places(recording.state), recording.frames
        begun, *_, plain = simulated(recording, lambda frame: places(recording.state) if frame in (0, last) else None)
        self.places, self.way = (float(np.linalg.norm(x - here, axis=1).max()) for x in (plain, begun))        # [m]
        if not self.places <= MOST * self.way:
            part = 100.0 * self.places / max(self.way, 1e-300)
            recording.warn(f"/: gradients: a simulation of these frames ends up to {self.places:.2g} m from where the "
                           f"recording does, which solves each step to its residual ({part:.2g} % of how far points move); "
                           "take more iterations or substeps")

    def tell_gradient(self, recording, seeds, states: dict[int, np.ndarray]) -> None:
        """Measures `gradient` of the loss of `seeds` by differences, once. states: gradients at the start. Warns where it is
        much; costs five runs of a simulation."""
        state, rng, square = recording.state, np.random.default_rng(0), 0.0
        by = states[state.v.ptr].astype(np.float64)
        size = float(np.linalg.norm(by))
        step = PART[recording.sim.precision] * self.way * recording.sim.scene.fps / recording.frames
        if self.gradient is not None or not (size > 0.0 and step > 0.0):
            return
        free = recording.plan.find("constants").w.numpy()[:, None] > 0.0

        def run(change: np.ndarray) -> float:
            return sum(simulated(recording, partial(loss, state, seeds), partial(kick, state.v, change)))
        here = run(0.0 * by)
        for _ in range(DIRECTIONS):
            way = free * rng.choice([-1.0, 1.0], by.shape)
            slopes = [(run(s * step * way) - here) / (s * step) for s in (1.0, -1.0)]
            square += min((slope - float((by * way).sum()))**2 for slope in slopes) / DIRECTIONS
        recording.pose(0)
        self.gradient = float(np.sqrt(square)) / size
        if not self.gradient <= POOR:
            recording.warn(f"/: gradients: among contacts those of a simulation of these frames differ by about "
                           f"{100.0 * self.gradient:.2g} % from those of the recording, which solves each step to its residual "
                           f"(places by {100.0 * self.places / self.way:.2g} %); take more iterations or substeps")


def simulated(recording, read: Callable[[int], Any], before: Callable[[], None] = lambda: None) -> list:
    """What `read` has after each of the frames, 0 the start, of a simulation in the place of a recording, whose arrays stay as
    they are. before: changes the start."""
    plan, state = recording.plan, recording.state
    kept = [plan.status.array, *(array for array, _ in state.copies())]
    ends = [wp.clone(array) for array in kept]
    recording.rewind()
    before()
    found = [read(0)]
    for frame in range(recording.frames):
        recording.pose(frame)
        plan.frame()
        plan.clock.starting = False
        found.append(read(frame + 1))
    for array, end in zip(kept, ends, strict=True):
        wp.copy(array, end)
    return found


def places(state) -> np.ndarray:
    """Positions of all points, (n, 3) [m]."""
    return state.x.numpy().astype(np.float64) + state.e.numpy()


def loss(state, seeds, frame: int) -> float:
    """Part of a loss that a frame has, linear in positions and velocities."""
    each = [(places(state) if base is state.x else base.numpy(), given[frame]) for base, given in seeds.arrays
            if frame in given]
    return sum(float((x * (w.numpy() if isinstance(w, wp.array) else w)).sum()) for x, w in each)


def kick(v: wp.array, change: np.ndarray) -> None:
    """Adds to velocities."""
    v.assign(v.numpy() + change)
