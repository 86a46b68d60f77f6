"""Runs settings against a reference until the budget is spent. Nothing is dropped in silence: `left_out` says why.

Each series starts at its coarsest setting and doubles the substeps; the cheapest run that is open goes first, where a new
series costs what compiling the dearest so far did, and is worth EAGER times that of more substeps.
A series ends where its error is below what the reference resolves, below a tenth of the smallest error of interest, or where
another one is far ahead.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from wsim.bench.budget import Budget
from wsim.bench.front import MeasuredSetting, pareto_front
from wsim.bench.reference import ReferenceSolution
from wsim.bench.report import format_percent
from wsim.bench.setting import Setting, first_setting_of_series, unusable_solvers
from wsim.bench.track import SampledFrames, Trajectory, largest_body_extent, rms_point_distance, run_with_setting
from wsim.scene import Scene, SceneError

ENOUGH = 1e-4          # error below which finer settings interest nobody: a tenth of 0.1 %
DOMINATED = 8.0        # times slower than a row that errs less: a series ends there
EAGER = 4.0            # a new series may cost so many times the cheapest run that is open
KEPT = 0.1             # of the budget, for what comes last
DEAR = 0.1             # of the budget, that the first run of a series may take unless it comes last
TICK = 1e-4            # [ms] of a clock: a frame that takes less is measured as 0
DOUBLES = 2            # float32 rows that are repeated in float64, to show where rounding begins


@dataclass
class BenchSweep:
    """The runs of one bench."""

    scene: Scene
    look: SampledFrames
    reference: ReferenceSolution
    budget: Budget
    say: Callable[[str], None]
    step: int = 2                          # substeps of a setting over those of the one before it
    rows: list[MeasuredSetting] = field(default_factory=list)
    left_out: list[dict] = field(default_factory=list)
    seconds: dict[Setting, float] = field(default_factory=dict)      # of the frames of a row
    starts: list[float] = field(default_factory=list)                # what the first runs of series took besides frames

    def drop(self, setting: Setting, why: str) -> None:
        self.left_out.append({"setting": str(setting), "why": why})

    def run(self, setting: Setting, cost: float) -> MeasuredSetting | None:
        """One row, or None with the reason in left_out."""
        left = self.budget.left(1.0 if setting.precision == "float64" else 1.0 - KEPT)
        if self.rows and (cost > left or not left):            # one row there is, whatever it costs
            self.drop(setting, f"would take about {cost:.2g} s, {left:.2g} s are left of the budget" if left else
                      f"the budget of {self.budget.seconds:g} s is spent")
            return None
        self.say(str(setting))
        try:
            track = run_with_setting(self.scene, setting, self.look, measured=bool(self.reference.refused))
        except SceneError as error:
            self.drop(setting, f"fails: {error.problems[0].text}")
            return None
        self.seconds[track.setting] = track.seconds
        row = self.row(track)
        if all(r.setting != row.setting for r in self.rows):
            self.rows.append(row)
        return row

    def row(self, track: Trajectory) -> MeasuredSetting:
        """A track beside the reference."""
        row, there = (MeasuredSetting(track.setting, track.ms, held=not track.notes, note="; ".join(track.notes)),
                      self.reference.track)
        if not self.reference.refused:
            errors = rms_point_distance(track.places, there.places) / largest_body_extent(self.scene)
            return replace(row, end=float(errors[-1]), largest=float(errors.max()))
        strains = [track.found[name] for name in ("rms_strain", "rms_solid_strain") if name in track.found]
        row.residual, row.strain = track.found.get("residual"), max(strains, default=None)
        turned = self.reference.found
        if turned:
            turnover = turned["kinetic_energy"] + turned.get("elastic_energy", 0.0) + abs(turned["gravity_work"])
            row.drift = (track.found["energy"] - turned["energy"]) / max(1e-12, turnover)
        return row

    def all(self, quick: bool = False) -> None:
        """Every series, the cheapest next run first; before them the scene's own setting, after them float64."""
        s = self.scene
        own = self.run(Setting(s.solver, s.integrator, s.substeps, s.iterations), 0.0)
        if own:
            own.own = True
        for solver, why in unusable_solvers(s).items():
            self.left_out.append({"setting": solver, "why": why})
        new, known = list(first_setting_of_series(s, quick)), list[tuple[float, Setting]]()
        if new and self.frames(new[0]) > DEAR * self.budget.seconds:
            new.append(new.pop(0))
        while new or known:
            start = max(self.starts, default=0.0)              # compiling, mostly; and frames where they may be many substeps
            start = max(start, self.frames(new[0])) if new else start
            known.sort(key=lambda entry: entry[0])
            if new and (not known or start <= EAGER * known[0][0]):
                began = self.budget.spent
                row = self.run(new.pop(0), start)
                self.starts += [self.budget.spent - began - self.seconds[row.setting]] if row else []
            else:
                row = self.run(known[0][1], known.pop(0)[0])
            if row and self.goes_on(row):
                known.append((self.step * self.seconds[row.setting], row.setting.with_more_substeps(self.step)))
        if not quick:
            self.repeat_in_double()

    def frames(self, setting: Setting) -> float:
        """Seconds that the frames of a series' first run may take: of leapfrog on soft bodies; of others nothing is known."""
        return self.look.frames * self.reference.leapfrog if setting.solver == "explicit" else 0.0

    def goes_on(self, row: MeasuredSetting) -> bool:
        """True if a finer setting of the same series tells more."""
        doubt = 0.0 if self.reference.refused else self.reference.error
        ahead = [r for r in self.rows if r.held and r.error <= row.error and DOMINATED * r.ms <= row.ms]
        if row.error <= max(ENOUGH, doubt):
            what = f"{format_percent(doubt)}, what the reference resolves" if doubt > ENOUGH else f"{format_percent(ENOUGH)}"
            self.drop(row.setting.with_more_substeps(self.step), f"{row.setting.substeps} substeps err by less than {what}"
                      + " in energy" * bool(self.reference.refused))
        elif ahead:
            self.drop(row.setting.with_more_substeps(self.step),
                      f"{ahead[0].setting} errs less than {row.setting.substeps} substeps and "
                      f"is {row.ms / max(ahead[0].ms, TICK):.0f} times faster")
        return row.error > max(ENOUGH, doubt) and not ahead

    def repeat_in_double(self) -> None:
        """The most accurate float32 rows of the front, in float64."""
        for row in pareto_front([r for r in self.rows if r.setting.precision == "float32"])[::-1][:DOUBLES]:
            self.run(replace(row.setting, precision="float64"), 2.0 * self.seconds[row.setting])

