"""Reports of what surfaces are like where they start: intersections, which no proof covers, and thicknesses that edges or the
precision of a file cannot hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry import topology
from wsim.physics.selfcontact.crossings import crossings
from wsim.scene import Problem, SceneError

if TYPE_CHECKING:
    from wsim.model.model import Body, Model
    from wsim.physics.selfcontact.surfaces import Surfaces

THICK = 0.4            # thickness over the shortest edge from which neighbours on a flat cloth would be in contact
STEPS = 8.0            # of rounding that a thickness takes, so that what is written keeps apart what is apart
LITTLE = 64.0 * 2.0 ** -24   # of the size of all surfaces, that those which intersect keep: more than proofs need
CROWD = 500            # points within the reach of a pair: 330 are where five layers of a cloth lie, twice as thick as edges
TANGLE, LOOSE = 4, 1000      # pairs a triangle that may intersect, and besides: each is tested exactly, and stays near
NAMED = 3              # places that are told


def reports(model: Model, surfaces: Surfaces) -> list[str]:
    """Warnings about the surfaces of the first world, by prim path, each with what would do. Where surfaces intersect they keep
    little more than rounding apart from here on: points of either side are on both sides of the other, and a thickness would
    push against itself, without end. Raises SceneError where so much is in one place that all of it would be near all else."""
    bodies = [b for b in surfaces.bodies if b.world == 0]
    _crowded(bodies, surfaces)
    found = [text for b in bodies for text in (*_thick(b, surfaces), *_far(b, surfaces))]
    return [*_crossed(model, surfaces), *_pierced(model, surfaces), *found]


def _first(surfaces: Surfaces) -> tuple[np.ndarray, int, list[str]]:
    """Triangles of the first world, (t, 3), those of bodies first, which have points that they share in one of them; how many
    are bodies'; and the path of what each is of."""
    o, own, free = surfaces.obstacles, surfaces.own["triangles"], surfaces.free["triangles"]
    triangles = np.concatenate([surfaces.triangles[:own], surfaces.triangles[free:]])
    names = [b.path for b in surfaces.bodies for _ in b.triangles]
    if o:
        each = [(o.contacts.rows.colliders[e.number].path, len(o.places[id(e)]) * len(e.triangles)) for e in o.each]
        names += [path for path, count in each for _ in range(count)]
    here = surfaces.world[triangles[:, 0]] == 0
    return triangles[here], int(here[:own].sum()), [name for name, one in zip(names, here, strict=True) if one]


def _pierced(model: Model, surfaces: Surfaces) -> list[str]:
    """Edges of strands that meet triangles, by the exact test: an edge is a triangle that has one point twice."""
    s = surfaces.strands
    if not s:
        return []
    edges = surfaces.edges[surfaces.own["edges"]:surfaces.free["edges"]]
    edges, (triangles, own, names) = edges[surfaces.world[edges[:, 0]] == 0], _first(surfaces)
    x, triangles = surfaces.start(model), triangles[:own]
    found = crossings(x, np.concatenate([edges[:, [0, 1, 1]], triangles]), neighbours=False, own=len(edges))
    found = found[found[:, 1] >= len(edges)] - (0, len(edges))
    where = [f"{s.path(int(edges[i, 0]))} and {names[t]} at "
             f"({', '.join(f'{v:.4g}' for v in x[edges[i]].mean(axis=0) + surfaces.base)}) m" for i, t in found[:NAMED]]
    return [f"{len(found)} edges of rods go through triangles where they start, such as {'; '.join(where)}: they stay crossed "
            "where nothing takes them apart; move them apart there"] if where else []


def _crowded(bodies: list[Body], surfaces: Surfaces) -> None:
    """Raises SceneError where more than CROWD points are within reach of each other."""
    x = np.concatenate([(b.places + b.origin)[np.unique(b.triangles) - b.first] for b in bodies])
    near = surfaces.thickness + 2.0 * surfaces.beta
    if not len(x) or _fullest(x, near)[0] <= CROWD / 8:                # a cube of that size is in eight cells at most
        return
    steps = 0.5 * np.stack(np.meshgrid(*[(0.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    count, first = max((_fullest(x + near * step, near) for step in steps), key=lambda found: found[0])
    if count > CROWD:
        of = np.searchsorted(np.cumsum([len(np.unique(b.triangles)) for b in bodies]), first, side="right")
        where = ", ".join(f"{v:.4g}" for v in x[first])
        raise SceneError(Problem(bodies[of].path, f"{count} points of surfaces that touch are within {near:.3g} m of each other"
                                 f" at ({where}) m; expected: {CROWD} at most, as each is near all others; move them apart, "
                                 f"weld them, give less thickness (now {surfaces.thickness:.3g} m), or leave "
                                 "wsim:selfCollision out"))


def _fullest(x: np.ndarray, size: float) -> tuple[int, int]:
    """Points in the fullest cell of a grid, and the first of them."""
    cell = np.floor((x - x.min(axis=0)) / size).astype(np.int64) if len(x) else x
    _, first, count = np.unique(cell, axis=0, return_index=True, return_counts=True)
    return int(count.max()), int(first[count.argmax()])


def _crossed(model: Model, surfaces: Surfaces) -> list[str]:
    """Triangles without a common point that intersect, by the exact test; not those of two colliders."""
    (triangles, own, names), x = _first(surfaces), surfaces.start(model)
    most = TANGLE * len(triangles) + LOOSE
    found = crossings(x, triangles, neighbours=False, own=own, most=most)
    if not len(found):
        return []
    where = [f"{names[s]} and {names[t]} at ({', '.join(f'{v:.4g}' for v in place)}) m"
             for s, t in found[:NAMED] for place in [x[triangles[[s, t]]].mean(axis=(0, 1)) + surfaces.base]]
    if len(found) > most:
        raise SceneError(Problem(names[found[0, 0]], f"its surface is a tangle where it starts: more than {most} pairs of "
                                 f"triangles intersect, such as {where[0]}; expected: none, {TANGLE} a triangle and {LOOSE} at "
                                 "most; move them apart, or leave wsim:selfCollision out"))
    size = float(np.ptp(x[triangles.ravel()], axis=0).max())
    surfaces.flatten(model, triangles[np.unique(found[found < own])], LITTLE * size)
    return [f"{len(found)} pairs of triangles intersect where surfaces start, such as {'; '.join(where)}: they keep no "
            "thickness there, and stay crossed where nothing takes them apart; move them apart there"]


def _thick(body: Body, surfaces: Surfaces) -> list[str]:
    """A thickness beyond THICK of the shortest edge."""
    ends = body.rest[topology.edges(body.triangles) - body.first]
    least = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min())
    own = 2.0 * float(surfaces.reach[body.first:body.last].max())
    if own <= THICK * least:
        return []
    return [f"{body.path}: its thickness is {own:.3g} m, and its shortest edge {least:.3g} m: contacts of neighbours keep "
            f"less; give at most {THICK * least:.3g} m, or longer edges"]


def _far(body: Body, surfaces: Surfaces) -> list[str]:
    """A thickness of less than STEPS units of rounding of float32 in the frame of its prim."""
    local = np.asarray(body.source.points, np.float64)
    stretch = np.linalg.norm(body.source.motion.at(0.0)[:3, :3], 2)
    step = float(np.spacing(np.float32(np.abs(local).max(initial=0.0)))) * stretch
    own = 2.0 * float(surfaces.reach[body.first:body.last].max())
    if own >= STEPS * step:
        return []
    return [f"{body.path}: its thickness is {own:.3g} m, and results round its points to {step:.3g} m, "
            f"{np.abs(local).max():.3g} from the origin of its prim; give {STEPS * step:.3g} m or more, or move the "
            "origin to the cloth"]
