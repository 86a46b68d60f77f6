"""What is wrong with how bodies and colliders start: points inside, and a thickness that lets chords through. NumPy only."""

from collections.abc import Iterator
from math import inf

import numpy as np

from wsim.scene import Problem, Scene
from wsim.scene.check import chord, signed_distance
from wsim.scene.check.objects import warning

NEAR = 1e-5            # of a body's extent: points so near to a surface are on it
SHORT = 1e-5           # [m] of a distance kept that does not count


def contacts(scene: Scene) -> Iterator[Problem]:
    """Problems of contacts in a scene whose objects are sound."""
    for body in scene.bodies():
        yield from _buried(scene, body)
    for path, other, gap, needed in kept(scene):
        if gap + SHORT < needed:
            yield warning(path, f"with a thickness of {gap:g} m it stands out by up to {needed - gap:.2g} m between points of "
                          f"{other}, whose triangles are chords", f"{needed:.2g} m or more",
                          "leave wsim:thickness unauthored, which takes that, or refine the mesh")


def kept(scene: Scene) -> list[tuple[str, str, float, float]]:
    """(path of a collider, path of a body, distance kept besides half the body's thickness, what would hide all chords [m])."""
    found = []
    for body in scene.bodies() if scene.colliders else ():
        c, reach = chord.body_breadth(body), chord.body_reach(body)
        for collider in scene.colliders:
            needed = max(chord.hidden(c, chord.radius(collider)) - reach, 0.0)
            found.append((collider.path, body.path, needed if collider.thickness is None else collider.thickness, needed))
    return found


def taken(scene: Scene) -> list[dict]:
    """The part of `kept` that the scene leaves open and is not 0, as a report has it."""
    free = {c.path for c in scene.colliders if c.thickness is None}
    return [{"collider": path, "body": body, "thickness": gap} for path, body, gap, _ in kept(scene)
            if path in free and gap > 0.0]


def _buried(scene: Scene, body) -> Iterator[Problem]:
    """Free points of a body inside of colliders."""
    free = np.ones(len(body.points), bool)
    for pin in scene.pins:
        if pin.body == body.path and pin.stiffness == inf:
            free[pin.points] = False
    which = np.flatnonzero(free)
    if not len(which):                                                  # what is pinned everywhere, nothing pushes
        return
    points = body.motion.points(body.points)[which]
    near = NEAR * float(np.ptp(points, axis=0).max(initial=0.0))
    for collider in scene.colliders:
        depth = -signed_distance.distance(collider, points, near)
        inside = int((depth > near).sum())
        if inside:
            k = int(np.argmax(depth))
            yield warning(body.path, f"{inside} of its {len(which)} free points start inside of {collider.path}, the deepest, "
                          f"point {which[k]}, by {depth[k]:.3g} m", "none", "move one of them apart, or pin those points: they "
                          "are pushed out the nearest way at 0.5 m/s, which may be the far side")
