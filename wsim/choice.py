"""Which solver and integrator a scene is stepped with: what it names, and where it leaves that open, what costs least.

    explicit    leapfrog needs n = dt / limit substeps a frame (`wsim.frequency`, `wsim.stability`), a launch or less each;
                where it is stable it errs by less than any of the others at any price they are run at
    implicit    Newton steps, where neighbouring masses differ so much that sweeps would not carry a load from one to the
                other (stress rows "heavy last": XPBD at 10 x 4 left a strain of 12, bound 3.4)
    xpbd        backward Euler errs by about DRIFT h on a cloth that falls (order 1), whatever its sweeps cost, and M sweeps
                leave it longer by SOFT g h^2 N^2 / M where load hangs on N springs in a row (`slack`); to err by no more than
                `Scene.error` it needs so many substeps, or those that the scene names if they are more

`COSTS` is a table by device, fitted to what tools/bench/choice.py measured (tools/results/choice_*.json); nothing is timed at
build.
"""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from wsim.cloth import HARD, Rows
from wsim.integrator import TABLE, Integrator
from wsim.model import Model, edge_lengths, hard_places
from wsim.scene import Problem, Scene, SceneError

DRIFT = 0.8            # [m/s]: RMS error over h of converged backward Euler, 1 m cloth at 0.25 s (1.3e-2 at 1/60 s)
SOFT = 0.4             # a sweep moves a mass by half of what a spring lacks: N springs in a row lack 2 N g h^2 / M at the top,
                       # N^2 g h^2 / M in all. Chains of 20 and 40 springs, M 4 and 8: 0.30 to 0.36 of that, M 1 0.50; cloths
                       # of 32 and 64 points a side 0.24 to 0.40 (over-relaxed sweeps)
STRETCHED = 1.5        # far from rest stiffness is not what the bound took it for
MARGIN = 1.02          # substeps over the limit's: the frequency is that of the rest shape, and `limit` is good to 0.1 %


@dataclass(frozen=True)
class Cost:
    """Seconds: of a substep of leapfrog, of each spring in it and of each element over its weight, of a sweep over a kind of
    constraint and of each constraint in it, of what XPBD launches a substep besides."""

    step: float
    pull: float
    element: float
    sweep: float
    projection: float
    rest: float


# H200: leapfrog 4.5 us at 1k points, 12 us at 0.6M springs (nets that a cluster takes: 0.42 us at 1k points, 0.74 at 4k, 1.06
# at 8k); XPBD 14 colours of 2 us, 2.1e-11 s a spring. CPU: 2.8e-9 s a spring of leapfrog (one thread), 1.9e-8 s a projection.
COSTS = {"cuda": Cost(4.5e-6, 1.3e-11, 1.3e-11, 2.5e-5, 2.1e-11, 9e-6),
         "cpu": Cost(2e-6, 2.8e-9, 6.7e-9, 1e-6, 1.9e-8, 4e-6)}
CLUSTER = 3.5e-7, 9e-11      # [s] a substep of a net that a cluster takes, and of each point in it: springs, no damping
WEIGHT = {"distance": 1.0, "membrane": 4.0, "dihedral": 9.5}     # work of a projection over that of a spring (CPU)
SOLVED = 2             # Newton steps a substep of soft bodies
STIFFENED = 1.7        # materials that stiffen under strain need shorter steps than at rest, where the bound is close
TEN = 8.0, 12.0        # work of a quadratic tet over that of a linear one: its forces, its part of a Newton step (CPU)
UNEVEN = 1e3           # ratio of two masses that hold each other, from which sweeps stall


@dataclass(frozen=True)
class Solid:
    """Seconds: of a substep of leapfrog and of each tet in it, of a Newton step and of each tet in it."""

    step: float
    tet: float
    newton: float
    solved: float


# H200, corotational (tools/results/soft_h200.json): leapfrog 12 us a substep of 25k tets, 112 of 976k; a Newton step
# 0.27 to 0.36 ms of 2560 tets, 4.3 to 8 of 976k. CPU: 0.17 us a tet of leapfrog, 1.6 to 1.9 of a Newton step (25k tets)
SOLID = {"cuda": Solid(9.4e-6, 1.05e-10, 3.5e-4, 5e-9), "cpu": Solid(2e-5, 1.7e-7, 1e-4, 1.8e-6)}


@dataclass(frozen=True)
class Choice:
    """What a scene is stepped with, and why."""

    solver: str
    integrator: Integrator
    substeps: int                            # systems of an implicit integrator a frame: sdirk3 takes two a step
    iterations: int
    why: str

    @property
    def steps(self) -> int:
        """Of a frame: what a scene says to be stepped so."""
        return self.substeps // self.integrator.solves


def needed(scene: Scene, method: Integrator, omega: float, c: float) -> int:
    """Substeps a frame that keep an explicit method stable."""
    from wsim.stability import limit
    return max(1, ceil(MARGIN / (scene.fps * limit(method, omega, c))))


def choose(model: Model, rows: dict[str, list[Rows]]) -> Choice:
    """The choice for a checked scene. Raises SceneError where a named explicit integrator is beyond its limit."""
    scene = model.scene
    method = TABLE.get(scene.integrator)
    sheets = model.gradients and scene.solver == "auto" and not (method or scene.softs)         # whatever XPBD would cost
    solver = "explicit" if sheets else scene.solver
    if solver == "explicit" or (method and method.explicit):
        return _explicit(model, rows, method)
    if scene.softs:
        return _soft(model, rows, method)
    if scene.solver in ("xpbd", "implicit"):
        return _named(scene, scene.solver, method or TABLE["backward_euler"], "the scene names it")
    if method:
        return _named(scene, "xpbd", method, f"the scene names {method.name}")
    return _auto(model, rows)


def _named(scene: Scene, solver: str, method: Integrator, why: str) -> Choice:
    return Choice(solver, method, scene.substeps * method.solves, scene.iterations, why)


def _soft(model: Model, rows: dict[str, list[Rows]], method: Integrator | None) -> Choice:
    """Soft bodies: leapfrog where its steps cost less, nothing is hit and nothing else is named; else Newton's method, of which
    a step of a frame is stable, and which solves to a residual: sdirk3 of half as many steps, or backward Euler of contacts."""
    scene, leapfrog = model.scene, TABLE["leapfrog"]
    iterations = scene.iterations if scene.solver == "implicit" else min(scene.iterations, SOLVED)
    solved = iterations >= SOLVED and not (_hard(rows) or scene.air_drag)      # drag leaves order 1, and sdirk3 fewer steps
    chosen = method or TABLE["backward_euler" if scene.colliders else "sdirk3" if solved else "bdf2"]
    steps = scene.substeps if method else ceil(scene.substeps / chosen.solves)       # as many systems are solved
    newton = Choice("implicit", chosen, steps * chosen.solves, iterations, "the scene names it")
    if scene.solver == "implicit" or method:
        return newton
    reason = _unfit(model, rows, "Newton's method")
    if reason:
        return replace(newton, why=reason)
    from wsim.frequency import bound
    cost = SOLID["cuda" if model.device.is_cuda else "cpu"]
    pulled, weighed = (sum(len(b.tets) * (1.0 if b.tets.shape[1] == 4 else ten) for b in model.bodies) for ten in TEN)
    omega, c = bound(model, rows)
    stiffens = any(m.model not in ("corotational", "linear") for s in scene.softs for m in s.materials)
    n = ceil(needed(scene, leapfrog, omega, c) * (STIFFENED if stiffens else 1.0))
    explicit = n * (cost.step + cost.tet * pulled)
    implicit = newton.substeps * iterations * (cost.newton + cost.solved * weighed)
    said = (f"{n} substeps of leapfrog keep {omega:.4g} rad/s stable, about {1e3 * explicit:.3g} ms a frame; Newton steps "
            f"would take {1e3 * implicit:.3g} ms for {steps} of {chosen.name}")
    if explicit <= implicit:
        return Choice("explicit", leapfrog, max(n, scene.substeps), 1, said)
    return replace(newton, why=said)


def _explicit(model: Model, rows: dict[str, list[Rows]], method: Integrator | None) -> Choice:
    from wsim import frequency
    from wsim.stability import limit
    scene = model.scene
    omega, c = frequency.bound(model, rows)
    chosen = method or TABLE["leapfrog"]
    least = needed(scene, chosen, omega, c)
    if method is None:
        return Choice("explicit", chosen, max(least, scene.substeps), 1,
                      f"{'the scene names explicit' if scene.solver == 'explicit' else 'gradients are asked for'}; {least} "
                      f"substeps keep {omega:.4g} rad/s stable")
    if scene.substeps < least:
        estimate = frequency.estimate(model, rows)             # the bound is cautious: refuse what is certain to grow
        step, h = limit(method, estimate, c * (estimate / omega)**2 if omega else c), 1.0 / scene.fps / scene.substeps
        if h > step:
            raise SceneError(Problem("/", f"integrator {method.name} is stable for {method.stable}: steps up to "
                                     f"{step:.3g} s here (highest "
                                     f"frequency {estimate:.4g} rad/s), found {h:.3g} s; give --substeps {least} "
                                     f"({1.0 / scene.fps / least:.3g} s), or another integrator"))
    return _named(scene, "explicit", method, f"the scene names {method.name}")


def _auto(model: Model, rows: dict[str, list[Rows]]) -> Choice:
    """The cheaper of leapfrog and coloured XPBD at the wanted error; Newton where sweeps would stall."""
    scene, leapfrog = model.scene, TABLE["leapfrog"]
    xpbd = _named(scene, "xpbd", TABLE["backward_euler"], "")
    if _uneven(model, rows):
        xpbd = replace(xpbd, solver="implicit", iterations=min(scene.iterations, 3))
        stall = f"masses that hold each other differ by more than {UNEVEN:g}: sweeps would stall"
    else:
        stall = ""
    reason = _unfit(model, rows, "XPBD")
    if reason:
        return replace(xpbd, why=stall or reason)
    from wsim.frequency import bound
    omega, c = bound(model, rows)
    n = needed(scene, leapfrog, omega, c)
    substeps = max(scene.substeps, ceil(DRIFT / scene.fps / (scene.error * _size(model))))
    if not stall:
        substeps = max(substeps, ceil((slack(model, 1.0 / scene.fps) / (scene.error * _size(model)))**0.5))
    explicit, sweeps = _costs(model, rows, n, substeps)
    if explicit <= sweeps:
        return Choice("explicit", leapfrog, max(n, scene.substeps), 1,
                      f"{n} substeps keep {omega:.4g} rad/s stable, about {1e3 * explicit:.3g} ms a frame; XPBD would take "
                      f"{1e3 * sweeps:.3g} ms for {substeps} x {scene.iterations}")
    return replace(xpbd, substeps=substeps, why=f"leapfrog would need {n} substeps ({omega:.4g} rad/s), about "
                   f"{1e3 * explicit:.3g} ms a frame; " + (stall or f"XPBD takes {1e3 * sweeps:.3g} ms"))


def _costs(model: Model, rows: dict[str, list[Rows]], n: int, substeps: int) -> tuple[float, float]:
    """Seconds a frame of n substeps of leapfrog, and of XPBD with the scene's sweeps."""
    cost, soft = COSTS["cuda" if model.device.is_cuda else "cpu"], [r for found in rows.values() for r in found]
    springs, work = (model.worlds * sum(WEIGHT[r.kind] * len(r.ids) for r in found)
                     for found in ([r for r in soft if r.kind == "distance"], soft))
    kinds = {r.kind for r in soft}
    plain = kinds == {"distance"} and not any(r.tau for r in soft)
    if model.device.is_cuda and model.device.arch >= 90 and plain and model.points <= 8192:
        step = CLUSTER[0] + CLUSTER[1] * model.points
    else:
        step = cost.step * (1 + len(kinds - {"distance"})) + cost.pull * springs + cost.element * (work - springs)
    sweep = cost.sweep * len(kinds) + cost.projection * work
    return n * step, substeps * (cost.rest + model.scene.iterations * sweep)


def _uneven(model: Model, rows: dict[str, list[Rows]]) -> bool:
    """Whether free masses that hold each other differ by more than UNEVEN."""
    pinned = hard_places(model)
    for body in (b for b in model.bodies if b.world == 0):
        masses = body.masses.copy()
        masses[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = np.nan
        for r in rows[body.path]:
            held = masses[r.ids - body.first]
            if np.any(np.nanmax(held, axis=1, initial=0.0) > UNEVEN * np.nanmin(held, axis=1, initial=np.inf)):
                return True
    return False


def _unfit(model: Model, rows: dict[str, list[Rows]], other: str) -> str:
    """Why a scene should not be stepped explicitly unless it asks to be, or ""."""
    if model.scene.colliders:
        return f"colliders: {other} solves contacts and forces together"
    if _hard(rows):
        return f"tethers or strain limits: {other} solves them and forces together"
    for body in model.bodies:
        rest, ends = edge_lengths(body), body.places[body.edges - body.first]
        if np.any(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > STRETCHED * np.maximum(rest, 1e-12)):
            return f"{body.path} starts with an edge stretched beyond {STRETCHED:g} times its length"
    return ""


def _hard(rows: dict[str, list[Rows]]) -> bool:
    return any(r.kind in HARD for found in rows.values() for r in found)


def slack(model: Model, h: float) -> float:
    """By how much [m] the sweeps of a step h [s] leave the bodies longer than they are, hanging: see SOFT."""
    g, most = float(np.linalg.norm(model.scene.gravity)), 0.0
    for body in (b for b in model.bodies if b.world == 0 and len(b.edges)):
        springs = float(np.ptp(body.places, axis=0).max() / max(edge_lengths(body).mean(), 1e-9))
        most = max(most, SOFT * g * h * h * springs**2 / model.scene.iterations)
    return most


def _size(model: Model) -> float:
    """Largest extent of a body [m]; at least 1 mm."""
    return max(1e-3, *(float((b.places.max(0) - b.places.min(0)).max()) for b in model.bodies))
