"""Runs of a sweep in one process: scenes and kernels are loaded once, and runs that fit share one set of arrays as worlds.

A run ends as `wsim run` of its scene would, to the bit, whatever its company (tests/sweep/test_worlds.py), but for one thing:
where there are colliders every frame has contacts, so that no run depends on whether another touches something. Worlds of one
simulation have the same base, solver, integrator and steps. Where a frame asks for what would change the steps of all (a
position that is not finite, a missed residual), the runs that asked, or halves until it is known which, run apart.
"""

import os
import socket
import traceback
from dataclasses import replace
from time import perf_counter
from typing import Any

from wsim.model import kernel_cache
from wsim.scene import Scene, SceneError
from wsim.simulation import plan as plans
from wsim.simulation.measure.checks.lost import FixedStepsError
from wsim.simulation.measure.checks.rise import left_open
from wsim.simulation.predicted import sag
from wsim.simulation.simulation import PRECISIONS, Simulation
from wsim.sweep import case as cases
from wsim.sweep.case import SweepCase, SweepCases
from wsim.sweep.job import Job
from wsim.sweep.share import reason_runs_go_apart, size_of_world
from wsim.sweep.vary.draws import Draw
from wsim.sweep.world import FinishedWorld, ResultLayers, worlds_of

Row = dict[str, Any]
SMALL = 4096           # points of one state on a CPU: more gain nothing there, and leave its caches
FILES = 64             # result layers that grow at once


class Worker:
    """Runs cases of a job. `run` gives a row for each, in their order."""

    def __init__(self, job: Job):
        self.job, self.cases = job, SweepCases(job)
        self.device = kernel_cache.warp_device(job.settings.device)
        self.real = PRECISIONS[job.settings.precision]
        self.name = f"{socket.gethostname()}:{os.getpid()}"

    # how runs are put together

    def most(self, scene: Scene) -> int:
        """Worlds that share arrays at most."""
        asked, points = self.job.settings.worlds, size_of_world(scene)
        if not points or reason_runs_go_apart(scene):
            return 1
        most = asked or (4096 if self.device.is_cuda else max(1, SMALL // points))
        if most > 1 and self.device.is_cuda:
            from wsim.simulation.measure.memory import MemoryForWorlds
            most = min(most,
                       max(1, MemoryForWorlds.of(Simulation(scene, device=self.device, precision=self.job.settings.precision),
                                                       most).fit))
        return min(most, FILES) if self.job.settings.keep == "all" else most

    def run(self, runs: list[tuple[int, Draw]]) -> list[Row]:
        """A row of each run."""
        rows: dict[int, Row] = {}
        groups: dict[tuple, list[tuple[int, Draw, SweepCase]]] = {}
        for number, draw in runs:
            try:
                case = self.cases.case(draw)
                groups.setdefault((case.key, *self.resolved_scheme(case)), []).append((number, draw, case))
            except Exception as error:
                rows[number] = self._row_of_failure(number, draw, error)
        for (_, *how), members in groups.items():
            most = self.most(members[0][2].base)
            for k in range(0, len(members), most):
                for row in self._run_together(members[k:k + most], how):
                    rows[row["run"]] = row
        return [rows[number] for number, _ in runs]

    def resolved_scheme(self, case: SweepCase) -> tuple:
        """Solver, integrator, substeps, iterations that its scene comes to."""
        scene = case.scene.single() if self.job.settings.precision == "float32" else case.scene
        named = scene.solver in ("xpbd", "implicit") and scene.integrator != "auto"
        if not scene.bodies() or named:
            return scene.solver, scene.integrator, sag.rigid_body_substeps(scene), scene.iterations
        choice = plans.choice_of_scene(scene, device=self.device, real=self.real)
        return choice.solver, choice.integrator.name, choice.steps, choice.iterations

    def _run_together(self, members: list, how: list) -> list[Row]:
        """Rows of runs as worlds; apart where they disturb each other."""
        if len(members) == 1:
            return [self._run_alone(*members[0])]
        try:
            return self._run_as_worlds(members, how)
        except (FixedStepsError, SceneError) as error:    # SceneError: a value that a running world does not take, or no memory
            worlds = getattr(error, "worlds", set())
            own, rest = ([m for k, m in enumerate(members) if (k in worlds) == inside] for inside in (True, False))
            if own and rest:
                return [self._run_alone(*m) for m in own] + self._run_together(rest, how)
            half = len(members) // 2
            return self._run_together(members[:half], how) + self._run_together(members[half:], how)

    # runs

    def _run_as_worlds(self, members: list, how: list) -> list[Row]:
        """Rows of two runs or more. Raises Company where one would change the steps of the others."""
        began = perf_counter()
        solver, integrator, substeps, iterations = how
        base = replace(members[0][2].base, solver=solver, integrator=integrator, substeps=substeps, iterations=iterations)
        sim = Simulation(base, device=self.device, precision=self.job.settings.precision, worlds=len(members))
        sim.plan.clock.touching = sim.plan.clock.apart = True
        sim.plan.clock.open = left_open(members[0][2].scene)
        steps = sim.plan.clock.substeps
        cases.set_live_values(sim, [case for _, _, case in members])
        for world, (_, _, case) in enumerate(members) if members[0][2].start else ():
            cases.start_from_result(sim, self.cases.started(case), world)
        if sim.plan.clock.substeps != steps:              # a value that explicit steps are too long for by the bound
            raise FixedStepsError(set())
        layers = ResultLayers(self.job, [(number, draw, case) for number, draw, case in members])
        self._run_all_frames(sim, layers)
        found = worlds_of(sim)
        files = layers.close(found)
        each = (perf_counter() - began) / len(members)
        return [self._row_of_run(number, draw, case, world, file, each, len(members))
                for (number, draw, case), world, file in zip(members, found, files, strict=True)]

    def _run_alone(self, number: int, draw: Draw, case: SweepCase) -> Row:
        """Row of one run, in a simulation of its own; tried again where it fails for another reason than its scene."""
        tries, (row, certain) = 1, self._try_one_run(number, draw, case)
        while not certain and tries <= self.job.settings.retries:
            tries, (row, certain) = tries + 1, self._try_one_run(number, draw, case)
        return {**row, "tries": tries}

    def _try_one_run(self, number: int, draw: Draw, case: SweepCase) -> tuple[Row, bool]:
        """Row of one run, and whether a failure is its scene's, so that it would fail again."""
        began = perf_counter()
        try:
            sim = Simulation(case.scene, device=self.device, precision=self.job.settings.precision)
            sim.plan.clock.touching = True
            cases.start_from_result(sim, self.cases.started(case))
            layers = ResultLayers(self.job, [(number, draw, case)])
            self._run_all_frames(sim, layers)
            found = worlds_of(sim)
            return self._row_of_run(number, draw, case, found[0], layers.close(found)[0], perf_counter() - began, 1), True
        except Exception as error:
            return self._row_of_failure(number, draw, error, case, perf_counter() - began), isinstance(error, SceneError)

    def _run_all_frames(self, sim: Simulation, layers: ResultLayers) -> None:
        """All frames. Layers of runs that do not come to their end are dropped."""
        try:
            layers.look(sim)
            for _ in range(sim.scene.frames):
                sim.step()
                layers.look(sim)
        except BaseException:
            layers.drop()
            raise

    # rows

    def _row_of_run(self, number: int, draw: Draw, case: SweepCase, world: FinishedWorld, file: str, seconds: float,
                    worlds: int) -> Row:
        return {**self._head(number, draw), "status": "done", "why": "", "frames": case.scene.frames, **world.error,
                "warnings": " | ".join(world.warnings), **self._last_columns(case), "state": world.state, "result": file,
                "seconds": seconds, "worker": self.name, "worlds": worlds, "tries": 1}

    def _row_of_failure(self, number: int, draw: Draw, error: Exception, case: SweepCase | None = None,
                        seconds: float = 0.0) -> Row:
        said = error.problems if isinstance(error, SceneError) else []
        last = traceback.extract_tb(error.__traceback__)[-1:] if not said else []
        where = f" ({os.path.basename(last[0].filename)}, line {last[0].lineno})" if last else ""
        why = " | ".join(f"{p.path}: {p.text}" for p in said) or f"{type(error).__name__}: {error}{where}"
        return {**self._head(number, draw), "status": "failed", "why": why, "frames": 0, "warnings": "",
                **self._last_columns(case),
                "state": "", "result": "", "seconds": seconds, "worker": self.name, "worlds": 1, "tries": 1}

    def _head(self, number: int, draw: Draw) -> Row:
        return {"run": number, **{name: list(v) if isinstance(v, tuple) else v for name, v in draw.items()}}

    def _last_columns(self, case: SweepCase | None) -> Row:
        from wsim import __version__
        return {"seed": self.job.seed, "version": __version__, "scene_hash": cases.motion_digest(case.scene) if case else ""}


