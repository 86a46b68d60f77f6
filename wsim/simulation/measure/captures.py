"""Graphs of a run's frames, and the log of their captures: in which frame, of which form, why, and how long each took.

A capture takes a GPU about 35 us for each launch of a frame, so that a frame of 10,000 launches stands still for a third of a
second. A run is to capture each form of a frame once, in its first frames.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import warp as wp

from wsim.model import kernel_cache

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class Capture:
    """One capture. form: of the frames that the graph is for, "with contacts" or "without contacts"."""

    frame: int
    form: str
    why: str
    seconds: float


class Graphs(dict[object, wp.Graph]):
    """Captured graphs by form of a frame: without contacts (True), with them (False), and see `wsim.simulation.live.prepare`.
    wanted: False where so few frames are to come that launching them one by one takes less than a capture."""

    def __init__(self) -> None:
        super().__init__()
        self.log: list[Capture] = []
        self.wanted = True
        self.whys: dict[str, str] = {}         # reason of the next capture of a form, if it is not the first

    def forget(self, why: str) -> None:
        """Drops all graphs, since frames launch something else from now on."""
        if self:
            self.whys = {capture.form: why for capture in self.log}
        self.clear()

    def capture(self, device, frame: int, form: str, launch: Callable[[], None]) -> wp.Graph:
        """A graph of what `launch` launches, which is not kept here. frame: the number of the frame to come."""
        began = time.perf_counter()
        with kernel_cache.capture(device) as capture:
            launch()
        why = self.whys.pop(form, f"the first frame {form}")
        self.log.append(Capture(frame, form, why, time.perf_counter() - began))
        return capture.graph

    def told(self) -> list[dict]:
        """The log for a report."""
        return [asdict(capture) for capture in self.log]
