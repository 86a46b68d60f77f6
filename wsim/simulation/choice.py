"""Which solver and integrator a scene is stepped with: what it names, and where it leaves that open, what costs least of what
errs by no more than `Scene.error` of the scene's size over the time T = sqrt(2 L / g) of a fall through a body's size L.

    explicit    leapfrog needs n = dt / limit substeps a frame (`wsim.physics.motion.stability`); where it is stable it errs by
                less than the others; where slivers make it dear, with mass (`wsim.physics.motion.fused.mass_scaling`)
    implicit    Newton steps, where neighbouring masses differ so much that sweeps would not carry a load from one to the
                other (stress rows "heavy last": XPBD at 10 x 4 left a strain of 12, bound 3.4), and of soft bodies; of sheets
                BDF2 with one Newton step a substep, where as many as the wanted error takes cost less than sweeps
    xpbd        as many substeps of backward Euler as the wanted error takes, or those that the scene names if they are more,
                and the scene's sweeps or one, whichever costs less; so many that the edges that carry a cloth are strained by
                no more than STRAINED times that error. Particles: as often as the scene names

What each errs by: `wsim.simulation.predicted.errors`. What a frame costs: `wsim.simulation.cost`. How often the choice misses:
tools/bench/choice/misses.py (tools/results/data/choice_*.json). For so many frames a second: `wsim.simulation.predicted.rate`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, inf

import numpy as np

from wsim.model.model import Model, edge_lengths
from wsim.physics.motion.stability import substeps_needed
from wsim.scene import Scene
from wsim.scene.attachments import body_ties
from wsim.scene.integrator import TABLE, Integrator
from wsim.scene.methods import has_collisions, has_tets, method_colliders, solid_materials
from wsim.simulation import cost
from wsim.simulation.duration import percent_of_size
from wsim.simulation.predicted import errors, sag, sweep_strain
from wsim.simulation.predicted.errors import HIT, drift_error, falling_bodies, size_of_model
from wsim.simulation.predicted.sweep_strain import UNEVEN, masses_are_uneven

STRAINED = 10.0        # strain that sweeps may leave in an edge, over the wanted error. A cloth of even cells has 7 to 9
                       # where `slack` is all of that error. Lower: slender triangles take more substeps, with the root of it
STRETCHED = 1.5        # far from rest stiffness is not what the bound took it for
SURE = 1.5             # time over that of XPBD or Newton's method that leapfrog may take: the table is good to 1.3, and it errs
                       # by a hundredth of theirs or less
FIRM, FELT = 2.2, 0.05 # the same with mass at slivers where sweeps leave more than this strain in an edge. The shirt on its
                       # dummy (CPU): 2.0 by the table, 1.3 in CPU time, 0.7 of the time on two cores; peak strain 0.09 for 0.64
STRUCK = 3.0           # the same where colliders are, for what EULER leaves
SURER = 1.3            # time of XPBD over that of Newton steps of sheets, from which these are taken: the table is good to that
RIGHTER = 5.0          # error of XPBD over that of Newton steps, from which these may take SURE times its time
FINER = 1.02           # ratio of substeps that are tried one after the other for the wanted error
SOLVED = 2             # Newton steps a substep of soft bodies
STIFFENED = 1.7        # materials that stiffen under strain need shorter steps than at rest, where the bound is close


@dataclass(frozen=True)
class SchemeChoice:
    """The solver, integrator and steps of a scene, and the reason why."""

    solver: str
    integrator: Integrator
    substeps: int                            # systems of an implicit integrator a frame: sdirk3 takes two a step
    iterations: int
    why: str
    other: "SchemeChoice | None" = None      # what goes on where explicit steps that nobody named tear an edge
    error: float | None = None               # predicted, over the scene's size: `wsim.simulation.predicted.errors`
    omega: float = 0.0                       # highest frequency [rad/s] of Newton steps of sheets, where it is known
    slowed: bool = False                     # leapfrog of as many substeps as mass for slivers leaves
    bears: float = inf                       # stretch of an edge up to which explicit steps that are named are stable, and
    least: int = 0                           # substeps that bear any: `stability.bears`
    need: sag.SubstepNeed = sag.SubstepNeed()  # substeps that rigid bodies want

    @property
    def steps(self) -> int:
        """Steps of a frame: what a scene says to be stepped so."""
        return self.substeps // self.integrator.solves


def choose_scheme(model: Model, named: str = "") -> SchemeChoice:
    """The choice for a checked scene. Raises SceneError where a named explicit integrator is beyond its limit."""
    found = _choose_by_scene(model, named)
    if found.solver != "explicit" and found.integrator.order > 1 and any(body_ties(model.scene, b.path) for b in model.bodies):
        return replace(_choose_by_scene(model, "backward_euler"), why="points tied to bodies keep their momentum by it")
    if (model.scene.solver, model.scene.integrator) != ("auto", "auto") or not falling_bodies(model):
        return found
    error = found.error if found.error is not None else predict_choice_error(model, found)
    return replace(found, error=error,
                   why=f"{found.why}; it errs by about {percent_of_size(error)} of the size" if found.why else found.why)


def predict_choice_error(model: Model, choice: SchemeChoice) -> float:
    """Error of a choice over the scene's size."""
    bodies, h = falling_bodies(model), choice.integrator.solves / model.scene.fps / choice.substeps
    if choice.solver == "explicit":
        left = errors.leapfrog_error(model, bodies, h) + choice.slowed * errors.SLIVERS * size_of_model(model)
    elif choice.solver == "xpbd":
        left = errors.backward_euler_error(model, bodies, h, 0 if _has_hard_constraints(model) else choice.iterations)
    else:
        left = errors.newton_error(model, bodies, h, choice.integrator.name, choice.omega or cost.highest_frequency(model))
    return left / size_of_model(model)


def _choose_by_scene(model: Model, named: str) -> SchemeChoice:
    scene, method = model.scene, TABLE.get(named or model.scene.integrator)
    if not model.bodies:
        return SchemeChoice("none", TABLE["backward_euler"], scene.substeps, scene.iterations, "there are no points")
    if method and method.rebounds and method_colliders(scene):
        return replace(_choose_by_scene(model, "bdf2"), why=f"{method.name} rebounds from rigid bodies that points touch")
    if any(body.is_particles for body in scene.bodies()):
        return _choice_as_named(scene, *sweep_strain.solver_for_particles(model))
    if any(body.is_cluster for body in scene.bodies()):
        return _choose_for_clusters(model, method)
    if scene.solver == "explicit" or (method and method.explicit):
        return _choose_explicit(model, method)
    if has_tets(scene):
        return _choose_for_soft_bodies(model, method)
    if scene.solver in ("xpbd", "implicit"):
        return _choice_as_named(scene, scene.solver, method or TABLE["backward_euler"], "the scene names it")
    if method:
        return _choice_as_named(scene, "xpbd", method, f"the scene names {method.name}")
    return _choose_automatically(model)


def _choice_as_named(scene: Scene, solver: str, method: Integrator, why: str) -> SchemeChoice:
    return SchemeChoice(solver, method, scene.substeps * method.solves, scene.iterations, why)


def _choose_for_clusters(model: Model, method: Integrator | None) -> SchemeChoice:
    """Shape matching by XPBD's iterations, behind the Newton steps of soft bodies: XPBD has no tetrahedra."""
    scene, solver = model.scene, "implicit" if model.scene.solver == "implicit" or has_tets(model.scene) else "xpbd"
    if method or scene.solver != "auto":
        return _choice_as_named(scene, solver, method or TABLE["backward_euler"], "the scene names it")
    most = min(scene.iterations, SOLVED) if has_tets(scene) else scene.iterations
    return replace(_choose_backward_euler(model, solver, most), why="bodies keep their shape in clusters, which XPBD projects")


def _choose_for_soft_bodies(model: Model, method: Integrator | None) -> SchemeChoice:
    """Soft bodies: leapfrog where its steps cost less and nothing else is named; else Newton's method, of which a step of a
    frame is stable, and which solves to a residual: sdirk3 of half as many steps as the scene names, or backward Euler of
    contacts; of either as many as the wanted error takes."""
    scene, leapfrog = model.scene, TABLE["leapfrog"]
    iterations = scene.iterations if scene.solver == "implicit" else min(scene.iterations, SOLVED)
    # drag leaves order 1, and sdirk3 fewer steps
    solved = iterations >= SOLVED and not (_has_hard_constraints(model) or scene.air_drag)
    chosen = method or TABLE["backward_euler" if has_collisions(scene) else "sdirk3" if solved else "bdf2"]
    steps = scene.substeps if method else ceil(scene.substeps / chosen.solves)       # as many systems are solved
    newton = SchemeChoice("implicit", chosen, steps * chosen.solves, iterations, "the scene names it")
    if scene.solver == "implicit" or method:
        return newton
    euler = _choose_backward_euler(model, "implicit", iterations)
    if has_collisions(scene):
        newton = euler
    else:
        bodies = falling_bodies(model)
        steps = _substeps_within_error(model, steps, lambda h: errors.newton_error(model, bodies, h, chosen.name, 0.0))
        newton = replace(newton, substeps=steps * chosen.solves)
    reason = reason_against_explicit(model, "Newton's method")
    if reason:
        return replace(newton, why=reason)
    from wsim.physics.motion.frequency import frequency_bound
    omega, c = frequency_bound(model)
    stiffens = any(m.model not in ("corotational", "linear") for m in solid_materials(scene))
    n = _substeps_for_collisions(model, ceil(substeps_needed(scene, leapfrog, omega, c) * (STIFFENED if stiffens else 1.0)))
    explicit = cost.seconds_of_counts(model, cost.count_explicit_frame(model, n))
    newton = replace(newton, omega=omega)
    implicit = cost.seconds_of_counts(model, cost.count_newton_of_soft_bodies(model, newton.substeps, iterations, omega))
    said = (f"{n} substeps of leapfrog keep {omega:.4g} rad/s stable, about {1e3 * explicit:.3g} ms a frame; Newton steps "
            f"would take {1e3 * implicit:.3g} ms for {newton.steps} of {newton.integrator.name}")
    if explicit <= _worth_of_leapfrog(scene) * implicit:
        return SchemeChoice("explicit", leapfrog, max(n, scene.substeps), 1, said, euler)
    return replace(newton, why=said)


def _choose_explicit(model: Model, method: Integrator | None) -> SchemeChoice:
    from wsim.physics.motion import frequency
    from wsim.physics.motion.stability import stable_stretch
    scene = model.scene
    omega, c = frequency.frequency_bound(model)
    chosen = method or TABLE["leapfrog"]
    least = substeps_needed(scene, chosen, omega, c)
    if method is None:
        return SchemeChoice("explicit", chosen, max(least, scene.substeps), 1,
                            f"the scene names explicit; {least} substeps keep {omega:.4g} rad/s stable")
    found = _choice_as_named(scene, "explicit", method, f"the scene names {method.name}")
    if scene.substeps >= least:
        return found
    estimate = frequency.frequency_estimate(model)       # the bound is cautious: refuse what is certain to grow
    rate = c * (estimate / omega)**2 if omega else c
    return replace(found, bears=stable_stretch(scene, method, estimate, rate, least), least=least)


def _choose_automatically(model: Model) -> SchemeChoice:
    """The cheaper of leapfrog and coloured XPBD at the wanted error; Newton where sweeps would stall."""
    scene, leapfrog, xpbd = model.scene, TABLE["leapfrog"], _choose_sweeps(model)
    stall = f"masses that hold each other differ by more than {UNEVEN:g}: sweeps would stall" * (xpbd.solver == "implicit")
    if reason := reason_against_explicit(model, "XPBD"):
        return replace(xpbd, why=stall or reason)
    from wsim.physics.motion.frequency import RowSums, frequency_bound
    omega, c = frequency_bound(model, rows=(rows := RowSums(model)))
    n = _substeps_for_collisions(model, substeps_needed(scene, leapfrog, omega, c))
    explicit = cost.seconds_of_counts(model, cost.count_explicit_frame(model, n))
    sweeps = cost.seconds_of_counts(model, cost.count_sweeps_frame(model, xpbd.substeps, xpbd.iterations))
    newton = _choose_newton_for_sheets(model, omega) if not stall else None
    solved = cost.seconds_of_counts(model, cost.count_newton_of_sheets(model, newton.substeps, 1, omega)) if newton else inf
    whole = SchemeChoice("explicit", leapfrog, max(n, scene.substeps), 1,
                         f"{n} substeps keep {omega:.4g} rad/s stable, about {1e3 * explicit:.3g} ms a frame; XPBD would take "
                         f"{1e3 * sweeps:.3g} ms for {xpbd.substeps} x {xpbd.iterations}", xpbd)
    if explicit <= SURE * min(sweeps, solved):
        return whole
    why = f"leapfrog would need {n} substeps ({omega:.4g} rad/s), about {1e3 * explicit:.3g} ms a frame; "
    slow, said = leapfrog_with_added_mass(model, rows)
    least = cost.seconds_of_counts(model, cost.count_explicit_frame(model, slow)) if slow else inf
    few = SchemeChoice("explicit", leapfrog, max(slow, scene.substeps), 1,
                       f"{why}{slow} with more mass at slivers, {1e3 * least:.3g} ms: {said}; XPBD would take "
                       f"{1e3 * sweeps:.3g} ms for {xpbd.substeps} x {xpbd.iterations}", xpbd, slowed=slow > scene.substeps)
    if least <= SURE * min(sweeps, solved):
        return few
    if explicit <= _worth_of_leapfrog(scene) * min(sweeps, solved):
        return whole
    if least <= FIRM * min(sweeps, solved) and not _has_hard_constraints(model) and sweep_strain.strain_left(model,
                                                                                            falling_bodies(model), xpbd) > FELT:
        return few
    if newton and (SURER * solved < sweeps or
                   solved <= SURE * sweeps
                   and RIGHTER * predict_choice_error(model, newton) <= predict_choice_error(model, xpbd)):
        return replace(newton, why=f"{why}XPBD {1e3 * sweeps:.3g} ms for {xpbd.substeps} x {xpbd.iterations}; Newton steps "
                       f"take {1e3 * solved:.3g} ms for {newton.substeps} of BDF2")
    return replace(xpbd, why=why
                   + (stall or f"XPBD takes {1e3 * sweeps:.3g} ms for {xpbd.substeps} x {xpbd.iterations}{xpbd.why}"))


def leapfrog_with_added_mass(model: Model, rows) -> tuple[int, str]:
    """Substeps of leapfrog where slivers have more mass, and what was done to which; (0, "") where none would have."""
    from wsim.physics.motion.fused.mass_scaling import try_sliver_mass
    said, bound = try_sliver_mass(model, rows)
    return (_substeps_for_collisions(model, substeps_needed(model.scene, TABLE["leapfrog"], *bound)), said) if said else (0, "")


def _choose_newton_for_sheets(model: Model, omega: float) -> SchemeChoice | None:
    """BDF2 of sheets, one Newton step a substep, of as many as the wanted error takes."""
    if not errors.newton_known(model):
        return None
    bodies = falling_bodies(model)
    n = _substeps_within_error(model, model.scene.substeps, lambda h: errors.newton_error(model, bodies, h, "bdf2", omega))
    return SchemeChoice("implicit", TABLE["bdf2"], n, 1, "", omega=omega)


def _choose_sweeps(model: Model) -> SchemeChoice:
    """XPBD with the scene's sweeps or one, whichever costs less at the wanted error; Newton steps where sweeps would stall."""
    scene = model.scene
    if masses_are_uneven(model):
        return _choose_backward_euler(model, "implicit", min(scene.iterations, 3))
    if _has_hard_constraints(model):                      # limits and tethers carry loads past the sweeps
        return _choose_backward_euler(model, "xpbd", scene.iterations)
    damped, lag = any(r.tau for r in model.constraints), sweep_strain.sweep_lag(model, falling_bodies(model))  # it slows sweeps
    tried = [_choose_backward_euler(model, "xpbd", m, lag) for m in {scene.iterations, scene.iterations if damped else 1}]
    return min(tried, key=lambda c: cost.seconds_of_counts(model, cost.count_sweeps_frame(model, c.substeps, c.iterations)))


def _choose_backward_euler(model: Model, solver: str, iterations: int, lag: float = 0.0) -> SchemeChoice:
    """Backward Euler at the wanted error, of no fewer substeps than named. lag: `wsim.simulation.predicted.sweep_strain`."""
    sweeps, bodies = iterations if solver == "xpbd" and not _has_hard_constraints(model) else 0, falling_bodies(model)

    def euler_error_of_step(h: float) -> float:
        return errors.backward_euler_error(model, bodies, h, sweeps)

    def sweep_strain_of_step(h: float) -> float:
        return lag * h * h / iterations * size_of_model(model) / STRAINED
    n = _substeps_within_error(model, model.scene.substeps, euler_error_of_step)
    most = _substeps_within_error(model, n, sweep_strain_of_step)
    why = f" ({n} would leave a strain of {lag / (model.scene.fps * n)**2 / iterations:.2g} in its edges)" if most > n else ""
    return SchemeChoice(solver, TABLE["backward_euler"], most, iterations, why)


def _worth_of_leapfrog(scene: Scene) -> float:
    """Times the time of another solver that leapfrog is worth."""
    return STRUCK if has_collisions(scene) else SURE


def _substeps_for_collisions(model: Model, n: int) -> int:
    """Substeps of leapfrog, n or more where colliders are."""
    bodies = falling_bodies(model) if has_collisions(model.scene) else []
    return _substeps_within_error(model, n, lambda h: drift_error(bodies, h, HIT))


def _substeps_within_error(model: Model, n: int, error: Callable[[float], float]) -> int:
    """Substeps a frame, n or more, with which error(h) [m] is no more than wanted."""
    wanted = model.scene.error * size_of_model(model)
    while wanted > 0.0 and error(1.0 / model.scene.fps / n) > wanted:
        n = max(n + 1, int(n * FINER))
    return n


def reason_against_explicit(model: Model, other: str) -> str:
    """Reason why a scene should not be stepped explicitly unless it asks to be, or ""."""
    if _has_hard_constraints(model):
        return f"tethers or strain limits: {other} solves them and forces together"
    for body in model.bodies:
        along = np.diff(body.places[body.edges - body.first], axis=1)
        if np.any(np.linalg.norm(along, axis=2)[:, 0] > STRETCHED * np.maximum(edge_lengths(body), 1e-12)):
            return f"{body.path} starts with an edge stretched beyond {STRETCHED:g} times its length"
    return ""


def _has_hard_constraints(model: Model) -> bool:
    return any(r.hard for r in model.constraints)
