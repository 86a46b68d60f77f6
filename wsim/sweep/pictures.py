"""Pictures of a sweep: a contact sheet of its results, and a column of its table over what varies (needs the extra `plot`)."""

import csv
import os
from importlib.util import find_spec
from math import inf
from pathlib import Path

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.show.camera import fit_camera_to_points, subjects_in_view
from wsim.show.image import png
from wsim.show.image.label import label_image
from wsim.show.picture import caster_of_stage, contact_sheet_cells, finite_points, image_of_stage, tile_images
from wsim.show.visible import VisibleStage, read_visible_stage
from wsim.sweep.folder import CIRCUMSTANCES
from wsim.usd.result.atomic import replace_bytes, replace_file_atomically

SIZE = 1920, 1080
MOST = 100             # images of a sheet; of more runs so many are taken, evenly


def read_sweep_table(folder) -> list[dict[str, str]]:
    """Rows of a sweep's table as text. Raises SceneError where there is none."""
    try:
        with open(Path(folder) / "runs.csv", newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))
    except OSError as error:
        raise SceneError(Problem(str(folder), f"holds no table of a sweep ({error.strerror})")) from None


def draw_contact_sheet(folder, size: tuple[int, int] = SIZE, device=None) -> str:
    """Draws the last frame of every run, in the order of runs and by one camera, into sheet.png of the folder; its path. Raises
    SceneError where no result was kept."""
    kept = [row for row in read_sweep_table(folder) if row["result"]]
    if not kept:
        raise SceneError(Problem(str(folder), "no result was kept to draw; sweep with --keep last"))
    chosen = [kept[k] for k in np.unique(np.round(np.linspace(0, len(kept) - 1, min(len(kept), MOST))).astype(int))]
    stages = [read_visible_stage(os.path.join(folder, row["result"])) for row in chosen]
    cell, columns = contact_sheet_cells(size, len(stages))
    camera = _camera_for_all_runs(stages, cell[0] / cell[1])
    images = [label_image(_image_of_last_frame(seen, camera, cell, device), describe_run(row))
              for seen, row in zip(stages, chosen, strict=True)]
    out = Path(folder) / "sheet.png"
    replace_bytes(out, png.encode_png(tile_images(images, columns)))
    return str(out)


def describe_run(row: dict[str, str]) -> list[str]:
    """Lines NAME=VALUE of what varies in a sweep, for a tile of its sheet; numbers to four digits."""
    names = list(row)
    varied = names[1:names.index("status")] if "status" in names else []
    return [f"{name.rpartition(':')[2]}={row[name][:24] if _number_or_inf(row[name]) == inf else f'{float(row[name]):.4g}'}"
            for name in varied]


def _camera_for_all_runs(stages: list[VisibleStage], aspect: float):
    """One camera that shows what moves in any of them."""
    ends = [[points for d in seen.drawn if (points := finite_points(d, seen.times[-1], True)) is not None] for seen in stages]
    groups = [np.concatenate([points[::1 + len(points) // 5000] for points in sets]) for sets in zip(*ends, strict=False)]
    points = np.concatenate([groups[k] for k in subjects_in_view(groups)] or [np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, 1.0]])])
    return fit_camera_to_points(points, stages[0].up, aspect)


def _image_of_last_frame(seen: VisibleStage, camera, cell: tuple[int, int], device) -> np.ndarray:
    time = seen.times[-1]
    base = min((float(d.points(time)[:, "XYZ".index(seen.up)].min()) for d in seen.drawn), default=0.0)
    return image_of_stage(caster_of_stage(seen, cell, device), seen, time, camera, seen.floor(time) if seen.floor else base)


# plots

def require_matplotlib() -> None:
    """Raises SceneError where matplotlib is missing: found out before the sweep and not after it."""
    if find_spec("matplotlib") is None:
        raise SceneError(Problem("--plot", 'matplotlib is not installed; install it by: pip install -e ".[plot]"'))


def plot_table_column(folder, column: str) -> str:
    """Draws a column over the first number that varies, a colour for each value of the second thing that does, into COLUMN.png
    of the folder; its path. Raises SceneError for a column that is no number in any run."""
    require_matplotlib()
    rows = read_sweep_table(folder)
    names = list(rows[0]) if rows else []
    varied = names[1:names.index("status")] if "status" in names else []
    if column not in names or not any(_number_or_inf(row[column]) < inf for row in rows):
        have = [name for name in names if name not in ("status", "why", *CIRCUMSTANCES[:1]) and rows
                and any(_number_or_inf(row[name]) < inf for row in rows)]
        raise SceneError(Problem("--plot", f"there are no numbers in a column {column!r}; there are {', '.join(have)}"))
    across = next((name for name in varied if all(_number_or_inf(row[name]) < inf for row in rows)), "run")
    other = next((name for name in varied if name != across), None)
    out = Path(folder) / f"{''.join(c if c.isalnum() or c in '._-' else '_' for c in column)}.png"
    _draw_column_plot(rows, column, across, other, out)
    return str(out)


def _number_or_inf(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return inf


def _draw_column_plot(rows: list[dict[str, str]], column: str, across: str, other: str | None, out: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=(8.0, 5.0), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(xlabel=across, ylabel=column)
    series: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        point = _number_or_inf(row[across]), _number_or_inf(row[column])
        if max(map(abs, point)) < inf:
            series.setdefault(row[other] if other else "", []).append(point)
    for label, points in series.items():
        x, y = np.array(sorted(points)).T
        axes.plot(x, y, "o-", ms=4, lw=1, label=f"{other} {label}" if other and len(series) <= 12 else None)
    values = np.array([point for points in series.values() for point in points]).T
    for axis, some in ((axes.set_xscale, values[0]), (axes.set_yscale, values[1])):
        if some.min() > 0.0 and some.max() > 30.0 * some.min():
            axis("log")
    if other and len(series) <= 12:
        axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.3)
    with replace_file_atomically(out, ".png") as whole:
        figure.savefig(whole)
