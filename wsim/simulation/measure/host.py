"""Time of the host around the graph of a frame, by what it is spent on: what the report lists as `host`.

Files are not in it, nor what waits for the device, nor kernels that a CPU runs before the graph.
"""

import time
from collections.abc import Callable
from typing import Any

from wsim.model.launches import LaunchList

SETTLED = 2            # frames that are not counted: tables are made in them
LEAST = 1e-3           # [ms] a frame: less is not told


class HostTimes:
    """Seconds by what they were spent on."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        self.frames = 0

    def call(self, what: str, function: Callable, *given) -> Any:
        """Result of a call whose time counts as spent on `what`."""
        began, kernels = time.perf_counter(), LaunchList.seconds
        try:
            return function(*given)
        finally:
            spent = time.perf_counter() - began - (LaunchList.seconds - kernels)
            self.seconds[what] = self.seconds.get(what, 0.0) + spent

    def before_frame(self, sim) -> None:
        """Calls `Method.before_frame` of all methods."""
        for method in sim.plan.methods:
            self.call(method.name, method.before_frame, sim.time, sim.plan.clock)

    def count_host_frame(self, frame: int) -> None:
        """A frame is done; frame: its number, 1 for the first."""
        if frame <= SETTLED:
            self.seconds.clear()
        else:
            self.frames += 1

    def told(self, methods) -> list[dict]:
        """Rows of what took time: what, ms a frame, and what is evaluated there in NumPy; the longest first."""
        works = {method.name: [f"{what} of {path}" for what, paths in method.evaluates.items() for path in paths]
                 for method in methods}
        each = {what: 1e3 * spent / max(self.frames, 1) for what, spent in self.seconds.items()}
        rows = [{"what": what, "ms": ms, "evaluates": works.get(what, [])} for what, ms in each.items()
                if self.frames and ms >= LEAST or works.get(what)]
        return sorted(rows, key=lambda row: -row["ms"])
