"""How large a step an explicit integrator bears: the spectral radius of its amplification matrix. NumPy.

    mode    x'' = -omega^2 x - c x';  stable at h: no amplitude grows by more than exp(rate h) a step
    bound   of the highest frequency: row sums of M^-1 K (Gershgorin 1931), see `wsim.frequency`
"""

from functools import cache

import numpy as np

from wsim.integrator import Integrator


def step(method: Integrator, state: np.ndarray, acceleration, h: float) -> np.ndarray:
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


def growth(method: Integrator, omega: float, c: float, h: float) -> float:
    """Spectral radius of a step of size h [s] for x'' = -omega^2 x - c x'; omega [rad/s], c [1/s]."""
    if method.explicit:
        modes = np.eye(3)
        matrix = step(method, modes, lambda x, v: -omega**2 * x - c * v, h)
        return float(np.abs(np.linalg.eigvals(matrix)).max()) if np.isfinite(matrix).all() else np.inf
    return 1.0


@cache
def limit(method: Integrator, omega: float, c: float = 0.0, rate: float = 1.0) -> float:
    """Largest stable step [s] for every mode up to omega [rad/s] whose decay rate is c [1/s] at omega; inf: any.

    Stable: amplitudes grow by no more than exp(rate h) a step, 1/s unless given. Found by bisection to 0.1 %.
    """
    fastest = max(omega, c)
    if not method.explicit or fastest == 0.0:
        return float("inf")

    def stable(h: float) -> bool:
        return growth(method, omega, c, h) <= np.exp(min(rate * h, 1.0)) + 1e-13

    good = 1e-12 / fastest
    while stable(1.1 * good) and good * fastest < 1e3:
        good *= 1.1
    bad = 1.1 * good
    while bad > 1.001 * good:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good
