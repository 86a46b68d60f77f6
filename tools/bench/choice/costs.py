"""Constants of `wsim.simulation.cost.COSTS` from measured frames: least squares of relative errors, none below 0.

    sum over rows of (sum_k counts_k c_k / seconds - 1)^2 + HOLD sum_k (c_k / present_k - 1)^2

so that what no row tells apart stays as it is.
"""

import numpy as np

HOLD = 1e-3
ROUNDS = 2000


def fitted(rows: list[dict], present: dict[str, float]) -> dict[str, float]:
    """rows: {"counts": {name: times a frame}, "seconds": of a frame}; constants by name, for all that the rows do."""
    names = sorted({name for row in rows for name, times in row["counts"].items() if times})
    A = np.array([[row["counts"].get(name, 0.0) * present[name] / row["seconds"] for name in names] for row in rows])
    H, b = A.T @ A + HOLD * np.eye(len(names)), A.sum(axis=0) + HOLD
    z = np.ones(len(names))
    for _ in range(ROUNDS):                                # Gauss-Seidel, each kept from going below 0
        for k in range(len(names)):
            z[k] = max(0.0, z[k] + (b[k] - H[k] @ z) / H[k, k])
    return {name: float(z[k] * present[name]) for k, name in enumerate(names)}


def ratios(rows: list[dict], costs: dict[str, float]) -> np.ndarray:
    """Seconds that the constants say over those measured, (rows,)."""
    return np.array([sum(times * costs[name] for name, times in row["counts"].items()) / row["seconds"] for row in rows])
