"""What was measured of one setting, which settings are worth having, and which one suits a wish. Pure Python.

A row is on the front when no other is both as fast and as accurate, and better in one of the two (Pareto).
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from math import inf, isfinite

from wsim.bench.setting import Setting

AMPLIFIES = 100.0      # growth of a perturbation beyond which positions say nothing
PERTURBED = 1e-6       # size of that perturbation, over the scene's
MARGIN = 0.2           # of a frame's time that "real time" leaves for everything else


@dataclass
class MeasuredSetting:
    """One setting and what it gave. Errors are RMS distances of the points from the reference over the scene's size."""

    setting: Setting
    ms: float                              # of a warm frame, median
    end: float | None = None               # error after the last frame; None: errors are not quoted here
    largest: float | None = None           # largest of the sampled frames
    drift: float | None = None             # energy beside the reference's, over what energy turned over
    residual: float | None = None          # what the sweeps left (strain, radians); None: not known
    strain: float | None = None            # RMS over the edges, or over the volume of soft bodies where that is larger
    held: bool = True                      # False: the setting gave way to another on the way, as the note says
    own: bool = False                      # what the scene itself names
    note: str = ""

    @property
    def error(self) -> float:
        """Number by which rows are ranked: the largest error, or |drift| where errors are not quoted."""
        value = self.largest if self.largest is not None else self.drift
        return abs(value) if value is not None and isfinite(value) else inf

    def as_dict(self) -> dict:
        return {**self.setting.as_dict(), **{k: v for k, v in asdict(self).items() if k != "setting"}}

    @staticmethod
    def from_dict(data: dict) -> "MeasuredSetting":
        """Raises KeyError, TypeError or ValueError where the data is no row."""
        setting = Setting(*(kind(data[f.name]) for f, kind in zip(fields(Setting), (str, str, int, int, str), strict=True)))
        numbers = {name: None if data[name] is None else float(data[name])
                   for name in ("end", "largest", "drift", "residual", "strain")}
        if setting.substeps < 1 or setting.iterations < 1 or not float(data["ms"]) > 0.0:
            raise ValueError(f"no row: {data}")
        return MeasuredSetting(setting, float(data["ms"]), **numbers, note=str(data["note"]),
                   held=bool(data["held"]), own=bool(data["own"]))


def pareto_front(rows: Sequence[MeasuredSetting], doubt: float = 0.0) -> list[MeasuredSetting]:
    """The rows that are on the front, fastest first. Of equals the first one is; what did not hold is not.

    Errors below `doubt`, the reference's own, are equal: the fastest of them ends the front.
    """
    found: list[MeasuredSetting] = []
    for row in sorted(rows, key=lambda r: (r.ms, r.error)):
        if row.held and row.error < inf and (not found or max(row.error, doubt) < max(found[-1].error, doubt)):
            found.append(row)
    return found


def within_error(rows: Sequence[MeasuredSetting], error: float, doubt: float = 0.0) -> MeasuredSetting | None:
    """The fastest whose largest error, and the reference's own, `doubt`, stay within `error`; None if there is none."""
    return _best_by_rank([r for r in rows if r.largest is not None and r.largest + doubt <= error], lambda r: (r.ms, r.error))


def within_time(rows: Sequence[MeasuredSetting], dt: float, margin: float = MARGIN,
                most: float = inf) -> MeasuredSetting | None:
    """The most accurate that takes at most dt [s] less the margin and errs by `most` at most; None if there is none."""
    return _best_by_rank([r for r in rows if r.ms <= 1e3 * dt * (1.0 - margin) and r.error <= most], lambda r: (r.error, r.ms))


def _best_by_rank(rows: Sequence[MeasuredSetting],
                  rank: Callable[[MeasuredSetting], tuple[float, float]]) -> MeasuredSetting | None:
    """The first by rank of those that held; float64, the measuring instrument, only where no float32 will do."""
    good = [r for r in rows if r.held and r.error < inf]
    return min([r for r in good if r.setting.precision == "float32"] or good, key=rank, default=None)
