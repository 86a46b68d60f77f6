"""What can be wrong with domains of air and of liquid where they start, alike for both: their neighbours, what fills them, the
steps that known speeds need. NumPy only."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsim.geometry.triangulate import triangulate
from wsim.scene import Problem, Scene, Surface
from wsim.scene.check import signed_distance
from wsim.scene.check.objects import error, surface, warning

DOMAINS = ("Fluid", "Liquid")
SOURCES = {"Fluid": ("Source", "fluid"), "Liquid": ("LiquidSource", "liquid")}
TOUCH = 1e-6           # of a cell, by which boxes may lie in each other
FINEST = 12            # places along an axis at which a domain is asked whether a collider fills it


def common(domain: Any, scene: Scene) -> Iterator[Problem]:
    """Problems of a domain that lies in another one, or whose steps are too few."""
    if not (np.isfinite(domain.low).all() and np.isfinite(domain.high).all() and domain.cell > 0.0):
        return
    kind = type(domain).__name__
    others = scene.things(kind)
    for other in others[next(k for k, each in enumerate(others) if each is domain) + 1:]:
        low, high = np.maximum(domain.low, other.low), np.minimum(domain.high, other.high)
        if (high - low > TOUCH * domain.cell).all():
            yield warning(domain.path, f"it overlaps {other.path} in a box of {' x '.join(f'{v:.3g}' for v in high - low)} m: "
                          "each has its own flow there, and neither feels the other", "domains apart",
                          "move one of them, or make one domain of both")
    yield from _fast(domain, kind, scene)


def _fast(domain: Any, kind: str, scene: Scene) -> Iterator[Problem]:
    """A CFL number that the most steps cut from the first frame on, by speeds that the scene names."""
    name, of = SOURCES[kind]
    given = [x.velocity for x in scene.things(name) if x.velocity is not None and getattr(x, of) in ("", domain.path)]
    given += [v for v in (getattr(domain, "velocity", None), getattr(domain, "side_velocities", None)) if v is not None]
    speed = max((float(np.abs(v).max(initial=0.0)) for v in given), default=0.0)
    if domain.steps or not (domain.cfl > 0.0 and scene.fps > 0.0 and np.isfinite(speed)):
        return
    wanted = speed / scene.fps / (domain.cfl * domain.cell)
    if wanted > domain.most_steps:
        yield warning(domain.path, f"a speed of {speed:g} m/s needs {int(np.ceil(wanted))} steps a frame at a CFL number of "
                      f"{domain.cfl:g}, and most_steps is {domain.most_steps}: it crosses "
                      f"{wanted * domain.cfl / domain.most_steps:.3g} cells in a step",
                      f"most_steps of {int(np.ceil(wanted))} or more", "author more most_steps, larger cells, or a larger cfl")


def cut(domains: list, steps: np.ndarray, more: int) -> list[tuple[tuple, float, str]]:
    """Notes of the domains (with a world each) whose frame took all steps that it may, `more` times as many if repeated."""
    found = [(domain, world, n) for (domain, world), n in zip(domains, steps, strict=True)
             if not domain.steps and n >= more * domain.most_steps]
    return [(("steps", domain.path, world), float(n), f"{domain.path}: frames took {{worst}} steps, all that most_steps "
             f"allows, and what flows may cross more than {domain.cfl:g} cells (cfl) in one; give more most_steps, or larger "
             "cells") for domain, world, n in found]


def filled(domain: Any, scene: Scene, what: str) -> Iterator[Problem]:
    """Colliders that have all of its box within themselves at the start."""
    shape = np.clip(np.array(domain.shape) + 1, 2, FINEST)
    ends = [np.linspace(a, b, n) for a, b, n in zip(domain.low, domain.high, shape, strict=True)]
    places = np.stack(np.meshgrid(*ends, indexing="ij"), -1).reshape(-1, 3)
    for collider in scene.colliders:
        sound = np.isfinite(collider.motion.values[0]).all() and not any(_broken(collider))
        if sound and (signed_distance.distance(collider, places, 0.0) < 0.0).all():
            yield warning(domain.path, f"{collider.path} fills all of it: there is no {what}", "obstacles that leave some",
                          f"move {collider.path}, or the domain")


def _broken(collider: Any) -> Iterator[Problem]:
    if isinstance(collider.shape, Surface):
        yield from (p for p in surface(collider.shape, collider.path) if p.fatal)


def solid(shape: Surface, path: str) -> Iterator[Problem]:
    """A mesh that has an inside, which a source fills."""
    found = list(surface(shape, path))
    yield from found
    if any(p.fatal for p in found):
        return
    points = shape.points.astype(np.float64)
    if not signed_distance.closed(points, triangulate(shape.points, shape.counts, shape.indices, True)[0]):
        yield error(path, "it is an open mesh, which has no inside to be filled", "a closed mesh",
                    "close its holes, or take a Sphere, Cube or Cylinder")
