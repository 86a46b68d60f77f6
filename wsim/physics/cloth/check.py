"""What can be wrong with one cloth by itself: its polygons, arrays, material. NumPy only."""

from collections.abc import Iterator
from math import inf

import numpy as np

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.cloth.objects import CLOTH_MODELS, Cloth
from wsim.scene import Problem, Scene
from wsim.scene.check import mesh
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
from wsim.scene.nodal.masses import cloth_masses

SLACK, RIGID = 1e-3, 1e9                # [N/m] thin gel; five times a plate of steel of 1 mm


def check(thing: Cloth, scene: Scene) -> list[Problem]:
    """Problems of a cloth."""
    path, n = thing.path, (len(thing.points),)
    found = list(check_placement(path, thing.points, thing.motion))
    found += _check_sheet_surface(thing, not found)
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
        found += [*_check_rest_areas(thing), *_check_fabric_units(thing)]
    return found


def _check_sheet_surface(thing: Cloth, sound: bool) -> list[Problem]:
    """Problems of its polygons: as given, and, where its places are sound, as they are simulated: seams welded."""
    path = thing.path
    found = mesh.check_polygon_mesh(path, thing.points, thing.counts, thing.indices, True)
    if not sound or any(p.fatal for p in found) or not 0.0 < thing.weld < inf:
        return found
    try:
        particle = topology.weld_points(thing.motion.points(thing.points), thing.weld)
    except ValueError as wrong:
        return [*found, Problem(path, str(wrong))]
    first = np.unique(particle, return_index=True)[1]
    welded = mesh.check_polygon_mesh(path, thing.points[first], thing.counts, particle[thing.indices])
    return [Problem(path, f"{p.text} (once points closer than weld = {thing.weld:g} m are one: lower weld)", p.fatal)
            if p.fatal else p for p in welded]


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


def _check_fabric_units(cloth: Cloth) -> Iterator[Problem]:
    """A stretch that is possible, and yet in the wrong unit more often than not."""
    if not SLACK <= (stretch := cloth.material.stretch) <= RIGID:
        yield object_warning(cloth.path, f"its stretch is {stretch:g} N/m", f"{SLACK:g} to {RIGID:g} N/m",
                             "author it in stage units (metersPerUnit, kilogramsPerUnit), or set those to what was meant")
