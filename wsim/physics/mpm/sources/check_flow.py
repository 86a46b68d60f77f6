"""What can be wrong with shapes that pour and with sinks, and with what begins within a solid. NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.physics.mpm.objects import MaterialPoints, MaterialSink
from wsim.physics.mpm.seeding import coarsened, place_particles
from wsim.physics.particles.check_pour import check_free_places, check_pour_numbers, poured_places
from wsim.physics.particles.check_shapes import check_volume_shape
from wsim.scene import Problem, Scene, Surface, solids
from wsim.scene.check.objects import check_rigid_motion, thing_error

LOOKS = 64               # cells across a shape, at most, when its particles are looked at
DEEP = 0.25              # cells that a particle may begin within a solid


def check_pour(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """Problems of a shape that pours, whose shape and material are sound."""
    if np.any(thing.spin) or thing.further or np.ndim(np.asarray(thing.colors)) > 1:
        yield thing_error(thing.path, "it pours, and has a spin, further materials or colours of each point",
                           "one material and colour", "leave them out")
    yield from check_pour_numbers(thing, scene, f"cells are {thing.cell:g} m", "smaller cells")


def check_sink(thing: MaterialSink, scene: Scene) -> Iterator[Problem]:
    """Problems of a sink."""
    if isinstance(thing.shape, Surface) or type(thing.shape) in [each.shape for each in solids.SOLIDS]:
        yield from check_volume_shape(thing.path, thing.shape)
    else:
        yield thing_error(thing.path, f"its shape is a {type(thing.shape).__name__}",
                           "a Plane, a closed shape or a closed Surface", "give it one of these")
    yield from check_rigid_motion(thing.path, thing.motion, "put the scale into the shape's sizes")


def check_start(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """An error of what pours into a solid, a convex collider, and a warning of a body that begins in one."""
    places = poured_places(thing) if thing.pour else place_particles(coarsened(thing, LOOKS)).x
    yield from check_free_places(thing, scene, places, DEEP * thing.cell)
