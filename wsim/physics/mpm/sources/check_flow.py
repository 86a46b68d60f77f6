"""What can be wrong with shapes that pour and with sinks, and with what begins within a solid. NumPy only."""

from collections.abc import Iterator
from math import inf, isfinite
from typing import Any

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.contact.collider.shells import body_shells
from wsim.physics.mpm.objects import MaterialPoints, MaterialSink
from wsim.physics.mpm.seeding import coarsened, place_particles
from wsim.physics.mpm.sources.check_shapes import check_volume_shape
from wsim.physics.mpm.sources.pouring import PouringShape
from wsim.scene import Problem, Scene, Surface, solids
from wsim.scene.check.objects import check_number, check_rigid_motion, object_warning, thing_error, three_digits
from wsim.scene.solids import shape_row

LOOKS = 64               # cells across a shape, at most, when its particles are looked at
DEEP = 0.25              # cells that a particle may begin within a solid


def check_pour(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """Problems of a shape that pours, whose shape and material are sound."""
    path, pour, velocity = thing.path, thing.pour, np.asarray(thing.velocity)
    assert pour is not None
    if not np.any(velocity) or velocity.shape != (3,):
        yield thing_error(path, f"it pours with the velocity {velocity.tolist()}", "three numbers [m/s], not all 0",
                           "give velocity=, along its own axes")
        return
    if np.any(thing.spin) or thing.further or np.ndim(np.asarray(thing.colors)) > 1:
        yield thing_error(path, "it pours, and has a spin, further materials or colours of each point",
                           "one material and colour", "leave them out")
    yield from check_number(path, "start of its pour", pour.start, -inf)
    if not pour.end > pour.start and pour.start == pour.start:
        yield thing_error(path, f"it pours from {pour.start:g} s to {pour.end:g} s", "an end after the start",
                           "give another end")
    if pour.rate is not None and not (isfinite(pour.rate) and pour.rate > 0.0):
        yield thing_error(path, f"it pours {pour.rate:g} kg/s", "a finite rate above 0", "give another, or none for as much "
                           "as its cross-section carries")
        return
    shape = PouringShape(thing)
    if not len(shape.places):
        yield thing_error(path, f"its shape holds no particle: cells are {thing.cell:g} m", "a shape of a cell or more",
                           "give smaller cells, or a larger shape")
        return
    most = shape.greatest_rate
    if pour.rate is not None and pour.rate > most * (1.0 + 1e-6):
        speed = float(np.linalg.norm(velocity))
        yield thing_error(path, f"it pours {pour.rate:g} kg/s, and carries {three_digits(most, int):g} kg/s at {speed:g} m/s",
                           "a rate up to that", f"give a speed of {speed * pour.rate / most:.3g} m/s, or a larger shape")
    if pour.start * scene.fps >= scene.frames > 0:
        yield object_warning(path, f"it pours from {pour.start:g} s on, behind the last frame", f"up to "
                              f"{scene.frames / scene.fps:g} s", "give an earlier start, or more frames")
    if isinstance(thing.shape, PointCloud) and thing.shape.poses is not None and thing.shape.poses.moves:
        yield object_warning(path, "its points move", "points that stay, below an Xform that may move",
                              "they pour from where they are at the start")


def check_sink(thing: MaterialSink, scene: Scene) -> Iterator[Problem]:
    """Problems of a sink."""
    if isinstance(thing.shape, Surface) or type(thing.shape) in [each.shape for each in solids.SOLIDS]:
        yield from check_volume_shape(thing.path, thing.shape)
    else:
        yield thing_error(thing.path, f"its shape is a {type(thing.shape).__name__}",
                           "a Plane, a closed shape or a closed Surface", "give it one of these")
    yield from check_rigid_motion(thing.path, thing.motion, "put the scale into the shape's sizes")


def check_start(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """An error of what pours into a solid, a convex collider, and a warning of a body that begins in one."""
    M, places = thing.motion.at(0.0), None
    within: list[Any] = [*scene.colliders, *body_shells(scene)]
    for collider in within:
        if isinstance(collider.shape, (Surface, PointCloud)):
            continue
        if places is None:
            places = PouringShape(thing).places @ M[:3, :3].T + M[:3, 3] if thing.pour else place_particles(
                coarsened(thing, LOOKS)).x
        C = collider.motion.at(0.0)
        deep = -shape_row(collider.shape).distance(collider.shape, (places - C[:3, 3]) @ C[:3, :3])
        if np.any(deep > DEEP * thing.cell):
            count = np.count_nonzero(deep > 0.0)
            say = thing_error if thing.pour else object_warning
            yield say(thing.path, f"{'it pours into' if thing.pour else 'it begins within'} {collider.path}: {count} of "
                      f"{len(places)} particles, up to {deep.max():.3g} m deep", "places outside of colliders",
                      "move it, or cut its shape")
            return
