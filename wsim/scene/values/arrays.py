"""Arrays of the dataclasses of a scene: of one kind and shape, whatever a caller gives. NumPy only."""

from typing import Any

import numpy as np


class WrongArray(ValueError):
    """`value`: what a caller gave, by which the field is found."""

    def __init__(self, value: Any, text: str):
        super().__init__(text)
        self.value = value


def as_numbers(value, shape: tuple[int, ...], numbers: str = "numbers") -> np.ndarray:
    """value as an array. Raises WrongArray where its members are no numbers, or its rows differ in length."""
    try:
        given = np.asarray(value)
        return given.astype(np.float64) if given.dtype.kind not in "buif" and given.size else given
    except (TypeError, ValueError):
        rows = f"rows of {shape[-1]} {numbers}" if len(shape) > 1 else numbers
        found = " ".join(repr(value).split())
        raise WrongArray(value, f"found {found:.60} where {rows} belong; fix: give a NumPy array of them") from None


def contiguous_array(value, dtype, *shape):
    """value as a contiguous array of that dtype and shape (-1: any); None stays None. Raises WrongArray where numbers of
    points are none (a mask, fractions), and as `as_numbers` and `demand_rows` do."""
    if value is None:
        return None
    given = as_numbers(value, shape, "whole numbers" if dtype is np.int32 else "numbers")
    demand_rows(value, given, shape)
    if dtype is np.int32 and given.dtype == bool:
        raise WrongArray(value, "found a mask where numbers of points or the like belong; give numpy.flatnonzero(mask)")
    if dtype is np.int32 and given.dtype.kind == "f" and (parts := given[given % 1 != 0]).size:
        raise WrongArray(value, f"found {parts[0]:g} where whole numbers belong")
    return np.ascontiguousarray(given, dtype).reshape(shape)


def polygon_corners(what: str, counts, indices) -> tuple[np.ndarray, np.ndarray]:
    """How many corners each polygon has, (faces,), and the points of all of them in a row; or, without indices, of a table of
    polygons (faces, corners). Raises ValueError for neither."""
    if indices is None or (np.ndim(counts) == 2 and not np.size(indices)):
        if np.ndim(counts) != 2:
            raise ValueError(f"{what}: it has no indices; allowed: counts and indices, or triangles (t, 3) alone; fix: give "
                             "(points, counts, indices), or (points, triangles)")
        indices, counts = counts, np.full(np.shape(counts)[0], np.shape(counts)[1])
    elif np.ndim(counts) == 2 and np.size(counts):
        raise ValueError(f"{what}: counts has rows of {np.shape(counts)[1]}, and there are indices; allowed: how many corners "
                         "each polygon has; fix: give (points, triangles), or [3] * len(triangles) as counts")
    return contiguous_array(counts, np.int32, -1), contiguous_array(indices, np.int32, -1)


def real_array(value, *shape):
    """value as a contiguous array of that shape, float32 where it is float32, as files hold it, else float64: nobody's doubles
    are rounded. None stays None. Raises WrongArray as `as_numbers` and `demand_rows` do."""
    if value is None:
        return None
    kept = as_numbers(value, shape)
    if kept.dtype in (np.float16, np.float32):
        return contiguous_array(kept, np.float32, *shape)
    demand_rows(value, kept, shape)
    return np.array(kept, np.float64, order="C").reshape(shape)              # apart from the caller's


def demand_rows(value, given: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raises WrongArray where a table has rows of another length than `shape`: a reshape would cut them anew."""
    if given.ndim > 1 and len(shape) > 1 and given.size and given.shape[-1] != shape[-1] > 0:
        raise WrongArray(value, f"found rows of {given.shape[-1]} where rows of {shape[-1]} belong, in an array {given.shape}")


def demand_kind(path: str, name: str, value, kind: type, example: str) -> None:
    """Raises ValueError where a field is none of that class."""
    if not isinstance(value, kind):
        found = " ".join(repr(value).split())
        raise ValueError(f"{path}: {name} is {found:.80}; allowed is a {kind.__name__}, such as {example}")
