"""What can be wrong with a load. NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.scene import Load, Problem, Scene
from wsim.scene.check.objects import check_point_array, find_point_object, object_warning, thing_error


def check_load(thing: Load, scene: Scene) -> Iterator[Problem]:
    """Problems of a load."""
    path, values = thing.path, thing.curve.values
    if values.shape[1:] != (3,):
        yield thing_error(path, f"its {thing.name} has keys of shape {values.shape[1:]}", "three numbers a key",
                           f"give a {thing.name} (3,), or a Curve of such")
    elif not np.isfinite(values).all() or not np.isfinite(thing.curve.times).all():
        yield thing_error(path, f"its {thing.name} or its times are not finite", "finite numbers",
                           f"give another {thing.name}")
    if (thing.points is None) == (thing.triangles is None):
        yield thing_error(path,
                           "it names both points and triangles" if thing.points is not None else "it names neither points nor "
                           "triangles", "points of a force, or triangles of a traction", "leave one of them out, or name some")
        return
    body = yield from find_point_object(path, "load", "loads", thing.body, scene)
    if body is None:
        return
    named = thing.triangles if thing.points is None else thing.points
    assert named is not None
    if named.size == 0:
        yield thing_error(path, "it acts on nothing", "at least one point or triangle", "name some, or remove it")
        return
    bad = (named < 0) | (named >= body.point_count)
    if bad.any():
        yield thing_error(path, f"it loads point {named[bad][0]} of {body.path}", f"0 to {body.point_count - 1}",
                           "count from 0, in the order of the mesh's points")
    elif thing.triangles is not None:
        yield from _check_load_triangles(thing, thing.triangles, body)
    elif body.is_solid and (idle := np.setdiff1d(named, body.held_points()[1])).size:
        yield object_warning(path, f"it loads point {idle[0]} of {body.path}, which no tet has: that moves nothing",
                             "points of tets", "name others")
    if thing.points is not None:
        yield from check_point_array(path, "weights", thing.weights, (len(thing.points),))


def _check_load_triangles(thing: Load, triangles: np.ndarray, body) -> Iterator[Problem]:
    """Each has its corners in one face of the body, and is named once."""
    if not body.has_surface:
        what = f"are {body.noun}, which have" if body.plural else f"is a {body.noun}, which has"
        yield thing_error(thing.path, f"{body.path} {what} no triangles for a traction", "a cloth or soft body",
                           "give a force on points")
        return
    try:
        counts, indices = body.surface_faces()
    except (ValueError, IndexError):                 # said of the body
        return
    of = _faces_around_points(counts, indices, triangles)
    for k, (a, b, c) in enumerate(triangles.tolist()):
        if len({a, b, c}) < 3 or not of[a] & of[b] & of[c]:
            where = "in one face of the mesh" if body.is_sheet else "of one triangle of its surface"
            yield thing_error(thing.path, f"triangle {k} has the points {a}, {b}, {c} of {body.path}",
                               f"three corners {where}",
                               "name triangles that are there (`wsim.scene.nodal.loads.surface_triangles_among` finds them)")
            return
    ordered = np.sort(triangles, axis=1)
    if len(np.unique(ordered, axis=0)) < len(triangles):
        yield thing_error(thing.path, "it names a triangle twice", "each once", "leave one out, or give twice the traction")


def _faces_around_points(counts: np.ndarray, indices: np.ndarray, triangles: np.ndarray) -> dict[int, set[int]]:
    """Faces of each point that the triangles name."""
    found: dict[int, set[int]] = {p: set() for p in np.unique(triangles).tolist()}
    owner = np.repeat(np.arange(len(counts)), counts)
    for corner in np.flatnonzero(np.isin(indices, triangles)).tolist():
        found[int(indices[corner])].add(int(owner[corner]))
    return found
