"""Seconds that a bench may take, and what of them is left."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter


@dataclass
class Budget:
    seconds: float
    clock: Callable[[], float] = perf_counter
    began: float = field(init=False)

    def __post_init__(self):
        self.began = self.clock()

    @property
    def spent(self) -> float:
        return self.clock() - self.began

    def left(self, share: float = 1.0) -> float:
        """Time that is left of that share of the whole [s]; never negative."""
        return max(0.0, share * self.seconds - self.spent)
