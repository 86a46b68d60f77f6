"""What can be wrong with the air, the pins and the loads of material points. NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.physics.mpm.actions.choice import loads_on_points
from wsim.physics.mpm.objects import MaterialPoints
from wsim.scene import Load, Pin, Problem, Scene
from wsim.scene.check.objects import (
    check_number,
    check_point_array,
    check_rigid_motion,
    check_table_values,
    object_warning,
    thing_error,
)

HARD = "hard pins of jelly and snow by implicit steps, or all pins by explicit ones"


def check_actions(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """Problems of what acts on one body. Its shape, or its points, are sound."""
    yield from check_number(thing.path, "drag", thing.drag, 0.0)
    if np.any(scene.wind) and not thing.drag:
        yield object_warning(thing.path, "its particles do not feel the wind: drag is 0", "a number > 0", "give it drag=1.0")
    loads = [load for load in loads_on_points(scene) if load.body == thing.path]
    acted: list[Pin | Load] = [*thing.pins, *loads]
    if thing.pour:
        for each in acted:
            what = "holds" if isinstance(each, Pin) else "loads"
            yield thing_error(each.path, f"it {what} particles of {thing.path}, which pours: none is there at the start",
                              "a body that is full at the start", "leave it out, or take a body without pour")
        return
    if not acted:
        return
    places, held = thing.placed_points(), np.zeros(thing.point_count, int)
    for pin in thing.pins:
        yield from _check_particle_pin(pin, thing, places)
        inside = pin.points[(pin.points >= 0) & (pin.points < len(held))]
        np.add.at(held, np.unique(inside), 1)
    if (held > 1).any():
        yield thing_error(thing.path, f"particle {int(np.argmax(held > 1))} is held by two pins", "one",
                          "leave it to one of them")
    if thing.integrator == "implicit" and any(pin.stiffness < np.inf for pin in thing.pins) or (
            thing.integrator == "implicit" and thing.pins and thing.material.law == "sand"):
        yield thing_error(thing.pins[0].path, f"it holds particles of {thing.path}, whose integrator is implicit", HARD,
                          'give integrator="explicit", or leave it at auto')


def _check_particle_pin(pin: Pin, thing: MaterialPoints, places: np.ndarray) -> Iterator[Problem]:
    yield from check_table_values(pin)
    yield from check_point_array(pin.path, "places", pin.places, (len(pin.points),))
    yield from check_rigid_motion(pin.path, pin.motion, "take the scale out of the xform that the pin hangs on")
    if len(pin.points) == 0:
        yield thing_error(pin.path, "it holds no points", "at least one", f"name particles of {thing.path}, such as those "
                          "of points_within(shape, at), or remove the pin")
        return
    if pin.points.min() < 0 or pin.points.max() >= len(places):
        yield thing_error(pin.path, f"it holds points {pin.points.min()} to {pin.points.max()} of {thing.path}",
                          f"0 to {len(places) - 1}", "count from 0, in the order of its particles")
    elif len(np.unique(pin.points)) < len(pin.points):
        yield thing_error(pin.path, "it holds a particle twice", "each once", "name it once")
    elif pin.follows is not None:
        yield thing_error(pin.path, f"it holds particles of {thing.path} at skin", "an xform, or a collider that keeps its "
                          "shape", "hang it on a joint's xform, or give it motion=...")
    elif pin.places is not None and pin.stiffness == np.inf and len(pin.places) == len(pin.points):
        away = np.linalg.norm(pin.motion.points(pin.places, 0.0) - places[pin.points], axis=1)
        if away.max() > thing.cell:
            k = int(np.argmax(away))
            yield object_warning(pin.path, f"it holds particle {pin.points[k]} of {thing.path} {away[k]:.3g} m from where it "
                                 "starts: it jumps there at once, apart from what is around it", "places where particles start",
                                 "leave places out, and give the pin a motion")
