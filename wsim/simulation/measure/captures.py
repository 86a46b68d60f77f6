"""Graphs of a run's frames, and the log of their captures: in which frame, of which form, why, and how long each took.

A capture takes a GPU about 35 us for each launch of a frame, so that a frame of 10,000 launches stands still for a third of a
second. On a GPU a run captures every form of a frame behind its first one, which is slow anyway. A CPU takes about as long for
a capture as for a frame, and captures a form in the first frame that has it.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import warp as wp

from wsim.model import kernel_cache

if TYPE_CHECKING:
    from collections.abc import Callable

    from wsim.simulation.simulation import Simulation


@dataclass(frozen=True)
class GraphCapture:
    """One capture. form: of the frames that the graph is for, "with contacts" or "without contacts"."""

    frame: int
    form: str
    why: str
    seconds: float


class FrameGraphs(dict[object, wp.Graph]):
    """Captured graphs by form of a frame: without contacts (True), with them (False), and see
    `wsim.simulation.live.prepare_live_use`. wanted: False where so few frames are to come that launching them one by one takes
    less than a capture."""

    def __init__(self) -> None:
        super().__init__()
        self.log: list[GraphCapture] = []
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
        with kernel_cache.capture_graph(device) as capture:
            launch()
        why = self.whys.pop(form, f"the first frame {form}")
        self.log.append(GraphCapture(frame, form, why, time.perf_counter() - began))
        return capture.graph

    def told(self) -> list[dict]:
        """The log for a report."""
        return [asdict(capture) for capture in self.log]


def capture_frame(sim: Simulation) -> wp.Graph:
    """A graph of the frame to come. It is kept for others of its form, if these launch the same."""
    clock = sim.plan.clock
    graph = sim.graphs.capture(sim.device, sim.frame + 1, clock.form, sim.plan.frame)
    if not sim.plan.starts:
        sim.graphs[clock.free] = graph
    sim.seconds["capture"] = sim.graphs.log[-1].seconds
    return graph


def capture_forms(sim: Simulation) -> None:
    """Captures every form of a frame that has no graph yet: with contacts, without, and with contacts behind a frame without
    ("met again"). Tables of a frame must be there."""
    plan, clock = sim.plan, sim.plan.clock
    before, clock.starting = (clock.free, clock.after_free, clock.starting), False
    whole = plan.parted and bool(plan.ports.whole_frames)
    for clock.free in (False, True) if plan.parted else before[:1]:
        clock.after_free = clock.free and whole
        if sim.graph is None:
            capture_frame(sim)
    clock.free, clock.after_free = False, whole
    if plan.starts and "met again" not in sim.graphs:
        sim.graphs["met again"] = capture_frame(sim)
    clock.free, clock.after_free, clock.starting = before
