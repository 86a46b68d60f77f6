"""The least noise that a fit claims: what simulations and observations are wrong by, whatever the data look like.

    simulated   EXACT of the size of the body (of forces: of the largest): tolerances of Newton's method and of conjugate
                gradients, and what they leave to chance
    observed    rounding of numbers that are kept in float32, as USD keeps points: spacing / sqrt(12)
"""

import numpy as np

from wsim.fitting.observations.observe import objects_with_points, observed_points
from wsim.scene import Scene

EXACT = 1e-7


def observation_noise_floor(experiments: list[tuple[Scene, list]]) -> float:
    """Root of the mean square over all that was observed, in the unit of residuals: [m], [N], or of the given noise."""
    square, count = 0.0, 0
    for scene, seen in experiments:
        for o in seen:
            values = _finite_observed_values(o)
            error = max(EXACT * _size_of_observed(o, values, scene), _single_precision_rounding(o, values)) / (o.sigma or 1.0)
            square, count = square + len(values) * error**2, count + len(values)
    return float(np.sqrt(square / max(count, 1)))


def _finite_observed_values(o) -> np.ndarray:
    values = next(getattr(o, name) for name in ("values", "positions", "points") if hasattr(o, name))
    values = np.asarray(values, np.float64).ravel()
    return values[np.isfinite(values)]


def _size_of_observed(o, values: np.ndarray, scene: Scene) -> float:
    if o.unit == "N" or hasattr(o, "field"):
        return float(np.abs(values).max(initial=0.0))
    if hasattr(o, "local"):
        return float(np.ptp(o.local, axis=0).max(initial=0.0))
    points = next(observed_points(b) for b in objects_with_points(scene) if b.path == o.path)
    return float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 0.0


def _single_precision_rounding(o, values: np.ndarray) -> float:
    """0 of values that float32 does not hold."""
    single = np.abs(values).astype(np.float32)
    if not len(values) or (o.source == "observations" and not np.array_equal(single, np.abs(values))):
        return 0.0
    return float(np.sqrt(np.mean(np.spacing(single).astype(np.float64)**2) / 12.0))
