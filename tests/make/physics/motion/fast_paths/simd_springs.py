"""What tests/physics/motion/fast_paths/test_simd_springs.py shares with other tests: DOUBLE,
FPS, FRAMES, SUBSTEPS, leapfrog."""

import numpy as np

DOUBLE = {"device": "cpu", "precision": "float64"}
FRAMES, SUBSTEPS, FPS = 3, 7, 60.0


def leapfrog(net: dict, frames: int, drag: float = 0.0, gravity=(0.0, -9.81, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """Kick, drift, kick; damping and drag see v + h a / 2 of the step before. Forces are summed with np.add.at."""
    x, v, m = net["points"].copy(), net["velocities"].copy(), net["masses"][:, None]
    (i, j), k, h = net["edges"].T, net["stiffness"], 1.0 / FPS / SUBSTEPS

    def acceleration(seen: np.ndarray) -> np.ndarray:
        r = x[j] - x[i]
        size = np.linalg.norm(r, axis=1)
        n = r / np.where(size > 0.0, size, 1.0)[:, None]
        pull = k * (size - net["lengths"] + net["damping"] * np.sum(n * (seen[j] - seen[i]), axis=1))
        f = np.zeros_like(x)
        np.add.at(f, i, pull[:, None] * n)
        np.add.at(f, j, -pull[:, None] * n)
        return f / m + gravity - drag * seen
    for _ in range(frames):
        seen = v
        for step in range(SUBSTEPS):
            a = acceleration(seen)
            v = v + (h if step else 0.5 * h) * a
            x += h * v
            seen = v + 0.5 * h * a
        v = v + 0.5 * h * acceleration(seen)
    return x, v
