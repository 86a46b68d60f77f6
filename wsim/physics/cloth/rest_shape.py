"""Rest shapes and rest lengths while a simulation is there: bodies get them first, then what was made of them. NumPy only.

    rest_shape    where the author's points of a body are at rest [m], (n, 3), in world space at the start (wherever that is)
    lengths       rest lengths [m] of a spring net, (edges,), in the author's order

Masses follow a rest shape where they follow a density, as when a scene is loaded. Which points belong together stays: an
element that loses its size, or a tether that would lead to another pin, raises.
"""

from dataclasses import replace
from typing import Any, cast

import numpy as np

from wsim.geometry.tetra.tets import signed_tet_volumes
from wsim.model.midnodes import with_midnode_values
from wsim.model.model import Model, PointBody, hard_places
from wsim.physics.cloth.constraints import constraints_of_body, of_body, renew_rest_values
from wsim.scene import Problem, SceneError
from wsim.scene.nodal.masses import fill_loose_masses, single_density


def current_rest_shape(body: PointBody) -> np.ndarray:
    """(n, 3) [m] about its mean; points that are one particle have one place. Raises SceneError where there is none."""
    if body.source.lengths is not None:
        raise SceneError(Problem(body.path, "its springs have rest lengths of their own, and no rest shape; take lengths"))
    return body.rest[body.own - body.first]


def reshape_bodies(model: Model, name: str, values, bodies: list[PointBody], densities: dict[int, float]) -> None:
    """Changes bodies; densities: those that were set, by number. Raises SceneError before anything is changed."""
    values, change = np.asarray(values, np.float64), {"rest_shape": body_with_rest_shape, "lengths": body_with_lengths}[name]
    found = [(b, change(b, values)) for b in bodies]
    pinned, again = hard_places(model), []
    for before, after in found:
        before_rows, after_rows = of_body(model, before), constraints_of_body(after, pinned)
        again.append((before_rows, after_rows))
        alike = len(before_rows) == len(after_rows) and all(np.array_equal(r.ids, s.ids)
                                                            for r, s in zip(before_rows, after_rows, strict=False))
        if not alike or (len(after.tets) and not (signed_tet_volumes(after.rest, after.tets[:, :4] - after.first) > 0.0).all()):
            raise SceneError(Problem(before.path, f"{name}: an edge, triangle or tet has no size (or is inside out), or a "
                                     "tether leads to another pin; give other values, or make another Simulation of them"))
        if model.alias is not None and (after.masses != before.masses).any():
            raise SceneError(Problem(before.path, f"{name} changes masses of points that bodies share; give points masses, or "
                                     "make another Simulation"))
    for body, after in found:
        factor = densities[body.number] / (single_density(body.source) or 1.0) if body.number in densities else 1.0
        body.source, body.rest = after.source, after.rest
        if after.masses is not body.masses:
            body.masses = factor * after.masses
    for rows, new in again:
        renew_rest_values(rows, new)


def body_with_rest_shape(body: PointBody, points: np.ndarray) -> PointBody:
    if points.shape != (len(body.own), 3) or not np.isfinite(points).all():
        raise SceneError(Problem(body.path, f"rest_shape must be finite with shape ({len(body.own)}, 3); found {points.shape}"))
    current_rest_shape(body)
    points, rest = points - points.mean(axis=0), body.rest.copy()
    rest[body.middles - body.first] = with_midnode_values(points, body.ends)[len(points):]
    rest[body.own[::-1] - body.first] = points[::-1]                  # of a weld the first
    masses = masses_of(body, points)
    return replace(body, rest=rest, masses=body.masses if masses is None else masses)


def body_with_lengths(body: PointBody, lengths: np.ndarray) -> PointBody:
    if not body.source.is_net or lengths.shape != (len(body.edges),) or not (lengths > 0.0).all() \
            or not np.isfinite(lengths).all():
        raise SceneError(Problem(body.path, "lengths are those of a spring net: finite, > 0, with shape "
                                 f"({len(body.edges)},); found {lengths.shape}"))
    source = replace(cast(Any, body.source))
    source.lengths = lengths.copy()                                   # stays in float64
    return replace(body, source=source)


def masses_of(body: PointBody, rest: np.ndarray) -> np.ndarray | None:
    """Masses of the particles [kg], (points,), from the author's points at rest; None where they follow nothing."""
    source = body.source
    if source.masses is not None and not len(body.middles):
        return None
    masses = source.masses_at_rest(rest)
    if masses is None:
        return None
    masses = np.bincount(np.concatenate([body.own, body.middles]) - body.first, masses, body.count)
    return fill_loose_masses(masses, body.triangles - body.first)[0] if source.is_sheet else masses


def object_with_rest(thing: Any, name: str, values: np.ndarray):
    """A scene's object with a rest shape (n, 3) or lengths (edges,) or (edges, 1). A shape is moved to where it was."""
    if thing.is_net:
        new = replace(thing)
        new.lengths = values.reshape(-1).copy()                       # stays in float64
        return new
    matrix, places = thing.motion.at(0.0), values - values.mean(axis=0) + thing.rest_places().mean(axis=0)
    return replace(thing, rest_points=np.linalg.solve(matrix[:3, :3], (places - matrix[:3, 3]).T).T)
