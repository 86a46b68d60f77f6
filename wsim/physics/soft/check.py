"""What can be wrong with one soft body by itself: its tets, arrays, materials, skins. NumPy only; see
`wsim.scene.check.scene`."""

from collections.abc import Iterator
from math import inf

import numpy as np

from wsim.geometry.tetra import tets
from wsim.geometry.tetra.repair import repair_tets
from wsim.physics.soft.objects import Skin, Soft
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import (
    check_float32_rounding,
    check_object_size,
    check_placement,
    check_point_array,
    check_point_masses,
    check_table_values,
    object_warning,
    thing_error,
)
from wsim.scene.nodal.masses import soft_masses

SOFTEST, STIFFEST = 10.0, 1e12      # [Pa] E of a jelly that cannot stand, ten times that of diamond
LIGHTEST, HEAVIEST = 1.0, 3e4       # [kg/m^3] air; osmium has 2.3e4


def check(thing: Soft, scene: Scene) -> list[Problem]:
    """Problems of a soft body. Rest shape and winding are judged in the world, where volumes must be positive."""
    path, n, t = thing.path, (len(thing.points),), (len(thing.tets),)
    if not n[0]:
        return [thing_error(path, "it has no points", "a tet and its four points, or more", "author them again")]
    found = [*check_point_array(path, "points", thing.points, n), *check_placement(path, thing.points, thing.motion)]
    found += check_point_array(path, "rest points", thing.rest_points, n)
    if not found:
        found += [*_check_tets(thing), *check_object_size(path, thing.motion.points(thing.points)),
                  *check_float32_rounding(path, thing.points)]
    found += check_point_array(path, "velocities", thing.velocities, n)
    found += check_point_array(path, "masses", thing.masses, n, 0.0, True)
    found += [*check_table_values(thing), *check_point_array(path, "filled", thing.filled, t, 0.0),
              *_check_tet_materials(thing), *_check_material_units(thing), *check_unsupported_material(thing)]
    sound = not any(p.fatal for p in found)
    if sound:
        rest = thing.points if thing.rest_points is None else thing.rest_points
        found += check_point_masses(path, soft_masses(thing, thing.motion.points(rest))[0])
    for skin in thing.skins:
        found += _check_skin_points(thing, skin, sound)
    return found


def _check_tets(thing: Soft) -> Iterator[Problem]:
    """Winding, flatness, copies, points that are idle or doubled, coarseness. Arrays are finite here."""
    path, rest = thing.path, thing.points if thing.rest_points is None else thing.rest_points
    _, turned, flaws = repair_tets(thing.motion.points(rest), thing.tets)
    if len(turned):
        yield thing_error(path,
                           f"{len(turned)} of its {len(thing.tets)} tets are turned inside out at rest, first tet {turned[0]}",
                           "a positive volume (x1 - x0) . (x2 - x0) x (x3 - x0) / 6 in the world",
                           "swap the last two corners of each (wsim.geometry.tetra.repair.repair_tets does), or correct the "
                           "rest shape")
    yield from (Problem(path, flaw.text, flaw.fatal) for flaw in flaws)
    if not thing.quadratic and not any(flaw.fatal for flaw in flaws):
        coarse = tets.describe_coarseness(tets.cells_across_thickness(thing.tets))
        if coarse:
            yield Problem(path, coarse, False)


def _check_tet_materials(thing: Soft) -> Iterator[Problem]:
    """Which material each tet has, and how much of it is body."""
    path, count, materials = thing.path, len(thing.tets), len(thing.materials)
    which = thing.which
    if which is not None:
        if len(which) != count:
            yield thing_error(path, f"{len(which)} values of which", f"{count}, one a tet", "give as many")
        bad = (which < 0) | (which >= materials)
        if bad.any():
            k = int(np.argmax(bad))
            yield thing_error(path, f"which[{k}] is {which[k]}: tet {k} has a material that there is not",
                               f"0 to {materials - 1}", "0 is material, k is others[k - 1]")
    used = {0} if which is None else set(which.tolist())
    idle = [k for k in range(1, materials) if k not in used]
    if idle:
        yield object_warning(path, f"material {idle[0]} of {materials} (counted from 0) is that of no tet", "some tets",
                             "name tets by which (a GeomSubset), or take it out")
    if thing.filled is not None and (thing.filled > 1.0).any():
        k = int(np.argmax(thing.filled > 1.0))
        yield thing_error(path, f"filled[{k}] is {thing.filled[k]:g}", "0 to 1", "give the part of tet {k} that is body")


def _check_material_units(thing: Soft) -> Iterator[Problem]:
    """Numbers that are possible, and yet in the wrong unit more often than not."""
    for k, material in enumerate(thing.materials):
        for name, value, low, high, unit in (("E", material.young, SOFTEST, STIFFEST, "Pa"),
                                             ("density", material.density, LIGHTEST, HEAVIEST, "kg/m^3")):
            if not low <= value <= high:
                which = f"material {k}" if thing.others else "its material"
                yield object_warning(thing.path, f"{which} has {name} = {value:g} {unit}", f"{low:g} to {high:g} {unit}",
                                     "author it in stage units (metersPerUnit, kilogramsPerUnit), or set those to what was "
                                     "meant")


def check_unsupported_material(thing: Soft) -> Iterator[Problem]:
    """Problems of what a scene can say and no solver does yet."""
    for material in thing.materials:
        if material.yield_strain < inf and thing.quadratic:
            yield thing_error(thing.path, f"yield strain is {material.yield_strain:g}: quadratic tets do not flow yet",
                               "inf, or " "linear tets", "leave wsim:yieldStrain of its material off, or wsim:quadratic")


def _check_skin_points(thing: Soft, skin: Skin, sound: bool) -> Iterator[Problem]:
    """Finite points near the body (where that is sound), and faces that name them."""
    yield from check_point_array(skin.path, "points", skin.points, (len(skin.points),))
    counts, indices = skin.counts.astype(np.int64), skin.indices
    few = counts < 3
    if few.any():
        k = int(np.argmax(few))
        yield thing_error(skin.path, f"face {k} has {counts[k]} corners", "3 and more", "correct faceVertexCounts")
    elif counts.sum() != len(indices):
        yield thing_error(skin.path, f"its faces have {counts.sum()} corners, and {len(indices)} are given", "as many",
                           "correct faceVertexIndices or faceVertexCounts")
    bad = (indices < 0) | (indices >= len(skin.points))
    if bad.any():
        k = int(np.argmax(bad))
        yield thing_error(skin.path, f"corner {k} names point {indices[k]}", f"0 to {len(skin.points) - 1}",
                           "count from 0, in the order of its points")
    if not sound or not np.isfinite(skin.points).all() or len(skin.points) == 0:
        return
    rest = thing.motion.points(thing.points if thing.rest_points is None else thing.rest_points)
    places, reach = thing.motion.points(skin.points), float(np.sqrt(tets.volumes_and_squared_edges(rest, thing.tets)[1].max()))
    rest = rest[np.unique(thing.tets)]
    away = np.maximum(rest.min(axis=0) - places, places - rest.max(axis=0)).max(axis=1)
    if away.max() > reach:                       # a point nearer is found, or refused, when it is tied to a tet
        k = int(np.argmax(away))
        yield thing_error(skin.path, f"point {k} lies {away[k]:.3g} m outside of {thing.path} at rest",
                           f"in its tets, or nearer than their longest edge, {reach:.3g} m",
                           "check its transform, or its points in the bind pose")
