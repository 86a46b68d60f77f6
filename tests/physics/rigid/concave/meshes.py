"""Closed concave meshes for tests: rings, gears, bowls."""

import numpy as np

from tools.scenes.machines import gear_grid, loop_faces, torus_grid
from wsim import Surface


def _loops(P: np.ndarray) -> Surface:
    """Quads of a grid of places (n, m, 3) [m] that closes both ways."""
    n, m = P.shape[:2]
    return Surface(P.reshape(-1, 3), np.full(n * m, 4), loop_faces(n, m).ravel())


def ring(R: float, r: float, n: int = 32, m: int = 16) -> Surface:
    """A torus about z."""
    return _loops(torus_grid(R, r, n, m))


def gear(teeth: int, module: float, width: float, backlash: float = 0.06) -> Surface:
    """A spur gear about z with involute flanks of 20 degrees, its first tooth along x, and a bore."""
    return _loops(gear_grid(teeth, module, width, backlash))


def bowl(R: float, t: float, n: int = 24, m: int = 8) -> Surface:
    """Half a shell of thickness t below z = 0, without poles."""
    down = np.linspace(np.pi / 2, np.pi, m + 1)[:-1]
    u = 2 * np.pi * np.arange(n)[:, None] / n
    r, a = np.concatenate([np.full(m, R), np.full(m, R - t)]), np.concatenate([down, down[::-1]])
    P = np.stack(np.broadcast_arrays(r * np.sin(a) * np.cos(u), r * np.sin(a) * np.sin(u), r * np.cos(a)), axis=-1)
    plain = _loops(P)
    quads = np.delete(plain.indices.reshape(n, 2 * m, 4), m - 1, axis=1).reshape(-1, 4)       # lids close both lowest rims
    lowest = np.arange(n) * 2 * m + m - 1
    return Surface(plain.points, np.concatenate([np.full(len(quads), 4), [n, n]]),
                   np.concatenate([quads.ravel(), lowest, lowest[::-1] + 1]))


def signed_volume(shape: Surface) -> float:
    """Signed volume [m^3] of a mesh, by fans of its faces."""
    total, at = 0.0, 0
    for count in shape.counts:
        face = shape.points[shape.indices[at:at + count]].astype(float)
        total += sum(np.dot(face[0], np.cross(face[k], face[k + 1])) / 6.0 for k in range(1, count - 1))
        at += count
    return total
