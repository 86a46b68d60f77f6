"""Middles of edges: points of a body of quadratic tets that its author does not have. NumPy only.

They stand behind the author's points in a `BodyGeometry` and in restart fields, each between two ends of `Body.ends`. What is
given to the author's points, middles get as the mean of their ends; what is held at both ends is held between.
"""

import numpy as np

from wsim.geometry import topology

HRZ = np.repeat([1.0 / 36.0, 4.0 / 27.0], [4, 6])      # of a tet's mass, for each node (Hinton, Rock, Zienkiewicz 1976)


def with_midnode_values(values: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """values (n, ...) of the author's points, followed by those of the middles, (n + m, ...). ends (m, 2)."""
    if len(ends) == 0:
        return values
    return np.concatenate([values, (0.5 * (values[ends[:, 0]] + values[ends[:, 1]])).astype(values.dtype)])


def places_with_midnodes(body) -> np.ndarray:
    """Places in the arrays of a body's author's points, then of its middles, (n + m,)."""
    return np.concatenate([body.index, body.middles])


def restart_rows_of_body(body, values: np.ndarray) -> np.ndarray:
    """Rows of a restart field for `places_with_midnodes`: as they are; where an earlier run had no middles, or others, those of
    the author's points and what lies between."""
    n = len(body.index)
    return values if len(values) == n + len(body.middles) else with_midnode_values(values[:n], body.ends)


def held_with_midnodes(body, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of some author's points (k,) and of all middles between two of them, (k + h,), and the ends of those in `points`,
    (h, 2)."""
    where = np.full(len(body.index), -1, np.int64)
    where[points] = np.arange(len(points))
    ends = where[body.ends]
    both = (ends >= 0).all(axis=1)
    return np.concatenate([body.index[points], body.middles[both]]), ends[both]


def with_middles(shape, weights: np.ndarray):
    """A `BodyGeometry` of four-node tets as one of ten. weights [kg/m^3]: mass of each tet over its volume, (t,)."""
    from wsim.geometry.tetra.tets import edges_of_tets
    shape.ends = edges_of_tets(shape.tets)
    shape.masses, shape.tets = lump_node_masses(shape.masses, weights, shape.rest, shape.tets)
    shape.rest, shape.reach = with_midnode_values(shape.rest, shape.ends), with_midnode_values(shape.reach, shape.ends)
    shape.particle = np.arange(len(shape.rest))
    return shape


def memory_neighbours(shape) -> np.ndarray:
    """Pairs of points that belong near each other in memory, (m, 2)."""
    if len(shape.ends):
        middle = len(shape.rest) - len(shape.ends) + np.arange(len(shape.ends))
        return np.concatenate([np.column_stack([shape.ends[:, k], middle]) for k in range(2)])
    return shape.edges if len(shape.edges) else topology.edges_of_triangles(shape.triangles)


def lump_node_masses(masses: np.ndarray, weights: np.ndarray, rest: np.ndarray,
                     tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masses of the nodes [kg], (n + m,), from those of the author's points, (n,); and rows of ten, (t, 10).

    By `weights` times volume each tet gets its part of what its corners have, which is its own mass where they have a quarter
    of each tet; its nodes share that by `HRZ`, as `wsim.geometry.tetra.tets.lumped_tet_masses` does."""
    from wsim.geometry.tetra.tets import signed_tet_volumes, ten_node_mesh
    nodes, ten = ten_node_mesh(rest, tets)
    weight = weights * signed_tet_volumes(rest, tets)
    total = np.bincount(tets.ravel(), np.repeat(weight, 4), len(rest))
    part = weight * (masses / np.where(total > 0.0, total, 1.0))[tets].sum(axis=1)
    found = np.bincount(ten.ravel(), np.outer(part, HRZ).ravel(), len(nodes))
    found[:len(rest)] += np.where(total > 0.0, 0.0, masses)                     # of points that no tet has
    return found, ten
