"""What a bench found: rows, the front, recommendations, and how far any of it can be trusted; in words and as plain data."""

from dataclasses import dataclass, field
from math import inf, isfinite

from wsim.bench.front import AMPLIFIES, MARGIN, PERTURBED, MeasuredSetting, pareto_front, within_error, within_time
from wsim.simulation.measure.columns import text_columns

CALM = 0.1                             # energy beside the reference's that a recommendation bears
GOALS = (0.01, 0.001)                  # errors for which settings are recommended


@dataclass
class Report:
    """Rows with all that is needed to judge them."""

    scene: str
    points: int
    size: float                        # [m]; errors are over it
    fps: float
    frames: int                        # looked at
    device: str
    hardware: str
    clock: str                         # by which frames are timed: "CPU seconds of all threads", "wall clock"
    versions: dict[str, str]
    reference: dict                    # setting, error, ratio, seconds, notes
    growth: list[float]                # of a perturbation, by sampled frame
    sampled: list[int]                 # those frames
    refused: str                       # why errors of positions are not quoted; "" where they are
    rows: list[MeasuredSetting] = field(default_factory=list)
    left_out: list[dict] = field(default_factory=list)
    seconds: float = 0.0               # that the bench took

    def recommend(self, error: float) -> MeasuredSetting | None:
        """The fastest setting within an error (0.01: 1 % of the size); None if none was found."""
        return None if self.refused else within_error(self.rows, error, self.reference["error"])

    @property
    def real_time(self) -> MeasuredSetting | None:
        """The most accurate setting within the time of a frame, less a margin."""
        return within_time(self.rows, 1.0 / self.fps, most=CALM if self.refused else inf)

    @property
    def front(self) -> list[MeasuredSetting]:
        """Fastest first."""
        return pareto_front(self.rows, 0.0 if self.refused else self.reference["error"])

    @property
    def recommended(self) -> dict[str, MeasuredSetting | None]:
        return {"real time": self.real_time, **{f"{100 * e:g} %": self.recommend(e) for e in GOALS}}

    def as_dict(self) -> dict:
        data = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "rows"}
        return data | {"rows": [r.as_dict() for r in self.rows], "front": [str(r.setting) for r in self.front],
                       "recommended": {name: row.setting.as_dict() if row else None for name, row in self.recommended.items()}}

    @staticmethod
    def from_dict(data: dict) -> "Report":
        """Raises KeyError, TypeError or ValueError where the data is no report."""
        values = {name: data[name] for name in Report.__dataclass_fields__}
        values["rows"] = [MeasuredSetting.from_dict(row) for row in data["rows"]]
        values["reference"] = {**data["reference"], "error": _number_from_json(data["reference"]["error"])}
        report = Report(**values)
        if not (report.fps > 0.0 and isinstance(report.refused, str) and report.frames > 0):
            raise ValueError("no report")
        return report

    def text(self) -> str:
        """The table and what follows from it."""
        return "\n".join([*self._head(), *self._table(), *self._recommendation_lines(),
                          *self._left_out(), f"took      {self.seconds:.3g} s"])

    def _head(self) -> list[str]:
        r, where = self.reference, self.device if self.hardware == self.device else f"{self.device} ({self.hardware})"
        known = f"estimated error {format_percent(r['error'])}" if isfinite(r["error"]) else "not refined"
        known = "not refined" if max(self.growth) > AMPLIFIES and r["ratio"] is None else known
        ratio = "" if r["ratio"] is None else f", differences fall by {r['ratio']:.3g} a level"
        grown = f"grows {max(self.growth):.3g} times" if any(self.growth) else "was not followed: the budget is spent"
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        lines = [f"{self.scene}: {self.points} points, {self.frames} frames of 1/{self.fps:g} s ({self.frames / self.fps:.3g} "
                 f"s) on {where}, {versions}",
                 f"errors are RMS distances over the scene's size, {self.size:.4g} m, after the last frame and the largest",
                 f"times of frames are {self.clock}",
                 f"reference {r['setting']}: {known}{ratio}; {r['seconds']:.3g} s",
                 f"  {PERTURBED:g} of the size, put in at the start, {grown}"]
        lines += [f"  {note}" for note in r["notes"]]
        if self.refused:
            lines += [f"no errors of positions: {self.refused}{self.mend}",
                      "energy is beside the reference's, over what was turned over; residual and strain are of the last frame"]
        return lines

    @property
    def mend(self) -> str:
        """Number of frames that could be compared, in words, where errors of positions are refused."""
        calm = [f for f, g in zip(self.sampled, self.growth, strict=True) if g <= AMPLIFIES]
        past = [f for f, g in zip(self.sampled, self.growth, strict=True) if g > AMPLIFIES]
        good = max((f for f in calm if not past or f < past[0]), default=0)
        if not past:
            return "; give a larger --budget or fewer --frames"
        return (f", more than {AMPLIFIES:g} times by frame {past[0]}"
                + (f": --frames {good} compares positions before that" if good else ""))

    def _table(self) -> list[str]:
        best = {id(row) for row in self.front}
        three = ("energy", "residual", "rms strain") if self.refused else ("end", "largest", "")
        rows: list[tuple[str, ...]] = [("", "solver", "integrator", "substeps x it.", "  precision", "ms/frame", *three, "")]
        for row in sorted(self.rows, key=lambda r: (r.setting.solver, r.setting.integrator, r.setting.precision,
                                                    r.setting.iterations, r.setting.substeps)):
            s = row.setting
            values = ((format_percent(row.drift, sign=True), format_short_number(row.residual), format_percent(row.strain))
                      if self.refused else (self._format_error(row.end), self._format_error(row.largest), ""))
            note = "; ".join(filter(None, ["the scene's own" * row.own, row.note]))
            rows.append(("*" * (id(row) in best), s.solver, s.integrator, f"{s.substeps} x {s.iterations}", f"  {s.precision}",
                         f"{row.ms:.4g}", *values, f"  {note}"))
        lines = text_columns(rows, "<<<><>>>><", (2, 10, 16, 15, 12, 9, 11, 11, 12, 0), gap="")
        return [*(line.rstrip() for line in lines), "* nothing else here is both faster and nearer to the reference"]

    def _format_error(self, value: float | None) -> str:
        """An error; where it is below what the reference knows, that."""
        doubt = self.reference["error"]
        return f"< {format_percent(doubt)}" if value is not None and value < doubt else format_percent(value)

    def _recommendation_lines(self) -> list[str]:
        dt, fast = 1e3 / self.fps, self.real_time
        fastest = min((r.ms for r in self.rows), default=0.0)
        missed = (f"nothing takes less than {(1 - MARGIN) * dt:.3g} ms" + f" and keeps energy within {100 * CALM:g} %" *
                  bool(self.refused) + f"; the fastest takes {fastest:.3g} ms")
        lines = [f"{'real time':<10}" + (self._format_setting_line(fast) + f" of {dt:.3g} ms" if fast else missed)]
        if self.refused:
            return lines
        nearest = min(self.rows, key=lambda r: r.error, default=None)
        for goal in GOALS:
            row = self.recommend(goal)
            found = (self._format_setting_line(row) if row
                     else "not reached" + (f"; nearest: {self._format_setting_line(nearest)}" if nearest else ""))
            lines.append(f"{f'{100 * goal:g} %':<10}{found}")
        return lines

    def _left_out(self) -> list[str]:
        """Settings by reason, as they came."""
        why: dict[str, list[str]] = {}
        for entry in self.left_out:
            why.setdefault(entry["why"], []).append(entry["setting"])
        return [f"left out  {', '.join(settings)}: {reason}" for reason, settings in why.items()]

    def _format_setting_line(self, row: MeasuredSetting) -> str:
        error = f"energy {format_percent(row.drift, sign=True)}" if self.refused else f"error {self._format_error(row.largest)}"
        return f"{row.setting.options}: {error}, {row.ms:.3g} ms a frame"


def _number_from_json(value) -> float:
    return float("inf") if value is None else float(value)


def format_percent(value: float | None, sign: bool = False) -> str:
    """0.0123 as 1.23 %; "-" where there is none."""
    return "-" if value is None or not isfinite(value) else f"{100 * value:{'+' if sign else ''}.2g} %"


def format_short_number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"
