"""Copies of one fit on several workers of Ray, each with a part of them: the derivatives of a fit that one device is too small
for, or too slow.

    with Team(Settings(workers=2)) as team:
        fit(scene, seen, "stretch,bend", settings=wsim.fitting.Settings(team=team))

What a part of the copies gives is what they give together, to the bit (`wsim.fitting.batch`), so that the fit is that of one
process. A worker that is lost is replaced, and the new one goes through the moments that the lost one had seen.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wsim.fitting.batch import CopiesBatch, split_into_turns
from wsim.fitting.copies import BrokenRun
from wsim.scene import Problem, SceneError
from wsim.sweep.job import Job, Settings
from wsim.sweep.sweep import require_ray


@dataclass(frozen=True)
class CopiesJob(Job):
    """A job of parts of one fit. copies: of each worker at once, None: all it has."""

    runs: str = "wsim.sweep.team"
    experiments: list = field(default_factory=list)
    parameters: list = field(default_factory=list)
    copies: int | None = None

    def files(self) -> list[str]:
        return []                              # scenes and what was seen go with the job


class Worker:
    """Batches of one process. `run` calls one of their methods; failures of the scene come back as values."""

    def __init__(self, job: CopiesJob):
        self.job = job
        self.batches: dict[int, CopiesBatch] = {}

    def run(self, asked: tuple) -> tuple:
        copies, what, *given = asked
        try:
            if copies not in self.batches:
                self.batches[copies] = CopiesBatch(self.job.experiments, self.job.parameters, copies, self.job.settings.device,
                                                   self.job.copies)
            found = getattr(self.batches[copies], what)
            return "done", found(*given) if callable(found) else found
        except BrokenRun as broken:
            return "broken", broken.frame, broken.reason
        except SceneError as error:
            return "refused", error.problems


class Team:
    """Workers of one fit. A context manager; called, it is the `make` of a `wsim.fitting.observations.residuals.Misfit`."""

    def __init__(self, settings: Settings, copies: int | None = None, said: Callable[[str], None] = lambda text: None):
        """settings: workers, cores, address, device, retries; copies: of each worker at once; said: told what workers are."""
        require_ray(settings)
        self.settings, self.copies, self.said = settings, copies, said
        self.cluster: Any = None

    def __enter__(self) -> "Team":
        return self

    def __exit__(self, *_) -> None:
        if self.cluster is not None:
            self.cluster.__exit__()
            self.cluster = None

    def __call__(self, experiments: list, parameters: list, copies: int) -> "DistributedBatch":
        if self.cluster is None:
            from wsim.sweep.cluster import RayCluster
            self.cluster = RayCluster(CopiesJob("", {}, os.getcwd(), 0, self.settings, experiments=experiments,
                                                parameters=parameters, copies=self.copies)).__enter__()
            for text in self.cluster.said:
                self.said(text)
        return DistributedBatch(self, copies)


class DistributedBatch:
    """So many copies on the workers of a team: what a `CopiesBatch` does, by parts."""

    def __init__(self, team: Team, copies: int):
        self.team, self.cluster = team, team.cluster
        self.size = 1 + -(-(copies - 1) // self.cluster.size)
        self.past: list[list[tuple]] = []             # what each part was asked since it began, for a worker that takes it over
        self.counts: list[int] = []
        self.tries = 0
        self.solvers = self.ask([[("solvers",)]])[0]

    def begin(self, values: np.ndarray) -> list[int]:
        parts = split_into_turns(values, self.size)
        self.past, self.counts = [[] for _ in parts], [count for _, count in parts]
        return np.max(self.ask([[("begin", rows)] for rows, _ in parts]), axis=0).tolist()

    def take(self, substeps: list[int]) -> None:
        self.ask([[("take", substeps)] for _ in self.counts])

    def residuals(self, number: int) -> np.ndarray:
        found = self.ask([[("residuals", number)] for _ in self.counts])
        return np.concatenate([r[bool(k):1 + count] for k, (r, count) in enumerate(zip(found, self.counts, strict=True))])

    def notes(self) -> list[str]:
        return list(dict.fromkeys(text for found in self.ask([[("notes",)] for _ in self.counts]) for text in found))

    def ask(self, asked: list[list[tuple]]) -> list:
        """Answers of a worker for each part, to the last question of each; all work at once."""
        self.past = self.past or [[] for _ in asked]
        for past, questions in zip(self.past, asked, strict=False):
            past += questions
        flying = {k: self.send(k, questions) for k, questions in enumerate(asked)}
        return [self.answer_of_worker(k, ref) for k, ref in flying.items()]

    def send(self, k: int, questions: list[tuple]):
        """Reference of the answer to the last of some questions."""
        return [self.cluster.actors[k].run.remote((self.size, *question)) for question in questions][-1]

    def answer_of_worker(self, k: int, ref):
        """Raises Broken and SceneError as a worker did."""
        given, lost = self.cluster.answer_of_worker(ref)
        if given is None:
            return self.answer_of_worker(k, self.again(k, lost))
        kind, *found = given
        if kind == "broken":
            raise BrokenRun(*found)
        if kind == "refused":
            raise SceneError(found[0])
        return found[0]

    def again(self, k: int, why: str):
        """The same of another worker, which is asked all that the lost one was."""
        self.tries += 1
        if self.tries > self.team.settings.retries:
            raise SceneError(Problem("worker", f"was lost {self.tries} times ({why}); start again, with fewer workers or "
                                     "fewer copies on each (--copies)"))
        self.cluster.actors[k] = self.cluster.maker.remote(self.cluster.given)
        return self.send(k, self.past[k])
