"""What can be wrong with one body of clusters by itself. NumPy only; see `wsim.scene.check.scene`."""

from collections.abc import Iterator
from math import inf
from numbers import Real

import numpy as np

from wsim.physics.soft.clusters.groups import FLAT, lies_in_line, spread_of_group
from wsim.physics.soft.clusters.objects import Clusters
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import (
    check_float32_rounding,
    check_number,
    check_object_size,
    check_placement,
    check_point_array,
    check_point_masses,
    object_warning,
    thing_error,
)


def check(thing: Clusters, scene: Scene) -> list[Problem]:
    """Problems of a body of clusters."""
    path, n = thing.path, len(thing.points)
    if not n:
        return [thing_error(path, "it has no points", "three points or more, not in a line", "author them again")]
    found = [*check_point_array(path, "points", thing.points, (n,)), *check_placement(path, thing.points, thing.motion)]
    found += check_point_array(path, "rest points", thing.rest_points, (n,))
    if not found:
        found += [*check_object_size(path, thing.motion.points(thing.points)), *check_float32_rounding(path, thing.points)]
    found += check_point_array(path, "velocities", thing.velocities, (n,))
    found += [*_check_masses(thing), *_check_numbers(thing), *_check_surface(thing, scene)]
    named = list(_check_members(thing))
    found += named
    if not any(p.fatal for p in found):
        found += _check_groups(thing)
    return found


def _check_masses(thing: Clusters) -> Iterator[Problem]:
    path, n = thing.path, len(thing.points)
    if thing.masses is None and not (isinstance(thing.mass, Real) and 0.0 < thing.mass < inf):
        given = f"{thing.mass:g}" if isinstance(thing.mass, Real) else f"{thing.mass!r:.60}"
        said = "no mass" if thing.mass is None else f"a mass of {given} kg"
        yield thing_error(path, f"it has {said}", "mass [kg] of the whole, finite and > 0, or masses of its points",
                          "give mass=1.0, say; in USD physics:mass of PhysicsDeformableBodyAPI")
        return
    bad = list(check_point_array(path, "masses", thing.masses, (n, 1), 0.0, True))
    yield from bad or check_point_masses(path, thing.point_masses())


def _check_numbers(thing: Clusters) -> Iterator[Problem]:
    """Stiffness, cubes, plasticity, radius, friction."""
    path = thing.path
    finite = ("damping", "creep", "radius", "static_friction", "dynamic_friction")
    for name in ("stiffness", "spacing", "yield_strain", "max_strain", *finite):
        strict, endless = name in ("stiffness", "spacing"), name not in finite
        value = getattr(thing, name)
        if not (endless and value == inf):
            allowed = f"{'>' if strict else '>='} 0" + ", or inf" * endless
            yield from (Problem(path, f"{name} is {value!r:.40}; allowed: {allowed}; fix: give another {name}")
                        for _ in check_number(path, name, value, 0.0, strict))
    if not 0.0 <= thing.overlap <= 1.0:
        yield thing_error(path, f"overlap is {thing.overlap:g}", "0 to 1 of the spacing", "give 0.25, say")


def _check_surface(thing: Clusters, scene: Scene) -> Iterator[Problem]:
    """Polygons of a surface name its points."""
    path, n, counts = thing.path, len(thing.points), thing.counts.astype(np.int64)
    if (counts < 3).any():
        k = int(np.argmax(counts < 3))
        yield thing_error(path, f"face {k} has {counts[k]} corners", "3 and more", "correct counts")
    elif counts.sum() != len(thing.indices):
        yield thing_error(path, f"its faces have {counts.sum()} corners, and {len(thing.indices)} are given", "as many",
                          "correct indices or counts")
    elif ((thing.indices < 0) | (thing.indices >= n)).any():
        yield thing_error(path, f"a face names point {thing.indices[np.argmax((thing.indices < 0) | (thing.indices >= n))]}",
                          f"0 to {n - 1}", "count from 0")
    if thing.meets_as_balls and not thing.radius > 0.0:
        yield thing_error(path, "self_collision is on, and it has neither a surface nor a radius", "polygons, or a radius > 0 "
                          "that makes its points balls", "give counts and indices, or radius=0.01, say")
    other = next((body.path for body in scene.bodies() if body.self_collision), None)
    if other is not None and not thing.self_collision:
        yield object_warning(path, f"it has no self_collision: it passes through {other}, which has", "self_collision of both",
                             "give it a surface (counts, indices) and self_collision=True; in USD a Mesh with "
                             "wsim:selfCollision")


def _check_members(thing: Clusters) -> Iterator[Problem]:
    """Clusters by name: as many members as they have, each a point of the body, none twice in a cluster."""
    path, n, sizes = thing.path, len(thing.points), thing.sizes
    if sizes is None:
        if thing.members is not None:
            yield thing_error(path, "it has members and no sizes", "both, or none", "give the number of points of each cluster")
        return
    members = np.zeros(0, np.int32) if thing.members is None else thing.members
    if not len(sizes) or (sizes < 1).any() or sizes.sum() != len(members):
        yield thing_error(path, f"sizes of clusters are {np.array2string(sizes, threshold=6)} for {len(members)} members",
                          "sizes >= 3 whose sum is the number of members", "correct sizes or members")
        return
    bad = (members < 0) | (members >= n)
    if bad.any():
        yield thing_error(path, f"members[{np.argmax(bad)}] is {members[np.argmax(bad)]}", f"0 to {n - 1}", "count from 0")
        return
    pairs = np.sort(np.repeat(np.arange(len(sizes)), sizes) * np.int64(n) + members)
    if (pairs[1:] == pairs[:-1]).any():
        k = int(pairs[1:][pairs[1:] == pairs[:-1]][0] // n)
        yield thing_error(path, f"cluster {k} names a point twice", "each point once", "take it out")


def _check_groups(thing: Clusters) -> Iterator[Problem]:
    """Each cluster has a rotation, and each point a cluster."""
    path, rest = thing.path, thing.rest_places()
    groups = thing.groups
    for k, group in enumerate(groups):
        if lies_in_line(rest[group]):
            what = f"{len(group)} point{'s' * (len(group) > 1)}, whose rotation is not determined" if len(group) < 3 else \
                f"{len(group)} points in a line (or in one place), whose rotation is not determined"
            yield thing_error(path, f"cluster {k} of {len(groups)} has {what}", "three points or more, not in a line",
                              "give larger clusters (spacing), or points beside the line")
            return
    spreads = [spread_of_group(rest[group]) for group in groups] if thing.flows else []
    if spreads and all(s[0] < FLAT * s[2] for s in spreads):
        yield thing_error(path, f"its clusters are flat, and it has a yield_strain of {thing.yield_strain:g}: flat ones do not "
                          "flow", "points in three dimensions, or yield_strain inf", "leave it off, or give it thickness")
    alone = np.flatnonzero(np.bincount(np.concatenate(groups), minlength=len(rest)) == 0)
    if len(alone):
        yield thing_error(path, f"{len(alone)} of its points are in no cluster, first point {alone[0]}", "each in one or more",
                          "name them in members, or take them out")
