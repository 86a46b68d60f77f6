"""What can be wrong with particles that constraints move. NumPy only."""

from collections.abc import Iterator
from dataclasses import fields
from math import ceil, inf
from typing import Any

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.particles.check_pour import check_free_places, check_pour_numbers, poured_places
from wsim.physics.particles.check_shapes import check_volume_shape
from wsim.physics.position_based.objects import MATERIALS, ConstraintFluid, Particles
from wsim.scene import Plane, Problem, Scene, Surface, solids
from wsim.scene.check.counts import MANY
from wsim.scene.check.objects import (
    check_number,
    check_placement,
    check_point_array,
    check_rigid_motion,
    object_warning,
    thing_error,
)

BRIGHTEST = 10.0       # part of a colour: lights of pictures may be brighter than 1
SMOOTHEST = 0.5        # of smoothing
DEEP = 0.5             # radii that a particle may begin within a solid
MOST_PARTICLES = 2e7   # that come: some 6 GB
UNLIKE = 50.0          # ratio of radii from which lists of the largest would hold very many of the smallest


def check(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """Problems of particles."""
    path, n = thing.path, len(thing.points)
    if thing.pour:
        yield from _check_pour(thing, scene)
        return
    if thing.shape is not None and (broken := list(_check_shape(thing))):
        yield from broken
        return
    if n == 0:
        yield thing_error(path, "no particles", "one at least", "give points")
        return
    yield from check_point_array(path, "points", thing.points, (n,))
    yield from check_placement(path, thing.points, thing.motion)
    yield from check_point_array(path, "velocities", thing.velocities, (n,))
    yield from check_point_array(path, "radii", thing.radius, (n, 1), 0.0, True)
    radius = thing.radius[thing.radius > 0.0]
    if len(radius) and radius.max() > UNLIKE * radius.min():
        yield thing_error(path, f"radii from {radius.min():g} to {radius.max():g} m", f"a ratio of {UNLIKE:g} at most",
                          "make the largest rigid bodies, or the smallest larger")
    if thing.velocity is not None and thing.velocity.shape != (3,):
        yield thing_error(path, f"velocity of shape {thing.velocity.shape}", "(3,) [m/s]", "give velocity=(0, -1, 0), say")
    yield from _check_colors(thing, n)
    yield from _check_material(thing)
    yield from _check_one_radius(thing, scene)
    yield from _check_explicit_steps(thing, scene)
    yield from _check_solver(thing, scene)


def _check_pour(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """Problems of a shape that pours."""
    path = thing.path
    if thing.shape is None:
        yield thing_error(path, "it pours, and has no shape", "a closed shape, or a PointCloud", "give a shape")
        return
    if np.shape(thing.radius) != (1,):
        yield thing_error(path, f"it pours, and has {len(thing.radius)} radii", "one radius", "give radius=0.01")
        return
    found = [*check_point_array(path, "radii", thing.radius, (1, 1), 0.0, True), *_check_material(thing),
             *check_rigid_motion(path, thing.motion, "put the scale into the shape's sizes"), *_check_shape(thing)]
    if thing.velocities is not None or np.ndim(np.asarray(thing.colors)) > 1:
        found.append(thing_error(path, "it pours, and has velocities or colours of each particle", "one velocity and colour",
                                 "give velocity=, and one colour"))
    else:
        found += _check_colors(thing, 1)
    yield from found
    if not found:
        found = list(check_pour_numbers(thing, scene, f"its radius is {thing.radius[0]:g} m", "a smaller radius"))
        yield from found
    if not any(problem.fatal for problem in found):
        yield from _check_count(thing, scene)
        yield from check_free_places(thing, scene, poured_places(thing), DEEP * float(thing.radius[0]))
    yield from _check_one_radius(thing, scene)
    yield from _check_explicit_steps(thing, scene)
    yield from _check_solver(thing, scene)


def _check_colors(thing: Particles, n: int) -> Iterator[Problem]:
    """Problems of the colours of n particles."""
    if thing.colors is None:
        return
    if thing.colors.shape not in ((3,), (n, 3)):
        yield thing_error(thing.path, f"colors of shape {thing.colors.shape}", f"(3,) or ({n}, 3)",
                          "give one of all, or one each")
    elif not np.isfinite(thing.colors).all() or thing.colors.min() < 0.0 or thing.colors.max() > BRIGHTEST:
        wrong = next(c for c in np.reshape(thing.colors, (-1, 3)) if not np.all((c >= 0.0) & (c <= BRIGHTEST)))
        yield thing_error(thing.path, f"a colour is ({', '.join(f'{v:g}' for v in wrong)})", "linear RGB, 0 to 1",
                          "divide parts of 255 by 255")


def _check_shape(thing: Particles) -> Iterator[Problem]:
    """Problems of what it pours from."""
    if isinstance(thing.shape, PointCloud):
        return
    if isinstance(thing.shape, Surface) or type(thing.shape) in [row.shape for row in solids.SOLIDS if row.shape is not Plane]:
        yield from check_volume_shape(thing.path, thing.shape)
    else:
        yield thing_error(thing.path, f"its shape is a {type(thing.shape).__name__}", "a closed shape or mesh, or a PointCloud",
                          "give it one of these")


def _check_count(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """An error of more particles than fit: room for all is reserved."""
    count = thing.pouring_shape().count_until(scene.frames / scene.fps)
    if count > MOST_PARTICLES:
        larger = thing.radius[0] * (count / MOST_PARTICLES) ** (1 / 3)
        yield thing_error(thing.path, f"{count:.3g} particles come in {scene.frames} frames",
                          f"{MOST_PARTICLES:.3g}, for which there is room",
                          f"give a radius of {larger:.2g} m, an earlier end, a lower rate or fewer frames")


def _check_material(thing: Particles) -> Iterator[Problem]:
    path, m = thing.path, thing.material
    if type(m) not in MATERIALS.values():
        yield thing_error(path, f"material is {m!r:.60}", f"one of {', '.join(MATERIALS)}, or one of their classes",
                          'give material="grains"')
        return
    yield from check_number(path, "density", m.density, 0.0, True)
    for f in fields(m):
        if f.name != "density" and not (f.name == "rolling_friction" and getattr(m, f.name) in (None, inf)):
            yield from check_number(path, f.name, getattr(m, f.name), 0.0)
    if getattr(m, "smoothing", 0.0) > SMOOTHEST:
        yield thing_error(path, f"smoothing is {m.smoothing:g}", f"0 to {SMOOTHEST:g}", "author viscosity for a thick fluid")
    if thing.is_fluid and len(thing.radius) and np.ptp(thing.radius) > 0.0:
        yield thing_error(path, f"radii from {thing.radius.min():g} to {thing.radius.max():g} m", "one radius of a fluid",
                          "author one width")


def _check_one_radius(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """All fluids of a scene have one radius, by which their densities are measured."""
    fluids = [other for other in scene.things("Particles") if other.is_fluid]
    if thing.is_fluid and len(thing.radius) and thing is not fluids[0] and len(fluids[0].radius) \
            and thing.radius[0] != fluids[0].radius[0]:
        yield thing_error(thing.path, f"radius is {thing.radius[0]:g} m, that of {fluids[0].path} {fluids[0].radius[0]:g} m",
                          "one radius for all fluids of a scene", "fill both with particles of one radius")


def _check_explicit_steps(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """Warnings of more surface tension or viscosity than explicit substeps carry; it is cut to that."""
    m: Any = thing.material
    if not (isinstance(m, ConstraintFluid) and len(thing.radius) and isinstance(m.density, float | int)
            and scene.fps > 0.0 and scene.substeps > 0):
        return
    limits = ("surface_tension", "N/m", m.tension_limit, 2), ("viscosity", "Pa s", m.viscosity_limit, 1)      # order in 1 / h
    for name, unit, limit, order in limits:
        value, most = getattr(m, name), limit(float(thing.radius[0]), 1.0 / (scene.fps * scene.substeps))
        if isinstance(value, float | int) and 0.0 < most < value < inf:
            fewest = ceil(scene.substeps * (value / most) ** (1.0 / order))
            say = f"give {fewest} substeps, or larger particles" if fewest < MANY else f"give larger particles, or less {name}"
            yield object_warning(thing.path, f"{name} is {value:g} {unit}, and acts as {most:.2g}",
                                 f"what {scene.substeps} substeps carry", say)


def _check_solver(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """Particles move in the iterations of XPBD, or before Newton steps, with backward Euler."""
    if scene.solver not in ("auto", "xpbd", "implicit"):
        yield thing_error(thing.path, f"solver is {scene.solver}", "xpbd, implicit, or auto, which chooses for particles",
                          "author wsim:solver = xpbd; or take material points, which need none")
    if scene.integrator not in ("auto", "backward_euler"):
        yield thing_error(thing.path, f"integrator is {scene.integrator}", "backward_euler, or auto",
                          "author wsim:integrator = auto")
    if scene.contact_width > 0.0:
        yield thing_error(thing.path, f"contact_width is {scene.contact_width:g} m", "0 beside particles",
                          "their contacts are hard: author wsim:contactWidth = 0")
