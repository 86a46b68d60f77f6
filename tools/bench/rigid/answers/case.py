"""A case: a scene whose answer is known, and how far a run is from it. Errors stand beside what is allowed and the CPU time."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite


@dataclass(frozen=True)
class Figure:
    """An error of a run, and the largest that is allowed."""

    what: str
    error: float
    allowed: float
    unit: str = ""

    @property
    def good(self) -> bool:
        return isfinite(self.error) and self.error <= self.allowed


@dataclass(frozen=True)
class Case:
    """run: precision -> figures, CPU seconds of the run's frames."""

    name: str
    run: Callable[[str], tuple[list[Figure], float]]


def lines(case: Case, figures: list[Figure], cpu: float) -> list[str]:
    """Rows of a table: the case, error and what is allowed, CPU time."""
    return [f"{'ok  ' if f.good else 'FAIL'} {case.name:<46} {f.what:<40} {f.error:>11.3g} {f.allowed:>9.3g} {f.unit:<6}"
            + (f" {cpu:>8.2f} s" if k == 0 else "") for k, f in enumerate(figures)]
