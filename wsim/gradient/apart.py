"""Difference between a recording and a simulation of the same frames. Implicit solves of a recording iterate to a residual,
those of a simulation take a fixed number of Newton steps.

    places      largest |x_sim - x_rec| of a point at the end [m]
    gradient    |g_sim - g_rec| / |g_rec|, g: gradient with respect to the velocities at the start

With contacts the second is 4 to 20 times the first divided by the distance that points move: a small residual changes which
points touch, and how hard. For random signs d, the rms of (g_sim - g_rec) . d is |g_sim - g_rec| (Hutchinson 1990); two
directions d give it to a factor 2. Finite differences are one-sided, and the side with the smaller difference counts: on the
other side a contact may begin or end.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import warp as wp

MOST = 1e-3            # of the distance that points move: largest difference in positions without a warning
POOR = 2e-2            # of a gradient: largest difference without a warning; in float32 the method resolves 1e-2
PART = {"float32": 1e-3, "float64": 1e-4}      # of the distance that points move: size of the change of velocities
DIRECTIONS = 2


class DifferenceToSimulation:
    """The difference, measured after a recording has run. Warns where it is large. Costs one run of a simulation."""

    def __init__(self, recording):
        self.gradient: float | None = None             # among contacts, after the first `backward`
        here, last = exact_positions(recording.state), recording.frames
        begun, *_, plain = simulate_recorded_frames(recording, lambda frame: exact_positions(recording.state)
                                                    if frame in (0, last) else None)
        self.places, self.way = (float(np.linalg.norm(x - here, axis=1).max()) for x in (plain, begun))        # [m]
        if not self.places <= MOST * self.way:
            part = 100.0 * self.places / max(self.way, 1e-300)
            recording.warn(f"/: gradients: a simulation of these frames ends up to {self.places:.2g} m away from the "
                           f"recording, which solves each step to its residual ({part:.2g} % of how far points move); "
                           "take more iterations or substeps")

    def tell_gradient(self, recording, seeds, states: dict[int, np.ndarray]) -> None:
        """Measures `gradient` by finite differences, once, for the loss of `seeds`. states: gradients of the recording with
        respect to the start. Warns where the difference is large. Costs five runs of a simulation."""
        state, rng, square = recording.state, np.random.default_rng(0), 0.0
        by = states[state.v.ptr].astype(np.float64)
        size = float(np.linalg.norm(by))
        step = PART[recording.sim.precision] * self.way * recording.sim.scene.fps / recording.frames
        if self.gradient is not None or not (size > 0.0 and step > 0.0):
            return
        free = recording.plan.ports.constants.w.numpy()[:, None] > 0.0

        def linearised_loss_after(change: np.ndarray) -> float:
            return sum(simulate_recorded_frames(recording, partial(linearised_loss, state, seeds),
                                                partial(kick_velocities, state.v, change)))
        here = linearised_loss_after(0.0 * by)
        for _ in range(DIRECTIONS):
            way = free * rng.choice([-1.0, 1.0], by.shape)
            slopes = [(linearised_loss_after(s * step * way) - here) / (s * step) for s in (1.0, -1.0)]
            square += min((slope - float((by * way).sum()))**2 for slope in slopes) / DIRECTIONS
        recording.pose(0)
        self.gradient = float(np.sqrt(square)) / size
        if not self.gradient <= POOR:
            recording.warn(f"/: gradients: with contacts, those of a simulation of these frames differ by about "
                           f"{100.0 * self.gradient:.2g} % from those of the recording, which solves each step to its residual "
                           f"(positions by {100.0 * self.places / self.way:.2g} %); take more iterations or substeps")


def simulate_recorded_frames(recording, read: Callable[[int], Any], before: Callable[[], None] = lambda: None) -> list:
    """Runs a simulation with the plan of a recording, and returns read(frame) at the start (frame 0) and after each frame. The
    arrays of the recording are restored at the end. before: called at the start, to change the state."""
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


def exact_positions(state) -> np.ndarray:
    """Positions of all points, (n, 3) [m]."""
    return state.x.numpy().astype(np.float64) + state.e.numpy()


def linearised_loss(state, seeds, frame: int) -> float:
    """Contribution of a frame to the loss, linearised in positions and velocities."""
    each = [(exact_positions(state) if base is state.x else base.numpy(), given[frame]) for base, given in seeds.arrays
            if frame in given]
    return sum(float((x * (w.numpy() if isinstance(w, wp.array) else w)).sum()) for x, w in each)


def kick_velocities(v: wp.array, change: np.ndarray) -> None:
    """Adds a change [m/s] to the velocities, (n, 3)."""
    v.assign(v.numpy() + change)
