"""Rows of peers.py in words: a line each, a table, and where wsim is behind."""

from tools.bench.rigid.problems import PROBLEMS, Problem
from tools.bench.rigid.settings import words

DECIDES = ("speed", "slid", "energy", "momentum", "mean_overlap", "below", "gap", "place_end")     # errors beside the first
RESTS = 1e-2                     # [m/s] over which a stack does not stand
CLOSE = 1.02                     # errors that count as the same


def name(row: dict) -> str:
    return f"{row['engine']} {words(row['engine'], row['setting'])}"


def stands(row: dict) -> bool:
    errors = row.get("errors")
    return bool(errors) and not errors.get("fallen") and errors.get("rms_speed", 0.0) < 1.0 and not errors.get("below")


def said(row: dict, problem: Problem) -> str:
    """Errors in words."""
    errors = row["errors"]
    first = "fallen" if errors.get("fallen") else f"{problem.key} {errors[problem.key]:.3g} {problem.unit}"
    more = [f"{key.replace('_', ' ')} {errors[key]:.2g}" for key in DECIDES if key in errors and key != problem.key]
    return ", ".join([first, *more])


def line(row: dict, problem: Problem) -> str:
    begin = f"  {problem.name:<22}{name(row):<34}"
    if "errors" not in row:
        return f"{begin}{row.get('failed', 'not finite').splitlines()[0][:110]}"
    return f"{begin}{row['ms']:>9.3f} ms {row.get('cpu_ms', float('nan')):>9.3f} cpu  {said(row, problem)}"


def table(rows: list[dict]) -> str:
    """Markdown: scenes, engines with their settings, milliseconds of a frame and of processors, errors."""
    lines = ["| scene | engine, setting | ms a frame | cpu ms | errors |", "|---|---|---|---|---|"]
    for problem in PROBLEMS.values():
        for row in (r for r in rows if r["problem"] == problem.name):
            if "errors" in row:
                lines.append(f"| {problem.name} | {name(row)} | {row['ms']:.3g} | {row['cpu_ms']:.3g} | {said(row, problem)} |")
            else:
                lines.append(f"| {problem.name} | {name(row)} | | | {row.get('failed', 'not finite').splitlines()[0][:80]} |")
    return "\n".join(lines)


def slower(rows: list[dict], clock: str = "ms") -> list[str]:
    """A line on every peer's row that stands: how long wsim takes at no larger error, or that it errs more in all rows.
    clock: ms, or cpu_ms, which others who use the machine disturb less."""
    found = []
    for problem in PROBLEMS.values():
        here = [r for r in rows if r["problem"] == problem.name and stands(r)]
        own = [r for r in here if r["engine"] == "wsim"]
        for peer in (r for r in here if r["engine"] != "wsim"):
            best = peer["errors"][problem.key]
            good = [r for r in own if r["errors"][problem.key] <= CLOSE * abs(best)]
            fastest = min(good, key=lambda r: r[clock], default=None)
            begin = f"{problem.name}, beside {name(peer)} ({peer[clock]:.3g} ms, {best:.3g} {problem.unit}): "
            if fastest:
                ratio = fastest[clock] / peer[clock]
                found.append(f"{begin}wsim takes {ratio:.2g} times as long at no larger error ({name(fastest)})"
                             + (" -- slower" if ratio > 1.0 else ""))
            else:
                least = min((r["errors"][problem.key] for r in own), default=float("nan"))
                found.append(f"{begin}no row of wsim errs as little; its least is {least:.3g} -- less accurate")
    return found
