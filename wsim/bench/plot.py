"""Work-precision plot: error against the time of a frame, both logarithmic, one colour a solver. Needs the extra `plot`."""

import os
from typing import TYPE_CHECKING

from wsim.bench.front import MeasuredSetting
from wsim.bench.report import GOALS, Report
from wsim.scene import Problem, SceneError
from wsim.usd.result.atomic import replace_file_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ENDINGS = (".png", ".svg")
MISSING = 'matplotlib is not installed; install it by: pip install -e ".[plot]"'
COLOURS = {"explicit": "#0b7a75", "xpbd": "#c2571a", "implicit": "#4a4e9e"}      # told apart by colour-blind eyes too
MARKS = {"backward_euler": "o", "bdf2": "s", "leapfrog": "^"}
OTHER = "D"                                                                      # any other integrator
LINES = {1: ":", 4: "-", 16: "--"}                                               # by iterations


def require_plotting() -> None:
    """Raises SceneError where matplotlib is missing: found out before the bench and not after it."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise SceneError(Problem("--plot", MISSING)) from None


def plot_bench_report(report: Report, place: str) -> None:
    """Draws a report as .png or .svg, whole or not at all."""
    require_plotting()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(xscale="log", yscale="log")
    rows = [r for r in report.rows if 0.0 < r.error < float("inf")]          # what a logarithm knows
    axes.set_ylim(min((r.error for r in rows), default=1e-3) / 3.0, max((r.error for r in rows), default=1.0) * 2.0)
    _draw_setting_series(axes, rows)
    _mark_recommended_settings(axes, report, rows)
    _draw_error_goals(axes, report)
    _style_plot_axes(axes, report)
    figure.legend(loc="outside right upper", frameon=False, fontsize=8)
    with replace_file_atomically(place, os.path.splitext(place)[1].lower()) as whole:
        figure.savefig(whole)


def _style_plot_axes(axes: "Axes", report: Report) -> None:
    """Scales, names, grid, title."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    axes.set(xlabel="time of a frame [ms]",
             ylabel="energy beside the reference's, over what was turned over" if report.refused
             else "largest RMS error of positions, over the scene's size")
    for axis, text, ends in ((axes.xaxis, "{:g}", axes.get_xlim()), (axes.yaxis, "{:.6g} %", axes.get_ylim())):
        scale = 1.0 if axis is axes.xaxis else 100.0
        few = ends[1] < 100.0 * ends[0]                                       # less than two powers of ten
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        axis.set_major_formatter(FuncFormatter(lambda v, _, text=text, scale=scale: text.format(round(scale * v, 9))))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set_title(f"{os.path.basename(report.scene)}: {report.points} points, {report.frames} frames of 1/{report.fps:g} s\n"
                   f"{report.hardware}", loc="left", fontsize=10)


def _draw_setting_series(axes: "Axes", rows: list[MeasuredSetting]) -> None:
    """A line for each solver, integrator and iterations, over the substeps; float64 hollow."""
    groups: dict[tuple, list[MeasuredSetting]] = {}
    for row in sorted(rows, key=lambda r: r.setting.substeps):
        s = row.setting
        if s.precision == "float32" and not row.own:
            groups.setdefault((s.solver, s.integrator, s.iterations), []).append(row)
    for (solver, integrator, iterations), group in sorted(groups.items()):
        times = f" x {iterations}" * (solver != "explicit")
        axes.plot([r.ms for r in group], [r.error for r in group], linewidth=1.2, markersize=5, color=COLOURS[solver],
                  marker=MARKS.get(integrator, OTHER), linestyle=LINES.get(iterations, "-."),
                  label=f"{solver} {integrator.replace('_', ' ')}{times}")
    for what, size, chosen in (("float64", 9, [r for r in rows if r.setting.precision == "float64"]),
                               ("gave way on the way", 5, [r for r in rows if not r.held])):
        for k, row in enumerate(chosen):
            axes.plot(row.ms, row.error, MARKS.get(row.setting.integrator, OTHER), color=COLOURS[row.setting.solver],
                      markersize=size, markerfacecolor="none" if row.held else "#ffffff", label=what if k == 0 else "")


def _mark_recommended_settings(axes: "Axes", report: Report, rows: list[MeasuredSetting]) -> None:
    """The front as what can be had for a time, the scene's own setting, and the recommended ones by name."""
    best = [r for r in report.front if r in rows]
    axes.plot([r.ms for r in best], [r.error for r in best], color="#000000", alpha=0.13, linewidth=5,
              drawstyle="steps-post", solid_capstyle="round", solid_joinstyle="round", zorder=0, label="front")
    for row in (r for r in rows if r.own):
        axes.plot(row.ms, row.error, "*", color=COLOURS[row.setting.solver], markeredgecolor="#000000", markersize=12,
                  label=f"the scene's own:\n{row.setting.integrator.replace('_', ' ')} {_substeps_by_iterations(row)}")
    names: dict[str, list[str]] = {}
    for name, chosen in report.recommended.items():
        if chosen and chosen in rows:
            names.setdefault(str(chosen.setting), []).append(name)
    edge = 3.0 * min((r.ms for r in rows), default=0.0)        # names of what is left of it stand to the right
    for row in (r for r in rows if str(r.setting) in names):
        offset, side = ((-8, -16), "right") if row.ms > edge else ((10, 8), "left")
        axes.annotate(f"{', '.join(names[str(row.setting)])}: {_substeps_by_iterations(row)}", (row.ms, row.error),
                      xytext=offset, textcoords="offset points", ha=side, fontsize=8,
                      bbox={"boxstyle": "round,pad=0.1", "color": "#ffffff", "alpha": 0.8},
                      arrowprops={"arrowstyle": "-", "color": "#444444", "linewidth": 0.7})


def _substeps_by_iterations(row: MeasuredSetting) -> str:
    return f"{row.setting.substeps} x {row.setting.iterations}"


def _draw_error_goals(axes: "Axes", report: Report) -> None:
    """The time that a frame has, what the reference knows, and the errors for which settings are recommended."""
    dt = 1e3 / report.fps
    axes.axvline(dt, color="#888888", linewidth=0.9, linestyle="-.", label=f"real time, {dt:.3g} ms")
    if report.refused:
        return
    for goal in GOALS:
        axes.axhline(goal, color="#888888", linewidth=0.6)
    floor = report.reference["error"]
    if floor > 0.0:
        low = axes.get_ylim()[0]
        if low < floor:
            axes.axhspan(low, floor, color="#f0e6d8", zorder=-1, label=f"below the reference's\nown error, {100 * floor:.1g} %")

