"""What can be wrong with domains of air and of liquid where they start, alike for both: their neighbours, what fills them, the
steps that known speeds need. NumPy only."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.contact.collider.point_cloud import PointCloud, cloud_problems
from wsim.scene import Plane, Problem, Scene, Sphere, Surface, solids
from wsim.scene.check import signed_distance
from wsim.scene.check.objects import check_number, check_surface, object_warning, thing_error
from wsim.scene.solids import shape_row

DOMAINS = ("Fluid", "Liquid")
SOURCES = {"Fluid": ("Source", "fluid"), "Liquid": ("LiquidSource", "liquid")}
TOUCH = 1e-6           # of a cell, by which boxes may lie in each other
FRAMES = 2000          # most frames that are checked for colliders that move through a domain
FINEST = 12            # places along an axis at which a domain is asked whether a collider fills it


def check_domain_start(domain: Any, scene: Scene) -> Iterator[Problem]:
    """Problems of a domain that lies in another one, or whose steps are too few."""
    if not (np.isfinite(domain.low).all() and np.isfinite(domain.high).all() and domain.cell > 0.0):
        return
    kind = type(domain).__name__
    others = scene.things(kind)
    for other in others[next(k for k, each in enumerate(others) if each is domain) + 1:]:
        low, high = np.maximum(domain.low, other.low), np.minimum(domain.high, other.high)
        if (high - low > TOUCH * domain.cell).all():
            yield object_warning(domain.path,
                                 f"it overlaps {other.path} in a box of {' x '.join(f'{v:.3g}' for v in high - low)} m: "
                                 "each has its own flow there, and neither feels the other", "domains apart",
                                 "move one of them, or make one domain of both")
    yield from _warn_of_few_steps(domain, kind, scene)


def _warn_of_few_steps(domain: Any, kind: str, scene: Scene) -> Iterator[Problem]:
    """Warns if most_steps is too few for the speeds and surface waves of the scene."""
    if domain.steps or not (domain.cfl > 0.0 and scene.fps > 0.0):
        return
    needs = list(_steps_needed(domain, kind, scene))
    wanted, what = max(((n, what) for n, what in needs if np.isfinite(n)), default=(0.0, ""))
    if wanted > domain.most_steps:
        yield object_warning(domain.path,
                             f"{what}, and most_steps is {domain.most_steps}: steps are {wanted / domain.most_steps:.3g} "
                             "times too long", f"most_steps of {int(np.ceil(wanted))} or more",
                             "author a larger most_steps, larger cells, or a larger cfl")


def _steps_needed(domain: Any, kind: str, scene: Scene) -> Iterator[tuple[float, str]]:
    """Steps a frame that each speed and wave needs, and the reason in words, with the constants of a run."""
    cell, fps = domain.cell, scene.fps
    for path, speed in _known_speeds(domain, kind, scene):
        n = speed / fps / (domain.cfl * cell)
        yield n, f"{path} moves at {speed:g} m/s, which needs {_whole_steps(n)} steps a frame at a CFL number of {domain.cfl:g}"
    if kind == "Liquid":
        from wsim.physics.fluid.liquid.objects import GIVEN, WAVE  # not in scenes of air
        pull = float(np.abs(np.asarray(scene.gravity)[list(domain.axes)]).max(initial=0.0))
        n = np.sqrt(np.pi * pull / cell) / WAVE / fps
        yield n, f"waves of its surface need {_whole_steps(n)} steps a frame"
        for source in scene.things("LiquidSource"):
            if source.role == "source" and source.velocity is not None and source.liquid in ("", domain.path):
                n = float(np.linalg.norm(source.velocity)) / fps / (GIVEN * cell)
                yield n, f"the inflow of {source.path} needs {_whole_steps(n)} steps a frame, to cross {GIVEN:g} cells a step"


def _whole_steps(steps: float) -> int:
    return int(np.ceil(steps)) if np.isfinite(steps) else 0


def _known_speeds(domain: Any, kind: str, scene: Scene) -> Iterator[tuple[str, float]]:
    """Name and greatest velocity component [m/s] of each thing that moves in a domain, as known before a run."""
    name, of = SOURCES[kind]
    for source in scene.things(name):
        if source.velocity is not None and getattr(source, of) in ("", domain.path):
            yield source.path, _greatest_component(source.velocity)
    for own in ("velocity", "side_velocities"):
        if getattr(domain, own, None) is not None:
            yield "its air", _greatest_component(getattr(domain, own))
    if kind == "Fluid" and {"open", "wind"} & set(domain.sides):
        yield "the wind", _greatest_component(scene.wind)
    for collider in scene.colliders:
        if collider.motion.moves:
            yield collider.path, _passing_speed(collider, domain, scene)
    for body in scene.things("Body"):
        place = body.motion.values[0][:3, 3]
        if ((place >= domain.low) & (place <= domain.high)).all():
            yield body.path, _greatest_component(body.velocity)


def _greatest_component(velocity: Any) -> float:
    return float(np.abs(np.asarray(velocity)).max(initial=0.0))


def _passing_speed(collider: Any, domain: Any, scene: Scene) -> float:
    """Greatest speed [m/s] of a collider within a domain, from its poses at the frames; of its rim where it turns."""
    shape, last = collider.shape, min(max(scene.frames, 1), FRAMES)
    M = collider.motion.sampled(np.arange(last + 1) / scene.fps)
    places, turns = M[:, :3, 3], M[:, :3, :3]
    if isinstance(shape, Surface):
        ball = float(np.linalg.norm(shape.points, axis=1).max(initial=0.0))
    else:
        ball = 0.0 if isinstance(shape, Plane) else shape_row(shape).ball(shape)
    low, high = np.minimum(places[:-1], places[1:]) - ball, np.maximum(places[:-1], places[1:]) + ball
    within = isinstance(shape, Plane) | ((low <= domain.high) & (high >= domain.low)).all(axis=1)
    rim = 0.0 if isinstance(shape, Sphere) else ball * np.linalg.norm(turns[1:] - turns[:-1], axis=(1, 2)) / np.sqrt(2.0)
    speed = scene.fps * (np.abs(places[1:] - places[:-1]).max(axis=1) + rim)
    return float(speed[within & np.isfinite(speed)].max(initial=0.0))


def cut_step_warnings(domains: list, steps: np.ndarray, more: int) -> list[tuple[tuple, float, str]]:
    """Warnings for the domains (with a world each) whose frame needed more steps than most_steps, or than `more` times
    most_steps if it was repeated. steps: taken and needed, of each domain."""
    found = [(domain, world, n) for (domain, world), n in zip(domains, steps[1::2], strict=True)
             if not domain.steps and n > more * domain.most_steps]
    return [(("steps", domain.path, world), float(n), f"{domain.path}: a frame needed {{worst}} steps at a CFL number of "
             f"{domain.cfl:g}, and most_steps is {domain.most_steps}: its steps are too long; give a larger most_steps "
             "or larger cells")
            for domain, world, n in found]


def covering_colliders(domain: Any, scene: Scene, what: str) -> Iterator[Problem]:
    """Colliders that have all of its box within themselves at the start."""
    shape = np.clip(np.array(domain.shape) + 1, 2, FINEST)
    ends = [np.linspace(a, b, n) for a, b, n in zip(domain.low, domain.high, shape, strict=True)]
    places = np.stack(np.meshgrid(*ends, indexing="ij"), -1).reshape(-1, 3)
    for collider in scene.colliders:
        sound = np.isfinite(collider.motion.values[0]).all() and not any(_broken_surface(collider))
        if sound and (signed_distance.collider_signed_distance(collider, places, 0.0) < 0.0).all():
            yield object_warning(domain.path, f"{collider.path} fills all of it: there is no {what}",
                                 "obstacles that leave some", f"move {collider.path}, or the domain")


def _broken_surface(collider: Any) -> Iterator[Problem]:
    if isinstance(collider.shape, Surface):
        yield from (p for p in check_surface(collider.shape, collider.path) if p.fatal)


def source_shape(source: Any) -> Iterator[Problem]:
    """What is wrong with the shape of a source of smoke or liquid."""
    shape, path = source.shape, source.path
    if isinstance(shape, Surface):
        yield from check_source_mesh(shape, path)
    elif isinstance(shape, PointCloud):
        yield from cloud_problems(shape, path)
    elif type(shape) not in [each.shape for each in solids.SOLIDS]:
        yield thing_error(path, f"its shape is a {type(shape).__name__}",
                           f"{', '.join(each.shape.__name__ for each in solids.SOLIDS)}, Surface, PointCloud",
                           "give it one of these")
    else:
        for name, value in shape_row(shape).named(shape).items():
            for v in np.atleast_1d(value):
                yield from check_number(path, name, float(v), 0.0, name not in shape_row(shape).vanishing)


def bounding_radius(shape: Any) -> float:
    """Radius about its own origin that holds a shape [m]; inf of a plane, and of what is no shape."""
    if isinstance(shape, PointCloud):
        return shape.bounding_radius
    if isinstance(shape, Surface):
        return float(np.linalg.norm(shape.points, axis=1).max(initial=0.0))
    return float(shape_row(shape).ball(shape)) if type(shape) in [each.shape for each in solids.SOLIDS] else np.inf


def touches_box(shape: Any, places: np.ndarray, domain: Any) -> bool:
    """Whether the ball about a shape touches the box of a domain, its origin at one of the places (n, 3) [m]."""
    nearest = np.clip(places, domain.low, domain.high)
    return bool((np.linalg.norm(places - nearest, axis=1) <= bounding_radius(shape)).any())


def check_source_mesh(shape: Surface, path: str) -> Iterator[Problem]:
    """A mesh that has an inside, which a source fills."""
    found = list(check_surface(shape, path))
    yield from found
    if any(p.fatal for p in found):
        return
    points = shape.points.astype(np.float64)
    if not signed_distance.is_closed_mesh(points, triangulate_polygons(shape.points, shape.counts, shape.indices, True)[0]):
        yield thing_error(path, "it is an open mesh, which has no inside to be filled", "a closed mesh",
                           "close its holes, or take a Sphere, Cube or Cylinder")
