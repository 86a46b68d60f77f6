"""Example scenes (scenes/*.usda) with every solver and integrator, held against a converged run of the same scene.

    converged   Newton's method, backward Euler, CONVERGED substeps of so many Newton steps, to a residual under 1 or as it says
                (in Newton's steps, not in time: it damps. Of the flag, after a second, it leaves an RMS strain of .013, BDF2 of
                32 substeps .018, sdirk3 of 32 .020, leapfrog .028)
    strain      at the end: RMS and largest of the edges, at most WORSE times those of the converged run
    energy      kinetic + elastic + gravity, less the work of the wind and of what carries the scene (`tools.stress.work`), at
                every frame: at most what there was at the start and COUNTED of what was turned over. Where something else
                does work, as pins that go apart: at most what the converged run had until then and SLACK of what that
                turned over.
                Of sweeps without the elastic part: of what they have not resolved a step can free next to nothing
                (`tools.stress.energy`)
    turned over the largest of the kinetic energies, of the way of the energy, and of the work given and taken in all
    refusal     a SceneError before the first frame: this scene is none for this solver, and why
"""

from dataclasses import asdict, dataclass, field, replace
from functools import cache
from math import ceil, inf
from pathlib import Path
from time import perf_counter

import numpy as np

from tools.stress.judge import Verdict
from tools.stress.solvers import MOST, STRETCHED, Solver
from tools.stress.work import Work
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation
from wsim.usd import load

FOLDER = Path(__file__).resolve().parents[2] / "scenes"
CONVERGED = 16, 10     # substeps of a frame, Newton steps of a substep
NEWTON = 8, 6          # of those that are judged
WORSE = 10.0
FLOOR = 1e-3           # strain that is none: cloth that hangs or lies loosely
SLACK = 0.25           # solvers differ in what is not counted
COUNTED = 0.05         # explicit integrators swing about the energy that they keep, near the limit of their steps
GROWS = {"explicit_euler", "midpoint"}                   # at every step, see `tools.stress.solvers`


@dataclass
class Example:
    """One run. Lists have an entry a frame; the energy's begins at the start [J]."""

    scene: str
    solver: str
    energy: list[float] = field(default_factory=list)      # less the work that is counted
    kinetic: list[float] = field(default_factory=list)
    rms: list[float] = field(default_factory=list)
    largest: list[float] = field(default_factory=list)
    refusal: str = ""
    broke: str = ""
    residual: float = 0.0
    ms: float = 0.0
    notes: list[str] = field(default_factory=list)
    start: float = 0.0                                     # elastic energy included [J]
    work: float = 0.0                                      # counted [J]
    turned: float = 0.0                                    # by it, to and fro [J]
    besides: str = ""                                      # what does work and is not counted


@cache
def names() -> list[str]:
    """Scenes with points, which solvers and integrators step."""
    scenes = {p.stem: load(p) for p in sorted(FOLDER.glob("*.usda"))}
    return [name for name, scene in scenes.items() if scene.cloths or scene.springs or scene.softs]


def converged(name: str, frames: int, device, precision: str) -> Example:
    scene = load(FOLDER / f"{name}.usda")
    substeps, iterations = CONVERGED
    return run(name, "converged", replace(scene, solver="implicit", integrator="backward_euler", substeps=substeps,
                                          iterations=iterations), frames, device, precision)


def case(name: str, solver: Solver, frames: int, device, precision: str) -> Example:
    """One scene with one solver."""
    scene = replace(load(FOLDER / f"{name}.usda"), solver=solver.solver, integrator=solver.integrator)
    if solver.solver == "implicit":
        substeps, iterations = NEWTON
        scene = replace(scene, substeps=substeps, iterations=iterations)
    if solver.needs and solver.integrator != "auto":
        try:
            scene = replace(scene, substeps=max(scene.substeps, steps(scene, solver)))
        except SceneError as error:
            return Example(name, solver.name, refusal=str(error))
        if scene.substeps * scene.fps > MOST:
            return Example(name, solver.name, refusal=f"it would take {scene.substeps * scene.fps:.3g} substeps a second, "
                                                      f"at most {MOST} are asked for")
    return run(name, solver.name, scene, frames, device, precision)


def steps(scene: Scene, solver: Solver) -> int:
    """Substeps a frame that an explicit integrator needs, by the frequency that bounds the scene at rest; of soft bodies as
    much more as rows of them get."""
    import warp as wp

    from wsim.model import model
    from wsim.physics.cloth.constraints import fill_constraints
    from wsim.physics.motion import frequency
    from wsim.physics.motion.stability import substeps_needed
    from wsim.scene.integrator import TABLE
    built = model.build_model(scene, 1, wp.get_device("cpu"), wp.float64)
    fill_constraints(built)
    omega, c = frequency.frequency_bound(built)
    assert solver.needs is not None
    grown = STRETCHED if scene.softs else 1.0
    return max(substeps_needed(scene, TABLE[solver.integrator], omega, c), ceil(1.05 * solver.needs(grown * omega) / scene.fps))


def run(name: str, solver: str, scene: Scene, frames: int, device, precision: str) -> Example:
    """As many frames as the scene has, or `frames`."""
    found = Example(name, solver)
    try:
        sim = Simulation(scene, device=device, precision=precision)
        sim.load()
    except SceneError as error:
        found.refusal = str(error)
        return found
    try:
        now, work = sim.indicators(), Work(sim, min(frames, scene.frames))
        found.start, found.besides = now["energy"], work.besides
        found.energy.append(held(sim, now))
        spent: list[float] = []
        for _ in range(min(frames, scene.frames)):
            began, here = perf_counter(), work.seconds
            sim.step()
            spent.append(perf_counter() - began - (work.seconds - here))
            measure(sim, found, work)
        found.ms, found.notes = 1e3 * float(np.mean(spent[1:] or spent)), list(sim.warnings)
    except Exception as error:                           # whatever comes out of a run that had begun is a fault
        found.broke = f"{type(error).__name__}: {error}"
    return found


def held(sim: Simulation, now: dict[str, float]) -> float:
    """Energy [J] that is judged."""
    return now["energy"] - (now.get("elastic_energy", 0.0) if sim.plan.choice.solver == "xpbd" else 0.0)


def measure(sim: Simulation, found: Example, work: Work) -> None:
    now = sim.indicators()
    work.close()
    found.work, found.turned = work.total, work.gross
    found.energy.append(held(sim, now) - work.total)
    found.kinetic.append(now["kinetic_energy"])
    found.rms.append(now.get("rms_strain", 0.0))
    found.largest.append(now.get("max_strain", 0.0))
    found.residual = max(found.residual, now.get("residual", 0.0))


def judge(found: Example, right: Example) -> Verdict:
    """right: the converged run."""
    if found.refusal:
        return Verdict(True, f"none for this solver: {found.refusal.splitlines()[0]:.140}")
    if right.refusal or right.broke:
        return Verdict(False, f"nothing to compare with: {right.refusal or right.broke}")
    if found.broke:
        return Verdict(False, found.broke.splitlines()[0][:200])
    faults = []
    for what in ("rms", "largest"):
        now, bound = getattr(found, what)[-1], WORSE * max(getattr(right, what)[-1], FLOOR)
        if not now <= bound:                             # also: no number
            faults.append(f"{what} strain {now:.3g}, converged {getattr(right, what)[-1]:.3g}")
    over, slack = excess(found, right)
    if not over <= slack:
        faults.append(f"gains {over:.3g} of the energy turned over")
    if faults and found.solver.partition("/")[2] in GROWS:
        return Verdict(True, f"{'; '.join(faults)}, as listed: it grows at any step")
    said = f"; says: {found.notes[-1][:100]}" if found.notes else ""
    return Verdict(not faults, ("; ".join(faults) or "held") + said)


def excess(found: Example, right: Example) -> tuple[float, float]:
    """Largest energy above what there may be, over what was turned over; and what is allowed."""
    of = right if found.besides else found
    ceiling = np.maximum.accumulate(right.energy) if found.besides else np.full(len(found.energy), found.start)
    turned = max(max(of.kinetic), float(np.ptp(of.energy)), of.turned, 1e-12)
    over = [(e - c) / turned for e, c in zip(found.energy, ceiling, strict=False)]
    return float(np.max(over)) if np.isfinite(over).all() else inf, SLACK if found.besides else COUNTED


def line(found: Example, verdict: Verdict) -> str:
    strain, most = (f"{x[-1]:.2g}" if x else "-" for x in (found.rms, found.largest))
    return (f"{'scene ' + found.scene:<26} {found.solver:<26} {most:>12} {strain:>9} {found.residual:>8.3g} "
            f"{found.ms:>7.2f}  {'' if verdict.held else 'FAILS: '}{verdict.text}")


def as_dict(found: Example, verdict: Verdict) -> dict:
    numbers = {k: v for k, v in asdict(found).items() if k not in ("energy", "kinetic", "rms", "largest")}
    last = {"final_rms": found.rms[-1] if found.rms else None, "final_largest": found.largest[-1] if found.largest else None}
    return numbers | last | {"row": f"scene {found.scene}", "held": verdict.held, "verdict": verdict.text}
