"""What a bench compares with: the scene in float64, refined until its own error is small, and whether that has a meaning.

    levels     substeps n, 2 n, 4 n ...;  d_k = largest of the sampled frames of |x_k+1 - x_k| over the scene's size
    estimate   error of the finest = d_last / (r - 1),  r = min(d_before / d_last, 2^order)        (Richardson 1911)
    growth     |x~ - x| over what it was at the start, where x~ starts PERTURBED of the size away, at random; seen with the
               coarsest level and, unless that is hopeless, with a finer one

Refinement of a scene that amplifies perturbations a hundredfold shows where rounding leads and not where the scene goes: two
right solutions differ as much. So does one whose differences do not shrink. Then no errors of positions are quoted.

Where only springs, membranes, hinges, tets and pins act the reference is Runge-Kutta of order 4; else leapfrog, whose limit for
short substeps is that of coloured XPBD too (33 x 33 hanging cloth with tethers and strain limits, 7 frames: they meet within
1.3e-4 of its size, box and cloth within 4e-5). Collisions, tethers and limits make it order 1, and are iterated: what twice the
iterations change is added to the estimate. Scenes too stiff for explicit steps are refined with Newton's method or XPBD,
soft bodies with Newton's alone; of those the cost of explicit steps is known from `wsim.simulation.cost` before any is taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, isnan, nan

import numpy as np

from wsim.bench.budget import Budget
from wsim.bench.front import AMPLIFIES, PERTURBED
from wsim.bench.setting import NEWTON, Setting, first_substeps, scene_is_smooth
from wsim.bench.track import LONGEST, SampledFrames, Trajectory, largest_body_extent, rms_point_distance, run_in_shorter_frames
from wsim.model.model import hard_places
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.integrator import TABLE
from wsim.scene.methods import has_tets
from wsim.simulation.cost import COSTS
from wsim.simulation.simulation import Simulation

HOPELESS = 1e3         # growth in coarse steps, which exaggerate it, beyond which nothing is refined
TARGET = 1e-4          # estimated error at which refinement ends: a tenth of the smallest error of interest, 0.1 %
USABLE = 1e-2          # with an estimate above it nothing can be said of 1 %
SHRINKS = 1.25         # least ratio of successive differences that counts as converging
SHARP = 1e-7           # estimated error down to which refinement goes on while it costs next to nothing: CHEAP of the budget
LEVELS = 9             # at most
LEAST = 8.0            # times the coarsest level: two finer ones, and the perturbed one
SHARE, CHEAP = 0.5, 0.03
UNSURE = 2.0           # times what is to be spent that a guess of seconds must be before it counts without a trial


@dataclass
class ReferenceSolution:
    """The finest track and how good it is."""

    track: Trajectory
    error: float                           # estimated, over the scene's size; inf: not converging
    ratio: float                           # of the last two differences; nan where there is one
    growth: np.ndarray                     # of a perturbation at each sampled frame
    seconds: float
    notes: list[str] = field(default_factory=list)
    found: dict[str, float] = field(default_factory=dict)      # energies, where errors of positions are refused; or nothing
    leapfrog: float = 0.0                  # guess of the seconds of a frame of leapfrog, see `leapfrog`

    @property
    def refused(self) -> str:
        return reason_errors_are_refused(self.growth, self.error)


def reason_errors_are_refused(growth: np.ndarray, error: float) -> str:
    """Reason why errors of positions are not quoted; "" where they are. growth by sampled frame; error of the reference."""
    if growth.max() > AMPLIFIES:
        return f"the scene amplifies perturbations: {PERTURBED:g} of its size at the start grows {growth.max():.3g} times"
    if isnan(error):
        return "the budget pays for no refinement of the reference"
    if not isfinite(error):
        return "the reference does not converge: more substeps do not bring it closer to itself"
    if error > USABLE:
        return f"the reference did not get far enough: its estimated error is {100 * error:.2g} % of the size"
    return ""


def richardson(differences: Sequence[float], order: int) -> float:
    """Estimated error of the finest level from the differences of successive ones (each with twice the substeps).

    One difference: the order is believed. More: never a faster fall than was seen; inf where it is slower than SHRINKS.
    """
    last = differences[-1]
    if last == 0.0:
        return 0.0
    ratio = 2.0**order if len(differences) < 2 else min(differences[-2] / last, 2.0**order)
    return last / (ratio - 1.0) if ratio > SHRINKS else inf


def stable_leapfrog_cost(scene: Scene, look: SampledFrames) -> tuple[int, float]:
    """Substeps a frame with which leapfrog is stable, and a guess of its seconds a frame, known beforehand of soft bodies only
    (of others 0: a trial costs little)."""
    auto = Simulation(replace(scene, solver="explicit", integrator="auto", substeps=1), device=look.device)
    stable, costs = auto.plan.choice.substeps, COSTS["cuda" if auto.device.is_cuda else "cpu"]
    tets = sum(len(body.tets) for body in auto.model.bodies if body.world == 0)
    return stable, stable * (costs["block"] + costs["tet"] * tets) if tets else 0.0


def reference_methods(scene: Scene, stable: int) -> list[tuple[Setting, int]]:
    """Coarsest setting and order of every method that may serve, the best first; leapfrog is stable with so many substeps."""
    n, sweeps = max(4, first_substeps(scene)), max(scene.iterations, 4)
    if not scene_is_smooth(scene):
        integrator, order = ("backward_euler", 1) if scene.colliders else ("bdf2", 2)
        solver, repeats = ("implicit", NEWTON[-1]) if has_tets(scene) else ("xpbd", sweeps)
        return [(Setting("explicit", "leapfrog", stable, 1, "float64"), 1),
                (Setting(solver, integrator, max(n, scene.substeps // 2), repeats, "float64"), order)]
    newton = [(Setting("explicit", "rk4", stable, 1, "float64"), 4), (Setting("implicit", "bdf2", n, NEWTON[-1], "float64"), 2)]
    return newton if has_tets(scene) else [*newton, (Setting("xpbd", "bdf2", n, 4 * sweeps, "float64"), 2)]


def perturb_positions(sim: Simulation) -> None:
    """Moves every point that is not pinned hard by PERTURBED of the scene's size, at random, the same every time."""
    rng, pinned = np.random.default_rng(1), hard_places(sim.model)
    steps = rng.normal(size=(sim.model.points, 3)) * PERTURBED * largest_body_extent(sim.scene) / 3.0**0.5
    steps[pinned] = 0.0
    for body in sim.scene.bodies():
        sim.set(body.path, "positions", sim.positions(body.path) + steps[sim.model.body(body.path).index])


class Refinement:
    """Levels of one method, each with twice the substeps of the one before."""

    def __init__(self, scene: Scene, look: SampledFrames, coarsest: Setting, order: int, say: Callable[[str], None]):
        self.scene, self.look, self.order, self.say = scene, look, order, say
        self.size = largest_body_extent(scene)
        self.next = coarsest
        self.tracks: list[Trajectory] = []
        self.differences: list[float] = []
        self.growth = np.zeros(len(look.sampled))
        self.notes: list[str] = []

    @property
    def finest_track(self) -> Trajectory:
        return self.tracks[-1]

    @property
    def cost(self) -> float:
        """Seconds that the next level is going to take."""
        return 2.0 * self.finest_track.seconds

    @property
    def error(self) -> float:
        return richardson(self.differences, self.order) if self.differences else nan

    def known(self, budget: Budget) -> bool:
        """True if the reference is good enough: three levels that converge, or two that hardly differ."""
        few = len(self.differences) < 2 and (not self.differences or self.differences[-1] > 1e-2 * TARGET)
        goal = SHARP if self.order > 2 and self.cost < CHEAP * budget.seconds else TARGET
        return not few and self.error <= goal

    def tried(self) -> float:
        """Seconds that the least refinement may take, from one frame, where that frame has many substeps; else 0."""
        if self.next.substeps <= 3 * LONGEST or self.look.frames < 3:
            return 0.0
        self.say(f"reference: one frame of {self.next}")
        return LEAST * self.look.frames * run_in_shorter_frames(self.scene, self.next, replace(self.look, frames=1)).seconds

    def refine(self, measured: bool = False) -> None:
        """One more level; `measured`: with its energies and strain, for which kernels are compiled."""
        self.say(f"reference: {self.next}")
        track = run_in_shorter_frames(self.scene, self.next, self.look, measured=measured)
        if self.tracks:
            self.differences.append(float(rms_point_distance(track.places, self.finest_track.places).max()) / self.size)
        self.tracks = [*self.tracks[-1:], track]
        self.next = self.next.with_more_substeps()

    def measure_growth(self) -> None:
        """Measures the growth with the level before the finest, in place of what a coarser one showed."""
        base = self.tracks[0]
        self.say(f"reference: perturbed, {base.setting}")
        other = run_in_shorter_frames(self.scene, base.setting, self.look, perturb_positions)
        moved = rms_point_distance(other.start[None], base.start[None])[0]
        self.growth = rms_point_distance(other.places, base.places) / moved

    @property
    def amplifies_perturbations(self) -> bool:
        return bool(self.growth.max() > AMPLIFIES)

    def sweeps(self) -> float:
        """Change of the level before the finest by twice the iterations, over the scene's size [1]."""
        base = self.tracks[0]
        self.say(f"reference: twice the iterations of {base.setting}")
        more = run_in_shorter_frames(self.scene, replace(base.setting, iterations=2 * base.setting.iterations), self.look)
        return float(rms_point_distance(more.places, base.places).max()) / self.size


def make_reference_solution(scene: Scene, look: SampledFrames, budget: Budget, say: Callable[[str], None]) -> ReferenceSolution:
    """The best reference that SHARE of the budget pays for. Raises SceneError where nothing moves or nothing runs."""
    began, notes = budget.spent, []
    stable, guess = stable_leapfrog_cost(scene, look)
    found = reference_methods(scene, stable)
    for k, (coarsest, order) in enumerate(found):
        last = k + 1 == len(found)
        r, allowed = Refinement(scene, look, coarsest, order, say), inf if last else budget.left(SHARE)
        known = LEAST * look.frames * guess * TABLE[coarsest.integrator].forces if coarsest.solver == "explicit" else 0.0
        if not last and known > UNSURE * allowed:
            notes.append(f"{coarsest} would take about {known:.2g} s")
            continue
        try:
            cost = r.tried() if not last else 0.0
            if cost <= allowed:
                r.refine()
                cost = LEAST * r.finest_track.seconds
        except SceneError as error:
            if last:
                raise
            notes.append(f"{coarsest}: {error.problems[0].text}")
            continue
        if last or cost <= allowed:
            return replace(_refine_within_budget(r, budget, began, notes), leapfrog=guess)
        notes.append(f"{coarsest} would take about {cost:.0f} s")
    raise AssertionError("there is always a last candidate")


def _refine_within_budget(r: Refinement, budget: Budget, began: float, notes: list[str]) -> ReferenceSolution:
    """Goes on refining while it helps and is paid for."""
    _require_moving_scene(r)
    if r.finest_track.seconds <= budget.left():
        r.measure_growth()
    while len(r.differences) < LEVELS and not r.known(budget):
        hopeless = r.growth.max() > (AMPLIFIES if len(r.differences) > 1 else HOPELESS)
        if hopeless or r.cost > budget.left(SHARE if r.differences else 1.0):
            break
        r.refine()
        if len(r.differences) == 2:
            r.measure_growth()                                 # once more: coarse steps damp, and give way
    error = r.error
    direct = r.finest_track.setting.solver == "explicit" and scene_is_smooth(r.scene)  # nothing is iterated
    if not direct and not reason_errors_are_refused(r.growth, error):
        if r.finest_track.seconds <= budget.left(SHARE):
            error += r.sweeps()
        else:
            notes.append("whether its iterations are enough was not looked at: the budget is spent")
    if len(r.differences) == 1 and error > 1e-2 * TARGET and not r.amplifies_perturbations:
        notes.append(f"its error is from one refinement, believing in order {r.order}")
    ratios = r.differences[-2:]
    ratio = ratios[0] / ratios[1] if len(ratios) == 2 and ratios[1] else nan
    if reason_errors_are_refused(r.growth, error) and budget.left():
        if r.differences or r.cost > budget.left(SHARE):
            r.next = r.finest_track.setting                    # the same again, with its energies
        r.refine(measured=True)
    return ReferenceSolution(r.finest_track, error, ratio, r.growth, budget.spent - began, [*notes, *r.finest_track.notes],
                             r.finest_track.found)


def _require_moving_scene(r: Refinement) -> None:
    moved = float(rms_point_distance(r.finest_track.places, r.finest_track.start[None]).max()) / r.size
    if moved < 1e-9:
        raise SceneError(Problem("/", f"nothing moves in the first {r.look.frames} frames (by {moved:.1g} of its size): no "
                                 "error can be measured; look at more --frames, or at gravity, velocities and pins"))
