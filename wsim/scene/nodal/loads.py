"""Forces on points that stand for a load, and the triangles on which tractions act. NumPy only.

A traction is a dead load: it keeps its direction in the world and acts on the area that a triangle has at rest when the scene
begins, a third of it at each corner; of quadratic tets a third at the middle of each edge (the consistent nodal forces of a
constant traction: Zienkiewicz, Taylor, The Finite Element Method 1, 8).
"""

import numpy as np

from wsim.geometry import topology
from wsim.scene import Deformable, Load, Problem, SceneError
from wsim.scene.curve import Curve


def nodal_load_shares(load: Load, body) -> tuple[np.ndarray, np.ndarray]:
    """Places in the arrays of a `wsim.model.model.PointBody` that bear a load, and the part of its value that each has, 1 or
    [m^2]; a place may occur again."""
    if load.triangles is None:
        return body.index[load.points], load.parts
    source = body.source
    area = topology.triangle_areas(source.rest_places(), load.triangles) / 3.0
    if not len(body.middles):
        return body.index[load.triangles].ravel(), np.repeat(area, 3)
    n = len(body.index)
    sides = np.sort(load.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64), axis=1)
    ends = np.sort(body.ends.astype(np.int64), axis=1)
    key = ends[:, 0] * n + ends[:, 1]
    order = np.argsort(key)
    return body.middles[order[np.searchsorted(key[order], sides[:, 0] * n + sides[:, 1])]], np.repeat(area, 3)


def given_curve(load: Load, curve: Curve, value) -> Curve:
    """A value of a load as a curve: another Curve, values of the keys of its `curve`, (keys, 3), or one of all times, (3,).
    Raises SceneError."""
    try:
        of = value if isinstance(value, Curve) else curve
        values = np.array(value.values if isinstance(value, Curve) else value, np.float64)
        new = Curve(np.zeros(1), values[None]) if values.ndim == 1 else of.replaced(values)
    except (TypeError, ValueError) as error:
        raise SceneError(Problem(load.path, f"{load.name}: {error}; allowed are a Curve, values (keys, 3) or (3,)")) from None
    values = new.values
    if values.shape[1:] != (3,) or not (np.isfinite(values).all() and np.isfinite(new.times).all()):
        raise SceneError(Problem(load.path, f"{load.name} has shape {np.shape(values)}"
                                 f"{'' if np.isfinite(values).all() else ', not all finite'}; allowed are a Curve, "
                                 f"({len(curve.times)}, 3) values of its keys or (3,), all finite"))
    return new


def surface_triangles_among(body: Deformable, points=None) -> np.ndarray:
    """Triangles (m, 3) of the surface of a body, all of whose corners are among some points (None: all)."""
    triangles = body.surface_triangles()
    return triangles if points is None else triangles[np.isin(triangles, np.asarray(points)).all(axis=1)]
