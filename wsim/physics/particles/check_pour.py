"""What can be wrong with shapes that pour, and with what begins within a solid, whatever method moves it. NumPy only."""

from collections.abc import Iterator
from math import ceil, inf
from numbers import Real
from typing import Any

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.contact.collider.shells import body_shells
from wsim.physics.particles.pouring import MOST_PLACES
from wsim.scene import Problem, Scene, Surface
from wsim.scene.check.objects import check_number, object_warning, thing_error, three_digits
from wsim.scene.solids import shape_row


def check_pour_numbers(thing: Any, scene: Scene, size: str, smaller: str) -> Iterator[Problem]:
    """Problems of a shape that pours, whose shape and material are sound. size: how large its particles are, in words;
    smaller: what to give for smaller ones."""
    path, pour = thing.path, thing.pour
    velocity = np.zeros(3) if thing.velocity is None else np.asarray(thing.velocity)
    if not np.any(velocity) or velocity.shape != (3,) or not np.isfinite(velocity).all():
        yield thing_error(path, f"it pours with the velocity {velocity.tolist()}", "three numbers [m/s], not all 0",
                          "give a velocity along its own axes, velocity=(0, -1, 0) say; in USD, "
                          "wsim:particles:velocity or wsim:mpm:velocity")
        return
    wrong = [*check_number(path, "start of its pour", pour.start, -inf)]
    if pour.end != inf:
        wrong += check_number(path, "end of its pour", pour.end, -inf, mend="give a time [s], or inf for no end")
    if not wrong and not pour.end > pour.start:
        wrong.append(thing_error(path, f"it pours from {pour.start:g} s to {pour.end:g} s", "an end after the start",
                                 "give another end"))
    number = isinstance(pour.rate, Real)
    if pour.rate is not None and not (number and 0.0 < pour.rate < inf):
        found = f"{pour.rate:g}" if number else f"{pour.rate!r:.60}"
        wrong.append(thing_error(path, f"it pours {found} kg/s", "a finite rate above 0",
                                 "give another, or none for as much as its cross-section carries"))
    yield from wrong
    if wrong:
        return
    shape = thing.pouring_shape()
    if shape.lattice_size > MOST_PLACES:
        larger = shape.edge / 2.0 * (shape.lattice_size / MOST_PLACES) ** (1.0 / 3.0)
        yield thing_error(path, f"{size}, with which the box about its shape has {shape.lattice_size:.3g} places",
                          f"{MOST_PLACES:.3g} places", f"give particles of a radius of {larger:.2g} m, or a smaller shape")
        return
    if not len(shape.places):
        yield thing_error(path, f"its shape holds no particle: {size}", "a shape that holds one",
                          f"give {smaller}, or a larger shape")
        return
    most = shape.greatest_rate
    if pour.rate is not None and pour.rate > most * (1.0 + 1e-6):
        speed = float(np.linalg.norm(velocity))
        yield thing_error(path, f"it pours {pour.rate:g} kg/s, and carries {three_digits(most, int):g} kg/s at {speed:g} m/s",
                          "a rate up to that", f"give a speed of {speed * pour.rate / most:.3g} m/s, or a larger shape")
    yield from _check_pour_times(thing, scene)
    if isinstance(thing.shape, PointCloud) and thing.shape.poses is not None and thing.shape.poses.moves:
        yield object_warning(path, "its points move", "points that stay, below an Xform that may move",
                             "they pour from where they are at the start")


def _check_pour_times(thing: Any, scene: Scene) -> Iterator[Problem]:
    """A warning of what pours nothing in the scene's frames, or begins before them."""
    path, pour, shape = thing.path, thing.pour, thing.pouring_shape()
    if pour.start * scene.fps >= scene.frames > 0:
        yield object_warning(path, f"it pours from {pour.start:g} s on, behind the last frame", f"up to "
                             f"{scene.frames / scene.fps:g} s", "give an earlier start, or more frames")
    elif not pour.end > 0.0 and pour.end > pour.start:
        yield object_warning(path, f"it pours until {pour.end:g} s, before the first frame", "an end above 0 s",
                             "give a later end, or run with --preroll")
    elif pour.start < 0.0:
        yield object_warning(path, f"it pours from {pour.start:g} s on, and frames begin at 0 s: what comes before is left out",
                             "a start of 0 s or later", f"give one, or run with --preroll {ceil(-pour.start * scene.fps)}")
    elif scene.frames > 0 and not shape.count_until(scene.frames / scene.fps):
        length = min(pour.end, scene.frames / scene.fps) - pour.start
        yield object_warning(path, f"nothing comes: it pours {shape.mass / shape.interval:.3g} kg/s for {length:.3g} s, and a "
                             f"particle has {shape.mass:.3g} kg", "half a particle at least",
                             "give a higher rate, a longer pour, or smaller particles")


def check_free_places(thing: Any, scene: Scene, places: np.ndarray, depth: float) -> Iterator[Problem]:
    """An error of what pours into a solid, a convex collider, and a warning of what begins in one, by more than `depth` [m].
    places: world (n, 3) [m]."""
    within: list[Any] = [*scene.colliders, *body_shells(scene)]
    for collider in within:
        if isinstance(collider.shape, (Surface, PointCloud)):
            continue
        C = collider.motion.at(0.0)
        deep = -shape_row(collider.shape).distance(collider.shape, (places - C[:3, 3]) @ C[:3, :3])
        if np.any(deep > depth):
            count = np.count_nonzero(deep > 0.0)
            say = thing_error if thing.pour else object_warning
            yield say(thing.path, f"{'it pours into' if thing.pour else 'it begins within'} {collider.path}: {count} of "
                      f"{len(places)} particles, up to {deep.max():.3g} m deep", "places outside of colliders",
                      "move it, or cut its shape")
            return


def poured_places(thing: Any) -> np.ndarray:
    """Places where what pours comes at the start, world (n, 3) [m]."""
    M = thing.motion.at(0.0)
    return thing.pouring_shape().places @ M[:3, :3].T + M[:3, 3]
