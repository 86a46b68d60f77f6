"""What can be wrong with one object by itself: its numbers, its transform, its surface, its size. NumPy only.

Each rule yields Problems in one form: what was found, what is allowed (or expected, for a warning) and the mend.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from math import floor, inf, isfinite, log10
from typing import Any

import numpy as np

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import CLOTH_MODELS, Cloth, Collider, Plane, Problem, Springs, Surface, solids
from wsim.scene.check import mesh
from wsim.scene.check.counts import MANY, MOST
from wsim.scene.curve import Curve, Motion
from wsim.scene.nodal.masses import cloth_masses
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
    if not isfinite(value) or value < low or (strict and value == low):
        allowed = "finite" + (f" and {'>' if strict else '>='} {low:g}" if low > -inf else "")
        yield thing_error(path, f"{name} is {value:g}", allowed, mend or f"author another {name}")


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


def check_surface(thing: Cloth | Surface, path: str, motion: Motion | None = None) -> list[Problem]:
    """Polygons that can be cut into triangles; a cloth (with its motion) is seen as simulated: seams welded."""
    found = mesh.check_polygon_mesh(path, thing.points, thing.counts, thing.indices, isinstance(thing, Cloth))
    if motion is None or any(p.fatal for p in found) or not isinstance(thing, Cloth) or not 0.0 < thing.weld < inf:
        return found
    try:
        particle = topology.weld_points(motion.points(thing.points), thing.weld)
    except ValueError as wrong:
        return [*found, Problem(path, str(wrong))]
    first = np.unique(particle, return_index=True)[1]
    welded = mesh.check_polygon_mesh(path, thing.points[first], thing.counts, particle[thing.indices])
    return [Problem(path, f"{p.text} (once points closer than weld = {thing.weld:g} m are one: lower weld)", p.fatal)
            if p.fatal else p for p in welded]


def check_cloth(thing: Cloth) -> list[Problem]:
    path, n = thing.path, (len(thing.points),)
    found = list(check_placement(path, thing.points, thing.motion))
    found += check_surface(thing, path, None if found else thing.motion)
    if not any(p.fatal for p in found):
        found += [*check_object_size(path, thing.motion.points(thing.points)), *check_float32_rounding(path, thing.points)]
    found += check_point_array(path, "velocities", thing.velocities, n)
    found += check_point_array(path, "rest points", thing.rest_points, n)
    found += check_point_array(path, "masses", thing.masses, n, 0.0, True)
    found += check_point_array(path, "thicknesses", thing.thicknesses, n, 0.0, True)
    found += check_point_array(path, "stretches", thing.stretches, (len(thing.counts),), 0.0, True)
    found += check_point_array(path, "bends", thing.bends, (len(thing.counts),), 0.0)
    found += check_table_values(thing)
    if thing.model not in CLOTH_MODELS:
        found.append(thing_error(path, f"model is '{thing.model}'", " or ".join(CLOTH_MODELS), "choose one of them"))
    if thing.model == "springs" and thing.material.weft > 0.0:
        found.append(thing_error(path, f"weft is {thing.material.weft:g} and the model is 'springs', which has one stretch",
                                  "0 there", "take the model 'membrane'"))
    if not any(p.fatal for p in found):
        found += _check_rest_areas(thing)
    return found


def _check_rest_areas(thing: Cloth) -> Iterator[Problem]:
    """Faces without area at rest, and what they leave without mass. The mesh is sound here."""
    triangles, polygon = triangulate_polygons(thing.points, thing.counts, thing.indices)
    rest = thing.motion.points(thing.points if thing.rest_points is None else thing.rest_points)
    flat = np.unique(polygon[topology.triangle_areas(rest, triangles) == 0.0])
    if len(flat) == len(np.unique(polygon)) and thing.masses is None:
        yield thing_error(thing.path, "none of its faces has an area at rest", "a rest shape with an area",
                           "author physics:restShapePoints again, or leave them out")
        return
    particle = topology.weld_points(thing.motion.points(thing.points), thing.weld) if thing.weld > 0.0 else np.arange(len(rest))
    yield from check_point_masses(thing.path, np.bincount(particle, cloth_masses(thing, triangles, rest))[particle],
                                  "each face there has no area at rest" if len(flat) else "")
    if len(flat):
        yield object_warning(thing.path, f"{len(flat)} faces have no area at rest, first face {flat[0]}: they resist nothing",
                             "faces with an area", "move their rest points apart, or remove them")


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


def check_spring_net(net: Springs) -> list[Problem]:
    path, n, m = net.path, len(net.points), len(net.edges)
    found = [*check_point_array(path, "points", net.points, (n,)), *check_placement(path, net.points, net.motion)]
    found += list(check_point_array(path, "masses", net.masses, (n, 1), 0.0, True)) or check_point_masses(path, net.masses)
    found += check_point_array(path, "velocities", net.velocities, (n,))
    found += check_point_array(path, "stiffnesses", net.stiffness, (m, 1), 0.0, True)
    found += check_point_array(path, "rest lengths", net.lengths, (m,), 0.0, True)
    found += check_table_values(net)
    found += check_muscles(net)
    if m == 0:
        found.append(thing_error(path, "a net without springs", "at least one", "author curves of two or more points"))
    bad = ((net.edges < 0) | (net.edges >= n)).any(axis=1)
    if bad.any():
        k = int(np.argmax(bad))
        return [*found, thing_error(path, f"spring {k} joins points {net.edges[k].tolist()}", f"0 to {n - 1}",
                                     "name points of this net")]
    p, q = net.points[net.edges[:, 0]], net.points[net.edges[:, 1]]
    zero = (net.edges[:, 0] == net.edges[:, 1]) | ((p == q).all(axis=1) & (net.lengths is None))
    if zero.any():
        k = int(np.argmax(zero))
        found.append(thing_error(path, f"{zero.sum()} springs are of length 0, first spring {k} on points "
                                  f"{net.edges[k].tolist()}", "> 0", "make the two points one, or give rest lengths"))
    return found


def check_muscles(net: Springs) -> Iterator[Problem]:
    """Factors over time, and which spring is of which group."""
    path, m, curve = net.path, len(net.edges), net.actuation
    if curve is None:
        if net.muscles is not None:
            yield thing_error(path, "muscles without an actuation", "both, or none", "author wsim:actuation, or leave them out")
        return
    yield from check_point_array(path, "factors of actuation", curve.values.ravel(), (curve.values.size,), 0.0, True)
    if not curve.plain and not (least := float(np.min(curve.bounds()[0]))) > 0.0:
        yield thing_error(path, f"factors of actuation down to {least:g} between or outside of their keys (kind {curve.kind})",
                           "> 0", "take kind monotone, which stays between its keys, or hold it outside of them")
    if not np.isfinite(curve.times).all():
        yield thing_error(path, "times of actuation that are no numbers", "finite ones", "author its keys again")
    groups, of = curve.values.shape[1], np.zeros(m, np.int32) if net.muscles is None else net.muscles
    if len(of) != m:
        yield thing_error(path, f"{len(of)} muscles", f"{m}, the group of each spring", "author -1 for a spring that is none")
    bad = (of < -1) | (of >= groups)
    if bad.any():
        k = int(np.argmax(bad))
        yield thing_error(path, f"spring {k} is of muscle group {of[k]}",
                           f"-1 (passive) to {groups - 1}: actuation has {groups} "
                           "groups", "name one of them, or give the actuation more values a key")
    elif missing := sorted(set(range(groups)) - set(of.tolist())):
        yield object_warning(path, f"no spring is of muscle group {missing[0]}", f"springs in each of {groups} groups",
                             "leave the group out of wsim:actuation")


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
