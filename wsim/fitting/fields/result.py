"""What a fit of fields has found, and in words."""

from dataclasses import dataclass, field

import numpy as np

from wsim.fitting.fields.field import ParameterField
from wsim.fitting.fields.number import NumberField
from wsim.fitting.fields.time_step import FieldHalfStep
from wsim.fitting.least_squares.bounds import FittingMap
from wsim.fitting.least_squares.uncertainty import OPEN
from wsim.fitting.report import ORIGIN, format_with_error
from wsim.scene import Scene
from wsim.simulation.measure.columns import text_columns


@dataclass
class NumberErrorBar:
    """Error of a number: one error bar, and two of them below and above. inf: not identifiable. half_time_step_shift:
    change of the value with half the time step; None: not known."""

    error: float
    low: float
    high: float
    half_time_step_shift: float | None = None

    @staticmethod
    def of(map: FittingMap, theta: float, sigma: float, shift: float | None = None) -> "NumberErrorBar":
        """The error of a value from its theta, and the deviation and shift of theta."""
        if sigma >= OPEN:
            return NumberErrorBar(np.inf, -np.inf, np.inf)
        low, high = (float(map.inverse(theta + s * sigma)) for s in (-2.0, 2.0))
        slope = float(map.slope(theta))
        return NumberErrorBar(slope * sigma, low, high, None if shift is None else slope * shift)


@dataclass
class FieldFit:
    """Values of each field by its name, (n,), of vectors (n, 3), in the author's order; of a number (1,).

    sensitivity   what a unit of theta of each value moves of all that was observed, over the noise: the value is known to about
                  1 / sensitivity, were all others given. Below 1 the data do not see it: there it is as was believed
    """

    parameters: list[ParameterField | NumberField]  # numbers first
    values: dict[str, np.ndarray]
    sensitivity: dict[str, np.ndarray]
    scene: Scene                           # the first scene, with what was found
    scenes: list[Scene]
    converged: bool
    sigma: float                           # noise [unit]: estimated, or as given
    misfit: float                          # rms of the residuals at the end over sigma
    slope: float                           # norm of the gradient at the end, by theta
    steps: int
    simulations: float                     # gradients of the whole horizon (a run forward and one backward each)
    launches: int                          # of any horizon
    frames: int                            # last frame that was used
    seconds: float
    history: list[tuple] = field(default_factory=list)       # step, horizon [s], rms [m or sigma], F, |gradient|, gradients
    notes: list[str] = field(default_factory=list)
    bars: dict[str, NumberErrorBar] = field(default_factory=dict)  # of the numbers
    unit: str = "m"                        # of sigma; where positions and forces have one each, "sigma" and 1
    origin: str = "given"                  # of sigma: "given", "estimated", or "floor", below which none is claimed
    half_step: FieldHalfStep | None = None  # how far half the time step shifts the values

    @property
    def fields(self) -> list[ParameterField]:
        return [f for f in self.parameters if isinstance(f, ParameterField)]

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations of the numbers, whatever the fields are; inf: not identifiable."""
        return {name: bar.error for name, bar in self.bars.items()}

    def unseen(self, name: str) -> np.ndarray:
        """Elements of which the data say nothing, (n,) bool."""
        return _sizes_of_values(self.sensitivity[name]) < 1.0 / OPEN

    def as_dict(self) -> dict:
        """The result as a dictionary for JSON."""
        return {"parameters": [{"name": f.name, "value": float(self.values[f.name][0]), "unit": f.kind.unit,
                                "identifiable": bool(np.isfinite(self.bars[f.name].error)), **vars(self.bars[f.name])}
                               for f in self.parameters if f.name in self.bars],
                "fields": [{"name": f.name, "path": f.path, "of": f.kind.noun, "unit": f.kind.unit, "belief": f.belief,
                            "neighbours": f.near, "values": self.values[f.name].tolist(),
                            "sensitivity": self.sensitivity[f.name].tolist(), "unseen": int(self.unseen(f.name).sum())}
                           for f in self.fields],
                "half_time_step_shift_in_error_bars": self.half_step.rms if self.half_step else None,
                "converged": self.converged, "sigma": self.sigma, "sigma_unit": self.unit, "sigma_is": self.origin,
                "misfit_over_sigma": self.misfit, "gradient": self.slope,
                "frames": self.frames, "steps": self.steps, "simulations": self.simulations, "launches": self.launches,
                "seconds": self.seconds, "history": self.history, "notes": self.notes}

    def text(self) -> str:
        """Quantiles of each field, what is unseen, progress, cost."""
        lines = self.numbers()
        rows: list[tuple[str, ...]] = [("field", "of", "lowest", "median", "highest", "unit", "unseen")]
        for f in self.fields:
            v, unseen = self.values[f.name], int(self.unseen(f.name).sum())
            middle = [f"{q:.4g}" for q in np.quantile(v if f.kind.unit == "1" else _sizes_of_values(v), (0.0, 0.5, 1.0))]
            rows.append((f.name, f"{len(v)} {f.kind.noun} of {f.path}", *middle, f.kind.unit, str(unseen)))
        lines += [line.rstrip() for line in text_columns(rows, "<" * 7)]
        for f in self.fields:
            count = int(self.unseen(f.name).sum())
            if count:
                lines.append(f"{count} of {len(self.values[f.name])} {f.kind.noun} change nothing that was observed by more "
                             f"than the noise: their {f.kind.name} is what was believed, not what was seen")
        steps = [(f"{s:d}", f"{t:.3g}", f"{r:.4g}", f"{v:.4g}", f"{g:.3g}", f"{w:.4g}") for s, t, r, v, g, w in self.shown()]
        head = ("step", "frames [s]", "rms", "F", "|gradient|", "gradients")
        lines += text_columns([head, *steps], ">><<<<", (4, 10, 10, 10, 10, 0))
        lines.append(f"noise {self.sigma:.3g} {self.unit}, residuals over it {self.misfit:.3g}; noise {ORIGIN[self.origin]}")
        half = self.half_step
        if half and half.rms is not None:
            lines.append(f"half the time step shifts the values by at least {half.rms:.2g} error bars (root mean square)")
        end = ("NOT converged" if not self.converged else "converged for this time step alone" if half
               and half.exceeds_error_bar else
             "converged")
        lines.append(f"{end} after {self.steps} steps, {self.simulations:.3g} gradients ({self.launches} runs), "
                     f"{self.seconds:.3g} s, frames to {self.frames}")
        return "\n".join([*lines, *(f"warning: {n}" for n in self.notes)])

    def numbers(self) -> list[str]:
        lines = []
        for name, bar in self.bars.items():
            f = next(f for f in self.parameters if f.name == name)
            value = f"{name}  {format_with_error(float(self.values[name][0]), bar.error)} {f.kind.unit}"
            shift = "" if bar.half_time_step_shift is None else \
                f"; half the time step shifts it by {bar.half_time_step_shift:+.2g} {f.kind.unit}"
            lines.append(f"{value}, error bar {bar.error:.2g}, two of them {format_with_error(bar.low, bar.error)} to "
                         f"{format_with_error(bar.high, bar.error)}{shift}" if np.isfinite(bar.error) else
                         f"{value}, not identifiable: with the fields open these data do not say what it is; give a prior")
        return lines

    def shown(self) -> list[tuple]:
        """A dozen steps of the history, with the first and the last."""
        n = len(self.history)
        return [self.history[k] for k in sorted(set(np.linspace(0, n - 1, min(n, 12)).astype(int).tolist()))] if n else []


def _sizes_of_values(values: np.ndarray) -> np.ndarray:
    return values if values.ndim == 1 else np.linalg.norm(values, axis=1)
