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
from wsim.physics.motion.stability import needed
from wsim.scene.check import counts
from wsim.scene.integrator import TABLE, Integrator
from wsim.scene.methods import carried, collides
from wsim.simulation import choice as choices
from wsim.simulation import cost
from wsim.simulation.choice import SOLVED, Choice
from wsim.simulation.duration import percent
from wsim.simulation.predicted import errors

SPARE = 1.3            # of the time that there is: what the table may be off by
WORTH = 0.95           # of the error with half as many substeps, above which the other half is not worth its time
SWEEPS = (1, 2, 4, 8)  # of XPBD


def hold(model: Model, fps: float) -> Choice:
    """The choice for a checked scene. Raises SceneError as `choose` does."""
    if not model.bodies:
        return choices.choose(model)
    goal = 1.0 / fps / SPARE
    found = [made for least, make in _ways(model) for made in [_filled(model, goal, least, make)] if made]
    if not found:
        return choices.choose(model)
    held = [c for c in found if _seconds(model, c) <= goal]
    best = min(held, key=_error) if held else min(found, key=lambda c: _seconds(model, c))
    others = "; ".join(f"{_name(c)} {1e3 * _seconds(model, c):.3g} ms, {percent(_error(c))}" for c in found
                       if c is not best)
    took, left = f"{1e3 * _seconds(model, best):.3g} ms a frame", f"{percent(_error(best))} of the size"
    why = (f"the most accurate that holds {fps:g} frames a second, with {SPARE - 1.0:.0%} to spare: {took}" if held else
           f"nothing holds {fps:g} frames a second; this is the fastest: {took}")
    return replace(best, why=f"{why}; it errs by about {left}" + (f" ({others})" if others else ""))


def _name(c: Choice) -> str:
    return f"{c.integrator.name} {c.steps} x {c.iterations}" if c.solver == "explicit" else \
        f"{c.solver} {c.integrator.name} {c.steps} x {c.iterations}"


def _error(c: Choice) -> float:
    return inf if c.error is None else c.error


def _seconds(model: Model, c: Choice) -> float:
    return cost.seconds(model, cost.frame(model, c))


def _of(solver: str, integrator: Integrator, iterations: int, omega: float = 0.0) -> Callable[[int], Choice]:
    """The choice of n steps."""
    return lambda n: Choice(solver, integrator, n * integrator.solves, iterations, "", omega=omega)


def _ways(model: Model) -> Iterator[tuple[int, Callable[[int], Choice]]]:
    """The least steps of each solver that a scene may have, and the choice of so many."""
    scene = model.scene
    named = TABLE.get(scene.integrator)
    explicit = scene.solver == "explicit" or bool(named and named.explicit)
    free = scene.solver == "auto" and named is None
    if explicit or free and not choices.unfit(model, ""):
        from wsim.physics.motion.frequency import RowSums, bound
        own, rows = named or TABLE["leapfrog"], RowSums(model)
        omega, c = bound(model, rows=rows)
        stiffens = any(m.model not in ("corotational", "linear") for s in scene.softs for m in s.materials)
        least = int(needed(scene, own, omega, c) * (choices.STIFFENED if stiffens else 1.0))
        yield max(1, least), _of("explicit", own, 1)
        few = choices.slowed(model, rows)[0] if named is None and not explicit else 0
        if few:
            yield few, lambda n: replace(_of("explicit", own, 1)(n), slowed=n < least)
    if explicit:
        return
    if not scene.softs and scene.solver in ("auto", "xpbd") and not (free and choices.uneven(model)):
        own = named or TABLE["backward_euler"]
        for m in SWEEPS:
            yield 1, _of("xpbd", own, m)
    if scene.solver == "implicit" or scene.softs or free and errors.newton_known(model):
        omega, m = cost.highest(model), SOLVED if scene.softs else 1
        for own in _integrators(model, named):
            yield 1, _of("implicit", own, m, omega)


def _integrators(model: Model, named: Integrator | None) -> list[Integrator]:
    """Of Newton's method."""
    scene = model.scene
    if named:
        return [TABLE["bdf2"] if named.rebounds and carried(scene) else named]
    names = ["backward_euler"] if scene.softs and collides(scene) else ["sdirk3", "bdf2"] if scene.softs else ["bdf2"]
    return [TABLE[name] for name in names]


def _filled(model: Model, goal: float, least: int, make: Callable[[int], Choice]) -> Choice:
    """As many steps as there is time for, of which more would lower the error; the least where there is none."""
    def of(n: int) -> Choice:
        made = make(n)
        return replace(made, error=choices.predicted(model, made))
    n = least
    while 2 * n <= counts.MANY and _seconds(model, make(2 * n)) <= goal and _error(of(2 * n)) < WORTH * _error(of(n)):
        n *= 2
    step = n // 2
    while step:
        if _seconds(model, make(n + step)) <= goal and _error(of(n + step)) < _error(of(n)):
            n += step
        step //= 2
    return of(n)
