"""Which grid takes the steps of a scene's bodies, and whether it pushes rigid bodies, cloth or soft bodies."""

from typing import Any

import numpy as np

from wsim.model.stage import Stage
from wsim.physics.contact.collider.shells import body_shells, obstacle_sheets
from wsim.physics.contact.collider.table import ColliderTable, kind_names
from wsim.physics.mpm.actions.choice import action_traits
from wsim.physics.mpm.implicit.choice import chosen_integrator
from wsim.physics.mpm.objects import MaterialPoints


def law_names(things: list[MaterialPoints]) -> tuple[str, ...]:
    """Laws of a scene's materials, each once."""
    return tuple(sorted({material.law for thing in things for material in thing.materials}))


def grid_class(things: list[MaterialPoints], scene: Any, model: Any, pushes: bool) -> Any:
    """The class of the grid that takes the steps of a scene's bodies. Explicit steps alone have gradients, and are taken for
    them unless implicit ones are asked for. pushes: what pushes takes explicit steps."""
    gradients = model.gradients
    asked = any(thing.integrator == "implicit" for thing in things)
    if pushes:
        from wsim.physics.mpm.coupling.grid import PushingGrid
        return PushingGrid
    if chosen_integrator(things, scene.fps) == "explicit" or gradients and not asked:
        from wsim.physics.mpm import grid
        if grid.gathers(model.device) or any(action_traits(scene)):
            return grid.SparseGrid
        from wsim.physics.mpm.tile_grid import TileGrid
        return TileGrid
    if things[0].material.law == "sand":
        from wsim.physics.mpm.implicit.granular import GranularGrid
        return GranularGrid
    from wsim.physics.mpm.implicit.elastic import ElasticGrid
    return ElasticGrid


def pushed_things(model: Any) -> list:
    """What material points push: rigid bodies, by their colliders; surfaces of cloth and soft bodies."""
    return [*body_shells(model.scene), *obstacle_sheets(model)]


def signature(b: Any) -> list:
    """Part of a scene's bodies that decides kernels."""
    things, sinks = b.scene.things("MaterialPoints"), b.scene.things("MaterialSink")
    pushed = pushed_things(b.model)
    return [law_names(things), chosen_integrator(things, b.scene.fps, bool(pushed)), any(thing.pour for thing in things),
            kind_names(sinks), kind_names(pushed), action_traits(b.scene)]


def make_actions(method: Any, b: Any) -> Any:
    """What acts on the particles of a method from outside, `wsim.physics.mpm.actions.outside.OutsideActions`, or None."""
    if not any(action_traits(b.scene)):
        return None
    from wsim.physics.mpm.actions.outside import OutsideActions
    method.offers.grid_reactions = acts = OutsideActions(method, b)
    return acts


def make_walls(method: Any, b: Any) -> tuple[Any, Any]:
    """What the particles of a method push, with the stage behind what is pushed, or None where there is nothing; and the table
    of all that they meet, or None."""
    if not pushed_things(b.model):
        return None, ColliderTable(b.model, b.scene.colliders, method.corner) if b.scene.colliders else None
    from wsim.physics.mpm.coupling.exchange import Exchange
    density = np.array([material.density for material in method.materials])[method.material_of]
    exchange = Exchange(b, method.corner, method.cell, method.laws, float(density @ method.volume))
    method.stages.append(Stage("points beside bodies", "deform", lambda clock: exchange.settle_frame(method.grid, clock.dt), 6,
                               method.part.bytes, "frame", "and surfaces, where these have gone"))
    return exchange, exchange.colliders
