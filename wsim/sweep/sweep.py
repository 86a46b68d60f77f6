"""Sweeps: one scene in many variations.

    for row in wsim.sweep("flag.usda", ["/flag:stretch=log(100,10000,20)"], "stretches"):
        print(row["/flag:stretch"], row["max_strain"])

Every draw is checked before anything runs. Runs are handed out in parts, to this process or to workers of Ray; a row is on the
disk before it is yielded. `wsim.sweep.folder` says what stands in the folder, `wsim.sweep.vary.draws` how draws are written,
`wsim.sweep.vary.target` what may vary.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from wsim.scene import Problem, Scene, SceneError
from wsim.sweep.case import SweepCases, absolute_draw_paths, motion_digest
from wsim.sweep.folder import SweepFolder
from wsim.sweep.job import Job, Settings
from wsim.sweep.share import reason_runs_go_apart
from wsim.sweep.vary import draws as drawn
from wsim.sweep.vary.draws import Draw

Row = dict[str, Any]
SHARES = 4             # parts that each worker gets at least, so that the last do not wait for one


def sweep(scene: str | os.PathLike | Scene, vary: str | Iterable[str], folder: str | os.PathLike, *, latin: int | None = None,
          seed: int = 0, resume: bool = False, settings: Settings | None = None,
          told: Callable[[int, int], None] | None = None) -> Iterator[Row]:
    """Runs a scene once for each draw and yields a row of each as it ends.

    scene      a file, or a `Scene`
    vary       axes: "TARGET=log(LOW,HIGH,N)", lin(...), list(A,B), "TARGET=FILE.csv", "FILE.csv"; a grid is their product
    folder     of the table and results: not there, empty, or with `resume` that of this very sweep
    latin      so many draws of a Latin hypercube instead of a grid; seed: of these draws
    told       called with (runs that have ended, all of them)
    Raises SceneError, before anything runs, with every draw that the checks refuse, and for a folder that holds another sweep.
    A row has run, the values, status ("done" or "failed", why), errors, warnings, seconds, seed, version, scene_hash.
    """
    prepared = Sweep.prepare_sweep(scene, vary, folder, latin=latin, seed=seed, resume=resume, settings=settings)
    return prepared.rows(told)


class Sweep:
    """A sweep that is checked and has its folder: `rows` runs it."""

    def __init__(self, job: Job, draws: list[Draw], folder: SweepFolder, base: Scene):
        """base: the scene as it is loaded."""
        self.job, self.draws, self.folder, self.base = job, draws, folder, base
        self.said: Callable[[str], None] = lambda text: None          # called with what workers are

    @staticmethod
    def prepare_sweep(scene, vary, folder, *, latin: int | None = None, seed: int = 0, resume: bool = False,
                      settings: Settings | None = None, variants: dict | None = None) -> "Sweep":
        """See `sweep`; variants: of every run, as `wsim.load` takes them."""
        settings = settings or Settings()
        require_ray(settings)
        axes = drawn.parse_sweep_axes([vary] if isinstance(vary, str) else list(vary))
        draws = [absolute_draw_paths(d)
                 for d in (drawn.grid_draws(axes) if latin is None else drawn.latin_hypercube(axes, latin, seed))]
        path = os.path.abspath(os.fspath(folder))
        given = scene if isinstance(scene, Scene) else os.path.abspath(os.fspath(scene))
        job = Job(given, variants or {}, path, seed, settings)
        cases = SweepCases(job)
        base = cases.scene()
        cases.check(draws)
        if not isinstance(given, Scene) and os.path.commonpath([path, given]) == path:
            raise SceneError(Problem(path, "holds the scene itself; give another folder"))
        names = list(dict.fromkeys(name for d in draws for name in d))
        return Sweep(job, draws, SweepFolder(path, job.identity(draws, motion_digest(base)), names, resume=resume), base)

    def rows(self, told: Callable[[int, int], None] | None = None) -> Iterator[Row]:
        """Rows as runs end; those that an earlier sweep left come first. The table is whole whenever this stops."""
        runs = [(k, d) for k, d in enumerate(self.draws) if k not in self.folder.rows]
        done = len(self.folder.rows)
        try:
            yield from self.folder.ordered()
            for found in self._parts(runs):
                self.folder.add(found)
                done += len(found)
                if told:
                    told(done, len(self.draws))
                yield from found
        finally:
            self.folder.close()

    def why_one_after_another(self, runs: list[tuple[int, Draw]]) -> str:
        """Why runs share no arrays as worlds; "" where some do."""
        if why := reason_runs_go_apart(self.base):
            return why
        cases = SweepCases(self.job)
        found = [cases.case(draw) for _, draw in runs[:SHARES]]
        if len({case.key for case in found}) < len(found):
            return ""
        built = sorted({name for case in found for name in case.built})
        return f"each value of {', '.join(built)} is built into a scene of its own" if built else ""

    def _parts(self, runs: list[tuple[int, Draw]]) -> Iterator[list[Row]]:
        """Rows of parts as they end."""
        if not runs:
            return
        if len(runs) > 1 and self.job.runs == Job.runs and (why := self.why_one_after_another(runs)):
            self.said(f"runs go one after another on each worker: {why}")
        if self.job.settings.remote:
            from wsim.sweep.cluster import RayCluster
            with RayCluster(self.job) as cluster:
                for text in cluster.said:
                    self.said(text)
                yield from cluster.run(split_runs_into_parts(runs, cluster.size, cluster.most))
            return
        worker = import_module(self.job.runs).Worker(self.job)
        for part in split_runs_into_parts(runs, 1, worker.most(self.base)):
            yield worker.run(part)


def require_ray(settings: Settings) -> None:
    """Raises SceneError where workers are asked for and Ray is missing."""
    if settings.remote and find_spec("ray") is None:
        option = "--workers" if settings.address is None else "--address"
        raise SceneError(Problem(option, "Ray is not installed; install it by: pip install -e \".[sweep]\", or leave both out: "
                                 "one process runs the same sweep"))


def split_runs_into_parts(runs: list[tuple[int, Draw]], workers: int, most: int) -> list[list[tuple[int, Draw]]]:
    """Runs in parts of `most`, fewer where workers would wait for each other."""
    size = max(1, most if workers == 1 else min(most, -(-len(runs) // (workers * SHARES))))
    return [runs[k:k + size] for k in range(0, len(runs), size)]

