"""What can be wrong with bodies of the material point method. NumPy only."""

from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.contact.collider.shells import has_obstacles
from wsim.physics.mpm.actions.check_actions import check_actions
from wsim.physics.mpm.implicit.choice import (
    IMPLICIT_MATERIALS,
    INTEGRATORS,
    WAY,
    chosen_integrator,
    explicit_steps,
    has_implicit_steps,
    materials_of,
)
from wsim.physics.mpm.memory import check_memory
from wsim.physics.mpm.objects import CONES, MATERIALS, Granular, Jelly, MaterialPoints, MaterialSink, Snow, Water
from wsim.physics.mpm.seeding import coarsened, place_particles
from wsim.physics.mpm.sources.check_flow import check_pour, check_sink, check_start
from wsim.physics.particles.check_shapes import check_extent, check_volume_shape
from wsim.scene import Problem, Scene, Surface, solids
from wsim.scene.check.objects import check_number, check_rigid_motion, object_warning, thing_error

MOST = 100_000             # steps of a frame, as kernels/particles/mpm/steps.py
LOOKS = 64                 # cells across a shape, at most, when its particles are looked at
STIFFEST = 1e24            # [Pa] that products in single precision hold
SPARSE = 1.5               # cells between points, beyond which what is whole comes apart


def check(thing: MaterialPoints | MaterialSink, scene: Scene) -> Iterator[Problem]:
    """Problems of one body, or of a sink."""
    if isinstance(thing, MaterialSink):
        yield from check_sink(thing, scene)
        if not (scene.things("MaterialPoints") or scene.things("Particles")):
            yield object_warning(thing.path, "it is a sink, and there are no particles", "a body of `scene.mpm` or "
                                 "`scene.particles`", "add one")
        return
    found = [*(problem for material in thing.materials for problem in check_material(thing.path, material)),
             *check_number(thing.path, "cell", thing.cell, 0.0, True), *check_places(thing),
             *check_rigid_motion(thing.path, thing.motion, "put the scale into the shape's sizes")]
    yield from found
    first = scene.things("MaterialPoints")[0]
    if thing.cell != first.cell and isfinite(first.cell) and isfinite(thing.cell):
        yield thing_error(thing.path, f"cell is {thing.cell:g} m, and {first.path} has {first.cell:g} m",
                           "one cell size for all", f"give it cell={first.cell:g}")
    wrong = list(check_integrator(thing, scene))
    yield from wrong
    if not any(problem.fatal for problem in [*found, *wrong]):
        for material in thing.materials:
            yield from check_step(thing, material, scene)
        yield from check_speed(thing, scene)
        if thing.pour:
            found = list(check_pour(thing, scene))
            yield from found
        elif thing.points is None and not len(place_particles(coarsened(thing, LOOKS)).x):
            yield thing_error(thing.path, f"its shape holds no particle: cells are {thing.cell:g} m",
                               "a shape of a cell or more", "give smaller cells, or a larger shape")
            return
        if not any(problem.fatal for problem in found):
            yield from check_actions(thing, scene)
            yield from check_start(thing, scene)
            yield from check_memory(thing, scene)


def check_material(path: str, m: Any) -> Iterator[Problem]:
    """Problems of a material's numbers."""
    if type(m) not in MATERIALS.values():
        yield thing_error(path, f"material is {m!r}", f"Jelly, Snow, Granular, Water, or one of {', '.join(MATERIALS)}",
                           "give it one of these")
        return
    yield from check_number(path, "density", m.density, 0.0, True)
    yield from check_number(path, "viscosity", m.viscosity, 0.0)
    for name in ("young", "bulk"):
        if isfinite(value := getattr(m, name, 0.0)) and value > STIFFEST:
            yield thing_error(path, f"{name} is {value:.3g} Pa", f"up to {STIFFEST:g} Pa, which single precision holds",
                              f"give another {name}, or make it a rigid body")
    if isinstance(m, Snow):
        yield from check_number(path, "hardening", m.hardening, 0.0)
        yield from check_number(path, "tension_limit", m.tension_limit, 0.0)
        if not 0.0 <= m.compression_limit < 1.0:
            yield thing_error(path, f"compression_limit is {m.compression_limit:g}", "0 up to 1", "give another, such as 0.025")
    if isinstance(m, Water):
        yield from check_number(path, "bulk", m.bulk, 0.0, True)
        yield from check_number(path, "exponent", m.exponent, 1.0, True)
        return
    yield from check_number(path, "young", m.young, 0.0, True)
    if not -1.0 < m.poisson < 0.5:
        yield thing_error(path, f"poisson is {m.poisson:g}", "above -1 and below 0.5", "give another, such as 0.3")
    if isinstance(m, Jelly) and m.model not in ("neo_hookean", "corotational"):
        yield thing_error(path, f"model is {m.model!r}", "neo_hookean, corotational", "give it one of these")
    if isinstance(m, Granular):
        yield from check_number(path, "cohesion", m.cohesion, 0.0)
        if m.cone not in CONES:
            yield thing_error(path, f"cone is {m.cone!r}", ", ".join(CONES), "give it one of these")
        if not 0.0 <= m.friction_angle < 0.5 * np.pi:
            yield thing_error(path, f"friction_angle is {m.friction_angle:g} rad", "0 up to pi / 2",
                               "give radians, such as 0.6")


def check_places(thing: MaterialPoints) -> Iterator[Problem]:
    """Problems of the shape or the points."""
    path, points = thing.path, thing.points
    if (thing.shape is None) == (points is None):
        has = "neither a shape nor points" if points is None else "a shape and points"
        yield thing_error(path, f"it has {has}", "one of them", "give a shape, or points and volumes")
    elif points is None:
        known = [each.shape for each in solids.SOLIDS] + [PointCloud] * bool(thing.pour)
        if isinstance(thing.shape, solids.Plane) or not isinstance(thing.shape, (Surface, *known)):
            yield thing_error(path, f"its shape is a {type(thing.shape).__name__}", "a closed shape, or a closed Surface",
                               "give it one of these")
        elif not isinstance(thing.shape, PointCloud):
            yield from check_volume_shape(path, thing.shape)
    elif thing.pour:
        yield thing_error(path, "it has points, and pours", "a shape that pours", "give a PointCloud of balls about the points")
    elif thing.volumes is None:
        yield thing_error(path, "its points have no volume", "volumes [m^3], one number or one a point",
                           f"give volumes={(0.5 * thing.cell) ** 3:.3g} where 8 points are in a cell", lacks=True)
    else:
        yield from check_points(thing)
    shapes = [(3,)] if points is None else [(3,), (len(points), 3)]
    for name, allowed in {"velocity": shapes, "spin": [(3,)]}.items():
        v = np.asarray(getattr(thing, name))
        if v.shape not in allowed or not np.isfinite(v).all():
            yield thing_error(path, f"{name} is of shape {v.shape}, or not finite", " or ".join(map(str, allowed)),
                               "give finite numbers of that shape")
    yield from check_rows(thing)


def check_rows(thing: MaterialPoints) -> Iterator[Problem]:
    """Problems of what each point has of its own."""
    n = None if thing.points is None else len(thing.points)
    rows: dict[str, list] = {"which": [(n,)], "ids": [(n,)], "widths": [(1,), (n,)], "colors": [(3,), (n, 3)]}
    for name, allowed in rows.items():
        value = getattr(thing, name)
        if value is None:
            continue
        if n is None and name != "colors" or np.shape(value) not in allowed or not np.isfinite(value).all():
            shapes = " or ".join(map(str, allowed)) if n is not None else "(3,) of colors alone, where it has a shape"
            yield thing_error(thing.path, f"{name} is of shape {np.shape(value)}, or not finite", shapes, "give such numbers")
        elif name == "which" and len(value) and not 0 <= value.min() <= value.max() <= len(thing.further):
            yield thing_error(thing.path, f"which goes from {value.min()} to {value.max()}", f"0 to {len(thing.further)}, the "
                               "number of further materials", "name materials that there are")
        elif name == "ids" and len(np.unique(value)) != len(value):
            yield thing_error(thing.path, "two of its ids are the same", "one for each point", "give others, or none")


def check_points(thing: MaterialPoints) -> Iterator[Problem]:
    """Problems of points that are given, and their volumes."""
    path, points, volumes = thing.path, thing.points, np.asarray(thing.volumes)
    assert points is not None
    if not len(points) or not np.isfinite(points).all():
        yield thing_error(path, f"it has {len(points)} points, or some are not finite", "one finite point or more",
                           "give others")
    elif volumes.shape not in ((), (1,), (len(points),)) or not (np.isfinite(volumes).all() and (volumes > 0.0).all()):
        yield thing_error(path, f"volumes are of shape {volumes.shape}, or not all above 0",
                           f"one number above 0, or {len(points)} of them [m^3]", "give others")
    elif thing.cell > 0.0:
        yield from check_extent(path, points, thing.cell)
        spacing = float(np.median(volumes) ** (1.0 / 3.0))
        if spacing > SPARSE * thing.cell and not any(isinstance(m, (Jelly, Snow)) for m in thing.materials):
            yield object_warning(path, f"a point has the volume of a cube of {spacing:.3g} m, and cells are {thing.cell:g} m: "
                                  "grains that are apart do not meet", f"cells of {spacing / SPARSE:.3g} m or more",
                                  f"give cells of {2.0 * spacing:.3g} m, or more points")
        elif spacing > SPARSE * thing.cell:
            yield thing_error(path,
                               f"a point has the volume of a cube of {spacing:.3g} m, and cells are {thing.cell:g} m: the body "
                               "would come apart", f"cells of {spacing / SPARSE:.3g} m or more",
                               f"give cells of {2.0 * spacing:.3g} m, or more points")
        elif spacing < 0.125 * thing.cell:
            yield object_warning(path, f"{(thing.cell / spacing) ** 3:.0f} points fill a cell", "about 8",
                                 f"give cells of {2.0 * spacing:.3g} m, which costs as much and shows more")


def check_integrator(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """Problems of what steps are asked for."""
    things, path = scene.things("MaterialPoints"), thing.path
    if thing.integrator not in INTEGRATORS:
        yield thing_error(path, f"integrator is {thing.integrator!r}", ", ".join(INTEGRATORS), "give it one of these")
        return
    other = next((each for each in things if each.integrator not in ("auto", thing.integrator)), None)
    if other and thing.integrator != "auto":
        yield thing_error(path, f"integrator is {thing.integrator}, and that of {other.path} is {other.integrator}",
                          "one for all bodies of a scene", "give all of them the same, or leave one at auto")
    elif thing.integrator == "implicit" and are_known(things) and not has_implicit_steps(things):
        laws = ", ".join(sorted({each.law for each in materials_of(things)}))
        yield thing_error(path, f"integrator is implicit, and the scene's materials are {laws}", IMPLICIT_MATERIALS,
                          'give integrator="explicit", or simulate the others in a scene of their own')
    elif thing.integrator == "implicit" and has_obstacles(scene):
        yield thing_error(path, "integrator is implicit, and the scene has rigid bodies, cloth or soft bodies that it pushes",
                          "explicit steps, which push and are pushed", 'give integrator="explicit"')


def are_known(things: list[MaterialPoints]) -> bool:
    """True if all bodies are of materials that there are."""
    return all(type(each) in MATERIALS.values() for each in materials_of(things))


def check_speed(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """An error of what would cross more cells in a frame than its steps hold."""
    most = WAY * thing.cell * MOST * scene.fps
    speed = float(np.abs(np.asarray(thing.velocity)).max(initial=0.0))
    if speed > most > 0.0:
        yield thing_error(thing.path, f"velocity is up to {speed:.3g} m/s", f"{most:.3g} m/s, which {MOST} steps a frame hold",
                          "give a lower speed, larger cells or more frames a second")


def check_step(thing: MaterialPoints, material: Any, scene: Scene) -> Iterator[Problem]:
    """An error where a frame would take more explicit steps than there may be."""
    things = scene.things("MaterialPoints")
    if not are_known(things) or chosen_integrator(things, scene.fps, has_obstacles(scene)) == "implicit":
        return
    steps, length = explicit_steps(material, thing.cell, scene.fps)
    if not isfinite(steps) or steps > MOST:
        name = "bulk" if isinstance(material, Water) else "young"
        now = getattr(material, name)
        may = has_implicit_steps(things) and not has_obstacles(scene)
        or_implicit = ', or integrator="implicit"' if may else ""
        yield thing_error(thing.path, f"{name} is {now:.3g} Pa: a frame would take {steps:.3g} steps of {length:.2g} s, "
                          "the longest that hold it", f"up to {MOST} steps a frame",
                          f"give {name}={now * (MOST / steps) ** 2:.2g} or less, cells of {thing.cell * steps / MOST:.2g} m, "
                          f"{scene.fps * steps / MOST:.2g} fps{or_implicit}")
