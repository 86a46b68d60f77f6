"""What was seen of a motion: points at frames, or scans that do not say which point is which.

    Track    positions of points of a body or of rods, or of some of them, at frames; NaN: not seen
    Pull     forces of a pin (`wsim.fitting.observations.reactions`)
    Markers  on a rigid body (`wsim.fitting.observations.markers`)
    Smoke    smoke or heat of a fluid (`wsim.fitting.observations.smoke`)
    Functional   weighted sums of positions: means, markers (`wsim.fitting.observations.functional`)
    Profile  heights along a line (`wsim.fitting.observations.profile`)
    Scan     points on the surface of a body at one frame. Each counts by its distance to the nearest place of the simulated
             surface, along the normal there (Chen, Medioni 1992); of a spring net by the way to the nearest particle

Frame f is f / fps [s] after the scene's start; frame 0 is given and says nothing. Positions are in the world [m].
"""

from dataclasses import dataclass

import numpy as np

from wsim.scene import Problem, Scene

NEAR = 24              # triangles by their centres, among which the nearest place is looked for
CHUNK = 4_000_000      # distances at a time


@dataclass
class Track:
    """Positions of points of a body or of rods at frames, observed: what `wsim.fit` compares a run with, as in
    `Track("/flag", frames=[1, 2], positions=seen)`.

    path         prim path of the body
    frames       numbers of the frames, (k,) [frames]; 0 is the start
    positions    of n points, world (k, n, 3) [m]; NaN: not seen
    points       indices of these points, in the author's order, (n,); None: all
    weights      of each, (n,) or (k, n) [1]: its part of 1 / sigma^2; 0: not counted
    sigma        standard deviation of a coordinate [m]; None: estimated
    source       file, for messages
    """

    unit = "m"
    path: str
    frames: np.ndarray
    positions: np.ndarray
    points: np.ndarray | None = None
    weights: np.ndarray | None = None
    sigma: float | None = None
    source: str = "observations"

    def __post_init__(self):
        self.frames = np.atleast_1d(np.asarray(self.frames, np.int64))
        self.positions = np.asarray(self.positions, np.float64)
        if self.positions.ndim == 2:
            self.positions = self.positions[None]
        self.points = None if self.points is None else np.asarray(self.points, np.int64)
        self.weights = None if self.weights is None else np.asarray(self.weights, np.float64)

    def prepare(self, model) -> None:
        """Nothing to look up."""

    def residuals(self, k: int, x: np.ndarray) -> np.ndarray:
        """sqrt(weight) times what each of x (worlds, points, 3) [m] misses at frame number k, (worlds, m) [m]."""
        own, seen, root = self.counted(k)
        return ((x[:, own] - seen) * root).reshape(len(x), -1)

    def back(self, k: int, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Derivative of r . residuals by x (points, 3), of one world."""
        own, _, root = self.counted(k)
        found = np.zeros(x.shape)
        np.add.at(found, own, r.reshape(-1, 3) * root)
        return found

    def counted(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points that count, where they were seen, roots of their weights (m, 1)."""
        seen = self.positions[k]
        weight = np.ones(len(seen)) if self.weights is None else self.weights[k] if self.weights.ndim == 2 else self.weights
        good = np.isfinite(seen).all(axis=1) & (weight > 0.0)
        own = np.flatnonzero(good) if self.points is None else self.points[good]
        return own, seen[good], np.sqrt(weight[good])[:, None]


@dataclass
class Scan:
    """points (m, 3) [m] somewhere on the surface of the body `path` at a frame."""

    unit = "m"
    path: str
    frame: int
    points: np.ndarray
    weights: np.ndarray | None = None        # (m,)
    sigma: float | None = None
    source: str = "observations"

    def __post_init__(self):
        self.points = np.asarray(self.points, np.float64).reshape(-1, 3)
        self.weights = None if self.weights is None else np.asarray(self.weights, np.float64)

    @property
    def frames(self) -> np.ndarray:
        return np.array([self.frame])

    def prepare(self, model) -> None:
        """Triangles of the body, by the author's points."""
        body = model.body(self.path)
        author = np.zeros(model.points, np.int64)
        author[body.index] = np.arange(len(body.index))
        self.triangles = author[body.triangles]

    def residuals(self, k: int, x: np.ndarray) -> np.ndarray:
        """Residuals as of `Track`; which place is nearest is found in world 0 and kept for the others."""
        root = np.ones(len(self.points)) if self.weights is None else np.sqrt(self.weights)
        if not len(self.triangles):
            near = _nearest_places(self.points, x[0], 1)[:, 0]
            return ((x[:, near] - self.points) * root[:, None]).reshape(len(x), -1)
        corner, part = on_surface(self.points, x[0], self.triangles)
        return np.stack([((place - self.points) * normal).sum(axis=1) for place, normal, _ in
                         (_place_and_normal(each[corner], part) for each in x)]) * root

    def back(self, k: int, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Transposed derivative as of `Track`; exact but where another triangle is about to be nearest. A place that slides
        along the surface, or along an edge of it, changes nothing; off an edge, what lies beyond it in the plane turns with
        the normal."""
        root = np.ones(len(self.points)) if self.weights is None else np.sqrt(self.weights)
        found = np.zeros(x.shape)
        if not len(self.triangles):
            near = _nearest_places(self.points, x, 1)[:, 0]
            np.add.at(found, near, r.reshape(-1, 3) * root[:, None])
            return found
        corner, part = on_surface(self.points, x, self.triangles)
        place, normal, double = _place_and_normal(x[corner], part)
        e, f = x[corner[:, 1]] - x[corner[:, 0]], x[corner[:, 2]] - x[corner[:, 0]]
        off = place - self.points
        off = (off - (off * normal).sum(axis=1, keepdims=True) * normal) / np.where(double > 0.0, double, 1.0)[:, None]
        by = part[..., None] * normal[:, None, :]
        for k, turned in ((1, np.cross(f, off)), (2, np.cross(off, e))):
            by[:, k] += turned
            by[:, 0] -= turned
        np.add.at(found, corner, (root * r)[:, None, None] * by)
        return found


def _place_and_normal(corners: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of triangles (m, 3, 3): the place at these parts of the corners, the unit normal, twice the area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    return np.einsum("mki,mk->mi", corners, part), normal / np.where(size > 0.0, size, 1.0)[:, None], size


def _nearest_places(points: np.ndarray, places: np.ndarray, count: int) -> np.ndarray:
    """Numbers of the `count` places (n, 3) nearest to each of points (m, 3), (m, count)."""
    count = min(count, len(places))
    rows = max(1, CHUNK // max(len(places), 1))
    found = []
    for k in range(0, len(points), rows):
        some = points[k:k + rows]
        square = (places**2).sum(1) - 2.0 * some @ places.T
        found.append(np.argpartition(square, count - 1, axis=1)[:, :count])
    return np.concatenate(found) if found else np.zeros((0, count), np.int64)


def on_surface(points: np.ndarray, x: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest place of a surface to each of points (m, 3): corners (m, 3) and their parts (m, 3)."""
    near = _nearest_places(points, x[triangles].mean(axis=1), NEAR)
    a, b, c = (x[triangles[near][..., i]] for i in range(3))
    part = closest_on_triangle(points[:, None] - a, b - a, c - a)
    place = a + part[..., :1] * (b - a) + part[..., 1:] * (c - a)
    best = np.argmin(((points[:, None] - place)**2).sum(-1), axis=1)
    row = np.arange(len(points))
    u, v = part[row, best].T
    return triangles[near[row, best]], np.stack([1.0 - u - v, u, v], axis=1)


def closest_on_triangle(p: np.ndarray, e: np.ndarray, f: np.ndarray) -> np.ndarray:
    """(u, v) of the place u e + v f of triangles 0, e, f nearest to p, each (..., 3)."""
    ee, ef, ff, pe, pf = ((s * t).sum(-1) for s, t in ((e, e), (e, f), (f, f), (p, e), (p, f)))
    det = ee * ff - ef * ef
    safe = np.where(det > 0.0, det, 1.0)
    u, v = (ff * pe - ef * pf) / safe, (ee * pf - ef * pe) / safe
    inside = (det > 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
    g, tiny = f - e, 1e-300
    s = np.clip(pe / np.maximum(ee, tiny), 0.0, 1.0)
    t = np.clip(pf / np.maximum(ff, tiny), 0.0, 1.0)
    r = np.clip(((p - e) * g).sum(-1) / np.maximum((g * g).sum(-1), tiny), 0.0, 1.0)
    zero = np.zeros_like(s)
    edges = np.stack([np.stack([s, zero], -1), np.stack([zero, t], -1), np.stack([1.0 - r, r], -1)], -2)
    away = p[..., None, :] - edges[..., :1] * e[..., None, :] - edges[..., 1:] * f[..., None, :]
    best = np.argmin((away**2).sum(-1), axis=-1)
    on_edge = np.take_along_axis(edges, best[..., None, None], -2)[..., 0, :]
    return np.where(inside[..., None], np.stack([u, v], -1), on_edge)


# what is wrong

def objects_with_points(scene: Scene) -> list:
    """Objects whose points a fit can observe: cloth, springs, soft bodies, rods."""
    return [*scene.bodies(), *scene.things("Rods"), *scene.things("MaterialPoints")]


def problems_of_observations(observations: list, scene: Scene) -> list[Problem]:
    """All that is wrong with observations of a scene."""
    problems = []
    if not observations:
        problems.append(Problem("observations", "there are none; give Track or Scan objects, or a USD file"))
    for o in observations:
        rods = unobservable_rods(scene, isinstance(o, Scan))
        marked, smoke = hasattr(o, "local"), hasattr(o, "field")
        noun, things = ("rigid body", scene.things("Body")) if marked else ("body",
                                                                            objects_with_points(scene)) if o.unit == "m" else (
            "pin", scene.pins)
        if smoke:
            noun, things = "fluid", scene.things("Fluid")
        thing = next((t for t in things if t.path == o.path), None)
        if o.path in rods:
            problems.append(Problem(o.path, rods[o.path]))
            continue
        if thing is None:
            problems.append(Problem(o.path, f"is observed and is no {noun} of the scene; there are "
                                    f"{', '.join(t.path for t in things) or 'none'}"))
            continue
        count = 0 if smoke else len(o.local) if marked else 1 if getattr(o, "total", False) else len(observed_points(thing))
        texts = o.wrong(thing) if smoke else o.wrong(count) if hasattr(o, "wrong") else \
            _track_faults(o, count) if isinstance(o, Track) else _scan_faults(o, count)
        problems += [Problem(o.path, text) for text in texts]
        if o.sigma is not None and not (np.isfinite(o.sigma) and o.sigma > 0.0):
            problems.append(Problem(o.path, f"sigma is {o.sigma}; allowed is a finite number > 0 [{o.unit}], or None"))
        if len(o.frames) and (o.frames.min() < 1 or o.frames.max() > scene.frames):
            problems.append(Problem(o.path, f"is observed at frames {o.frames.min()} to {o.frames.max()}; allowed is 1 to "
                                    f"{scene.frames}, the scene's last (frame 0 is given)"))
    return problems


def observed_points(thing) -> np.ndarray:
    """Points of an object at the start (n, 3) [m]; of a body of material points its particles."""
    if thing.points is not None:
        return np.asarray(thing.points, np.float64)
    from wsim.physics.mpm.seeding import place_particles
    return place_particles(thing).x


def unobservable_rods(scene: Scene, scan: bool) -> dict[str, str]:
    """Messages on what fits cannot observe of rods, by path: forces of their pins and, with `scan`, the rods themselves."""
    found = {pin.path: f"is a pin of the rods {each.path}, and fits cannot use its force; observe the rods' points (Track)"
             for each in scene.things("Rods") for pin in each.pins}
    return found | {each.path: "are rods, which have no surface to scan; give the points that were seen (Track)"
                    for each in scene.things("Rods") if scan}


def problems_of_mixed_noise(observations: list) -> list[Problem]:
    """True if noise is known of some and not of others, or unknown of positions beside forces."""
    known = {o.sigma is not None for o in observations}
    if len(known) > 1:
        return [Problem("observations", "some have sigma and some have none; give it to all, or to none (estimated)")]
    if known == {False} and len({o.unit for o in observations}) > 1:
        return [Problem("observations", "positions [m], forces [N], smoke [1] and heat [K] need a sigma each: without, "
                        "nobody knows how to weigh them")]
    return []


def _track_faults(o: Track, count: int) -> list[str]:
    k, n = len(o.frames), count if o.points is None else len(o.points)
    texts = []
    if o.positions.shape != (k, n, 3):
        noun = "positions" if o.unit == "m" else "forces"
        texts.append(f"{o.source} has {noun} of shape {o.positions.shape}; allowed is {(k, n, 3)} (frames, points, 3)")
    elif not np.isfinite(o.positions).all(axis=2).any():
        texts.append("none of its points was seen: every position is NaN or infinite")
    if o.points is not None and len(o.points) and (o.points.min() < 0 or o.points.max() >= count):
        texts.append(f"points name {o.points.min()} to {o.points.max()}; allowed is 0 to {count - 1}")
    if len(np.unique(o.frames)) != k:
        texts.append("names a frame twice; give each frame once")
    if o.weights is not None and (o.weights.shape not in ((n,), (k, n)) or not (o.weights >= 0.0).all()
                                  or not np.isfinite(o.weights).all()):
        texts.append(f"weights have shape {o.weights.shape}; allowed are finite numbers >= 0 of shape {(n,)} or {(k, n)}")
    return texts


def _scan_faults(o: Scan, count: int) -> list[str]:
    if not len(o.points) or not np.isfinite(o.points).all():
        return ["a scan needs points, all finite"]
    if o.weights is not None and (o.weights.shape != (len(o.points),) or not (o.weights >= 0.0).all()):
        return [f"weights have shape {o.weights.shape}; allowed are numbers >= 0 of shape {(len(o.points),)}"]
    return []
