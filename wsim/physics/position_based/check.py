"""What can be wrong with particles that constraints move. NumPy only."""

from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from wsim.physics.position_based.objects import MATERIALS, Particles
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import check_number, check_placement, check_point_array, thing_error

SMOOTHEST = 0.5        # of smoothing
UNLIKE = 50.0          # ratio of radii from which lists of the largest would hold very many of the smallest


def check(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """Problems of particles."""
    path, n = thing.path, len(thing.points)
    if n == 0:
        yield thing_error(path, "no particles", "one at least", "give points, a larger shape, or a smaller radius")
        return
    yield from check_point_array(path, "points", thing.points, (n,))
    yield from check_placement(path, thing.points, thing.motion)
    yield from check_point_array(path, "velocities", thing.velocities, (n,))
    yield from check_point_array(path, "radii", thing.radius, (n, 1), 0.0, True)
    radius = thing.radius[thing.radius > 0.0]
    if len(radius) and radius.max() > UNLIKE * radius.min():
        yield thing_error(path, f"radii from {radius.min():g} to {radius.max():g} m", f"a ratio of {UNLIKE:g} at most",
                          "make the largest rigid bodies, or the smallest larger")
    if thing.colors is not None and thing.colors.shape not in ((3,), (n, 3)):
        yield thing_error(path, f"colors of shape {thing.colors.shape}", f"(3,) or ({n}, 3)", "give one of all, or one each")
    yield from _check_material(thing)
    yield from _check_one_radius(thing, scene)
    yield from _check_solver(thing, scene)


def _check_material(thing: Particles) -> Iterator[Problem]:
    path, m = thing.path, thing.material
    if type(m) not in MATERIALS.values():
        yield thing_error(path, f"material is {m!r:.60}", f"one of {', '.join(MATERIALS)}, or one of their classes",
                          'give material="grains"')
        return
    yield from check_number(path, "density", m.density, 0.0, True)
    for f in fields(m):
        if f.name != "density":
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


def _check_solver(thing: Particles, scene: Scene) -> Iterator[Problem]:
    """Particles move in the iterations of XPBD, with backward Euler."""
    if scene.solver not in ("auto", "xpbd"):
        yield thing_error(thing.path, f"solver is {scene.solver}", "xpbd, or auto, which takes it for particles",
                          "author wsim:solver = xpbd; or take material points, which need none")
    if scene.integrator not in ("auto", "backward_euler"):
        yield thing_error(thing.path, f"integrator is {scene.integrator}", "backward_euler, or auto",
                          "author wsim:integrator = auto")
    solid = next((body.path for body in scene.bodies() if body.is_solid), None)
    if solid is not None:
        yield thing_error(thing.path, f"a soft body {solid} beside particles", "cloth, nets and rigid bodies",
                          "take material points, or a scene without the soft body")
    if scene.contact_width > 0.0:
        yield thing_error(thing.path, f"contact_width is {scene.contact_width:g} m", "0 beside particles",
                          "their contacts are hard: author wsim:contactWidth = 0")
