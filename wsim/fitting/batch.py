"""Copies of the scenes of all experiments that are run together, and what they miss of what was seen: all of a fit, or a part.

A part of the copies gives residuals as all of them together do, to the bit: copies do not meet, all take the steps that the
stiffest of all parts needs, and each part begins with the copy that is not changed, by which a scan finds what is near.
Where memory holds fewer than all (`most`), they take turns between two moments, with their states aside on the host.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from wsim.fitting.copies import BrokenRun, SavedCopies, SceneCopies
from wsim.fitting.parameter import Parameter
from wsim.scene import Scene
from wsim.scene.methods import has_other_objects

Seen = tuple[int, int, Any, int]       # experiment, frame, observation, row of it


def observations_by_time(experiments: list[tuple[Scene, list]]) -> list[tuple[float, list[Seen]]]:
    """Observations by the time [s] at which each was seen, in order."""
    found: dict[float, list[Seen]] = {}
    for k, (scene, seen) in enumerate(experiments):
        for o in seen:
            for row, f in enumerate(o.frames):
                found.setdefault(int(f) / scene.fps, []).append((k, int(f), o, row))
    return sorted(found.items(), key=lambda each: each[0])


@dataclass
class CopiesTurn:
    """Some of the copies: their values of each experiment, its states (None at the start), and how many of them count."""

    values: list[np.ndarray]
    states: list[SavedCopies | None]
    count: int


def split_into_turns(rows: np.ndarray, size: int) -> list[tuple[np.ndarray, int]]:
    """Rows of theta or values in parts of `size`, each behind the first of all, which fills the last too; and how many of each
    are new."""
    found = []
    for k in range(1, max(len(rows), 2), size - 1) if size < len(rows) else (1,):
        own = rows[k:k + size - 1] if size < len(rows) else rows[1:]
        found.append((np.concatenate([rows[:1], own, np.repeat(rows[:1], max(size - 1 - len(own), 0), axis=0)]), len(own)))
    return found


class CopiesBatch:
    """`begin` with values of so many copies, `take` the steps of all, read `residuals` of one moment after the other."""

    def __init__(self, experiments: list[tuple[Scene, list]], parameters: list[Parameter], copies: int, device=None,
                 most: int | None = None):
        """most: copies at once, two or more; None: all."""
        self.moments = observations_by_time(experiments)
        self.columns = [[c for c, p in enumerate(parameters) if p.only in (None, k)] for k in range(len(experiments))]
        self.size = copies if most is None or any(has_other_objects(s) for s, _ in experiments) else min(copies, max(most, 2))
        self.copies = [SceneCopies(scene, [parameters[c] for c in own], self.size, device)
                       for (scene, _), own in zip(experiments, self.columns, strict=True)]
        for each, (_, seen) in zip(self.copies, experiments, strict=True):
            for o in seen:
                o.prepare(each.sim.model)
        self.turns: list[CopiesTurn] = []

    @property
    def solvers(self) -> list[str]:
        return [c.sim.plan.choice.solver for c in self.copies]

    def begin(self, values: np.ndarray) -> list[int]:
        """Sets copies to the start with values (copies, parameters); the least substeps of each experiment."""
        self.turns, steps = [], np.zeros(len(self.copies), int)
        for rows, count in split_into_turns(values, self.size):
            turn = CopiesTurn([rows[:, own] for own in self.columns], [None] * len(self.copies), count)
            for k, c in enumerate(self.copies):
                c.begin(turn.values[k])
                steps[k] = max(steps[k], c.substeps)
            self.turns.append(turn)
        return steps.tolist()

    def take(self, substeps: list[int]) -> None:
        """Takes so many substeps a frame in each experiment, or more."""
        for c, n in zip(self.copies, substeps, strict=True):
            c.take(n)

    def residuals(self, number: int) -> np.ndarray:
        """Residuals of every copy at the moment of that number, (copies, m). Raises Broken where one stops being a number."""
        found = []
        for turn in self.turns:
            rows = []
            for k, frame, seen, row in self.moments[number][1]:
                self.enter(turn, k)
                self.copies[k].to(frame)
                residual = seen.residuals(row, self.copies[k].look(seen)) / (seen.sigma or 1.0)
                if not np.isfinite(residual).all():
                    raise BrokenRun(frame, f"the misfit of {seen.path} is no number")
                rows.append(residual)
                self.leave(turn, k)
            found.append(np.concatenate(rows, axis=1)[bool(found):1 + turn.count])
        return np.concatenate(found)

    def enter(self, turn: CopiesTurn, k: int) -> None:
        """The copies of an experiment are those of a turn."""
        if len(self.turns) > 1:
            self.copies[k].enter(turn.values[k], turn.states[k])

    def leave(self, turn: CopiesTurn, k: int) -> None:
        if len(self.turns) > 1:
            turn.states[k] = self.copies[k].aside()

    def notes(self) -> list[str]:
        """Warnings of the simulations."""
        found = []
        for c in self.copies:
            found += [w.removeprefix("warning: ") for w in c.warnings]
            if c.substeps != c.scene.substeps:
                found.append(f"the stiffest copies needed {c.substeps} explicit substeps a frame, not "
                             f"{c.scene.substeps}: all took them")
        return list(dict.fromkeys(found))
