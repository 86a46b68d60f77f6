"""Skins: fine meshes that follow the tets of a soft body, each point by the tet that it lies in at rest. NumPy only.

    p = sum_i b_i x_i        v = sum_i b_i v_i        b: barycentric coordinates at rest (`wsim.geometry.tetra.embed`)

so a skin follows affine motions of its tets exactly; between tets it is continuous, and bent as they are. A point outside of
all tets follows the nearest one by extrapolation, if it is no farther away than the longest edge of a tet.
"""

from dataclasses import dataclass

import numpy as np

from wsim.geometry.tetra.embed import embed_in_tets
from wsim.geometry.tetra.tets import signed_tet_volumes
from wsim.scene import Problem, Scene, SceneError


@dataclass
class SkinEmbedding:
    """The points of one skin as weighed points of its body, `body` its path."""

    path: str
    body: str
    rows: np.ndarray                         # the four points of the body that hold each point, (m, 4)
    weights: np.ndarray                      # of these, sum 1, (m, 4) float64

    def of(self, values: np.ndarray) -> np.ndarray:
        """Positions or velocities of the skin's points, (m, 3) float64, from those of the body's, (n, 3)."""
        values = np.asarray(values, np.float64)
        return sum((w[:, None] * values.take(row, axis=0) for row, w in zip(self.rows.T, self.weights.T, strict=True)),
                   np.zeros((len(self.rows), 3)))


def embed_skin(soft, skin) -> SkinEmbedding:
    """Finds the tet of each point of a skin, where both are at rest. Lengths are those of the world at the start, so that a
    transform that stretches does no harm, nor one that mirrors.

    Raises SceneError with the skin's path where a point is farther outside of the tets than the longest of their edges, or the
    body's where its tets hold nothing."""
    rest, places = (soft.motion.points(points, 0.0) for points in (
        soft.points if soft.rest_points is None else soft.rest_points, skin.points))
    bad = np.flatnonzero(~np.isfinite(places).all(axis=1))
    if len(bad):
        raise SceneError(Problem(skin.path, f"point {bad[0]} is not finite; give it three finite coordinates"))
    try:
        tets = np.where((signed_tet_volumes(rest, soft.tets) < 0)[:, None], soft.tets[:, [0, 1, 3, 2]], soft.tets)
        tet, weights = embed_in_tets(rest, tets, places)
    except ValueError as error:
        what, _, text = str(error).partition(": ")
        if what != "places":
            raise SceneError(Problem(soft.path, f"cannot carry {skin.path}: {error}")) from None
        text = text.partition(";")[0]
        raise SceneError(Problem(skin.path, f"cannot follow the tets of {soft.path}: of its points {text}; bring it to where "
                                 "the tets are at rest, or take it out of the body")) from None
    return SkinEmbedding(skin.path, soft.path, tets[tet], weights)


def embed_all_skins(scene: Scene) -> dict[str, SkinEmbedding]:
    """All skins of a scene by path. Raises SceneError with every skin that cannot follow."""
    found, problems = {}, []
    for body in scene.bodies():
        for skin in body.skins:
            try:
                found[skin.path] = embed_skin(body, skin)
            except SceneError as error:
                problems += error.problems
    if problems:
        raise SceneError(problems)
    return found
