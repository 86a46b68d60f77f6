"""A fit in words: what `wsim fit` prints."""

from typing import TYPE_CHECKING

import numpy as np

from wsim.simulation.measure.columns import text_columns

if TYPE_CHECKING:
    from wsim.fitting.fit import Fit

STRONG = 0.9           # correlation that is named
ORIGIN = {"given": "as given", "estimated": "estimated from what is left",
          "floor": "as low as a fit claims: what solvers and rounding leave"}
BARS = " .:-=+*#"      # of the smallest to the largest residual


def format_with_error(value: float, error: float = 0.0) -> str:
    """Text of a number with two figures of its error, five at least and ten at most."""
    figures = 5 if not 0.0 < error < abs(value) else int(np.ceil(np.log10(abs(value) / error))) + 2
    return f"{value:.{min(max(figures, 5), 10)}g}"


def fit_report_text(fit: "Fit") -> str:
    """Table, what the data leave open, residuals over time, cost."""
    e, half = fit.estimate, fit.half_step
    rows = [("parameter", "value", "error bar", "two error bars", "unit", "half the time step shifts it by")]
    for k, p in enumerate(fit.parameters):
        known, error = np.isfinite(e.errors[k]), float(e.errors[k])
        rows.append((p.name, format_with_error(e.values[k], error), f"{error:.2g}" if known else "unknown",
                     f"{format_with_error(e.low[k], error)} to {format_with_error(e.high[k], error)}" if known
                     else "not identifiable", p.unit, half.told(k, e.values[k]) if half else "unknown"))
    lines = [line.rstrip() for line in text_columns(rows, "<>><<<")]
    lines += [f"not identifiable: {w}" for w in e.words]
    lines += _correlation_lines(fit)
    lines.append(f"singular values {', '.join(f'{s:.3g}' for s in e.singular)} (of the Jacobian over the noise)")
    lines.append(f"noise {fit.sigma:.3g} {fit.unit}, residuals over it {fit.misfit:.3g}; by time |{residual_bars(fit)}|; noise "
                 f"{ORIGIN[fit.origin]}")
    end = "NOT converged" if not fit.converged else \
        "converged for this time step alone" if half and half.exceeds_error_bar.any() else "converged"
    lines.append(f"{end} after {fit.steps} steps, {fit.simulations:.3g} simulations ({fit.launches} launches of "
                 f"{fit.worlds} copies), {fit.seconds:.3g} s, frames to {fit.frames}")
    return "\n".join([*lines, *(f"warning: {n}" for n in fit.notes)])


def _correlation_lines(fit: "Fit") -> list[str]:
    names, C, known = [p.name for p in fit.parameters], fit.estimate.correlation, np.isfinite(fit.estimate.errors)
    return [f"{names[i]} and {names[j]} are correlated by {C[i, j]:+.3f}" for i in range(len(names)) for j in range(i)
            if known[i] and known[j] and abs(C[i, j]) > STRONG]


def residual_bars(fit: "Fit", width: int = 48) -> str:
    """Residuals over time, a sign for each moment, or for some together."""
    values = np.array([r[2] for r in fit.residuals])
    if not len(values) or not values.max() > 0.0:
        return ""
    parts = [p.mean() for p in np.array_split(values, min(width, len(values)))]
    return "".join(BARS[int(round(p / max(parts) * (len(BARS) - 1)))] for p in parts)
