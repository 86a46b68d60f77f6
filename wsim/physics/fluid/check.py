"""What can be wrong with a fluid and its sources. NumPy only."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsim.physics.fluid import start
from wsim.physics.fluid.objects import ADVECTION, KINDS, PRESSURE, SCALARS, SIDES, Fluid, Source, meets_bodies
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import check_number, check_rigid_motion, check_step_count, object_warning, thing_error

LEAST = 4                  # cells along an axis that is not flat
LONG = 1 << 30             # cells that the flat arrays of a device count


def check(thing: Fluid | Source, scene: Scene) -> Iterator[Problem]:
    yield from _check_smoke_source(thing, scene) if isinstance(thing, Source) else _check_fluid(thing, scene)


def _check_fluid(fluid: Fluid, scene: Scene) -> Iterator[Problem]:
    path, wrong = fluid.path, False
    for name in ("low", "high", "side_velocities", "velocity", "smoke", "temperature", "acceleration"):
        value = getattr(fluid, name)
        if value is not None and not np.isfinite(value).all():
            yield thing_error(path, f"{name} holds NaN or infinity", "finite numbers", f"author another {name}")
            wrong = True
    if not wrong and fluid.cell > 0.0:
        yield from _check_fluid_box(fluid)
        yield from start.covering_colliders(fluid, scene, "air")
    yield from _check_fluid_sides(fluid)
    for name, found, allowed in (("advection", fluid.advection, ADVECTION),
                                 ("scalar_advection", fluid.scalar_advection, SCALARS),
                                 ("pressure", fluid.pressure, PRESSURE)):
        if found not in allowed:
            yield thing_error(path, f"{name} is '{found}'", ", ".join(allowed), "choose one of them")
    if fluid.pressure == "direct" and scene.colliders:
        yield thing_error(path, f"its pressure is solved directly, and {scene.colliders[0].path} is an obstacle in it",
                           "multigrid or auto", "leave it on auto")
    yield from _unmet_objects(fluid, scene)
    yield from check_step_count(path, "steps", fluid.steps, 0)
    yield from check_step_count(path, "most_steps", fluid.most_steps, 1)
    yield from start.check_domain_start(fluid, scene)
    yield from check_number(path, "margin", fluid.margin, 0.0)
    if fluid.margin > 0.0:
        yield from _check_solved_part(fluid)
    if fluid.conserve:
        yield from _check_conserved(fluid)
    if 0 < fluid.tolerance < 1e-7:
        yield object_warning(path, f"tolerance is {fluid.tolerance:g}, which float32 does not reach", "1e-6 or more",
                             "give a larger one, or float64")
    if fluid.acceleration is not None and np.shape(fluid.acceleration) not in ((3,), (*fluid.shape, 3)):
        yield thing_error(path, f"acceleration has shape {np.shape(fluid.acceleration)}",
                           f"(3,) or {(*fluid.shape, 3)}, one a cell", "give it at `centers()`, or one for all air")
    for name, shape in (("velocity", (*fluid.shape, 3)), ("smoke", fluid.shape), ("temperature", fluid.shape)):
        value = getattr(fluid, name)
        if value is not None and np.shape(value) != shape:
            yield thing_error(path, f"{name} at the start has shape {np.shape(value)}", f"{shape}, a value a cell",
                               f"give {name} at `centers()`, or leave it out")
    if not scene.things("Source") and not any(x is not None for x in (fluid.velocity, fluid.smoke, fluid.temperature,
                                                                       fluid.acceleration)):
        moved = np.any(np.asarray(scene.wind)) or np.any(fluid.side_velocities) or any(c.motion.moves for c in scene.colliders)
        if not moved:
            yield object_warning(path, "nothing moves its air: no source, no wind, nothing at the start", "one of them",
                                 "add a Source, or wind")


def _unmet_objects(fluid: Fluid, scene: Scene) -> Iterator[Problem]:
    """What goes through its air and is no wall in it."""
    for thing in (*scene.bodies(), *scene.things("Body")):
        bare = not getattr(thing, "has_surface", True)
        if bare or not meets_bodies(fluid):
            kind = "made of particles" if getattr(thing, "is_particles", False) else "a net"
            why = (f"{kind}, which has no surface" if bare else
                   "solved directly" if fluid.pressure == "direct" else "solved in a part")
            yield object_warning(fluid.path, f"{thing.path} passes through its air, as it is {why}",
                                 "cloth, soft and rigid bodies in air that is solved by multigrid, all of it",
                                 "go on where that is enough")
            return


def _check_solved_part(fluid: Fluid) -> Iterator[Problem]:
    path = fluid.path
    if not _has_open_side(fluid):
        yield thing_error(path, "a part of its air is solved, and no side is open: what is sealed moves all at once",
                           "margin 0", "open a side, or leave margin out")
    if fluid.acceleration is not None:
        yield thing_error(path, "a part of its air is solved, and all of it is accelerated", "margin 0", "leave margin out")
    if fluid.velocity is not None and np.any(fluid.velocity):
        yield object_warning(path, "its air has a velocity at the start, and stays so but for a margin around smoke, heat and "
                                   "sources",
                             "margin 0 where air moves elsewhere", "leave margin out")


def _check_conserved(fluid: Fluid) -> Iterator[Problem]:
    path, mend = fluid.path, "close the side, or leave conserve out"
    if fluid.scalar_advection != "cubic":
        yield thing_error(path, f"it conserves smoke that is carried by {fluid.scalar_advection}", "cubic",
                           "carry it by cubic")
    for k, kind in enumerate(fluid.sides if len(fluid.sides) == 6 else ()):
        if k // 2 in fluid.axes and (kind not in ("closed", "periodic") or fluid.side_velocities[k, k // 2] != 0.0):
            yield thing_error(path, f"it conserves smoke, and air passes side {SIDES[k]}, which is {kind}",
                               "closed or periodic", mend)


def _check_fluid_box(fluid: Fluid) -> Iterator[Problem]:
    path, size = fluid.path, fluid.high - fluid.low
    if not (size > 0.0).all():
        yield thing_error(path, f"its box is empty: {' x '.join(f'{v:g}' for v in size)} m", "high above low along each axis",
                           "author another box; a flat fluid is one cell thick")
        return
    shape = fluid.shape
    few = [n for n in shape if 1 < n < LEAST]
    if len(fluid.axes) < 2 or few:
        yield thing_error(path, f"it has {'x'.join(map(str, shape))} cells",
                           f"{LEAST} or more along two or three axes, one along "
                           "the third of a flat one", "give smaller cells, or a larger box")
    if fluid.cells > LONG:
        many = float(np.prod(np.array(shape, np.float64)))
        yield thing_error(path, f"it has {many:.3g} cells", f"up to {LONG}",
                           f"give cells of {float(np.prod(size) / LONG) ** (1.0 / 3.0):.3g} m or more")
    rest = np.abs(size / fluid.cell - np.array(shape)).max()
    if rest > 1e-3:
        yield object_warning(path, f"its box is {' x '.join(f'{v:.4g}' for v in size / fluid.cell)} cells",
                             "whole numbers of cells",
                             f"give high = {tuple(np.round(fluid.low + fluid.cell * np.array(shape), 6).tolist())}, which it "
                             f"has")


def check_box_sides(box: Any, kinds: tuple[str, ...]) -> Iterator[Problem]:
    """Problems of the sides of a box of smoke or liquid: six of some kinds, those of an axis periodic both or none."""
    path = box.path
    if len(box.sides) != 6 or any(kind not in kinds for kind in box.sides):
        yield thing_error(path, f"sides are {box.sides}", f"six of {', '.join(kinds)}",
                           "name what is at -x, +x, -y, +y, -z, +z")
        return
    for a, n in enumerate(box.shape):
        low, high = box.sides[2 * a:2 * a + 2]
        if (low == "periodic") != (high == "periodic"):
            yield thing_error(path, f"side {SIDES[2 * a]} is {low} and side {SIDES[2 * a + 1]} is {high}",
                               "both of an axis periodic", "make the other one periodic too")
        elif low == "periodic" and n > 1 and n % 2:
            yield thing_error(path, f"it is periodic along {'xyz'[a]}, with {n} cells", "an even number of cells there",
                               "give one cell more or less")


def _check_fluid_sides(fluid: Fluid) -> Iterator[Problem]:
    path = fluid.path
    yield from check_box_sides(fluid, KINDS)
    if len(fluid.sides) != 6 or any(kind not in KINDS for kind in fluid.sides):
        return
    for k, kind in enumerate(fluid.sides):
        if kind != "closed" and np.any(fluid.side_velocities[k]):
            yield object_warning(path, f"side {SIDES[k]} is {kind} and has a velocity", "velocities of closed sides",
                                 f"close it, or take the velocity of {SIDES[k]} away")
    inflow = sum((fluid.side_velocities[2 * a + s][a] * (1 - 2 * s)) for a in fluid.axes for s in (0, 1)
                 if fluid.sides[2 * a + s] == "closed")
    if abs(inflow) > 1e-6 * np.abs(fluid.side_velocities).max() and not _has_open_side(fluid):
        yield object_warning(path, "air comes in through closed sides and has no way out", "as much out as in, or an open side",
                             "open a side; else what does not fit is spread over all cells")


def _check_smoke_source(source: Source, scene: Scene) -> Iterator[Problem]:
    path, fluids = source.path, scene.things("Fluid")
    yield from check_rigid_motion(path, source.motion, "put the scale into the shape's sizes")
    found = list(start.source_shape(source))
    yield from found
    if any(problem.fatal for problem in found):
        return
    if source.velocity is not None and not np.isfinite(source.velocity).all():
        yield thing_error(path, "velocity holds NaN or infinity", "finite numbers", "author another velocity")
    yield from check_number(path, "smoke", source.smoke, 0.0)
    if not np.isfinite(source.strength.values).all():
        yield thing_error(path, "strength holds NaN or infinity", "finite numbers", "author another strength")
    if source.fluid and source.fluid not in [f.path for f in fluids]:
        yield thing_error(path, f"it is a source of '{source.fluid}', which is no fluid here",
                           ", ".join(f.path for f in fluids) or "none, the scene has no fluid",
                           "name one of them, or none for all", lacks=True)
    elif not fluids:
        yield thing_error(path, "it is a source, and there is no fluid", "a fluid", "add a Fluid", lacks=True)
    elif not any(_source_meets_fluid(source, f) for f in fluids if source.fluid in ("", f.path)):
        yield object_warning(path, "it is outside of its fluids at the start, and stays there", "a place within one",
                             "move it, or enlarge the fluid's box")
    for fluid in fluids if source.expansion > 0.0 else ():
        if source.fluid in ("", fluid.path) and _source_meets_fluid(source, fluid) and not _has_open_side(fluid):
            yield object_warning(path,
                                 f"it brings {source.expansion:g} m^3/s of air a cubic metre into {fluid.path}, which has no "
                                 "open side: what does not fit is spread over all cells", "an open side, or no expansion",
                                 "author wsim:fluid:sides with an open one, or leave wsim:fluid:expansion out")
    if source.velocity is None and source.smoke == source.temperature == source.expansion == 0.0:
        yield object_warning(path, "it gives nothing: no smoke, heat, air or velocity", "one of them",
                             "author one, or take it away")


def _has_open_side(fluid: Fluid) -> bool:
    return len(fluid.sides) == 6 and "open" in [fluid.sides[2 * a + s] for a in fluid.axes for s in (0, 1)]


def _source_meets_fluid(source: Source, fluid: Fluid) -> bool:
    """Whether its ball touches the box at a key of its motion."""
    return start.touches_box(source.shape, source.motion.values[:, :3, 3], fluid)
