"""Reports of what surfaces are like where they start: intersections, which no proof covers, and thicknesses that edges or the
precision of a file cannot hold."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry import topology
from wsim.kernels.contact.selfcontact.rows import RECOVERY
from wsim.kernels.contact.selfcontact.search import REST
from wsim.physics.contact.selfcontact.crossings import box_overlap_batches, crossed_triangles, share_common_point, unique_pairs
from wsim.scene import Problem, SceneError
from wsim.scene.check.objects import NEAR, three_digits

if TYPE_CHECKING:
    from wsim.model.model import Model, PointBody
    from wsim.physics.contact.selfcontact.surfaces import ContactSurfaces

THICK = 0.4            # thickness over the shortest edge from which neighbours on a flat cloth would be in contact
STEPS = 8.0            # of rounding that a thickness takes, so that what is written keeps apart what is apart
LITTLE = 64.0 * 2.0 ** -24   # of the size of all surfaces, that those which intersect keep: more than proofs need
CROWD = 500            # points within the reach of a pair: 330 are where five layers of a cloth lie, twice as thick as edges
TANGLE, LOOSE = 4, 1000      # pairs a triangle that may intersect, and besides: each is tested exactly, and stays near
NAMED = 3              # places that are told
MET = 1e-3             # of what both keep: strands nearer than that begin in each other, and no side is theirs
SUNK = 0.9             # of it: strands nearer than that are told
HEAP = 20000           # pairs of edges nearer than half of it, besides TANGLE an edge: 60 parallel strands take half a minute
KEPT = 1.75            # units of rounding of a file that a proof asks for between two surfaces


def report_start_state(model: Model, surfaces: ContactSurfaces) -> list[Problem]:
    """Warnings about the surfaces of the first world, by prim path, each with what would do. Where surfaces intersect they keep
    little more than rounding apart from here on: points of either side are on both sides of the other, and a thickness would
    push against itself, without end. Raises SceneError where so much is in one place that all of it would be near all else."""
    bodies = [b for b in surfaces.active if b.world == 0]
    _refuse_crowded_bodies(bodies, surfaces)
    found = [(b.path, text) for b in bodies for text in (*_report_thick_surface(b, surfaces), *_report_rounding(b, surfaces))]
    found = [*_report_crossed_triangles(model, surfaces), *_report_pierced_triangles(model, surfaces), *found]
    return [Problem(path, text, False) for path, text in found]


def _first_triangles(surfaces: ContactSurfaces) -> tuple[np.ndarray, int, list[str]]:
    """Triangles of the first world, (t, 3), those of bodies first, which have points that they share in one of them; how many
    are bodies'; and the path of what each is of."""
    o, own, free = surfaces.obstacles, surfaces.active_triangles, surfaces.free["triangles"]
    triangles = np.concatenate([surfaces.triangles[:own], surfaces.triangles[free:]])
    names = [b.path for b in surfaces.active for _ in b.triangles]
    if o:
        each = [(o.contacts.rows.colliders[e.number].path, len(o.places[id(e)]) * len(e.triangles)) for e in o.each]
        names += [path for path, count in each for _ in range(count)]
    here = surfaces.world[triangles[:, 0]] == 0
    return triangles[here], int(here[:own].sum()), [name for name, one in zip(names, here, strict=True) if one]


def _report_pierced_triangles(model: Model, surfaces: ContactSurfaces) -> list[tuple[str, str]]:
    """Edges of strands that meet triangles, by the exact test: an edge is a triangle that has one point twice."""
    s = surfaces.strands
    if not s:
        return []
    edges = surfaces.edges[surfaces.own["edges"]:surfaces.free["edges"]]
    edges, (triangles, own, names) = edges[surfaces.world[edges[:, 0]] == 0], _first_triangles(surfaces)
    x, triangles = surfaces.start(model), triangles[:own]
    found = crossed_triangles(x, np.concatenate([edges[:, [0, 1, 1]], triangles]), neighbours=False, own=len(edges))
    found = found[found[:, 1] >= len(edges)] - (0, len(edges))
    where = [f"{s.path(int(edges[i, 0]))} and {names[t]} at "
             f"({', '.join(f'{v:.4g}' for v in x[edges[i]].mean(axis=0) + surfaces.base)}) m" for i, t in found[:NAMED]]
    return [(s.path(int(edges[found[0, 0], 0])), f"{len(found)} edges of rods go through triangles where they start, such as "
             f"{'; '.join(where)}: they stay crossed where nothing takes them apart; move them apart there")] if where else []


def _refuse_crowded_bodies(bodies: list[PointBody], surfaces: ContactSurfaces) -> None:
    """Raises SceneError where more than CROWD points are within reach of each other."""
    each = [np.unique(b.triangles) - b.first for b in bodies]
    x = np.concatenate([np.zeros((0, 3)), *((b.places + b.origin)[own] for b, own in zip(bodies, each, strict=True))])
    refuse_crowded_points(x, np.repeat([b.path for b in bodies], [len(own) for own in each]), "surfaces", surfaces)


def refuse_crowded_points(x: np.ndarray, paths: np.ndarray, what: str, tables: Any) -> None:
    """Raises SceneError where more than CROWD of points x (n, 3) [m] of prims (n,) are within reach of each other, by what is
    in their tables."""
    near = tables.thickness + 2.0 * tables.beta
    if not len(x) or _fullest_grid_cell(x, near)[0] <= CROWD / 8:      # a cube of that size is in eight cells at most
        return
    steps = 0.5 * np.stack(np.meshgrid(*[(0.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    count, first = max((_fullest_grid_cell(x + near * step, near) for step in steps), key=lambda found: found[0])
    if count > CROWD:
        where = ", ".join(f"{v:.4g}" for v in x[first])
        raise SceneError(Problem(str(paths[first]), f"{count} points of {what} that touch are within {near:.3g} m of each other"
                                 f" at ({where}) m; expected: {CROWD} at most, as each is near all others; move them apart, "
                                 f"weld them, give less thickness (now {tables.thickness:.3g} m), or leave "
                                 "wsim:selfCollision out"))


@dataclass
class StartingStrands:
    """Edges of strands of a world where they start. x: places [m], (n, 3); rest: places in the rest shape of the strand [m],
    (n, 3); reach: radii [m], (n,); edges: (e, 2); strand, path: of each, (e,)."""

    x: np.ndarray
    rest: np.ndarray
    reach: np.ndarray
    edges: np.ndarray
    strand: np.ndarray
    path: np.ndarray

    def keep(self, pairs: np.ndarray) -> np.ndarray:
        """Distances [m] that pairs of edges keep, (k,), as kernels/contact/selfcontact/search.py has them."""
        found = self.reach[self.edges].max(axis=1)[pairs].sum(axis=1)
        same = np.flatnonzero(self.strand[pairs[:, 0]] == self.strand[pairs[:, 1]])
        found[same] = np.minimum(found[same], REST * segment_distances(*np.swapaxes(self.rest[self.edges[pairs[same]]], 0, 1)))
        return found

    def near(self, most: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Pairs of edges that are nearer than SUNK of what they keep, (k, 2), nearest first, and the part of it that they have,
        (k,): some of them, where more than most[0] meet, or most[1] are nearer than half. Least distance of those that are
        nearer than that and do not meet [m]."""
        ends, reach, n = self.x[self.edges], self.reach[self.edges].max(axis=1)[:, None], len(self.edges)
        keys, part, least = np.zeros(0, np.int64), np.zeros(0), math.inf
        for some in box_overlap_batches(ends.min(axis=1) - reach, ends.max(axis=1) + reach):
            some = some[~share_common_point(self.edges, some)]
            away = segment_distances(ends[some[:, 0]], ends[some[:, 1]])
            found = away / self.keep(some)
            sunk = found < SUNK
            least = float(away[sunk & (found >= MET)].min(initial=least))
            if (_count_met(part) <= most).all():
                keys, first = np.unique(np.concatenate([keys, (some @ (n, 1))[sunk]]), return_index=True)
                part = np.concatenate([part, found[sunk]])[first]
        order = np.lexsort((keys, part))
        return np.stack(np.divmod(keys[order], n), axis=1), part[order], least

    def told(self, pairs: np.ndarray) -> list[str]:
        """Paths and places of pairs."""
        at = self.x[self.edges[pairs]].mean(axis=(1, 2))
        return [f"{self.path[i]} and {self.path[j]} at ({', '.join(f'{v:.4g}' for v in x)}) m"
                for (i, j), x in zip(pairs, at, strict=True)]


def _count_met(part: np.ndarray) -> np.ndarray:
    """How many meet, and how many are nearer than half."""
    return np.array([np.count_nonzero(part < MET), np.count_nonzero(part < 0.5)])


def report_touching_strands(s: StartingStrands) -> list[Problem]:
    """Warnings of edges of strands whose centre lines meet, nearer than MET of what both keep, and of those nearer than SUNK of
    it. Raises SceneError where so many do, or are nearer than half, that a frame takes minutes."""
    most = np.array([LOOSE, HEAP]) + TANGLE * len(s.edges)
    pairs, part, least = s.near(most)
    met, half = _count_met(part)
    where = s.told(pairs[:NAMED])
    if met > most[0]:
        raise SceneError(Problem(str(s.path[pairs[0, 0]]), f"its strands are a tangle where they start: more than {most[0]} "
                                 f"pairs of edges meet, such as {where[0]}; expected: none; move them apart, or leave "
                                 "wsim:selfCollision out"))
    found = [Problem(str(s.path[pairs[0, 0]]), f"{met} pairs of edges of strands meet where they start, such as "
                     f"{'; '.join(where[:met])}: which is on which side is arbitrary; move them apart there",
                     False)] if met else []
    ends = np.sort(s.strand[pairs], axis=1) @ (int(s.strand.max(initial=0)) + 1, 1)
    rest = ~np.isin(ends, ends[:met])                    # beside edges that meet others of both strands are near
    return [*found, _sunk_strands(s, pairs[rest], part[rest][0], half if half > most[1] else 0, least)] if rest.any() else found


def _sunk_strands(s: StartingStrands, pairs: np.ndarray, part: float, heap: int, least: float) -> Problem:
    """Warning of pairs that begin nearer than they keep, the first of which has that part of it. Raises SceneError where there
    are a heap of them. least: distance of all that do not meet [m]."""
    keep, path = float(s.keep(pairs[:1])[0]), str(s.path[pairs[0, 0]])
    where = f"such as {s.told(pairs[:1])[0]}, {part * keep:.3g} m apart where they keep {keep:.3g} m"
    mend = f"give widths of at most {three_digits(least, math.floor):.3g} m there, or move them apart"
    if heap:
        raise SceneError(Problem(path, f"at least {heap} pairs of edges of strands begin nearer than half of what they keep, "
                                 f"{where}: a frame would take minutes; expected: {HEAP} and {TANGLE} an edge at most; {mend}, "
                                 "or leave wsim:selfCollision out"))
    return Problem(path, f"{len(pairs)} pairs of edges of strands begin nearer than they are thick, {where}: they are pushed "
                   f"apart at {RECOVERY:g} m/s and more; {mend}", False)


def segment_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances [m] of segments a and b, (k, 2, 3): least of those of ends and, where they face each other, of the lines."""
    u, v, r = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0], b[:, 0] - a[:, 0]
    uu, uv, vv, ru, rv = ((p * q).sum(axis=1) for p, q in ((u, u), (u, v), (v, v), (r, u), (r, v)))
    tiny, det = np.finfo(np.float64).tiny, uu * vv - uv * uv
    across = det > 1e-12 * uu * vv
    s, t = (np.where(across, p, -1.0) / np.where(across, det, 1.0) for p in (ru * vv - rv * uv, ru * uv - rv * uu))
    found = np.where((np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5),
                     np.linalg.norm(r + t[:, None] * v - s[:, None] * u, axis=1), np.inf)
    for p, q, w, ww in ((a[:, 0], b, v, vv), (a[:, 1], b, v, vv), (b[:, 0], a, u, uu), (b[:, 1], a, u, uu)):
        f = np.clip(((p - q[:, 0]) * w).sum(axis=1) / np.maximum(ww, tiny), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(q[:, 0] + f[:, None] * w - p, axis=1))
    return found


def _fullest_grid_cell(x: np.ndarray, size: float) -> tuple[int, int]:
    """Points in the fullest cell of a grid, and the first of them."""
    cell = np.floor((x - x.min(axis=0)) / size).astype(np.int64) if len(x) else x
    _, first, count = np.unique(cell, axis=0, return_index=True, return_counts=True)
    return int(count.max()), int(first[count.argmax()])


def _report_crossed_triangles(model: Model, surfaces: ContactSurfaces) -> list[tuple[str, str]]:
    """Triangles without a common point that intersect, by the exact test; not those of two colliders. Others that lie on each
    other, nearer than files can tell apart; of two that share a point, those of two bodies: what is sewn to the edge of another
    may have points between the common ones."""
    (triangles, own, names), x = _first_triangles(surfaces), surfaces.start(model)
    gap = KEPT * max(_least_thickness(b) for b in surfaces.bodies if b.world == 0) / STEPS
    most = TANGLE * len(triangles) + LOOSE
    corners, whose, near = x[triangles], np.unique(names, return_inverse=True)[1], [np.zeros((0, 2), np.int64)]

    def unshared_pairs() -> Iterator[np.ndarray]:
        for some in box_overlap_batches(corners.min(axis=1) - 0.5 * gap, corners.max(axis=1) + 0.5 * gap):
            yield some
            some = some[some[:, 0] < own]
            some = some[~share_common_point(triangles, some) | (whose[some[:, 0]] != whose[some[:, 1]])]
            near.append(some[triangles_closer_than(corners[some], triangles[some], gap)])
    found = crossed_triangles(x, triangles, neighbours=False, own=own, most=most, among=unshared_pairs())

    def pair_places(pairs: np.ndarray) -> str:
        return "; ".join(f"{names[s]} and {names[t]} at ({', '.join(f'{v:.4g}' for v in at)}) m" for s, t in pairs[:NAMED]
                         for at in [corners[[s, t]].mean(axis=(0, 1)) + surfaces.base])
    if len(found) > most:
        raise SceneError(Problem(names[found[0, 0]], f"its surface is a tangle where it starts: more than {most} pairs of "
                                 f"triangles intersect, such as {pair_places(found[:1])}; expected: none, {TANGLE} a triangle "
                                 f"and {LOOSE} at most; move them apart, or leave wsim:selfCollision out"))
    told, base = [], (len(triangles), 1)
    if len(found):
        size = float(np.ptp(x[triangles.ravel()], axis=0).max())
        surfaces.flatten(model, triangles[np.unique(found[found < own])], LITTLE * size)
        told.append((names[found[0, 0]], f"{len(found)} pairs of triangles intersect where surfaces start, such as "
                     f"{pair_places(found)}: they keep no thickness there, and stay crossed where nothing takes them apart; "
                     "move them apart there"))
    on = unique_pairs(near, len(triangles))
    on = on[~np.isin(on @ base, found @ base)]
    if len(on):
        told.append((names[on[0, 0]], f"{len(on)} pairs of triangles lie on each other where surfaces start, such as "
                     f"{pair_places(on)}: files tell nothing apart that is nearer than {gap:.2g} m, and which is on which side "
                     "is arbitrary; move them apart there, or give them common points"))
    return told


def triangles_closer_than(x: np.ndarray, names: np.ndarray, gap: float) -> np.ndarray:
    """True where a point of one triangle is nearer to the other than gap [m], or edges are, of those that have no point in
    common, (k,). x: corners, (k, 2, 3, 3) [m]; names of their points, (k, 2, 3)."""
    n = np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0])
    n /= np.maximum(np.linalg.norm(n, axis=2, keepdims=True), np.finfo(np.float64).tiny)
    away = np.einsum("ksc,kspc->ksp", n, x[:, ::-1] - x[:, :, :1])                 # of the other's points from each plane
    some = np.flatnonzero(~((away > gap).all(axis=2) | (away < -gap).all(axis=2)).any(axis=1))
    x, names, found = x[some], names[some], np.zeros(len(x), bool)
    near = np.zeros(len(some), bool)
    for i in range(3):
        for j in range(3):
            own = ~(names[:, 0, [i, i - 1]][:, :, None] == names[:, 1, [j, j - 1]][:, None, :]).any(axis=(1, 2))
            near |= own & (segment_distances(x[:, 0, [i, i - 1]], x[:, 1, [j, j - 1]]) < gap)
        for s in (0, 1):
            p, own = x[:, s, i], ~(names[:, s, i, None] == names[:, 1 - s]).any(axis=1)
            near |= own & (np.abs(away[some, 1 - s, i]) < gap) & _projects_into_triangle(p, x[:, 1 - s], n[some, 1 - s])
    found[some[near]] = True
    return found


def _projects_into_triangle(p: np.ndarray, t: np.ndarray, n: np.ndarray) -> np.ndarray:
    """True where p (k, 3) is above or below a triangle (k, 3, 3) with the normal n (k, 3)."""
    e = np.roll(t, -1, axis=1) - t
    return (np.einsum("kic,kc->ki", np.cross(e, p[:, None] - t), n) >= 0.0).all(axis=1) & n.any(axis=1)


def _report_thick_surface(body: PointBody, surfaces: ContactSurfaces) -> list[str]:
    """A thickness beyond THICK of the shortest edge, with the largest that is not, if a file holds it."""
    edges = topology.edges_of_triangles(body.triangles)
    length = np.linalg.norm(np.diff(body.rest[edges - body.first], axis=1)[:, 0], axis=1)
    k = int(np.argmin(length))
    own, most, least = 2.0 * float(surfaces.reach[body.first:body.last].max()), THICK * float(length[k]), _least_thickness(body)
    if own <= (1.0 + 2.0 * NEAR) * most:
        return []
    ends = " and ".join(f"({', '.join(f'{v:.4g}' for v in x)})" for x in body.places[edges[k] - body.first] + body.origin)
    authored, fits = bool((body.reach > 0.0).any()), three_digits(most, math.floor) >= three_digits(least, math.ceil)
    mend = ["longer edges"] if length[k] > 0.0 else ["merge the two points"]
    if authored and fits:
        mend.insert(0, f"at most {three_digits(most, math.floor):.3g} m")
    return [f"its thickness is {own:.3g} m{'' if authored else ', a tenth of its mean edge'}, and its shortest edge "
            f"{length[k]:.3g} m, from {ends} m: contacts of neighbours keep less; give {', or '.join(mend)}"
            f"{'' if fits else ' (files hold no thickness that is less)'}"]


def _least_thickness(body: PointBody) -> float:
    """STEPS units of rounding of float32 in the frame of the body's prim [m]."""
    largest = np.abs(np.asarray(body.source.points, np.float64)).max(initial=0.0)
    return STEPS * float(np.spacing(np.float32(largest))) * float(np.linalg.norm(body.source.motion.at(0.0)[:3, :3], 2))


def _report_rounding(body: PointBody, surfaces: ContactSurfaces) -> list[str]:
    """A thickness of less than files hold."""
    own, least = 2.0 * float(surfaces.reach[body.first:body.last].max()), _least_thickness(body)
    if own >= least:
        return []
    return [f"its thickness is {own:.3g} m, and results round its points to {least / STEPS:.3g} m, "
            f"{np.abs(body.source.points).max():.3g} from the origin of its prim; give {three_digits(least, math.ceil):.3g} m "
            "or more, or move the origin to the cloth"]
