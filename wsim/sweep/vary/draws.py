"""Draws: which values the runs of a sweep have. NumPy and the standard library only.

    TARGET=lin(LOW,HIGH,N)     N values evenly spaced, both ends included
    TARGET=log(LOW,HIGH,N)     the same of their logarithms
    TARGET=list(A,B,C)         numbers, vectors as "0 -9.81 0", names, or files of curves: gust.csv (`wsim.sweep.vary.curves`)
    TARGET=FILE.csv            a row a value; three columns are a vector
    FILE.csv                   listed draws of several targets together: its first row names them

A grid is the product of all axes, the last one running fastest. A Latin hypercube of N draws (McKay, Beckman, Conover 1979)
cuts each axis into N parts of equal probability and takes one value in each, in an order of its own: the N of lin and log is
then left out. Lists of a hypercube are cut likewise.
"""

import csv
import re
from dataclasses import dataclass
from itertools import product
from math import isfinite, log

import numpy as np

from wsim.scene import Problem, SceneError

SPAN = re.compile(r"\s*(lin|log)\((.*)\)\s*\Z", re.S)
LIST = re.compile(r"\s*list\((.*)\)\s*\Z", re.S)
MOST = 1_000_000              # runs of a sweep

Draw = dict[str, object]      # {target: number, vector (3,) as a tuple, or text}


@dataclass(frozen=True)
class RangeOfValues:
    """Numbers from `low` to `high`; count: of a grid, None where it is left out."""

    target: str
    kind: str
    low: float
    high: float
    count: int | None

    @property
    def names(self) -> tuple[str, ...]:
        return (self.target,)

    def at(self, u: np.ndarray) -> list[tuple]:
        """Values at parts u of the way, (n,)."""
        if self.kind == "lin":
            return [(float(v),) for v in self.low + (self.high - self.low) * u]
        return [(float(v),) for v in np.exp(log(self.low) + (log(self.high) - log(self.low)) * u)]

    def values(self) -> list[tuple]:
        """Values of a grid, both ends as they were given."""
        assert self.count is not None
        spaced = np.linspace if self.kind == "lin" else np.geomspace
        return [(float(v),) for v in spaced(self.low, self.high, self.count)]


@dataclass(frozen=True)
class ListedValues:
    """Values that are named one by one, of one target or of several together: a tuple a draw."""

    names: tuple[str, ...]
    rows: tuple[tuple, ...]

    def at(self, u: np.ndarray) -> list[tuple]:
        return [self.rows[min(int(part * len(self.rows)), len(self.rows) - 1)] for part in u]

    def values(self) -> list[tuple]:
        return list(self.rows)


Axis = RangeOfValues | ListedValues


def parse_sweep_axes(texts) -> list[Axis]:
    """Axes of texts as above. Raises SceneError with everything that is wrong."""
    problems: list[Problem] = []
    found: list[Axis] = []
    for text in texts:
        try:
            found.append(parse_sweep_axis(str(text)))
        except SceneError as error:
            problems += error.problems
    names = [name for each in found for name in each.names]
    problems += [Problem(name, "is varied twice; name it once") for name in dict.fromkeys(names) if names.count(name) > 1]
    if not found and not problems:
        problems.append(Problem("--vary", "nothing varies; name a target, /World/Cloth:stretch=log(100,10000,20) say"))
    if problems:
        raise SceneError(problems)
    return found


def parse_sweep_axis(text: str) -> Axis:
    """One axis. Raises SceneError for what is none."""
    if text.lower().endswith(".csv") and "=" not in text:
        return read_joint_draws(text)
    target, equals, draws = text.partition("=")
    if not (equals and target.strip()):
        raise SceneError(Problem("--vary", f"found {text!r}; write it as TARGET=log(LOW,HIGH,N), lin(...), list(A,B) or "
                                 "FILE.csv"))
    target = target.strip()
    if match := SPAN.match(draws):
        return parse_value_range(target, match[1], match[2])
    if match := LIST.match(draws):
        rows = tuple((parse_draw_value(part),) for part in match[1].split(",") if part.strip())
        if not rows:
            raise SceneError(Problem(target, "its list is empty; name values"))
        return ListedValues((target,), rows)
    if draws.strip().lower().endswith(".csv"):
        return read_target_column(target, draws.strip())
    raise SceneError(Problem(target, f"varies as {draws!r}; allowed are lin(LOW,HIGH,N), log(LOW,HIGH,N), list(A,B) and "
                             "FILE.csv"))


def parse_value_range(target: str, kind: str, inside: str) -> RangeOfValues:
    """Span of `kind(inside)`. Raises SceneError for one that is empty."""
    parts, how = [p.strip() for p in inside.split(",")], f"{kind}(LOW,HIGH,N)"
    try:
        low, high = float(parts[0]), float(parts[1])
        count = int(parts[2]) if len(parts) > 2 else None
    except (ValueError, IndexError):
        raise SceneError(Problem(target, f"varies as {kind}({inside}); write it as {how}")) from None
    if len(parts) > 3 or not (isfinite(low) and isfinite(high)):
        raise SceneError(Problem(target, f"varies as {kind}({inside}); write it as {how} with finite numbers"))
    if not low < high:
        raise SceneError(Problem(target, f"its range {low:g} to {high:g} is empty; the first must be below the second"))
    if kind == "log" and low <= 0.0:
        raise SceneError(Problem(target, f"a logarithmic range begins at {low:g}; it must begin above 0, or take lin"))
    if count is not None and not 1 <= count <= MOST:
        raise SceneError(Problem(target, f"{count} values of a range; allowed are 1 to {MOST}"))
    return RangeOfValues(target, kind, low, high, count)


def parse_draw_value(text: str):
    """A number, a vector of three ("0 -9.81 0"), or the text itself."""
    words = text.split()
    try:
        numbers = tuple(float(w) for w in words)
    except ValueError:
        return text.strip()
    return numbers[0] if len(numbers) == 1 else numbers


def _csv_file_rows(path: str) -> list[list[str]]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            return [[cell.strip() for cell in row] for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError) as error:
        said = error.strerror if isinstance(error, OSError) and error.strerror else "it is no text in UTF-8"
        raise SceneError(Problem(path, f"cannot be read: {said}")) from None


def read_table_rows(path: str) -> list[tuple]:
    """Rows of a file as values; a first row that holds no numbers, where others do, is a heading and left out."""
    found = [tuple(parse_draw_value(cell) for cell in row) for row in _csv_file_rows(path)]
    if len(found) > 1 and _is_heading_row(found[0]) and not any(_is_heading_row(row) for row in found[1:]):
        found = found[1:]
    if not found:
        raise SceneError(Problem(path, "holds no row"))
    return found


def read_target_column(target: str, path: str) -> ListedValues:
    """Draws of one target: a row a value."""
    found = read_table_rows(path)
    wrong = next((k for k, row in enumerate(found) if len(row) not in (1, 3)), None)
    if wrong is not None:
        raise SceneError(Problem(path, f"row {wrong + 1} has {len(found[wrong])} columns; draws of {target} have one, or "
                                 "three of a vector"))
    return ListedValues((target,), tuple((row[0],) if len(row) == 1 else (row,) for row in found))


def _is_heading_row(row: tuple) -> bool:
    return all(isinstance(cell, str) for cell in row)


def read_joint_draws(path: str) -> ListedValues:
    """Draws of several targets together, which the first row names."""
    rows = _csv_file_rows(path)
    if len(rows) < 2 or not all(rows[0]):
        raise SceneError(Problem(path, "its first row must name the targets, and each row after it is a draw"))
    wrong = next((k for k, row in enumerate(rows) if len(row) != len(rows[0])), None)
    if wrong is not None:
        raise SceneError(Problem(path, f"row {wrong + 1} has {len(rows[wrong])} columns, and the first names {len(rows[0])}"))
    return ListedValues(tuple(rows[0]), tuple(tuple(parse_draw_value(cell) for cell in row) for row in rows[1:]))


# runs

def grid_draws(found: list[Axis]) -> list[Draw]:
    """The product of all axes. Raises SceneError for ranges without a number of values, or too many runs."""
    open_ = [a for a in found if isinstance(a, RangeOfValues) and a.count is None]
    if open_:
        raise SceneError([Problem(a.names[0], f"its range has no number of values; write {a.kind}({a.low:g},{a.high:g},N), "
                                  "or ask for a Latin hypercube") for a in open_])
    rows = [a.values() for a in found]
    _check_number_of_runs(int(np.prod([float(len(each)) for each in rows])))
    return [_draw_of_axis_values(found, parts) for parts in product(*rows)]


def latin_hypercube(found: list[Axis], count: int, seed: int) -> list[Draw]:
    """A Latin hypercube of `count` draws; the same seed gives the same draws."""
    _check_number_of_runs(count)
    made = np.random.default_rng(seed)
    parts = [a.at((made.permutation(count) + made.random(count)) / count) for a in found]
    return [_draw_of_axis_values(found, [each[k] for each in parts]) for k in range(count)]


def _draw_of_axis_values(found: list[Axis], parts) -> Draw:
    return {name: given for each, values in zip(found, parts, strict=True)
            for name, given in zip(each.names, values, strict=True)}


def _check_number_of_runs(count: int) -> None:
    if not 1 <= count <= MOST:
        raise SceneError(Problem("--vary", f"{count} runs; allowed are 1 to {MOST}"))
