"""What can be wrong with a liquid and its sources. NumPy only."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsim.physics.fluid import start
from wsim.physics.fluid.check import LEAST, LONG, check_box_sides
from wsim.physics.fluid.liquid.objects import KINDS, ROLES, TRANSFERS, Liquid, LiquidSource
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import check_rigid_motion, check_step_count, object_warning, thing_error


def check(thing: Liquid | LiquidSource, scene: Scene) -> Iterator[Problem]:
    yield from _check_liquid_source(thing, scene) if isinstance(thing, LiquidSource) else _check_liquid(thing, scene)


def _check_liquid(liquid: Liquid, scene: Scene) -> Iterator[Problem]:
    path, size = liquid.path, liquid.high - liquid.low
    if not (np.isfinite(liquid.low).all() and np.isfinite(liquid.high).all()):
        yield thing_error(path, "its box holds NaN or infinity", "finite numbers", "author another box")
    elif not (size > 0.0).all():
        yield thing_error(path, f"its box is empty: {' x '.join(f'{v:g}' for v in size)} m", "high above low along each axis",
                           "author another box; a flat liquid is one cell thick")
    elif liquid.cell > 0.0:
        yield from _check_liquid_cells(liquid)
        yield from _check_liquid_filled(liquid, scene)
        yield from start.covering_colliders(liquid, scene, "room")
    yield from check_box_sides(liquid, KINDS)
    if liquid.transfer not in TRANSFERS:
        yield thing_error(path, f"transfer is '{liquid.transfer}'", ", ".join(TRANSFERS), "choose one of them")
    yield from check_step_count(path, "steps", liquid.steps, 0)
    yield from check_step_count(path, "most_steps", liquid.most_steps, 1)
    yield from start.check_domain_start(liquid, scene)
    if 0 < liquid.tolerance < 1e-7:
        yield object_warning(path, f"tolerance is {liquid.tolerance:g}, which float32 does not reach", "1e-6 or more",
                             "give a larger one, or float64")
    for cloth in (body for body in scene.bodies() if not (body.is_particles and _stays_outside(liquid, body))):
        does = "moves it, and does not feel it" if cloth.has_surface else "passes through it"
        if scene.things("Body") and cloth.has_surface:
            does += " (where it moves fast some liquid passes it, since there are rigid bodies too)"
        yield object_warning(path,
                             f"{cloth.path} {does}: surfaces of cloth and soft bodies are walls that move, and liquids do not "
                             "push them", "rigid bodies, which do feel it",
                             "go on where that is enough, else make it a rigid body")
        break


def _stays_outside(liquid: Liquid, particles: Any) -> bool:
    """Whether particles begin outside of the box."""
    x = particles.placed_points()
    return not ((x > liquid.low) & (x < liquid.high)).all(axis=1).any()


def _check_liquid_cells(liquid: Liquid) -> Iterator[Problem]:
    path, shape, size = liquid.path, liquid.shape, liquid.high - liquid.low
    if len(liquid.axes) < 2 or [n for n in shape if 1 < n < LEAST]:
        yield thing_error(path, f"it has {'x'.join(map(str, shape))} cells",
                           f"{LEAST} or more along two or three axes, one along "
                           "the third of a flat one", "give smaller cells, or a larger box")
    if 8 * liquid.cells > LONG:
        cell, many = float(8.0 * np.prod(size) / LONG) ** (1.0 / 3.0), float(np.prod(np.array(shape, np.float64)))
        yield thing_error(path, f"it has {many:.3g} cells of up to 8 particles", f"up to {LONG} particles",
                           f"give cells of {cell:.3g} m or more")
    if np.abs(size / liquid.cell - np.array(shape)).max() > 1e-3:
        whole = tuple(np.round(liquid.low + liquid.cell * np.array(shape), 6).tolist())
        yield object_warning(path, f"its box is {' x '.join(f'{v:.4g}' for v in size / liquid.cell)} cells",
                             "whole numbers of cells", f"give high = {whole}, which it has")


def _check_liquid_filled(liquid: Liquid, scene: Scene) -> Iterator[Problem]:
    """Whether anything puts liquid into it."""
    give = [s for s in scene.things("LiquidSource") if s.role != "sink" and s.liquid in ("", liquid.path)]
    if not give:
        yield thing_error(liquid.path, "nothing fills it: no LiquidSource of role start or source is of it", "one or more",
                           "author WsimLiquidSourceAPI on a shape within its box, or add a LiquidSource", lacks=True)
    elif not any(_source_meets_liquid(source, liquid) for source in give):
        yield thing_error(liquid.path, f"what fills it is outside of it: {', '.join(s.path for s in give)}",
                           "shapes within its box", "move them, or enlarge the box")


def _check_liquid_source(source: LiquidSource, scene: Scene) -> Iterator[Problem]:
    path, liquids = source.path, scene.things("Liquid")
    yield from check_rigid_motion(path, source.motion, "put the scale into the shape's sizes")
    found = list(start.source_shape(source))
    yield from found
    if any(problem.fatal for problem in found):
        return
    if source.role not in ROLES:
        yield thing_error(path, f"role is '{source.role}'", ", ".join(ROLES), "choose one of them")
    if source.velocity is not None and not np.isfinite(source.velocity).all():
        yield thing_error(path, "velocity holds NaN or infinity", "finite numbers", "author another velocity")
    if not np.isfinite(source.strength.values).all():
        yield thing_error(path, "strength holds NaN or infinity", "finite numbers", "author another strength")
    if source.liquid and source.liquid not in [x.path for x in liquids]:
        yield thing_error(path, f"it is of '{source.liquid}', which is no liquid here",
                           ", ".join(x.path for x in liquids) or "none, the scene has no liquid",
                           "name one of them, or none for all", lacks=True)
    elif not liquids:
        yield thing_error(path, "it is a source of liquid, and there is no liquid", "a liquid", "add a Liquid", lacks=True)
    elif not any(_source_meets_liquid(source, x) for x in liquids if source.liquid in ("", x.path)):
        yield object_warning(path, "it is outside of its liquids, and stays there", "a place within one",
                             "move it, or enlarge the box")


def _source_meets_liquid(source: LiquidSource, liquid: Liquid) -> bool:
    """Whether its ball touches the box at a key of its motion (of a start, at the first)."""
    return start.touches_box(source.shape, source.motion.values[:1 if source.role == "start" else None, :3, 3], liquid)
