"""Messages of a simulation to the logger "wsim", for programs that host it. Without a handler nothing is printed.

    WARNING   every warning, once: of the scene when it is built, of frames when they end
    INFO      what was built, how long kernels took to compile, and every EVERY seconds how far the run is
    DEBUG     every frame, and why a frame was repeated
"""

import logging
import time
from typing import TYPE_CHECKING

from wsim.simulation.duration import format_duration

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation

LOGGER = logging.getLogger("wsim")
LOGGER.addHandler(logging.NullHandler())
EVERY = 5.0             # [s] between two lines of progress


class LogMessages:
    """Watches one simulation. sim.watchers has `log_frame`."""

    def __init__(self, sim: "Simulation"):
        self.told, self.repeats, self.last = 0, 0, time.perf_counter()
        choice, name = sim.plan.choice, sim.scene.source or "scene"
        LOGGER.info("%s: built in %.3g s, for %s, %s substeps a frame, expected %.3g ms a frame", name, sim.seconds["build"],
                    sim.device, choice.substeps, 1e3 * sim.plan.seconds)
        self.log_warnings(sim)

    def log_warnings(self, sim: "Simulation") -> None:
        for text in sim.warnings[self.told:]:
            LOGGER.warning("%s", text.removeprefix("warning: "))
        self.told = len(sim.warnings)

    def log_frame(self, sim: "Simulation") -> None:
        """A frame has ended."""
        if len(sim.milliseconds) == 1:
            LOGGER.info("kernels compiled in %.3g s, first frame after %.3g s", sim.seconds.get("compile", 0.0),
                        sim.seconds["first_frame"])
        self.log_warnings(sim)
        if not LOGGER.isEnabledFor(logging.INFO):
            return
        for why in sim.repeats[self.repeats:]:
            LOGGER.debug("frame %d was repeated: %s", sim.frame, why)
        self.repeats = len(sim.repeats)
        LOGGER.debug("frame %d took %.3g ms", sim.frame, sim.milliseconds[-1])
        now = time.perf_counter()
        if now - self.last >= EVERY:
            self.last = now
            left = max(0, sim.scene.frames - sim.frame) * 1e-3 * sim.milliseconds[-1]
            LOGGER.info("frame %d of %d, %.3g ms a frame, %s left", sim.frame, sim.scene.frames, sim.milliseconds[-1],
                        format_duration(left))
