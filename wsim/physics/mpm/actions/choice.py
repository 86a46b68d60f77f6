"""What of a scene acts on its material points from outside. NumPy only."""

from typing import Any

from wsim.physics.mpm.objects import MaterialPoints
from wsim.scene import Load, Scene


def loads_on_points(scene: Scene) -> list[Load]:
    """Loads of the scene's material points."""
    paths = {thing.path for thing in scene.things("MaterialPoints")} if scene.loads else set()
    return [load for load in scene.loads if load.body in paths]


def air_acts(scene: Scene) -> bool:
    """True if air acts on the scene's material points."""
    varies = any(value.path == "/" and value.name == "air_drag" for value in scene.varying)
    return bool(scene.air_drag) or varies or air_drags(scene.things("MaterialPoints"))


def air_drags(things: list[MaterialPoints]) -> bool:
    """True if some bodies have a drag coefficient."""
    return any(thing.drag for thing in things)


def has_pins(things: list[MaterialPoints]) -> bool:
    """True if pins hold some particles."""
    return any(thing.pins for thing in things)


def action_traits(scene: Scene) -> tuple[Any, ...]:
    """What of a scene's actions decides kernels: hard pins, soft pins, loads, air, drag; all False where nothing acts."""
    things = scene.things("MaterialPoints")
    hard = {pin.stiffness == float("inf") for thing in things for pin in thing.pins}
    return True in hard, False in hard, bool(loads_on_points(scene)), air_acts(scene), air_drags(things)
