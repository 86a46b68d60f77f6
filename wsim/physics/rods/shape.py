"""Frames and strains of strands on the host, for all strands of a count at once: NumPy only, float64. Formulas:
kernels/rods/element.py."""

import numpy as np

FOLD = 1e-3


def unit_vectors(v: np.ndarray) -> np.ndarray:
    """v / |v|, (..., 3); 0 stays 0."""
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(size > 0.0, size, 1.0)


def transport_directors(a: np.ndarray, b: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by the least rotation from unit tangent a to b."""
    k = np.cross(a, b)
    c = np.maximum(1.0 + np.sum(a * b, -1, keepdims=True), FOLD)
    return v + np.cross(k, v) + np.cross(k, np.cross(k, v)) / c


def director_frames(x: np.ndarray, given: np.ndarray | None = None, closed: bool = False) -> np.ndarray:
    """Unit directors (strands, edges, 3) across the edges of x (strands, points, 3): those given, made upright, else without
    twist, transported from the first edge on. closed: the last edge is a copy of the first; what is missing to come back to
    its director (the holonomy of the curve) is spread over all bends."""
    t = unit_vectors(np.diff(x, axis=1))
    if given is not None:
        return unit_vectors(given - t * np.sum(given * t, -1, keepdims=True))
    axis = np.eye(3)[np.argmin(np.abs(t[:, 0]), axis=-1)]
    found = [unit_vectors(axis - t[:, 0] * np.sum(axis * t[:, 0], -1, keepdims=True))]
    for i in range(1, t.shape[1]):
        m = transport_directors(t[:, i - 1], t[:, i], found[-1])
        found.append(unit_vectors(m - t[:, i] * np.sum(m * t[:, i], -1, keepdims=True)))
    m = np.stack(found, axis=1)
    if closed:
        a, b = m[:, -1], m[:, 0]
        angle = np.arctan2(np.sum(np.cross(a, b) * t[:, -1], -1), np.sum(a * b, -1))
        part = angle[:, None, None] * np.linspace(0.0, 1.0, m.shape[1])[:, None]
        m = np.cos(part) * m + np.sin(part) * np.cross(t, m)
        m[:, -1] = b
    return m


def bending_twist_strains(x: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Curvatures and twist (strands, points, 3) of points x with directors m; 0 at both ends."""
    t = unit_vectors(np.diff(x, axis=1))
    found = np.zeros(x.shape)
    t0, t1, m0, m1 = t[:, :-1], t[:, 1:], m[:, :-1], m[:, 1:]
    c = np.maximum(1.0 + np.sum(t0 * t1, -1, keepdims=True), FOLD)
    kb = 2.0 * np.cross(t0, t1) / c
    n = np.cross(t0, m0) + np.cross(t1, m1)
    p = transport_directors(t0, t1, m0)
    found[:, 1:-1, 0] = 0.5 * np.sum(n * kb, -1)
    found[:, 1:-1, 1] = -0.5 * np.sum((m0 + m1) * kb, -1)
    found[:, 1:-1, 2] = np.arctan2(np.sum(np.cross(p, m1) * t1, -1), np.sum(p * m1, -1))
    return found


def transported_directors(rest: np.ndarray, m: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Directors of x that go with those m of the shape at rest: each turned by the least rotation of its edge."""
    a, b = unit_vectors(np.diff(rest, axis=1)), unit_vectors(np.diff(x, axis=1))
    found = transport_directors(a, b, m)
    return unit_vectors(found - b * np.sum(found * b, -1, keepdims=True))


def longest_tight_step(x: np.ndarray, values: dict[str, np.ndarray], held: np.ndarray, counts: np.ndarray, stiff: float,
                       part: float) -> float:
    """Longest substep [s] in which colliders that tight strands press on let them sink by no more than a part of their
    diameter; inf: none is tight along a bend. x (points, strands, 3) [m]; values: length [m], A [N/m], m [kg], radius [m] of a
    strand table; held (points, strands): pinned; counts of points of strands.

    A point between edges of tensions T_i along t_i presses with F = |T_1 t_1 - T_0 t_0|, and sinks by F h^2 / (stiff m)
    (kernels/rods/contact.py)."""
    edges = np.diff(x, axis=0)
    size = np.linalg.norm(edges, axis=2)
    n = len(size)
    tension = np.maximum(values["A"][:n] * (size - values["length"][:n]), 0.0)
    pulls = tension[:, :, None] * unit_vectors(edges)
    force = np.linalg.norm(pulls[1:] - pulls[:-1], axis=2)                               # of the points between edges
    inner = (np.arange(1, n)[:, None] < counts - 1) & ~held[1:n] & (tension[1:] > 0.0) & (tension[:-1] > 0.0) & (force > 0.0)
    deep = part * 2.0 * values["radius"][1:n] * stiff * values["m"][1:n]
    return float(np.sqrt(np.min(deep[inner] / force[inner], initial=np.inf)))
