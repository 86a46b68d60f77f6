"""How large a step an explicit integrator bears: the spectral radius of its amplification matrix. NumPy.

    mode    x'' = -omega^2 x - c x';  stable at h: no amplitude grows by more than exp(rate h) a step
    bound   of the highest frequency: row sums of M^-1 K (Gershgorin 1931), see `wsim.physics.motion.frequency`
    tension a force k (l - l0) along an edge has the slope k along it, and k (1 - l0 / l) across. Where no edge is longer than s
            times its rest length, of a net that is alike in its directions, omega^2 <= (2 - 1 / s) omega_0^2, omega_0 that at
            rest. The bound sums the norms of both parts, and holds for every s.
"""

from functools import cache
from math import ceil

import numpy as np

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.integrator import Integrator

RATIO = 1.1            # of steps that are tried, over fastest of frequency and decay rate
GRID = RATIO ** np.arange(-290, 73)      # 1e-12 to 1e3
STRETCH = 2.0          # longer edges than this are suspect by any steps (`wsim.physics.motion.divergence_monitor`)
PLACES = 12            # of the bisection for s: to 2.5e-4
MARGIN = 1.02          # substeps over the limit's: the frequency is that of the rest shape, and `stable_step` is good to 0.1 %


def mode_step(method: Integrator, state: np.ndarray, acceleration, h) -> np.ndarray:
    """One step in NumPy, as the kernels do it. state (3, ...): x, v and the velocity v~ that damping acts on (leapfrog; the
    velocity at the half step stands in v then). Explicit methods only."""
    x, v, q = state
    if method.stages:
        dx, dv = np.zeros_like(x), np.zeros_like(v)
        V, A = v, np.zeros_like(v)
        for c, b in method.stages:
            X, V = x + c * h * V, v + c * h * A
            A = acceleration(X, V)
            dx, dv = dx + b * h * V, dv + b * h * A
        return np.stack([x + dx, v + dv, q])
    if len(method.steps) == 1:
        v = v + h * acceleration(x, v)
        return np.stack([x + h * v, v, q])
    a = acceleration(x, q)
    v = v + h * a
    return np.stack([x + h * v, v, v + 0.5 * h * a])


def spectral_radius(method: Integrator, omega: float, c: float, h):
    """Spectral radius of a step of size h [s], or of each of several (n,), for x'' = -omega^2 x - c x'; omega [rad/s], c [1/s].
    """
    sizes = np.atleast_1d(np.asarray(h, np.float64))
    found = np.ones(len(sizes))
    if method.explicit:
        with np.errstate(over="ignore", invalid="ignore"):
            modes = np.eye(3)[:, None] * np.ones((1, len(sizes), 1))
            matrix = mode_step(method, modes, lambda x, v: -omega**2 * x - c * v, sizes[:, None]).swapaxes(0, 1)
        finite = np.isfinite(matrix).all(axis=(1, 2))
        found = np.where(finite, np.abs(np.linalg.eigvals(np.where(finite[:, None, None], matrix, 0.0))).max(axis=1), np.inf)
    return found if np.ndim(h) else float(found[0])


@cache
def stable_step(method: Integrator, omega: float, c: float = 0.0, rate: float = 1.0) -> float:
    """Largest stable step [s] for every mode up to omega [rad/s] whose decay rate is c [1/s] at omega; inf: any.

    Stable: amplitudes grow by no more than exp(rate h) a step, 1/s unless given. The first that is not, to 0.1 %.
    """
    fastest = max(omega, c)
    if not method.explicit or fastest == 0.0:
        return float("inf")

    def last_stable(sizes: np.ndarray) -> float:
        """The last one before which none is unstable."""
        unstable = spectral_radius(method, omega, c, sizes) > np.exp(np.minimum(rate * sizes, 1.0)) + 1e-13
        return float(sizes[max(int(np.argmax(unstable)) - 1, 0)] if unstable.any() else sizes[-1])
    good = last_stable(GRID / fastest)
    return last_stable(good * np.linspace(1.0, RATIO, 101))


def substeps_needed(scene: Scene, method: Integrator, omega: float, c: float) -> int:
    """Substeps a frame that keep an explicit method stable."""
    return max(1, ceil(MARGIN / (scene.fps * stable_step(method, omega, c))))


def stable_stretch(scene: Scene, method: Integrator, omega: float, c: float, least: int) -> float:
    """Stretch of an edge, 1 to STRETCH, up to which the scene's steps are stable: between the limit at rest and that of the
    bound, they grow where tension is more. omega [rad/s], c [1/s]: the highest at rest, and the rate that goes with it; least:
    substeps of the bound. Raises SceneError where they are certain to grow at rest."""
    h = 1.0 / scene.fps / scene.substeps
    if h > (step := stable_step(method, omega, c)):
        raise SceneError(Problem("/", f"integrator {method.name} is stable for {method.stable}: steps up to {step:.3g} s here "
                                 f"(highest frequency {omega:.4g} rad/s), found {h:.3g} s; give --substeps {least} "
                                 f"({1.0 / scene.fps / least:.3g} s), or another integrator"))

    def is_stable_at(s: float) -> bool:
        more = 2.0 - 1.0 / s
        return MARGIN * h <= stable_step(method, more**0.5 * omega, more * c)
    low, high = 1.0, STRETCH
    if is_stable_at(high):
        return high
    for _ in range(PLACES):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_stable_at(middle) else (low, middle)
    return low
