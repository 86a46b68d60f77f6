"""Closed concave meshes for tests: rings, gears, bowls."""

import numpy as np

from wsim import Surface


def _loops(P: np.ndarray) -> Surface:
    """Quads of a grid of places (n, m, 3) [m] that closes both ways."""
    n, m = P.shape[:2]
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    corners = [(i + a) % n * m + (j + b) % m for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return Surface(P.reshape(-1, 3), np.full(n * m, 4), np.stack(corners, axis=-1).ravel())


def ring(R: float, r: float, n: int = 32, m: int = 16) -> Surface:
    """A torus about z."""
    u, v = 2 * np.pi * np.arange(n)[:, None] / n, 2 * np.pi * np.arange(m)[None] / m
    w = R + r * np.cos(v)
    return _loops(np.stack(np.broadcast_arrays(np.cos(u) * w, np.sin(u) * w, r * np.sin(v)), axis=-1))


def gear(teeth: int, module: float, width: float, backlash: float = 0.06) -> Surface:
    """A spur gear about z with involute flanks of 20 degrees, its first tooth along x, and a bore."""
    pitch, alpha = 0.5 * module * teeth, np.radians(20.0)
    base, top, root = pitch * np.cos(alpha), pitch + module, pitch - 1.25 * module

    def involute(a):
        return np.tan(a) - a
    half = np.pi / (2 * teeth) - 0.5 * backlash * module / pitch + involute(alpha)
    r = np.linspace(max(base, root), top, 4)
    turn = half - involute(np.arccos(np.minimum(1.0, base / r)))
    foot = [root] if root < base else []
    radius = np.concatenate([foot, r, r[::-1], foot])
    angle = np.concatenate([[-half] * len(foot), -turn, turn[::-1], [half] * len(foot)])
    angle = (angle + 2 * np.pi * np.arange(teeth)[:, None] / teeth).ravel()
    radius = np.tile(radius, teeth)
    bore = np.full(len(radius), 0.3 * root)
    section = [(radius, -0.5 * width), (radius, 0.5 * width), (bore, 0.5 * width), (bore, -0.5 * width)]
    return _loops(np.stack([np.stack([s * np.cos(angle), s * np.sin(angle), np.full(len(s), z)], axis=-1) for s, z in section],
                           axis=1))


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
