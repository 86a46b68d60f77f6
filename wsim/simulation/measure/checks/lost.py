"""Worlds that begin again, or are taken out because they are not finite, while the others go on to the bit.

Every part of the state knows which rows are whose (`wsim.model.state.StatePart.rows`): a world gets those of a run that begins.
Lists that worlds have in common (`common`) forget what is of it, by their methods (`Method.forget_worlds`).

Points of a lost world are held at their start. Other things cannot be held: they are put back to their start, at rest, before
every frame, and whether they are finite behind it does not matter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.scene.methods import has_other_objects

if TYPE_CHECKING:
    from wsim.model.state import StatePart
    from wsim.simulation.simulation import Simulation

TOLD = 64              # worlds of which a frame is told, at most
RATES = ("v", "u", "s", "b", "r", "w", "p", "L", "joint_qd")           # fields that are 0 at rest


class FixedStepsError(Exception):
    """A frame of several worlds asks for other steps, and they are to stay as they are (`Clock.apart`). worlds: those that ask
    for them; none where that is not known."""

    def __init__(self, worlds: set[int]):
        super().__init__(f"worlds {sorted(worlds)} take other steps")
        self.worlds = worlds


def worlds_not_finite(sim: Simulation) -> set[int]:
    """Worlds of which something that outlives a frame is not finite."""
    found = set()
    for part in (part for part in sim.state.parts.values() if not part.common):
        arrays = [part.arrays[f.name].numpy() for f in part.kept if f.type not in ("int", "long")]
        good = [np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in arrays if len(a)]
        if good and not (whole := np.logical_and.reduce(good)).all():
            found |= {world for (_, world), rows in part.rows.items() if not whole[rows].all()}
    return found


def drop_worlds(sim: Simulation) -> bool | None:
    """Takes worlds out that are not finite, where others are: each stays at its start from here on, and the others do not
    change. Returns whether the frame is to be repeated; None where all worlds are broken: steps are too long for any."""
    broken = set() if sim.worlds == 1 else worlds_not_finite(sim)
    if not broken or len(broken | sim.lost.keys()) == sim.worlds:
        return None
    new, others = broken - sim.lost.keys(), has_other_objects(sim.scene)
    for world in sorted(new):
        sim.lost[world] = sim.frame + 1
        sim.warnings.append(f"frame {sim.frame + 1}: world {world} stopped being a number and was taken out: it stands at its "
                            "start until it is reset; the others go on")
    if others:                                           # the frame holds for those that go on
        begin_again(sim, broken, held=True)
        return False
    sim.state.restore_snapshot()
    begin_again(sim, broken, held=True)
    sim.state.take_snapshot()
    return True


def hold_lost_worlds(sim: Simulation) -> None:
    """Puts what is lost and cannot be held where it started, before a frame."""
    if sim.lost and has_other_objects(sim.scene):
        begin_again(sim, set(sim.lost), held=True)


def begin_again(sim: Simulation, worlds: set[int], held: bool = False) -> None:
    """Puts worlds back to the state of the scene's start. Live values stay, and what varies in time goes on; BDF2 and leapfrog
    go on as if the velocity had been the same before. held: at rest, and held there."""
    for method in sim.plan.methods:
        method.forget_worlds(worlds)
    one = _simulation_at_start(sim)
    for part in sim.state.parts.values():
        for f in part.kept if not part.common else ():
            now = part.arrays[f.name].numpy()
            for (path, world), rows in part.rows.items():
                if world in worlds:
                    first = _rows_at_start(one, part, path, f.name, len(rows))
                    still = held and f.name in RATES
                    scale = sim.plan.clock.h if f.name == "s" else 1.0
                    now[rows] = 0.0 * first if still else scale * first if scale != 1.0 else first
            part.arrays[f.name].assign(now)
    points = sim.plan.ports.points
    if points is not None:
        points.hold(one.plan.ports.points.constants.w.numpy(), worlds, held)
    _restart_momenta(sim, one, worlds, held)
    sim.balance = None
    if not held:
        for world in worlds:
            sim.lost.pop(world, None)


def _simulation_at_start(sim: Simulation) -> Simulation:
    """One world where it begins; made once."""
    if sim.origin is None:
        sim.origin = type(sim)(sim.given, device=sim.device, precision=sim.precision)
    return sim.origin


def _restart_momenta(sim: Simulation, one: Simulation, worlds: set[int], held: bool) -> None:
    """Momenta of rigid bodies of other masses than at the start are those of the masses that they have."""
    bodies, alone = sim.plan.ports.bodies, one.plan.ports.bodies
    if bodies is None or {m.mass for m in bodies.masses} == {m.mass for m in alone.masses}:
        return
    each, moving = len(alone.bodies), 0.0 if held else 1.0
    rows = np.concatenate([world * each + np.arange(each) for world in sorted(worlds)])
    v, spin = (moving * np.tile(found, (len(worlds), 1)) for found in (alone.velocities(), alone.spins()))
    every = np.zeros((len(bodies.bodies), 3))
    every[rows] = spin
    L, mass = bodies.momentum(bodies.turns(), every), np.array([m.mass for m in bodies.masses])
    for name, values in (("p", mass[rows, None] * v), ("L", L[rows])):
        now = bodies.part.arrays[name].numpy()
        now[rows] = values
        bodies.part.arrays[name].assign(now)


def _rows_at_start(one: Simulation, part: StatePart, path: str, name: str, count: int) -> np.ndarray:
    """A field at the start: of those of points that carry history, the velocity. A list that has grown since then ends with
    rows of nothing. Raises SceneError where there are other rows."""
    name = {"s": "v", "u": "v", "b": "v"}.get(name, name) if part.name == "points" else name
    names = {f.name for f in part.kept}
    found = np.zeros(0)
    for other in one.state.parts.values():
        if (path, 0) in other.rows and {f.name for f in other.kept} == names:
            found = other.arrays[name].numpy()[other.rows[path, 0]]
    if len(found) < count and "id" in names:
        more = np.full((count - len(found), *found.shape[1:]), -1 if name == "id" else 0, found.dtype)
        found = np.concatenate([found, more])
    if len(found) != count:
        raise SceneError(Problem(path, "has grown since the start, so that no world is reset alone; fix: reset all"))
    return found
