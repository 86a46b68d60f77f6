"""What makes a scene impossible to run, as a list of problems: where, what was found, what is allowed, the mend.

NumPy only: the same check serves a stage that was loaded and a scene that Python made.
"""

import numpy as np

from wsim.curve import Motion
from wsim.scene import CLOTH_MODELS, INTEGRATORS, Cloth, Collider, Pin, Problem, Scene, Springs, Surface

SHAPE_SIZES = ("radius", "half", "half_height")
RIGID = 1e-5                       # |R^T R - I| of a motion that should be rigid


class _List(list):
    """Problems of one object."""

    def __init__(self, path: str):
        super().__init__()
        self.path = path

    def unless(self, good, text: str) -> bool:
        if not good:
            self.append(Problem(self.path, text))
        return bool(good)

    def finite(self, name: str, array: np.ndarray | None) -> None:
        if array is not None and not np.all(np.isfinite(array)):
            i = int(np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))[0])
            self.append(Problem(self.path, f"{name}[{i}] is {np.asarray(array)[i]}; allowed are finite numbers: repair "
                                "the mesh where it was made"))

    def lengths(self, name: str, array: np.ndarray | None, allowed: tuple[int, ...], of: str) -> bool:
        return array is None or self.unless(
            len(array) in allowed, f"{name} has {len(array)} values; allowed is {' or '.join(map(str, allowed))} "
                                   f"({of})")

    def above(self, name: str, array, low: float = 0.0, strict: bool = True) -> None:
        """Every value finite and > low (>= low unless strict)."""
        values = np.atleast_1d(np.asarray(array, np.float64))
        bad = ~np.isfinite(values) | (values <= low if strict else values < low)
        if bad.any():
            i = int(np.flatnonzero(bad)[0])
            where = f"[{i}]" if values.size > 1 else ""
            self.append(Problem(self.path, f"{name}{where} is {values[i]:g}; allowed is a finite number "
                                f"{'>' if strict else '>='} {low:g}"))


def scene_problems(scene: Scene) -> list[Problem]:
    """Everything fatal in a scene, in its order."""
    found = _settings(scene)
    for cloth in scene.cloths:
        found += cloth_problems(cloth)
    for springs in scene.springs:
        found += springs_problems(springs)
    for collider in scene.colliders:
        found += collider_problems(collider)
    bodies = {body.path: len(body.points) for body in scene.bodies()}
    for pin in scene.pins:
        found += pin_problems(pin, bodies)
    seen: set[str] = set()
    everything: list[Cloth | Springs | Collider | Pin] = [*scene.bodies(), *scene.colliders, *scene.pins]
    for path in [thing.path for thing in everything]:
        if path in seen:
            found.append(Problem(path, "two objects have this path; every object needs its own"))
        seen.add(path)
    return found


def _settings(scene: Scene) -> list[Problem]:
    p = _List("scene")
    p.unless(np.all(np.isfinite(scene.gravity)), f"gravity is {scene.gravity}; allowed are finite numbers")
    p.unless(np.all(np.isfinite(scene.wind)), f"wind is {scene.wind}; allowed are finite numbers")
    p.unless(scene.up in ("Y", "Z"), f"up is {scene.up!r}; allowed is 'Y' or 'Z'")
    p.unless(scene.integrator in INTEGRATORS,
             f"integrator is {scene.integrator!r}; allowed is {' or '.join(INTEGRATORS)} (wsim:integrator)")
    p.above("fps", scene.fps)
    p.above("substeps", scene.substeps, 1, strict=False)
    p.above("iterations", scene.iterations, 1, strict=False)
    p.above("frames", scene.frames, 0, strict=False)
    p.above("air_density", scene.air_density, strict=False)
    p.above("air_drag", scene.air_drag, strict=False)
    p.unless(np.isfinite(scene.start), f"start is {scene.start}; allowed is a finite time code")
    return p


def _mesh(p: _List, points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> bool:
    """Points, polygons and their indices fit each other."""
    p.finite("points", points)
    good = p.unless(len(points) > 0, "has no points")
    good &= p.unless(len(counts) > 0, "has no faces")
    if not good:
        return False
    if not p.unless(counts.min() >= 3, f"face {int(counts.argmin())} has {counts.min()} corners; allowed is 3 or more"):
        return False
    if not p.unless(counts.sum() == len(indices), f"faceVertexCounts sum to {counts.sum()}, and there are "
                    f"{len(indices)} faceVertexIndices; the two must agree"):
        return False
    bad = (indices < 0) | (indices >= len(points))
    return p.unless(not bad.any(), f"faceVertexIndices[{int(bad.argmax())}] is {indices[bad.argmax()]}; allowed is 0 "
                    f"to {len(points) - 1} (there are {len(points)} points)")


def _motion(p: _List, motion: Motion, rigid: bool = False) -> None:
    linear = motion.values[:, :3, :3]
    if not p.unless(np.all(np.isfinite(motion.values)), "its transform is not finite"):
        return
    lengths = np.linalg.norm(linear, axis=1).max(axis=1)
    p.unless(np.all(np.abs(np.linalg.det(linear)) > 1e-12 * lengths**3),
             "its transform flattens it: a scale is zero; every scale must differ from zero")
    if rigid:
        error = np.abs(np.swapaxes(linear, 1, 2) @ linear - np.eye(3)).max()
        p.unless(error < RIGID and np.all(np.linalg.det(linear) > 0),
                 "its motion is not rigid (it scales, shears or mirrors); put the scale into the shape's sizes")


def cloth_problems(cloth: Cloth) -> list[Problem]:
    p, n = _List(cloth.path), len(cloth.points)
    _mesh(p, cloth.points, cloth.counts, cloth.indices)
    for name in ("velocities", "rest_points", "masses", "thicknesses"):
        array = getattr(cloth, name)
        if p.lengths(name, array, (n,), "one a point"):
            p.finite(name, array)
    if cloth.masses is not None:
        p.above("masses", cloth.masses)
    if cloth.thicknesses is not None:
        p.above("thicknesses", cloth.thicknesses)
    if cloth.mass is not None:
        p.above("mass", cloth.mass)
    p.unless(cloth.model in CLOTH_MODELS, f"model is {cloth.model!r}; allowed is {' or '.join(CLOTH_MODELS)} "
                                          "(wsim:model)")
    for name in ("weld", "drag", "lift"):
        p.above(name, getattr(cloth, name), strict=False)
    _motion(p, cloth.motion)
    return p


def springs_problems(springs: Springs) -> list[Problem]:
    p, n, m = _List(springs.path), len(springs.points), len(springs.edges)
    p.finite("points", springs.points)
    if p.unless(n > 0 and m > 0, f"has {n} points and {m} springs; a net needs both"):
        bad = ((springs.edges < 0) | (springs.edges >= n)).any(axis=1)
        p.unless(not bad.any(), f"spring {int(bad.argmax())} joins points {springs.edges[bad.argmax()]}; allowed is 0 "
                 f"to {n - 1}")
        loops = springs.edges[:, 0] == springs.edges[:, 1]
        p.unless(not loops.any(), f"spring {int(loops.argmax())} joins a point to itself; give it two points")
    p.lengths("stiffness", springs.stiffness, (1, m), "one for all, or one a spring")
    p.lengths("masses", springs.masses, (1, n), "one for all, or one a point")
    p.lengths("lengths", springs.lengths, (m,), "one a spring")
    if p.lengths("velocities", springs.velocities, (n,), "one a point"):
        p.finite("velocities", springs.velocities)
    p.above("stiffness", springs.stiffness, strict=False)
    p.above("masses", springs.masses)
    if springs.lengths is not None:
        p.above("lengths", springs.lengths, strict=False)
    for name in ("damping", "radius", "static_friction", "dynamic_friction"):
        p.above(name, getattr(springs, name), strict=False)
    _motion(p, springs.motion)
    return p


def collider_problems(collider: Collider) -> list[Problem]:
    p, shape = _List(collider.path), collider.shape
    for name in SHAPE_SIZES:
        if hasattr(shape, name):
            p.above(name, getattr(shape, name), strict=name != "half_height" or type(shape).__name__ != "Capsule")
    if isinstance(shape, Surface):
        _mesh(p, shape.points, shape.counts, shape.indices)
        if shape.poses is not None:
            values = np.asarray(shape.poses.values)
            if p.unless(values.shape[1:] == shape.points.shape, f"poses have the shape {values.shape}; allowed is one "
                        f"set of {len(shape.points)} points a time: the mesh must keep its points"):
                p.finite("poses", values)
    for name in ("static_friction", "dynamic_friction", "thickness"):
        p.above(name, getattr(collider, name), strict=False)
    _motion(p, collider.motion, rigid=True)
    return p


def pin_problems(pin: Pin, bodies: dict[str, int]) -> list[Problem]:
    """bodies: number of points of each cloth and spring net, by path."""
    p = _List(pin.path)
    if p.unless(pin.body in bodies, f"holds {pin.body}, which is no cloth or spring net; there are: "
                f"{', '.join(bodies) or 'none'}"):
        bad = (pin.points < 0) | (pin.points >= bodies[pin.body])
        p.unless(not bad.any(), f"holds point {pin.points[bad.argmax()] if len(bad) else 0} of {pin.body}; allowed is "
                 f"0 to {bodies[pin.body] - 1}")
    p.unless(len(pin.points) > 0, "holds no point; give indices of points, or remove it")
    if p.lengths("places", pin.places, (len(pin.points),), "one a held point"):
        p.finite("places", pin.places)
    p.unless(pin.stiffness >= 0, f"stiffness is {pin.stiffness:g}; allowed is >= 0, or inf for a hard pin")
    p.above("damping", pin.damping, strict=False)
    _motion(p, pin.motion, rigid=True)
    return p
