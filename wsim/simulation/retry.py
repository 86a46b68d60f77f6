"""What makes a frame be repeated, and what is changed before: the other half of the transaction in
`wsim.simulation.simulation`."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, NoReturn

from wsim.scene import Problem, SceneError
from wsim.scene.check import counts
from wsim.scene.curve import Curve
from wsim.scene.integrator import TABLE
from wsim.scene.values.table import limits_explicit_steps
from wsim.simulation import plan as plans
from wsim.simulation.duration import format_duration
from wsim.simulation.measure.checks.lost import FixedStepsError, drop_worlds, hold_lost_worlds, worlds_not_finite

if TYPE_CHECKING:
    from wsim.model.stage import Remedy
    from wsim.model.state import SimulationState, StatePart
    from wsim.simulation.simulation import Simulation


def enter_frame(sim: Simulation) -> None:
    """A frame begins."""
    hold_lost_worlds(sim)
    for method in sim.plan.methods:
        method.choose_frame_form(sim.plan.clock)


def prepare_frame_tables(sim: Simulation) -> None:
    """The tables of the frame to come; what varies in time has its values of that frame."""
    if sim.scene.varying or any(isinstance(change[2], Curve) for change in sim.changes):
        from wsim.simulation.varying import follow_varying_values
        sim.host.call("values that vary", follow_varying_values, sim)
    sim.host.before_frame(sim)
    for method in sim.plan.methods:
        if method.moved:
            sim.graphs.forget(f"{method.name} launches something else")
            method.moved = False


def settle_built_simulation(sim: Simulation) -> None:
    """The settling of a simulation that has been built, before its first frame."""
    if sim.scene.varying:
        from wsim.simulation import varying
        varying.take_stiffest_substeps(sim)


def prepare_frame_retry(sim: Simulation) -> bool:
    """True if the frame must be repeated, after making it possible: each method says what its words of the status ask for."""
    said = [remedy for method in sim.plan.methods for remedy in method.find_remedies(sim.plan.status)]
    checks = [remedy for remedy in said if remedy.kind == "check"]
    said = [remedy for remedy in said if remedy.kind != "check"]
    if said and _act_on_remedies(sim, said):
        return True
    if not checks:
        return False
    from wsim.simulation.measure.checks.rise import raise_substeps
    return raise_substeps(sim, checks)


def _act_on_remedies(sim: Simulation, said: list[Remedy]) -> bool:
    """`prepare_frame_retry` of what keeps a frame from being whole."""
    kinds = {remedy.kind for remedy in said}
    if "room" in kinds:                                   # a frame without some of its contacts says nothing else
        _drop_graphs(sim, _grow_full_lists(sim, said, "room"))
        return True
    if sim.plan.clock.apart and kinds - {"grow", "again"}:
        raise FixedStepsError(worlds_not_finite(sim))
    if "meet" in kinds:                                   # whatever else is wrong may come of that
        sim.plan.clock.free = False
        sim.forms["repeated"] += 1
        return True
    for remedy in said:
        if remedy.kind == "stop":
            _give_up_frame(sim, remedy)
    if "refine" in kinds and (again := drop_worlds(sim)) is not None:
        _drop_graphs(sim, _grow_full_lists(sim, said, "grow"))
        return again or "grow" in kinds
    if sim.plan.choice.solver == "explicit" and kinds & {"doubt", "refine"} and (_switch_solver(sim) or _shorten_named(sim)):
        return True
    for remedy in said:
        if remedy.kind == "refine":
            _double_substeps(sim, remedy.part, remedy.row)
    grown = _grow_full_lists(sim, said, "grow")
    if "give way" in kinds and not grown:                 # a residual may come of what there was no room for
        _fall_back_to_euler(sim, next((r.why for r in said if r.kind == "give way" and r.why), ""))
    changed = "substeps were raised" if "refine" in kinds else "backward Euler from here on" if "give way" in kinds else ""
    _drop_graphs(sim, grown or [changed] * bool(changed))
    return bool(kinds - {"doubt"})


def _drop_graphs(sim: Simulation, changes: list[str]) -> None:
    """Drops graphs, where something has changed that they have."""
    if changes:
        sim.graphs.forget("; ".join(changes))


def _grow_full_lists(sim: Simulation, said: list[Remedy], kind: str) -> list[str]:
    """Makes room for what had none; what graphs do not know of it, in words."""
    grown = [(text, remedy.keeps) for remedy in said if remedy.kind == kind and remedy.act and (text := remedy.act())]
    sim.repeats += [f"frame {sim.frame + 1}: {text}; the frame was repeated" for text, _ in grown]
    return [text for text, keeps in grown if not keeps]


def _fall_back_to_euler(sim: Simulation, why: str) -> None:
    """Backward Euler, which damps what is left unsolved, from this frame on. why: if it is not for a residual."""
    clock = sim.plan.clock
    name, clock.integrator = clock.integrator.title, TABLE["backward_euler"]
    if why:
        sim.warnings.append(f"frame {sim.frame + 1}: {why}, so that {name} gains energy; backward Euler from here on")
        return
    more = "substeps" if sim.scene.solver == "auto" else "iterations or substeps"       # of iterations, auto takes its own
    sim.warnings.append(f"frame {sim.frame + 1}: the solver missed the residual that {name} needs (`met` in "
                        f"wsim.scene.integrator); backward Euler from here on; more {more} keep {name}")


def _double_substeps(sim: Simulation, part: str, row: int) -> None:
    """Twice the substeps, where a position is no number, as at a start: history is of other steps."""
    from wsim.simulation.measure.diagnose import author_of_row, first_fault_of_frame
    clock = sim.plan.clock
    path, where = author_of_row(sim.plan, part, row)
    if clock.substeps >= 16 * sim.plan.choice.substeps:
        least = sim.plan.ports.stable_substeps
        hint = f", or name a solver without a limit ({sim.plan.integrator} needs {least()} substeps at rest, more where the " \
               "shape is far from it)" if least else ""
        said = first_fault_of_frame(sim.plan, sim.time)
        raise SceneError(Problem(path, f"point {where} stopped being a number in frame {sim.frame + 1}, with "
                                 f"{clock.steps} substeps too{said and '; ' + said}; look for infinite velocities or "
                                 f"parameters{hint}"))
    clock.substeps, clock.starting = 2 * clock.substeps, True
    sim.warnings.append(f"frame {sim.frame + 1}: point {where} of {path} stopped being a number; repeated with "
                        f"{clock.steps} substeps, which stay")


def _give_up_frame(sim: Simulation, remedy: Remedy) -> NoReturn:
    """The end of a frame that no step can finish; the simulation stands where it began, and may go on, set otherwise."""
    sim.state.restore_snapshot()
    from wsim.simulation.measure.diagnose import author_of_row, place_of_point
    path, where = author_of_row(sim.plan, remedy.part, remedy.row)
    at = place_of_point(sim.plan, path, remedy.row) if remedy.part == "points" else ""     # else in `why`
    raise SceneError(Problem(path, f"point {where}{at} {remedy.why}; frame {sim.frame + 1} was given up"))


def _switch_solver(sim: Simulation) -> bool:
    """Goes on with XPBD (soft bodies: Newton's method) where an edge has more than doubled under an explicit integrator that
    nobody asked for by name: its step may have thrown it. Live parameters are set again."""
    scene = sim.scene
    if (scene.solver, scene.integrator) != ("auto", "auto") or sim.plan.choice.other is None:
        return False
    sim.state.restore_snapshot()
    kept = {name: sim.state.points.arrays[name].numpy() for name in ("x", "e", "v")}
    flowed = {(part.name, f.name): part.arrays[f.name].numpy() for part in _parts_but_points(sim.state) for f in part.kept}
    other = sim.plan.choice.other
    sim.scene = replace(scene, solver=other.solver, integrator="backward_euler", substeps=other.substeps,
                        iterations=other.iterations)
    sim.plan = plans.build_plan(sim.scene, device=sim.device, real=sim.model.real, worlds=sim.worlds)
    sim.model, sim.state = sim.plan.model, sim.plan.state
    sim.graphs.forget("another solver from here on")
    for name, values in kept.items():
        sim.state.points.arrays[name].assign(values)
    for part in _parts_but_points(sim.state):
        for f in part.kept:
            if len(flowed[part.name, f.name]) == part.capacity:             # else a list that has grown: it begins anew
                part.arrays[f.name].assign(flowed[part.name, f.name])
    for path, name, value, world in sim.changes:
        for method in sim.plan.methods:
            method.set_value(path, name, value, world)
    sim.seconds.pop("compile", None)
    sim.load()
    sim.state.take_snapshot()
    name = "Newton steps" if other.solver == "implicit" else "XPBD"
    sim.warnings.append(f"frame {sim.frame + 1}: an edge stretched to more than twice its length under leapfrog; from here on "
                        f"{name}, {other.substeps} substeps of {other.iterations} iteration{'s' * (other.iterations > 1)}")
    return True


def _parts_but_points(state: SimulationState) -> list[StatePart]:
    """Parts but the points."""
    return [part for part in state.parts.values() if part.name != "points"]


def keep_stable(sim: Simulation, name: str, thing=None, path: str = "", value=None, world: int | None = None) -> None:
    """Explicit steps follow a live parameter that makes the scene stiffer, and begin anew: leapfrog's velocity is that of half
    a step before. thing .. world: what was set to what, where that is known."""
    stable, clock = sim.plan.ports.stable_substeps, sim.plan.clock
    if stable is None or not limits_explicit_steps(name):
        return
    if sim.headroom is None:
        from wsim.simulation.live_stability import LiveStability
        sim.headroom = LiveStability()
    known = sim.headroom
    if known.holds(thing, path, name, value, world, clock.substeps):
        return
    least = stable()
    if least > counts.MOST:
        known.forget()
    counts.refuse_large_count(f"substeps a frame, which {name} of that size wants of {sim.plan.integrator},", least,
                              "set another value, or name a solver without a limit")
    known.found(least)
    if least > clock.substeps:
        each = sim.plan.seconds * least / sim.plan.choice.substeps
        about = f", about {format_duration(each)} a frame" if least > counts.MANY else ""
        sim.warnings.append(f"frame {sim.frame + 1}: {name} was set; {sim.plan.integrator} now takes {least} substeps instead "
                            f"of {clock.substeps}{about}")
        clock.substeps, clock.starting = least, True
        sim.graphs.forget(f"{name} was set, which takes more substeps")


def _shorten_named(sim: Simulation) -> bool:
    """`wsim.simulation.live_stability.shorten_steps`, where steps that a scene names may be too long."""
    if sim.plan.choice.bears == inf:
        return False
    from wsim.simulation.live_stability import shorten_steps
    return shorten_steps(sim)


def failure_in_words(error: Exception, device) -> SceneError:
    """`wsim.simulation.measure.memory.allocation_failure`, imported when something has failed."""
    from wsim.simulation.measure import memory
    return memory.allocation_failure(error, device)
