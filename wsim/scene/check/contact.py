"""What is wrong with how bodies and colliders start: points inside, and a thickness that lets chords through. NumPy only."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np

from wsim.scene import Collider, Motion, Plane, Problem, Scene, Surface
from wsim.scene.check import chord, sharp, signed_distance
from wsim.scene.check.objects import object_warning
from wsim.scene.methods import driving_bodies, each_method_object
from wsim.scene.solids import shape_row

NEAR = 1e-5            # of a body's extent: points so near to a surface are on it
SHORT = 1e-5           # [m] of a distance kept that does not count
LEVEL = 1e-3           # of a plane's normal that points up, from which it catches what falls
SIDES = 16             # on a circle of a round shape whose bounds are asked
THIN = 0.1             # least ratio of a collider's girth to the hole at which contacts of edges and triangles stop it: a
                       # square rod under a sheet of 17 cm cells goes through at 0.06, and not at 0.12
FINEST = 16            # places along an edge of a triangle at which a rigid body is looked for, at most


def check_contacts(scene: Scene) -> Iterator[Problem]:
    """Problems of contacts in a scene whose objects are sound."""
    moved = body_carried_colliders(scene)
    for body in (body for body in scene.bodies() if len(body.points)):
        yield from _points_inside_colliders(scene, body, moved)
        for mover in moved:
            yield from _bodies_inside_triangles(body, mover)
    yield from _bodies_above_nothing(scene)
    yield from _warn_of_thin_colliders(scene, moved)
    for path, other, gap, needed in kept_distances(scene):
        if gap + SHORT < needed:
            yield object_warning(path,
                                 f"with a thickness of {gap:g} m it stands out by up to {needed - gap:.2g} m between points of "
                                 f"{other}, whose triangles are chords", f"{needed:.2g} m or more",
                                 "leave wsim:thickness unauthored, which takes that, or refine the mesh")


def _warn_of_thin_colliders(scene: Scene, moved: list[Collider]) -> Iterator[Problem]:
    """Warns of colliders that may pass through a sheet or a soft body between its points. They fit through a triangle, where
    only points have contacts, or they are too thin for the contacts of edges and triangles to stop them."""
    for body in scene.bodies():
        if not body.has_surface:
            continue
        points, faces = chord.body_faces(body)
        hole = float(np.median(chord.enclosing_circle_radii(points, faces))) if len(faces) else 0.0
        reach = body.least_reach()
        for collider in (*scene.colliders, *moved):
            edged, thin, gap = sharp.has_sharp_edges(collider), chord.least_hole_radius(collider), collider.thickness
            if edged and body.self_collision:
                continue
            if gap is None:
                gap = chord.chord_sagitta(chord.body_breadth(body), chord.least_curvature_radius(collider)) - reach
            held = edged and sharp.has_edges(body) and scene.contact_width == 0.0 and scene.solver != "implicit"
            if thin < THIN * hole if held else thin + max(gap, 0.0) + reach < hole:
                yield object_warning(body.path, f"{collider.path} may pass undetected between the body's points: it fits "
                                     f"through a round hole of {2.0 * thin:.2g} m, and the triangles are {2.0 * hole:.2g} m "
                                     f"wide",
                                     "a wider collider, or smaller triangles", "refine the mesh"
                                     + ", or turn wsim:selfCollision on" * (edged and body.is_sheet))
                break


def body_carried_colliders(scene: Scene) -> list[Collider]:
    """Colliders that move with rigid bodies and meet points, where they start in the world."""
    apart = driving_bodies(scene)
    return [replace(c, motion=Motion.still(thing.motion.at(0.0) @ c.motion.at(0.0))) for _, thing in each_method_object(scene)
            if thing.path not in apart for c in getattr(thing, "colliders", ()) if c.meets]


def kept_distances(scene: Scene) -> list[tuple[str, str, float, float]]:
    """(path of a collider, path of a body, distance kept besides half the body's thickness, what would hide all chords [m])."""
    found = []
    for body in scene.bodies() if scene.colliders else ():
        c, reach = chord.body_breadth(body), body.least_reach()
        for collider in scene.colliders:
            met = sharp.has_edges(body) and scene.contact_width == 0.0 and sharp.has_sharp_edges(collider)
            needed = 0.0 if met else max(chord.chord_sagitta(c, chord.least_curvature_radius(collider)) - reach, 0.0)
            found.append((collider.path, body.path, needed if collider.thickness is None else collider.thickness, needed))
    return found


def automatic_thicknesses(scene: Scene) -> list[dict]:
    """The part of `kept_distances` that the scene leaves open and is not 0, as a report has it."""
    free = {c.path for c in scene.colliders if c.thickness is None}
    return [{"collider": path, "body": body, "thickness": gap} for path, body, gap, _ in kept_distances(scene)
            if path in free and gap > 0.0]


def _format_position(x: np.ndarray, near: float) -> str:
    """A place in words; what is less than near [m] is 0."""
    return f"({', '.join(f'{v if abs(v) > near else 0.0:.4g}' for v in x)}) m"


def _bounding_ball(c: Collider) -> tuple[np.ndarray, float]:
    """(center (3,), radius) [m] of a ball that holds a collider of a rigid body at the start."""
    M, center, shape = c.motion.at(0.0), np.zeros(3), c.shape
    if isinstance(shape, Surface):
        center = shape.points.mean(axis=0)
        return M[:3, :3] @ center + M[:3, 3], float(np.linalg.norm(shape.points - center, axis=1).max(initial=0.0))
    return M[:3, 3], shape_row(shape).ball(shape)


def _points_inside_colliders(scene: Scene, body, moved: list[Collider]) -> Iterator[Problem]:
    """Free points of a body inside of colliders, and of those that move with rigid bodies."""
    free = np.ones(len(body.points), bool)
    for pin in scene.pins:
        if pin.body == body.path and pin.stiffness == inf:
            free[pin.points] = False
    which = np.flatnonzero(free)
    if not len(which):                                                  # what is pinned everywhere, nothing pushes
        return
    points = body.motion.points(body.points)[which]
    near = NEAR * float(np.ptp(points, axis=0).max(initial=0.0))
    of_bodies = {id(c): _bounding_ball(c) for c in moved}
    for c in (*scene.colliders, *moved):
        some = np.arange(len(points))
        if id(c) in of_bodies:
            center, radius = of_bodies[id(c)]
            some = np.flatnonzero(np.linalg.norm(points - center, axis=1) < radius)
        depth = -signed_distance.collider_signed_distance(c, points[some], near)
        if inside := int((depth > near).sum()):
            d = int(some[np.argmax(depth)])
            yield object_warning(body.path, f"{inside} of its {len(which)} free points start inside of {c.path}, the deepest, "
                                 f"point {which[d]}, by {depth.max():.3g} m at {_format_position(points[d], near)}", "none",
                                 "move one of them "
                                 f"apart{'' if id(c) in of_bodies else ', or pin those points'}: they are pushed out the "
                                 "nearest way at 0.5 m/s, which may be the far side", overlap=True)


def _bodies_inside_triangles(body, mover: Collider) -> Iterator[Problem]:
    """Triangles that a rigid body stands in which holds no point of theirs, by more than chords leave one that rests on points:
    these alone meet rigid bodies."""
    points, faces = chord.body_faces(body)
    center, radius = _bounding_ball(mover)
    x = points[faces]
    reach = np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2).max(axis=1, initial=0.0)
    some = np.flatnonzero(np.linalg.norm(x.mean(axis=1) - center, axis=1) < radius + reach)
    near = NEAR * float(np.ptp(points, axis=0).max(initial=0.0))
    if not len(some) or not radius > 0.0 or (signed_distance.collider_signed_distance(mover, x[some].reshape(-1, 3),
                                                                                      near) < -near).any():
        return
    k = int(np.clip(np.ceil(4.0 * reach[some].max() / radius), 3, FINEST))
    u = np.array([(i, j, k - i - j) for i in range(k + 1) for j in range(k + 1 - i)]) / k
    places = np.einsum("ki,tij->tkj", u, x[some]).reshape(-1, 3)
    places = places[np.argsort(signed_distance.collider_signed_distance(mover, places, near))[:signed_distance.SOME]]
    depth = -signed_distance.collider_signed_distance(mover, places, near)
    if depth.max() > near + chord.chord_sagitta(chord.triangle_breadth(points, faces), chord.least_curvature_radius(mover)):
        yield object_warning(body.path, f"the rigid body {mover.path} starts in its triangles, between their points, by "
                             f"{depth.max():.3g} m at {_format_position(places[np.argmax(depth)], near)}: points alone meet "
                             "rigid bodies, and it goes through there", "bodies that start beside it",
                             "move one of them apart, or refine the mesh", overlap=True)


def _bodies_above_nothing(scene: Scene) -> Iterator[Problem]:
    """Bodies that fall straight, beside everything: nothing lies below their bounds. Where wind blows or a collider moves, that
    is not known."""
    g = np.asarray(scene.gravity, float)
    if not (np.isfinite(g).all() and g.any()) or np.any(scene.wind) or any(
            c.motion.moves or getattr(c.shape, "poses", None) is not None for c in scene.colliders):
        return
    down = g / np.linalg.norm(g)
    across = np.linalg.svd(down[None])[2][1:]
    free = _freely_falling_bodies(scene, across)
    if not free or any(isinstance(c.shape, Plane) and c.motion.at(0.0)[:3, 2] @ -down > LEVEL for c in scene.colliders):
        return
    found = list(_obstacle_bounds(scene, np.vstack([across, -down])))
    low, high = (np.array([bounds[k] for bounds in found]).reshape(-1, 3) for k in (1, 2))
    for k, (path, lowest, highest) in enumerate(found):
        if path in free:
            below = (low[:, :2] <= highest[:2]).all(axis=1) & (high[:, :2] >= lowest[:2]).all(axis=1) & (low[:, 2] < highest[2])
            below[k] = False
            if not below.any():
                yield object_warning(path, "falls beside everything: no collider and no other body lies below it",
                                     "something to land on", "move it above a collider, or hold it by a joint or a pin")


def _freely_falling_bodies(scene: Scene, across: np.ndarray) -> set[str]:
    """Bodies that only gravity moves, straight down. across: two directions in which they do not move, (2, 3)."""
    held = {path for tie in scene.ties for path in (tie.body, tie.other)}
    held |= {pin.body for pin in scene.pins} | {load.body for load in scene.loads}
    held |= {path for joint in scene.things("Joint") for path in (joint.body0, joint.body1)}
    points = {b.path for b in scene.bodies() if b.velocities is None or not np.any(b.velocities)}
    rigid = {b.path for b in scene.things("Body") if b.colliders and not b.asleep and not np.any(across @ b.velocity) and not (
        np.any(b.force) or np.any(b.torque) or np.any(b.spin))}
    return (points | rigid) - held


def _obstacle_bounds(scene: Scene, axes: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """(path, low, high) along three axes of all that falls or may be met, but planes; a domain of liquid holds what falls."""
    solids = [(c.path, c.motion.at(0.0), c.shape) for c in scene.colliders if not isinstance(c.shape, Plane)]
    solids += [(b.path, b.motion.at(0.0) @ c.motion.at(0.0), c.shape) for b in scene.things("Body") for c in b.colliders]
    known: dict[str, list[np.ndarray]] = {}
    for path, M, shape in solids:
        points = shape.points if isinstance(shape, Surface) else shape_row(shape).outline(shape_row(shape).given(shape),
                                                                                          SIDES)[0]
        known.setdefault(path, []).append(points @ M[:3, :3].T + M[:3, 3])
    for thing in (*scene.bodies(), *scene.things("Rods")):
        known.setdefault(thing.path, []).append(thing.motion.points(thing.points))
    for tank in scene.things("Liquid"):
        known.setdefault(tank.path, []).append(np.array([tank.low, tank.high]))
    for path, parts in known.items():
        x = np.concatenate(parts) @ axes.T
        if len(x):
            yield path, x.min(axis=0), x.max(axis=0)
