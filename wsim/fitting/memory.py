"""Memory for copies of a scene, before they are made: so many times what one copy holds on its device.

What one copy holds is counted in a simulation of it. Little of that is shared by all copies, so that many take a little less.
"""

from dataclasses import dataclass

from wsim.gradient import checkpoints
from wsim.scene import Problem, SceneError
from wsim.simulation.measure.memory import bytes_held_by  # noqa: F401  (what a copy holds)


@dataclass
class MemoryForCopies:
    """Memory for `copies` of a scene at once, by which a fit takes differences of so many parameters."""

    parameters: int
    copies: int
    each: int              # bytes of a copy alone: of seven sheets of 25 points 15 % more than they hold by packets of a CPU,
                           # which one alone does not fill, and 3 % less by XPBD
    free: float            # bytes
    where: str             # the device's name

    @staticmethod
    def on(device, parameters: int, copies: int, each: int) -> "MemoryForCopies":
        """The room of a device with what is free there now."""
        return MemoryForCopies(parameters, copies, each, checkpoints.free_bytes(device), str(device))

    @property
    def need(self) -> int:
        return self.copies * self.each

    @property
    def fit(self) -> int:
        """Copies for which there is room."""
        return int(min(self.free // max(self.each, 1), self.copies))

    def check(self) -> None:
        """Raises SceneError where there is too little."""
        if self.need > self.free:
            raise SceneError(self.problem())

    def problem(self) -> Problem:
        """Problem that says what is needed, what is there, and what would fit."""
        if 1 + self.parameters <= self.fit < self.copies:
            mend = f"differences=\"forward\" takes {1 + self.parameters} of them"
        elif self.fit > 1:
            mend = f"fit {self.fit - 1} of the parameters at a time, with differences=\"forward\""
        else:
            mend = "take fewer points, or a device with more memory"
        size = checkpoints.format_bytes
        return Problem("memory", f"a fit of {self.parameters} parameters runs {self.copies} copies of the scene at once, which "
                       f"hold about {self.need} bytes ({size(self.need)}, {size(self.each)} each), and {size(self.free)} are "
                       f"free on {self.where}: {self.fit} copies fit; {mend}")
