"""Work-precision plot of peers.py's figures: time of a frame against error at 0.25 s, ours beside Newton's.

    python tools/bench/nets/plot.py RESULT.json [RESULT.json ...] -o PICTURE.png          needs matplotlib: pip install -e
                                                                                          ".[plot]"

Every finite row that errs by less than MOST is a point, a solver's Pareto front a line; what is left out is counted below
the picture. A panel for each sheet (points, stiffness) of the files, ordered by both; of the same sheet twice the later file
counts. 1200 pixels wide on white.
"""

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.verdict import front, usable  # noqa: E402

KEY, MOST = "error_025", 1.0                 # MOST [m]: the size of the sheet
WIDE, HEAD, DPI = 8.0, 0.95, 150             # [inch], 1200 pixels wide; HEAD: title and legend
MISSING = 'matplotlib is not installed; install it by: pip install -e ".[plot]"'
# (side, solvers, label, colour, marker): hues that colour-blind eyes tell apart for ours, greys for the other
SERIES = (
    ("wsim", ("explicit",), "wsim explicit", "#0b7a75", "o"),
    ("wsim", ("xpbd",), "wsim XPBD", "#d1570f", "s"),
    ("wsim", ("implicit",), "wsim implicit", "#4b4fc4", "^"),
    ("newton", ("semi_implicit",), "Newton explicit", "#8a8a8a", "o"),
    ("newton", ("xpbd",), "Newton XPBD", "#5c5c5c", "s"),
    ("newton", ("vbd", "vbd_tile"), "Newton VBD", "#1c1c1c", "^"),
)
INK, FAINT = "#222222", "#e3e3e3"


def sheets(paths: list[str]) -> list[dict]:
    """Problems of the files with what they were measured on. SystemExit for a file that is none of peers.py's."""
    found = {}
    for path in paths:
        try:
            file = json.loads(Path(path).read_text())
            about = {"hardware": file["hardware"], "wsim": file["wsim"]}
            problems = [p | about | {"warp": file["warp"]} for p in file["problems"]]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise SystemExit(f"plot: {path} is no result of tools/bench/nets/peers.py: "
                         f"{type(error).__name__}: {error}") from None
        found |= {(p["n"], p["stiffness"]): p for p in problems if "stiffness" in p}       # the garment's error is no length
    if not found:
        raise SystemExit(f"plot: no sheet of springs in {', '.join(paths)}; "
                         "run tools/bench/nets/peers.py --sides 32,64 --json FILE")
    return [found[key] for key in sorted(found)]


def series(problem: dict) -> list[tuple[tuple, list[dict]]]:
    """Rows of each of SERIES that are drawn."""
    return [(kind, [r for r in usable(problem["rows"], KEY, MOST) if r["side"] == kind[0] and r["solver"] in kind[1]])
            for kind in SERIES]


def left_out(problem: dict) -> dict[str, int]:
    """How many rows of each of SERIES are not drawn."""
    counts = {}
    for (side, solvers, label, *_), drawn in series(problem):
        missing = sum(r["side"] == side and r["solver"] in solvers for r in problem["rows"]) - len(drawn)
        counts |= {label: missing} if missing else {}
    return counts


def draw(problems: list[dict], place: str) -> None:
    """The picture, whole or not at all. SystemExit without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise SystemExit(f"plot: {MISSING}") from None
    columns = min(2, len(problems))
    rows = -(-len(problems) // columns)
    figure = Figure(figsize=(WIDE, HEAD + 0.4 + (4.4 if columns == 1 else 3.4) * rows), dpi=DPI, layout="constrained",
                    facecolor="#ffffff")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for number, axes in enumerate(grid.flat):
        if number < len(problems):
            panel(axes, problems[number], number + columns >= len(problems), number % columns == 0)
        else:
            axes.set_visible(False)
    legend(figure)
    figure.supxlabel(below(problems), fontsize=8, color="#555555", x=0.01, ha="left")
    part = Path(place).with_name(f".{os.path.basename(place)}.part.png")
    try:
        figure.savefig(part)
        os.replace(part, place)
    finally:
        part.unlink(missing_ok=True)


def panel(axes: Any, problem: dict, bottom: bool, left: bool) -> None:
    """One sheet."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    axes.set(xscale="log", yscale="log")
    for (side, _, label, colour, marker), rows in series(problem):
        ours = side == "wsim"
        face = colour if ours else "#ffffff"
        axes.plot([r["ms"] for r in rows], [r[KEY] for r in rows], marker, color=colour, markerfacecolor=face, markersize=4,
                  alpha=0.35, markeredgewidth=0.8, linestyle="none", zorder=2)
        best = front(rows, KEY)
        axes.plot([r["ms"] for r in best], [r[KEY] for r in best], color=colour, marker=marker, markerfacecolor=face,
                  markersize=5.5, linewidth=2.2 if ours else 1.5, linestyle="-" if ours else "--", label=label,
                  zorder=4 if ours else 3)
    auto = [r for r in usable(problem["rows"], KEY, MOST) if r["side"] == "wsim" and r["solver"] == "auto"]
    axes.plot([r["ms"] for r in auto], [r[KEY] for r in auto], "*", color="#ffd23f", markeredgecolor=INK, markersize=13,
              markeredgewidth=0.9, linestyle="none", label="wsim, its own choice", zorder=5)
    axes.axhline(problem["worst"], color="#999999", linewidth=0.9, linestyle=":", zorder=1)
    axes.annotate("a cloth that never moves", (1.0, problem["worst"]), xycoords=("axes fraction", "data"), xytext=(-3, 3),
                  textcoords="offset points", ha="right", fontsize=8, color="#666666")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator())
        axis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_major_formatter(FuncFormatter(length))
    axes.grid(True, which="major", color=FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, colors=INK)
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)
    axes.set_title(title(problem), loc="left", fontsize=10.5, color=INK)
    if bottom:
        axes.set_xlabel("time of a frame of 1/60 s [ms]", fontsize=10, color=INK)
    if left:
        axes.set_ylabel("RMS error of positions after 0.25 s", fontsize=10, color=INK)


def title(problem: dict) -> str:
    k = problem["stiffness"]
    return f"{problem['n']} x {problem['n']} points, springs of {k / 1e3:g} kN/m"


def length(metres: float, _=None) -> str:
    """1e-6 -> 1 um, with the Greek letter."""
    for scale, unit in ((1.0, "m"), (1e-3, "mm"), (1e-6, "\u00b5m"), (1e-9, "nm")):
        if metres >= 0.999 * scale:
            return f"{metres / scale:g} {unit}"
    return f"{metres:g} m"


def legend(figure: Any) -> None:
    """Title and one legend for all panels, above them: ours in one row, the other's below."""
    found: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            if len(handle.get_xdata()):
                found.setdefault(label, handle)

    def up(inch: float) -> float:
        return 1.0 - inch / figure.get_figheight()
    figure.text(0.012, up(0.12), "Error against run time of a cloth of springs: lower left is better", va="top", fontsize=12.5,
                color=INK, weight="bold")
    for who, place in (("wsim", up(0.40)), ("Newton", up(0.64))):
        names = [name for name in found if name.startswith(who)]
        figure.legend([found[n] for n in names], names, loc="upper left", bbox_to_anchor=(0.005, place), ncols=4, frameon=False,
                      fontsize=9.5, columnspacing=1.4, handlelength=2.4, borderaxespad=0.0, borderpad=0.3)
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, up(HEAD)))


def below(problems: list[dict]) -> str:
    """What it was measured with, and what is not drawn."""
    def of(key):
        return ", ".join(dict.fromkeys(str(p[key]) for p in problems))
    counts: dict[str, int] = {}
    for problem in problems:
        for label, count in left_out(problem).items():
            counts[label] = counts.get(label, 0) + count
    text = f"{of('hardware')}, float32. wsim {of('wsim')}, Newton {of('newton')}, Warp {of('warp')}. Each point is a run; " \
           "lines join the best of a solver."
    gone = ", ".join(f"{count} of {label}" for label, count in counts.items())
    return text + (f"\nNot drawn, error of {MOST:g} m or more or no number: {gone}." if gone else "")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="+", metavar="RESULT.json")
    parser.add_argument("-o", "--out", required=True, metavar="PICTURE.png")
    args = parser.parse_args()
    if not args.out.endswith(".png"):
        parser.error(f"-o {args.out}: allowed is a name that ends in .png")
    draw(sheets(args.results), args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
