"""Fits of many specimens, over the workers of a sweep: each by itself, a row of a table for each.

    for row in many("flag.usda", ["a.usdc", "b.usdc"], "stretch,bend", "fits"):
        print(row["observed"], row["stretch"], row["stretch:error"])

The table stands in the folder as that of a sweep does; `NAME:error` is the standard deviation of a parameter, inf where it is
not identifiable. Specimens that share their parameters are one fit (`wsim.fit(..., also=...)`, `wsim fit --many ... --joint`).
"""

import os
import socket
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from time import perf_counter

from wsim.fitting import parameter
from wsim.fitting.fit import Settings as Fitting
from wsim.fitting.fit import fit
from wsim.fitting.observations.observed_usd import read
from wsim.scene import SceneError
from wsim.sweep.case import SweepCases, motion_digest
from wsim.sweep.folder import Row, SweepFolder
from wsim.sweep.job import Job, Settings
from wsim.sweep.sweep import Sweep, require_ray


@dataclass(frozen=True)
class FitRequest:
    """Settings of all fits, like those of `wsim.fit`. noise [m], force_noise [N]: of what was seen; None:
    estimated."""

    names: tuple[str, ...]
    start: dict = field(default_factory=dict)
    priors: dict = field(default_factory=dict)
    noise: float | None = None
    force_noise: float | None = None
    accuracy: float = 0.0
    limit: float = 200.0


@dataclass(frozen=True)
class SpecimenFits(Job):
    """A job of fits."""

    runs: str = "wsim.sweep.many"
    asked: FitRequest = FitRequest(())

    def identity(self, draws: list[dict], base: str) -> dict:
        return super().identity(draws, base) | {"fit": asdict(self.asked) | {"names": list(self.asked.names)}}


class Worker:
    """Fits specimens in one process. `run` gives a row for each."""

    def __init__(self, job: SpecimenFits):
        self.job, self.scene = job, SweepCases(job).scene()

    def run(self, runs: list) -> list[Row]:
        return [self._row_of_run(item) for item in runs]

    def most(self, scene) -> int:
        """Specimens at a time."""
        return 1

    def _row_of_run(self, item: tuple) -> Row:
        began, asked = perf_counter(), self.job.asked
        row = self.job.lost(item, "")
        try:
            seen = read(item[1]["observed"], self.scene, asked.noise, force=asked.force_noise)
            settings = Fitting(device=self.job.settings.device, accuracy=asked.accuracy, limit=asked.limit)
            found = fit(self.scene, seen, asked.names, start=asked.start, priors=asked.priors, settings=settings)
        except SceneError as error:
            return row | {"why": " | ".join(f"{p.path}: {p.text}" for p in error.problems), "seconds": perf_counter() - began}
        except Exception as error:
            return row | {"why": f"{type(error).__name__}: {error}", "seconds": perf_counter() - began}
        values = {key: float(value) for name in found.values
                  for key, value in ((name, found.values[name]), (f"{name}:error", found.errors[name]))}
        return row | values | {
            "status": "done", "why": "", "converged": bool(found.converged), "sigma": float(found.sigma),
            "misfit": float(found.misfit), "frames": found.frames, "simulations": float(found.simulations),
            "warnings": " | ".join(found.notes), "scene_hash": motion_digest(self.scene), "seconds": perf_counter() - began,
            "worker": f"{socket.gethostname()}:{os.getpid()}"}


def fit_specimens(scene: str | os.PathLike, observed: Iterable[str | os.PathLike], names: str | Iterable[str], folder, *,
                  asked: dict | None = None, resume: bool = False, settings: Settings | None = None,
                  told: Callable[[int, int], None] | None = None) -> Iterator[Row]:
    """Fits parameters of a scene to each of several specimens and yields a row of each as it ends.

    observed   files with sampled points of the scene's bodies, one of each specimen
    names      of parameters, as `wsim.fit` takes them: "stretch,bend"
    folder     of the table, as `wsim.sweep` has it
    asked      start, priors, noise, force_noise, accuracy, limit, see `FitRequest`
    Raises SceneError, before anything runs, for names that are no parameters and for files that are no observations.
    """
    return prepare_specimen_fits(scene, observed, names, folder, asked=asked, resume=resume, settings=settings).rows(told)


def prepare_specimen_fits(scene, observed, names, folder, *, asked: dict | None = None, resume: bool = False,
                          settings: Settings | None = None, variants: dict | None = None) -> Sweep:
    """Fits that are checked and have their folder."""
    wanted = tuple(n.strip() for n in (names.split(",") if isinstance(names, str) else names) if n.strip())
    path, settings = os.path.abspath(os.fspath(folder)), settings or Settings()
    require_ray(settings)
    how = FitRequest(wanted, **(asked or {}))
    job = SpecimenFits(os.path.abspath(os.fspath(scene)), variants or {}, path, 0, settings, asked=how)
    base = SweepCases(job).scene()
    parameter.parameters_of_names(list(wanted), [base], how.start)
    draws = [{"observed": os.path.abspath(os.fspath(file))} for file in observed]
    problems = []
    for draw in draws:
        try:
            read(draw["observed"], base, how.noise, force=how.force_noise)
        except SceneError as error:
            problems += error.problems
    if problems:
        raise SceneError(dict.fromkeys(problems))
    return Sweep(job, draws, SweepFolder(path, job.identity(draws, motion_digest(base)), ["observed"], resume=resume), base)
