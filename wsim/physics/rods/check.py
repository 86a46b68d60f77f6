"""Problems of rods. NumPy only."""

from collections.abc import Iterator
from dataclasses import replace
from math import floor

import numpy as np

from wsim.physics.rods.objects import LEAST, Rods, segment_ends, strand_neighbours
from wsim.scene import Collider, Motion, Pin, Problem, Scene, Surface
from wsim.scene.attachments import body_ties
from wsim.scene.check.objects import NEAR, check_number, object_warning, thing_error, three_digits
from wsim.scene.nodal.touching import collides_with_surfaces

STOUT = 1.0           # length over diameter of an edge below which a strand is no thin rod
ACROSS = 1e-5         # sine of the angle to its edge below which rounding of float32 says where a director points
AUTHORED = {"directors": "directors (of curves: normals)", "rest_directors": "rest_directors (of curves: physics:restNormals)",
            "rest_points": "rest_points (of curves: physics:restShapePoints)"}
PLACES = 63           # of an edge where it may begin in a body
SUNK = 1e-5           # of the extent of strands: points that are no deeper in a collider are on it
SEEN = 4096           # edges near a body, evenly chosen, at most


def check(rods: Rods, scene: Scene) -> Iterator[Problem]:
    path, n = rods.path, len(rods.points)
    if rods.counts.min(initial=2) < 2 or rods.counts.sum() != n or not n:
        k = int(np.argmin(rods.counts)) if len(rods.counts) else -1
        least = f", the least is {rods.counts[k]}, of strand {k}" if k >= 0 else ""
        yield thing_error(path,
                           f"counts of {len(rods.counts)} strands sum to {rods.counts.sum()}{least}; there are {n} points",
                           "2 or more points a strand, as many as there are in all",
                           "author points and curveVertexCounts again")
        return
    wrong = [*_check_rod_arrays(rods), *_check_closed_rods(rods)]
    yield from wrong
    for name, strict in (("young", True), ("density", True)):
        yield from check_number(path, name, getattr(rods, name), 0.0, strict)
    if not -1.0 < rods.poisson <= 0.5:
        yield thing_error(path, f"poisson is {rods.poisson:g}", "above -1, at most 0.5", "author another Poisson's ratio")
    for name in ("stretch", "bend", "twist"):
        if (value := getattr(rods, name)) is not None:
            yield from check_number(path, name, value, 0.0, name == "stretch")
    for name in ("static_friction", "dynamic_friction", "damping", "drag", "skin_drag"):
        yield from check_number(path, name, getattr(rods, name), 0.0)
    if wrong:
        return
    yield from _check_edge_lengths(rods)
    yield from _check_directors(rods)
    yield from _check_rod_pins(rods)
    yield from _check_strands_in_colliders(rods, scene)
    for c in scene.colliders:
        if isinstance(c.shape, Surface) and getattr(getattr(c.shape.poses, "skeleton", None), "bodies", None):
            yield object_warning(path,
                                 f"rigid bodies drive the joints of the mesh {c.path}, and strands meet its shape at the start",
                                 "meshes that are still or animated", "give the joints keys")
    if np.any(scene.wind) and not (rods.drag or rods.skin_drag):
        yield object_warning(path, "strands do not feel the wind: drag and skin_drag are 0", "numbers > 0", "author wsim:drag")
    through = [b.path for b in scene.bodies() if not (rods.self_collision and collides_with_surfaces(b, scene))]
    if through:
        yield object_warning(path, f"strands pass through {', '.join(through[:3])}{', ...' * (len(through) > 3)}",
                             "colliders, rigid bodies, or cloth and soft bodies that collide as strands do",
                             "give wsim:selfCollision to both, or what they shall meet as a collider")
    if scene.things("Body"):
        yield from _check_strands_in_bodies(rods, scene)


def _check_strands_in_bodies(rods: Rods, scene: Scene) -> Iterator[Problem]:
    """Rigid bodies in which strands begin, and such as they do not meet."""
    from wsim.physics.rigid.solids import bodies_met_by_strands, touching_colliders
    from wsim.scene.check.signed_distance import collider_signed_distance
    found = {body.path: colliders for body, colliders in bodies_met_by_strands(scene)}
    if missed := [body.path for body in scene.things("Body") if touching_colliders(body) and body.path not in found]:
        yield object_warning(rods.path,
                             f"strands pass through {', '.join(missed[:3])}{', ...' * (len(missed) > 3)}, which drives "
                             "what a skeleton moves", "what it moves as a collider", "give PhysicsCollisionAPI to that")
    x, n = rods.motion.points(rods.points, 0.0), len(rods.points)
    for body in scene.things("Body"):
        tied = [p for tie in body_ties(scene, rods.path) if tie.other == body.path for p in tie.points.tolist() if 0 <= p < n]
        free = np.ones((2, n), bool)                                     # points and edges that meet this body
        for point in tied:
            for side, near in enumerate(strand_neighbours(rods.counts, point, rods.closed)):
                free[side, near] = False
        for c in found.get(body.path, ()):
            where = replace(c, motion=Motion.still(body.motion.at(0.0) @ c.motion.at(0.0)))
            deep = -collider_signed_distance(where, x, 0.0)
            for what, depth in (("points", deep * free[0]),
                                ("edges, between their points,", _edge_depths(rods, where, x, deep) * free[1])):
                if (depth > 0.0).any():
                    k = int(np.argmax(depth))
                    yield object_warning(rods.path,
                                         f"{np.count_nonzero(depth > 0.0)} {what} begin inside of {c.path}, the deepest, "
                                         f"{k}, by {depth[k]:.3g} m: the first substep throws them out, and {body.path} the "
                                         f"other way",
                                         "strands beside it", "move one of both")


def _check_strands_in_colliders(rods: Rods, scene: Scene) -> Iterator[Problem]:
    """Colliders in which strands begin, at free points or between two that are outside."""
    from wsim.scene.check.signed_distance import collider_signed_distance
    if not scene.colliders:
        return
    x, free = rods.motion.points(rods.points, 0.0), np.ones(len(rods.points), bool)
    for pin in rods.pins:
        free[[k for k in pin.points if 0 <= k < len(free)]] = False
    step = max(1, -(-len(x) // SEEN))
    seen, near = np.flatnonzero(free)[::step], SUNK * float(np.ptp(x, axis=0).max())
    for c in scene.colliders:
        deep = np.zeros(len(x))
        deep[seen] = -collider_signed_distance(c, x[seen], near)
        between = _edge_depths(rods, c, x, -collider_signed_distance(c, x, near)) if step == 1 else np.zeros(len(x))
        for what, depth in (("points", deep), ("edges, between their points,", between)):
            if (inside := depth > near).any():
                k = int(np.argmax(depth))
                yield object_warning(rods.path,
                                     f"{np.count_nonzero(inside)} {what} begin inside of {c.path}, the deepest, {k}, by "
                                     f"{depth[k]:.3g} m: they are thrown out by the nearest way", "strands beside it",
                                     "move one of both, or pin those points")


def _edge_depths(rods: Rods, c: Collider, x: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """How deep [m] edges are in a collider whose points x are not, at `PLACES` of them; 0 of others."""
    from wsim.scene.check.signed_distance import collider_signed_distance
    found = np.zeros(len(x))
    first, second = segment_ends(rods).T
    k, d = first[(depth[first] <= 0.0) & (depth[second] <= 0.0)], np.zeros_like(x)
    d[first] = x[second] - x[first]
    if isinstance(c.shape, Surface):
        M, points = c.motion.at(0.0), c.shape.points if c.shape.poses is None else c.shape.poses.at(0.0)
        center = points.mean(axis=0)
        away = np.linalg.norm(x[k] + 0.5 * d[k] - M[:3, :3] @ center - M[:3, 3], axis=1) - np.linalg.norm(
            points - center, axis=1).max()
    else:
        away = collider_signed_distance(c, x[k] + 0.5 * d[k], 0.0)
    k = k[away < 0.5 * np.linalg.norm(d[k], axis=1)]
    k = k[::max(1, -(-len(k) // SEEN))]
    u = np.arange(1, PLACES + 1)[:, None, None] / (PLACES + 1.0)
    found[k] = -collider_signed_distance(c, (x[k] + u * d[k]).reshape(-1, 3), 0.0).reshape(PLACES, len(k)).min(axis=0)
    return np.maximum(found, 0.0)


def _check_rod_arrays(rods: Rods) -> Iterator[Problem]:
    path, n = rods.path, len(rods.points)
    for name in ("points", "velocities", "rest_points", "directors", "rest_directors"):
        value = getattr(rods, name)
        if value is None:
            continue
        if len(value) != n:
            yield thing_error(path, f"{name} has {len(value)} values", f"{n}, one a point", "author it again")
        elif not np.isfinite(value).all():
            k = int(np.flatnonzero(~np.isfinite(value).all(axis=1))[0])
            yield thing_error(path, f"{AUTHORED.get(name, name)}[{k}] is {value[k].tolist()}", "finite numbers",
                               "author it again")
    for name, sizes in (("diameters", (1, n)), ("masses", (n,))):
        value = getattr(rods, name)
        if value is not None and (len(value) not in sizes or not (np.isfinite(value) & (value > 0.0)).all()):
            yield thing_error(path, f"{name} has {len(value)} values, the least is {value.min(initial=np.inf):g}",
                               f"{' or '.join(map(str, sizes))} finite numbers > 0", "author it again")


def _check_closed_rods(rods: Rods) -> Iterator[Problem]:
    """Rings that cannot be."""
    if rods.closed and rods.counts.min() < LEAST:
        yield thing_error(rods.path, f"a closed strand has {rods.counts.min()} points", f"{LEAST} or more",
                           "give a point more, or leave closed (of curves: wrap = periodic) out")


def _check_edge_lengths(rods: Rods) -> Iterator[Problem]:
    """Edges without length, or shorter than they are thick."""
    world = rods.motion.points(rods.points if rods.rest_points is None else rods.rest_points, 0.0)
    first, second = segment_ends(rods).T
    length = np.linalg.norm(world[second] - world[first], axis=1)
    thick = np.broadcast_to(rods.diameters, len(rods.points))[first]
    if length.min(initial=np.inf) <= 0.0:
        k = int(np.argmin(length))
        yield thing_error(rods.path, f"points {first[k]} and {second[k]} of a strand are in one place", "edges with a length",
                           "remove the double point" + "; closed strands name their first point once" * rods.closed)
    elif (stout := length < STOUT * (1.0 - NEAR) * thick).any():
        k = int(np.argmax(stout))
        yield object_warning(rods.path,
                             f"{np.count_nonzero(stout)} edges are shorter than they are thick, such as that of point "
                             f"{first[k]}: {length[k]:.3g} m, {thick[k]:.3g} m thick", "thin rods",
                             "give fewer points, or a diameter of at most "
                             f" {three_digits(float(length[stout].min()) / STOUT, floor):.3g} m")
    if (short := rods.counts < LEAST).any():
        yield object_warning(rods.path,
                             f"{np.count_nonzero(short)} strands have {int(rods.counts.min())} points, and do not bend",
                             f"{LEAST} or more", "give a point more")


def _check_directors(rods: Rods) -> Iterator[Problem]:
    """Directors that are zero or along their edge: they say no turn of it."""
    R, (first, second) = rods.motion.at(0.0)[:3, :3], segment_ends(rods).T
    rest = rods.points if rods.rest_points is None else rods.rest_points
    for name, x in (("directors", rods.points), ("rest_directors", rest)):
        if (given := getattr(rods, name)) is None:
            continue
        x = np.asarray(x, np.float64)
        d, t = (np.asarray(v, np.float64) @ R.T for v in (given[first], x[second] - x[first]))
        size = np.linalg.norm(d, axis=1) * np.linalg.norm(t, axis=1)
        lost = (np.linalg.norm(np.cross(d, t), axis=1) <= ACROSS * size) & (np.linalg.norm(t, axis=1) > 0.0)
        if lost.any():
            row = int(np.argmax(lost))
            k = int(first[row])
            yield thing_error(rods.path, f"{AUTHORED[name]}[{k}] is {given[k].tolist()}, the edge behind point {k} goes along "
                               f"{(x[second] - x[first])[row].tolist()} ({np.count_nonzero(lost)} such edges)",
                               "directions across their edges, not 0", "author it again, or leave it out: no twist then")


def _check_rod_pins(rods: Rods) -> Iterator[Problem]:
    n, held = len(rods.points), np.zeros(len(rods.points), int)
    for pin in rods.pins:
        if len(pin.points) == 0 or pin.points.min() < 0 or pin.points.max() >= n:
            yield thing_error(pin.path,
                               f"holds points {pin.points.min(initial=0)} to {pin.points.max(initial=-1)} of {rods.path}",
                               f"0 to {n - 1}", "name points that there are")
            continue
        if pin.places is not None and len(pin.places) != len(pin.points):
            yield thing_error(pin.path, f"has {len(pin.places)} places and {len(pin.points)} points", "one a point",
                               "author it again")
        if np.isfinite(pin.stiffness):
            yield thing_error(pin.path, f"its stiffness is {pin.stiffness:g} N/m", "inf: strands are held hard",
                               "take physics:stiffness off, or tie them otherwise")
        if pin.follows is not None:
            yield from _check_skin_pin(pin)
        np.add.at(held, pin.points, 1)
    if (held > 1).any():
        yield thing_error(rods.path, f"point {int(np.argmax(held > 1))} is held by two pins", "one", "leave it to one of them")


def _check_skin_pin(pin: Pin) -> Iterator[Problem]:
    """Strands turn with triangles of skin: a point has no direction, and joints that bodies drive are not known before."""
    skin, corners = pin.follows.skin, pin.follows.corners
    if skin.skeleton.bodies:
        yield thing_error(pin.path, f"holds strands at skin of {skin.skeleton.path}, whose joints rigid bodies drive",
                           "a skeleton with keys", "give the joints keys, or attach the strands to an Xform")
    if len(corners) == len(pin.points) and (corners[:, 0] == corners[:, 1]).any():
        yield thing_error(pin.path, "holds strands at points of skin, which say no direction", "faces",
                           'author physics:type1 = "face"; in Python, rods.pin_roots(path, collider)')
