"""Runs one row with one solver and measures every frame; and runs it in a process of its own, so that a hang is seen.

The ledger: `budget` starts as the energy of the scene plus `Row.work`, and grows by what every act changes at one state
(positions moved, velocities given, gravity turned: energy after minus before). Nothing else may raise the energy.
"""

import multiprocessing
import time
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
import warp as wp

from tools.stress import judge
from tools.stress.energy import Elastic, elastic_of, fastest
from tools.stress.judge import Record
from tools.stress.rows import Row
from tools.stress.scenes import SIDE
from tools.stress.solids import Solid
from tools.stress.solvers import MOST, Solver, given, limit
from tools.stress.table import ROWS
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation

START = 120.0          # [s] for imports and compilation in a fresh process, on top of the limit of a row


@dataclass
class Run:
    """A simulation with its ledger: what `Row.act` is given."""

    scene: Scene
    sim: Simulation
    row: Row
    parts: list[tuple[str, Elastic | Solid]]
    gravity: np.ndarray
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))
    places: dict = field(default_factory=dict)

    @staticmethod
    def start(row: Row, solver: Solver, device, precision: str) -> "Run":
        scene = given(row.scene(), solver)
        sim = Simulation(scene, device=device, precision=precision)
        return Run(scene, sim, row, elastic_of(scene), np.asarray(scene.gravity, float))

    def set(self, path: str, name: str, value) -> None:
        self.sim.set(path, name, value)
        if name == "gravity":
            self.gravity = np.asarray(value, float)

    def state(self) -> list[tuple[Elastic | Solid, np.ndarray, np.ndarray]]:
        return [(e, self.sim.positions(path), self.sim.velocities(path)) for path, e in self.parts]

    def energy(self, whole: bool) -> float:
        """Kinetic, gravitational and elastic energy [J]; whole: all that is stored, else what a substep can free."""
        h = 0.0 if whole else 1.0 / self.scene.fps / self.sim.plan.clock.substeps
        total = 0.0
        for e, x, v in self.state():
            total += 0.5 * float(e.masses @ (np.sum(v * v, axis=1) * (e.weights > 0.0)))
            total -= float((e.masses * (e.weights > 0.0)) @ ((x - self.row.level) @ self.gravity))
            total += e.stored(x, h)
        return total

    def momentum(self) -> tuple[np.ndarray, float]:
        """sum m v [kg m/s], (3,), and sum m |v|."""
        found = [(e.masses @ v, float(e.masses @ np.linalg.norm(v, axis=1))) for e, _, v in self.state()]
        return sum(p for p, _ in found), sum(s for _, s in found)

    def strain(self) -> tuple[float, float]:
        """RMS and largest |strain| of the edges, or of the tets, by their volume."""
        if self.row.soft:
            (_, e), = self.parts
            assert isinstance(e, Solid)
            each = e.strain(self.sim.positions())
            return float(np.sqrt(np.average(each**2, weights=e.volumes))), float(each.max())
        all_ = np.concatenate([e.strain(x) for e, x, _ in self.state()])
        return float(np.sqrt(np.mean(all_**2))), float(np.abs(all_).max())

    def finite(self) -> bool:
        return all(np.isfinite(x).all() and np.isfinite(v).all() for _, x, v in self.state())


def case(row: Row, solver: Solver, device=None, precision: str = "float32", long: bool = False) -> Record:
    """Runs to the end, to the first number that is none, to a refusal, or to the limit."""
    record = Record(row.name, solver.solver, solver.integrator, limit=row.seconds * (100 if long and row.rest else 1))
    if solver.needs and solver.integrator == "auto" and limit(row.scene(), solver) > MOST:
        record.refusal = "not run: it would take all the substeps that it needs"
        return record
    try:
        run = Run.start(row, solver, device, precision)
        steps = run.scene.fps * run.sim.plan.clock.substeps
        if solver.needs and solver.integrator == "auto" and steps > MOST:
            record.refusal = f"not run: it takes the {steps:.3g} substeps a second that it needs, and says so"
            return record
        run.sim.plan.before_frame(0.0)
        _frames(run, record, long)
        _bounds(run, record, solver)
        record.notes = run.sim.warnings
    except SceneError as error:
        record.refusal = str(error)
    except Exception as error:                           # whatever else comes out of it is a fault of its own
        record.broke = f"{type(error).__name__}: {error}"
    return record


def _frames(run: Run, record: Record, long: bool) -> None:
    row, settle = run.row, run.row.settle + (run.row.rest * (50 if long else 1))
    record.abused = row.frames
    budget = run.energy(True) + row.work
    spent, first = 0.0, None
    for frame in range(row.frames + settle):
        before = run.energy(True) if row.act and frame < row.frames else 0.0
        if row.act and frame < row.frames and row.act(run, frame):
            budget += run.energy(True) - before
        if frame == row.frames:
            run.set("/", "air_drag", row.drag)
        if frame == 0:
            record.budget.append(budget)
            record.energy.append(run.energy(False))
            start = run.momentum()
            record.worst = run.strain()[1]
        began = time.perf_counter()
        run.sim.step()
        took = time.perf_counter() - began
        spent, first = (spent + took, first) if frame else (0.0, took)
        _measure(run, record, budget, start if row.momentum and frame < row.frames else None)
        record.seconds += took
        if frame == row.frames + row.settle - 1:
            run.places = {path: run.sim.positions(path) for path, _ in run.parts}
        elif frame >= row.frames + row.settle:
            _resting(run, record)
        if not record.finite or record.seconds > record.limit:
            break
    record.ms = 1e3 * spent / max(len(record.strain) - 1, 1)


def _measure(run: Run, record: Record, budget: float, start) -> None:
    record.finite = record.finite and run.finite()
    if not record.finite:
        return
    record.budget.append(budget)
    record.energy.append(run.energy(False))
    rms, worst = run.strain()
    record.strain.append(rms)
    record.worst = max(record.worst, worst)
    if start is not None:
        record.momentum.append(float(np.linalg.norm(run.momentum()[0] - start[0])) / max(start[1], 1e-300))


def _resting(run: Run, record: Record) -> None:
    for path, _ in run.parts:
        away = np.linalg.norm(run.sim.positions(path) - run.places[path], axis=1)
        record.drift = max(record.drift, float(away.max()))
        record.jitter = max(record.jitter, float(np.linalg.norm(run.sim.velocities(path), axis=1).max()))


def _bounds(run: Run, record: Record, solver: Solver) -> None:
    """What the record is held to, from the row, the solver and the worst strain of the abuse."""
    row, scene = run.row, run.scene
    h = 1.0 / scene.fps / run.sim.plan.clock.substeps
    early = record.strain[:record.abused + row.settle // 3]
    faded = max(early, default=0.0) * row.faded(2.0 / 3.0 * row.settle / scene.fps)
    gravity = float(np.linalg.norm(run.gravity))
    if solver.solver == "auto" and not row.soft:
        record.left = sqrt(3.0) * scene.error            # its promise, RMS over the size: a strain s moves y by s y
    if solver.sweeps:
        record.left = judge.sweeps_leave(gravity, h, row.edges, row.edge, run.sim.plan.clock.iterations)
    if solver.integrator == "symplectic_euler":
        record.swing = judge.swing(min(0.5 * h * fastest(run.scene), 0.99))
    if row.soft and run.sim.plan.choice.integrator.name == "leapfrog":
        record.swing = judge.leapfrog_swing(min(0.5 * h * fastest(run.scene), 0.99))
    record.bound = judge.recovery(row.static, faded) if row.recovers else np.inf
    record.momentum_bound = row.momentum or np.inf
    if row.rest:
        place = 2.0**-24 * SIDE                          # [m] to which float32 knows a place
        record.drift_bound, record.jitter_bound = 300.0 * place, 10.0 * place / h


class Worker:
    """A process that does one thing after another; one that does not answer in time is ended, and a new one started."""

    def __init__(self):
        self.context = multiprocessing.get_context("spawn")
        self.process = None

    def ask(self, work, arguments: tuple, seconds: float):
        """work(*arguments), done there: (True, answer), or (False, why) when there was none in time."""
        if self.process is None:
            self.here, there = self.context.Pipe()
            self.process = self.context.Process(target=_answer, args=(there,), daemon=True)
            self.process.start()
            there.close()
        self.here.send((work, arguments))
        try:
            if self.here.poll(seconds):
                return True, self.here.recv()
            why = f"no answer in {seconds:g} s"
        except EOFError:
            why = "the process died"
        self.end()
        return False, why

    def end(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.join()
            self.process = None


def _answer(pipe) -> None:
    wp.config.log_level = 40                             # the table is what is read
    while True:
        work, arguments = pipe.recv()
        pipe.send(work(*arguments))


def named(row: str, solver: Solver, device, precision: str, long: bool) -> Record:
    """`case`, by the row's name: rows hold functions, which do not travel."""
    return case(next(r for r in ROWS if r.name == row), solver, device, precision, long)


def watched(worker: Worker, row: Row, solver: Solver, *more) -> Record:
    """`case` in the worker; a hang is a record too."""
    long = bool(more[-1])
    seconds = START + 1.5 * row.seconds * (100 if long and row.rest else 1)
    done, answer = worker.ask(named, (row.name, solver, *more), seconds)
    if done:
        return answer
    return Record(row.name, solver.solver, solver.integrator, hung="no answer" in answer, broke=answer, limit=row.seconds)
