"""Curves that a sweep takes from files: a value over time of one draw, and the way of a pin or a collider.

    time, value           [s] from the start, linear between rows and held outside; three columns behind the time are a vector
    time, x, y, z         of a motion: how far the frame is from where it stands at the start [m]; it turns as it does there

A first row without numbers is a heading.
"""

from functools import cache

import numpy as np

from wsim.scene import Motion, Problem, SceneError
from wsim.scene.curve import Curve
from wsim.sweep.vary.draws import read_table_rows

END = ".csv"


def names_curve_file(given) -> bool:
    """True for a draw that names a file of a curve."""
    return isinstance(given, str) and given.lower().endswith(END)


@cache
def _curve_file_columns(path: str, what: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (rows,) and values (rows, count). Raises SceneError for other files."""
    rows = read_table_rows(path)
    if any(len(row) != count + 1 or not all(isinstance(cell, float) and np.isfinite(cell) for cell in row) for row in rows):
        raise SceneError(Problem(path, f"a curve of {what} has {count + 1} columns of finite numbers: a time [s], and "
                                 f"{'its value' if count == 1 else 'three numbers'}"))
    whole = np.array(rows, np.float64)
    return whole[:, 0], whole[:, 1:]


def read_curve_file(path: str, what: str, vector: bool) -> Curve:
    """The curve of a file, of a number or a vector. Raises SceneError for what is none."""
    times, values = _curve_file_columns(path, what, 3 if vector else 1)
    return curve_or_scene_error(path, lambda: Curve(times, values if vector else values[:, 0]))


def read_motion_file(path: str, start: np.ndarray) -> Motion:
    """The motion of a file, of a frame that stands at `start` (4, 4) [m]. Raises SceneError for what is none."""
    times, places = _curve_file_columns(path, "a motion", 3)
    whole = np.tile(np.asarray(start, np.float64), (len(times), 1, 1))
    whole[:, :3, 3] += places
    return curve_or_scene_error(path, lambda: Motion(times, whole))


def curve_or_scene_error(path: str, make):
    try:
        return make()
    except ValueError as error:
        raise SceneError(Problem(path, f"is no curve: {error}")) from None
