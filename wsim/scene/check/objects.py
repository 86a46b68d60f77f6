"""What can be wrong with one object by itself: its numbers, its transform, its surface, its size. NumPy only.

Each rule yields Problems in one form: what was found, what is allowed (or expected, for a warning) and the mend.
"""

from collections.abc import Callable, Generator, Iterator
from dataclasses import fields
from math import floor, inf, isfinite, log10
from numbers import Real
from typing import Any

import numpy as np

from wsim.scene import Collider, Plane, Problem, Scene, Surface, solids
from wsim.scene.check import mesh
from wsim.scene.check.counts import MANY, MOST
from wsim.scene.curve import Curve, Motion
from wsim.scene.methods import point_objects
from wsim.scene.values import table

FAR = 1e5                   # [m] from the own origin: float32 resolves 8 mm there, and no cloth survives that
LARGE, SMALL = 30.0, 1e-3   # [m] a cloth beyond these is in the wrong unit more often than not
ROUNDED = 1e-5              # rounding of the points against the size of the cloth; a warning above
LIGHTEST = 1e-30            # [kg] inverse masses, times a stiffness, must stay below float32's 3e38
NEAR = 1e-6                 # of a size: what float32 and decimals round
RIGID = 1e-4                # departure of M^T M from the identity that transforms kept as float32 reach


def thing_error(path: str, found: str, allowed: str, mend: str, lacks: bool = False) -> Problem:
    return Problem(path, f"{found}; allowed: {allowed}; fix: {mend}", lacks=lacks)


def object_warning(path: str, found: str, expected: str, mend: str, overlap: bool = False) -> Problem:
    return Problem(path, f"{found}; expected: {expected}; fix: {mend}", False, overlap)


def three_digits(value: float, whole: Callable[[float], int]) -> float:
    """A value > 0 of three digits, as a message has it: the next below by math.floor, above by math.ceil."""
    unit = 10.0 ** (floor(log10(value)) - 2) if value > 0.0 else 1.0
    near = round(value / unit)
    return unit * (near if abs(near * unit - value) < NEAR * value else whole(value / unit))


def check_number(path: str, name: str, value: float, low: float, strict: bool = False, mend: str = "") -> Iterator[Problem]:
    """One number that must be finite and at least (strict: above) low."""
    number = isinstance(value, (Real, np.ndarray))                      # an array of one number counts as a number
    if not number or not isfinite(value) or value < low or (strict and value == low):
        allowed = "finite" + (f" and {'>' if strict else '>='} {low:g}" if low > -inf else "")
        found = f"{value:g}" if number else f"{value!r:.60}"
        yield thing_error(path, f"{name} is {found}", allowed, mend or f"author another {name}")


def check_step_count(path: str, name: str, value: float, least: int) -> Iterator[Problem]:
    """How many steps: at least so many, and not more than end in time."""
    yield from check_number(path, name, value, least)
    if value > MOST:
        yield thing_error(path, f"{name} is {value:g}", f"{least} to {MOST}", f"author fewer {name}")
    elif value > MANY:
        yield object_warning(path, f"{name} is {value:g}: a frame takes as many times the time of one", f"up to {MANY}",
                             f"author fewer {name}, where they are not meant")


def check_table_values(thing) -> Iterator[Problem]:
    """Numbers and vectors that an object (or the scene, at "/") has itself, by the bounds of the table of values."""
    path = getattr(thing, "path", "/")
    for name, row in table.values_of_class(type(thing).__name__).items():
        value: Any = getattr(thing, name, None)
        mend = row.mend or f"author another {row.usd.attribute if row.usd else name}"
        if row.form == "vector" and value is not None and (np.shape(value) != (3,) or not np.all(np.isfinite(value))):
            if isinstance(value, Curve):
                mend = f'leave it at its value at the start, and give the Curve to simulation.set("{path}", "{name}", curve)'
            yield thing_error(path, f"{name} is {value}", "three finite numbers", mend)
        elif row.form == "number" and np.ndim(value) == 0 and value is not None and not row.range.holds(value, True):
            yield thing_error(path, f"{name} is {value:g}", row.range.words, mend)


def check_point_array(path: str, name: str, value: np.ndarray | None, counts: tuple[int, ...],
                      low: float = -inf, strict: bool = False) -> Iterator[Problem]:
    """One row a point: how many there are (one of counts), NaN and infinity, and the range."""
    if value is None:
        return
    if len(value) not in counts:
        yield thing_error(path, f"{len(value)} {name}", " or ".join(map(str, counts)), f"author as many {name} as that")
    bad = ~np.isfinite(value.reshape(len(value), int(np.prod(value.shape[1:])))).all(axis=1)
    if bad.any():
        yield thing_error(path, f"{bad.sum()} of {len(bad)} {name} are NaN or infinite, first at index {np.argmax(bad)}",
                           "finite numbers", "export the prim again, or give them a value")
    small = (value <= low) if strict else (value < low)
    if small.any():
        k = int(np.argmax(small))
        mend = "author a larger value" + ("; to hold a point still, pin it" if name == "masses" else "")
        yield thing_error(path, f"{small.sum()} of {len(small)} {name} are too small, first {value[k]:g} at index {k}",
                           f"{'>' if strict else '>='} {low:g}", mend)


def check_column_matrices(path: str, motion: Motion) -> Iterator[Problem]:
    """Matrices whose last row has no place: those that act on rows have it there, and would leave a thing where it was."""
    wrong = np.any(motion.values[:, 3, :3] != 0.0, axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        yield thing_error(path,
                           f"the last row of its matrix at t = {motion.times[k]:g} s is {tuple(motion.values[k, 3].tolist())}",
                           "(0, 0, 0, 1): matrices act on columns", "transpose those that act on rows; author no perspective")


def check_placement(path: str, points: np.ndarray, motion: Motion) -> Iterator[Problem]:
    """Finite transforms that flatten nothing, and points near enough to their own origin for float32."""
    if not np.all(np.isfinite(motion.values)):
        yield thing_error(path, "its transform holds NaN or infinity", "finite numbers", "author its xformOps again")
        return
    yield from check_column_matrices(path, motion)
    A = motion.values[:, :3, :3]
    if np.any(np.linalg.det(A) == 0.0):
        yield thing_error(path, "its transform flattens it (determinant 0)", "a scale that is not 0", "author another scale")
    finite = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    away = float(np.abs(finite @ A[0].T).max(initial=0.0))
    if away > FAR:
        yield thing_error(path, f"points lie up to {away:.3g} m from the prim's own origin",
                           f"{FAR:g} m, where float32 resolves 8 mm",
                           "check metersPerUnit, or put the place into the prim's transform, which is kept in float64")


def check_rigid_motion(path: str, motion: Motion, mend: str) -> Iterator[Problem]:
    """M^T M = 1 and det M > 0 at every key: a turn and a shift, no scale, no mirror."""
    if not np.all(np.isfinite(motion.values)):
        yield thing_error(path, "its motion holds NaN or infinity", "finite numbers", "author its xformOps again")
        return
    yield from check_column_matrices(path, motion)
    A = motion.values[:, :3, :3]
    off = np.abs(np.swapaxes(A, 1, 2) @ A - np.eye(3)).max(axis=(1, 2))
    wrong = (off > RIGID) | (np.linalg.det(A) <= 0.0)
    if wrong.any():
        yield thing_error(path, f"its motion scales, shears or mirrors at t = {motion.times[np.argmax(wrong)]:g} s",
                           "a turn and a shift", mend)


def check_point_masses(path: str, masses: np.ndarray, why: str = "") -> Iterator[Problem]:
    """Points whose inverse mass is infinite in float32, or nearly."""
    bad = ~(masses >= LIGHTEST)
    if bad.any():
        k = int(np.argmax(bad))
        yield thing_error(path, f"{bad.sum()} points have next to no mass, first point {k} with {masses[k]:.3g} kg"
                           + (f" ({why})" if why else ""), f"{LIGHTEST:g} kg and more",
                           "give those points a rest shape with an area or volume, or author masses, a density, metersPerUnit")


def check_object_size(path: str, world: np.ndarray) -> Iterator[Problem]:
    extent = float(np.ptp(world, axis=0).max())
    if extent > LARGE or extent < SMALL:
        yield object_warning(path, f"it is {extent:.3g} m {'large' if extent > LARGE else 'small'}",
                             f"{SMALL:g} m to {LARGE:g} m", "author metersPerUnit on the stage: 1 if its numbers are metres, "
                             "0.01 if they are centimetres (which is also what USD takes when none is authored)")


def check_float32_rounding(path: str, points: np.ndarray) -> Iterator[Problem]:
    """float32 steps by up to 1.2e-7 of the value: far from the own origin that is much of a small body."""
    step = float(np.abs(points).max()) * float(np.finfo(np.float32).eps)
    extent = float(np.ptp(points, axis=0).max())
    if step > ROUNDED * extent > 0.0:
        yield object_warning(path, f"so far from its own origin its points are rounded to {step / extent:.1g} of its size",
                             f"below {ROUNDED:g}", "move the points to the origin, the place into the transform")


def check_surface(shape: Surface, path: str) -> list[Problem]:
    """Problems of polygons that are to be cut into triangles."""
    return mesh.check_polygon_mesh(path, shape.points, shape.counts, shape.indices, False)


def find_point_object(path: str, what: str, verb: str, named: str, scene: Scene) -> Generator[Problem, None, Any]:
    """The object whose points a pin, load or tie (`what`, at `path`) names; None after a problem: it is not there, or its
    method takes none."""
    there = point_objects(scene)
    found = next((thing for thing in there if thing.path == named), None)
    if found is None:
        nouns = "cloth, spring net, soft body" + ", rods" * (what != "tie") + " or material points"
        yield thing_error(path, f"it {verb} '{named}', which is no {nouns} here",
                           ", ".join(thing.path for thing in there[:5]) or "none, the scene has no body", "name one of them")
    elif why := found.refused.get(what):
        yield thing_error(path, f"it {verb} {named}, and {why}", f"an object that takes a {what}",
                           f"leave the {what} out, or name another")
        return None
    return found


def check_collider(thing: Collider) -> list[Problem]:
    path, shape = thing.path, thing.shape
    found = list(check_table_values(thing))
    if type(shape) not in (known := [Surface, *(each.shape for each in solids.SOLIDS)]):
        return [*found, thing_error(path, f"its shape is a {type(shape).__name__}", ", ".join(each.__name__ for each in known),
                                     "give it one of these")]
    if isinstance(shape, Surface):
        found += check_placement(path, shape.points, thing.motion)
        found += check_surface(shape, path)
        found += _check_animated_points(path, shape)
    elif not isinstance(shape, Plane):
        for f in fields(shape):
            may_vanish = f.name == "half_height"       # a capsule without a straight part is a sphere
            for value in np.atleast_1d(getattr(shape, f.name)):
                found += check_number(path, f.name, float(value), 0.0, not may_vanish, "author its size; its scale may be 0")
    elif shape.axis not in (None, "Z"):
        found.append(thing_error(path, f"its plane faces {shape.axis}, which came too late to turn it",
                                  "an axis given to a new Collider",
                                  f"make it by scene.collider({path!r}, Plane({shape.axis!r}))"))
    return [*found, *check_rigid_motion(path, thing.motion, "put the scale into the shape: radius, half, points")]


def _check_animated_points(path: str, shape: Surface) -> Iterator[Problem]:
    if shape.poses is None or hasattr(shape.poses, "skeleton"):         # checked with its skeleton
        return
    values = shape.poses.values
    if values.shape[1:] != shape.points.shape:
        yield thing_error(path, f"its animated points have shape {values.shape}", f"(keys, {len(shape.points)}, 3)",
                           "animate the points without changing their number")
    elif not np.all(np.isfinite(values)):
        yield thing_error(path, "its animated points hold NaN or infinity", "finite numbers", "export the animation again")
