"""What tests/physics/rods/test_touch.py shares with other tests: linked, thrown."""

import numpy as np

from tests.physics.rods.knots import closed, linking
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene

N, THICK = 17, 0.02


def thrown(seed: int = 0, speed: float = 10.0, held: bool = True, on: bool = True, substeps: int = 4) -> tuple[Scene, Rods]:
    """Two ropes across each other, 0.1 m apart, thrown at each other; held: by their ends. seed: tilts and shifts, 0: none."""
    rng = np.random.default_rng(seed)
    t, some = np.linspace(-0.5, 0.5, N), float(seed > 0)
    turn = np.pi / 2.0 + some * rng.uniform(-0.9, 0.9)
    off = some * rng.uniform(-0.2, 0.2, 2)
    a = np.stack([t, 0.0 * t, 0.0 * t + 0.05], axis=1)
    b = np.stack([t * np.cos(turn) + off[0], t * np.sin(turn) + off[1], 0.0 * t - 0.05], axis=1)
    v = np.zeros((2 * N, 3))
    v[:, 2] = np.repeat([-speed, speed], N)
    v[:, :2] += some * rng.normal(size=2) * np.repeat([1.0, -1.0], N)[:, None]
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=substeps)
    rods = scene.add(Rods("/ropes", np.concatenate([a, b]), [N, N], THICK, young=1e7, velocities=v, self_collision=on))
    if held:
        rods.pin("/ends", [0, N - 1, N, 2 * N - 1])
    return scene, rods


def linked(x: np.ndarray) -> float:
    """Linking number of two held ropes as a file has them, each closed on its own side."""
    x = np.asarray(x, np.float32).astype(np.float64)
    a, b = x[:N], x[N:]
    return linking(closed(a, a[[-1, 0]] + (0.0, 0.0, 30.0)), closed(b, b[[-1, 0]] - (0.0, 0.0, 30.0)))
