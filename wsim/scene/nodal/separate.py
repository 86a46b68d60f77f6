"""Points joined by a spring that stand at one place: nothing tells which way it pushes, so they would stay. NumPy only.

A spring of rest length L between them is in equilibrium there, but in an unstable one: any distance grows. So each gets one of
NUDGE L in a direction of its own (the multiples of three irrational numbers without their whole part: Roberts 2018, R3).
"""

import numpy as np

NUDGE = 1e-6           # of the rest length: some roundings of float32, no more than what was lost when the file was written
PHI = 1.2207440846057596                             # root of x^4 = x + 1
STEPS = np.array([1.0 / PHI, 1.0 / PHI**2, 1.0 / PHI**3])


def separate_coincident_ends(places: np.ndarray, edges: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """places [m], (n, 3), with the ends of edges of length 0 moved; edges (m, 2); rest lengths [m], (m,).

    The same array where no edge has two ends at one place. Edges of rest length 0 stay as they are."""
    if len(edges) == 0:
        return places
    stuck = (places[edges[:, 0]] == places[edges[:, 1]]).all(axis=1) & (rest > 0.0)
    if not stuck.any():
        return places
    reach = np.full(len(places), np.inf)
    np.minimum.at(reach, edges[stuck].ravel(), np.repeat(rest[stuck], 2))
    k = np.flatnonzero(np.isfinite(reach))
    moved = places.copy()
    moved[k] += NUDGE * reach[k, None] * ((k[:, None] + 1) * STEPS % 1.0 - 0.5)
    return moved
