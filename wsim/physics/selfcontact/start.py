"""Reports of what surfaces are like where they start: intersections, which no proof covers, and thicknesses that edges or the
precision of a file cannot hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry import topology
from wsim.physics.selfcontact.crossings import crossings
from wsim.scene import Problem, SceneError

if TYPE_CHECKING:
    from wsim.model.model import Body
    from wsim.physics.selfcontact.surfaces import Surfaces

THICK = 0.4            # thickness over the shortest edge from which neighbours on a flat cloth would be in contact
STEPS = 8.0            # of rounding that a thickness takes, so that what is written keeps apart what is apart
LITTLE = 64.0 * 2.0 ** -24   # of the size of all surfaces, that those which intersect keep: more than proofs need
CROWD = 500            # points within the reach of a pair: 330 are where five layers of a cloth lie, twice as thick as edges
TANGLE, LOOSE = 4, 1000      # pairs a triangle that may intersect, and besides: each is tested exactly, and stays near
NAMED = 3              # places that are told


def reports(surfaces: Surfaces) -> list[str]:
    """Warnings about the surfaces of the first world, by prim path, each with what would do. Where surfaces intersect they keep
    little more than rounding apart from here on: points of either side are on both sides of the other, and a thickness would
    push against itself, without end. Raises SceneError where so much is in one place that all of it would be near all else."""
    bodies = [b for b in surfaces.bodies if b.world == 0]
    _crowded(bodies, surfaces)
    found = [text for b in bodies for text in (*_thick(b, surfaces), *_far(b, surfaces))]
    return [*_crossed(bodies, surfaces), *_pierced(bodies, surfaces), *found]


def _pierced(bodies: list[Body], surfaces: Surfaces) -> list[str]:
    """Edges of strands that meet triangles, by the exact test: an edge is a triangle that has one point twice."""
    s, own = surfaces.strands, surfaces.own
    if not s:
        return []
    edges, triangles = surfaces.edges[own["edges"]:surfaces.free["edges"]], surfaces.triangles[:own["triangles"]]
    edges, triangles = (each[surfaces.world[each[:, 0]] == 0] for each in (edges, triangles))
    x = surfaces.start(s.model)
    found = crossings(x, np.concatenate([edges[:, [0, 1, 1]], triangles]), neighbours=False, own=len(edges))
    found = found[found[:, 1] >= len(edges)] - (0, len(edges))
    where = [f"{s.path(int(edges[i, 0]))} and {next(b.path for b in bodies if triangles[t, 0] < b.last)} at "
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


def _crossed(bodies: list[Body], surfaces: Surfaces) -> list[str]:
    """Triangles without a common point that intersect, by the exact test; not those of two colliders."""
    first = np.cumsum([0, *(b.count for b in bodies)])
    x = np.concatenate([b.places + (b.origin - bodies[0].origin) for b in bodies])
    triangles = np.concatenate([b.triangles - b.first + start for b, start in zip(bodies, first, strict=False)])
    own, names, o = len(triangles), [b.path for b in bodies], surfaces.obstacles
    if o:
        first, world = np.append(first, first[-1] + np.cumsum([len(e.own) for e in o.each])), o.world == 0
        triangles = np.concatenate([triangles, *(e.triangles + s for e, s in zip(o.each, first[len(bodies):], strict=False))])
        x, names = np.concatenate([x, o.start()[world]]), [*names, *(o.contacts.rows.colliders[e.number].path for e in o.each)]
    most = TANGLE * len(triangles) + LOOSE
    found = crossings(x, triangles, neighbours=False, own=own, most=most)
    if not len(found):
        return []
    crossed = np.concatenate([b.triangles for b in bodies])[np.unique(found[found < own])]
    of = np.searchsorted(first, triangles[:, 0], side="right") - 1
    where = [f"{names[of[s]]} and {names[of[t]]} at ({', '.join(f'{v:.4g}' for v in place)}) m"
             for s, t in found[:NAMED] for place in [x[triangles[[s, t]]].mean(axis=(0, 1)) + bodies[0].origin]]
    if len(found) > most:
        raise SceneError(Problem(names[of[found[0, 0]]], f"its surface is a tangle where it starts: more than {most} pairs of "
                                 f"triangles intersect, such as {where[0]}; expected: none, {TANGLE} a triangle and {LOOSE} at "
                                 "most; move them apart, or leave wsim:selfCollision out"))
    surfaces.flatten(crossed, LITTLE * float(np.ptp(x, axis=0).max()))
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
