"""The most accurate setting that is predicted to hold so many frames a second of wall clock on a device.

Each solver that a scene may be stepped with takes as many substeps as there is time for (`wsim.simulation.cost`; the table is
good to SPARE), no more than lower its predicted error (`wsim.simulation.predicted.errors`); of those the one that errs by least
is taken. Where none is fast enough it is the fastest, and a warning says what it takes. What a scene names (`solver`,
`integrator`) stays, and is given the steps; its substeps and iterations, which it may name for the same reason, do not.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf

from wsim.model.model import Model
from wsim.physics.motion.stability import substeps_needed
from wsim.scene.check import counts
from wsim.scene.integrator import TABLE, Integrator
from wsim.scene.methods import has_collisions, has_tets, method_colliders, solid_materials
from wsim.simulation import choice as choices
from wsim.simulation import cost
from wsim.simulation.choice import SOLVED, SchemeChoice
from wsim.simulation.duration import percent_of_size
from wsim.simulation.predicted import errors

SPARE = 1.3            # of the time that there is: what the table may be off by
WORTH = 0.95           # of the error with half as many substeps, above which the other half is not worth its time
SWEEPS = (1, 2, 4, 8)  # of XPBD


def choose_for_rate(model: Model, fps: float) -> SchemeChoice:
    """The choice for a checked scene. Raises SceneError as `choose` does."""
    if not model.bodies:
        return choices.choose_scheme(model)
    goal = 1.0 / fps / SPARE
    found = [made for least, make in _ways_to_step(model) for made in [_fill_time_with_steps(model, goal, least, make)] if made]
    if not found:
        return choices.choose_scheme(model)
    held = [c for c in found if _seconds_of_choice(model, c) <= goal]
    best = min(held, key=_error_or_infinity) if held else min(found, key=lambda c: _seconds_of_choice(model, c))
    others = "; ".join(f"{_name_of_choice(c)} {1e3 * _seconds_of_choice(model, c):.3g} ms, "
                       f"{percent_of_size(_error_or_infinity(c))}" for c in found
                       if c is not best)
    took, left = (f"{1e3 * _seconds_of_choice(model, best):.3g} ms a frame",
                  f"{percent_of_size(_error_or_infinity(best))} of the size")
    why = (f"the most accurate that holds {fps:g} frames a second, with {SPARE - 1.0:.0%} to spare: {took}" if held else
           f"nothing holds {fps:g} frames a second; this is the fastest: {took}")
    return replace(best, why=f"{why}; it errs by about {left}" + (f" ({others})" if others else ""))


def _name_of_choice(c: SchemeChoice) -> str:
    return f"{c.integrator.name} {c.steps} x {c.iterations}" if c.solver == "explicit" else \
        f"{c.solver} {c.integrator.name} {c.steps} x {c.iterations}"


def _error_or_infinity(c: SchemeChoice) -> float:
    return inf if c.error is None else c.error


def _seconds_of_choice(model: Model, c: SchemeChoice) -> float:
    return cost.seconds_of_counts(model, cost.count_frame_of_choice(model, c))


def _choice_of_steps(solver: str, integrator: Integrator, iterations: int, omega: float = 0.0) -> Callable[[int], SchemeChoice]:
    """The choice of n steps."""
    return lambda n: SchemeChoice(solver, integrator, n * integrator.solves, iterations, "", omega=omega)


def _ways_to_step(model: Model) -> Iterator[tuple[int, Callable[[int], SchemeChoice]]]:
    """The least steps of each solver that a scene may have, and the choice of so many."""
    scene, solid = model.scene, has_tets(model.scene)
    named = TABLE.get(scene.integrator)
    explicit = scene.solver == "explicit" or bool(named and named.explicit)
    free = scene.solver == "auto" and named is None
    if explicit or free and not choices.reason_against_explicit(model, ""):
        from wsim.physics.motion.frequency import RowSums, frequency_bound
        own, rows = named or TABLE["leapfrog"], RowSums(model)
        omega, c = frequency_bound(model, rows=rows)
        stiffens = any(m.model not in ("corotational", "linear") for m in solid_materials(scene))
        least = int(substeps_needed(scene, own, omega, c) * (choices.STIFFENED if stiffens else 1.0))
        yield max(1, least), _choice_of_steps("explicit", own, 1)
        few = choices.leapfrog_with_added_mass(model, rows)[0] if named is None and not explicit else 0
        if few:
            yield few, lambda n: replace(_choice_of_steps("explicit", own, 1)(n), slowed=n < least)
    if explicit:
        return
    if not solid and scene.solver in ("auto", "xpbd") and not (free and choices.masses_are_uneven(model)):
        own = named or TABLE["backward_euler"]
        for m in SWEEPS:
            yield 1, _choice_of_steps("xpbd", own, m)
    if scene.solver == "implicit" or solid or free and errors.newton_known(model):
        omega, m = cost.highest_frequency(model), SOLVED if solid else 1
        for own in _newton_integrators(model, named):
            yield 1, _choice_of_steps("implicit", own, m, omega)


def _newton_integrators(model: Model, named: Integrator | None) -> list[Integrator]:
    """Of Newton's method."""
    scene = model.scene
    if named:
        return [TABLE["bdf2"] if named.rebounds and method_colliders(scene) else named]
    names = ["bdf2"] if not has_tets(scene) else ["backward_euler"] if has_collisions(scene) else ["sdirk3", "bdf2"]
    return [TABLE[name] for name in names]


def _fill_time_with_steps(model: Model, goal: float, least: int, make: Callable[[int], SchemeChoice]) -> SchemeChoice:
    """As many steps as there is time for, of which more would lower the error; the least where there is none."""
    def choice_with_error(n: int) -> SchemeChoice:
        made = make(n)
        return replace(made, error=choices.predict_choice_error(model, made))
    n = least
    while 2 * n <= counts.MANY and _seconds_of_choice(model,
                                                      make(2 * n)) <= goal and _error_or_infinity(choice_with_error(2
                                                                       * n)) < WORTH * _error_or_infinity(choice_with_error(n)):
        n *= 2
    step = n // 2
    while step:
        if _seconds_of_choice(model,
                              make(n + step)) <= goal and _error_or_infinity(choice_with_error(n
                                                                            + step)) < _error_or_infinity(choice_with_error(n)):
            n += step
        step //= 2
    return choice_with_error(n)
