"""Memory for copies of a scene, before they are made: so many times what one copy holds on its device.

What one copy holds is counted in a simulation of it. Little of that is shared by all copies, so that many take a little less.
"""

from dataclasses import dataclass
from types import FunctionType, MethodType
from typing import Any

import warp as wp

from wsim.gradient import checkpoints
from wsim.scene import Problem, SceneError


def held(root: Any) -> int:
    """Bytes of the arrays that an object of wsim holds: in its attributes, their tables, structs and functions."""
    seen: dict[int, Any] = {}
    sizes: dict[int, int] = {}
    left = [root]
    while left:
        thing = left.pop()
        if id(thing) in seen:
            continue
        seen[id(thing)] = thing                          # kept, so that no other has its id
        if isinstance(thing, wp.array):
            while isinstance(getattr(thing, "_ref", None), wp.array):        # a part of another
                thing = thing._ref
            sizes[thing.ptr or 0] = thing.capacity
        else:
            left += _within(thing)
    return sum(sizes.values())


def _within(thing: Any) -> list:
    if isinstance(thing, dict):
        return list(thing.values())
    if isinstance(thing, (list, tuple, set)):
        return list(thing)
    if isinstance(thing, MethodType):
        return [thing.__self__]
    if isinstance(thing, FunctionType):
        return [cell.cell_contents for cell in thing.__closure__ or ()]
    if hasattr(thing, "_cls") and hasattr(thing._cls, "vars"):               # a struct of kernels
        return [getattr(thing, name) for name in thing._cls.vars]
    return list(getattr(thing, "__dict__", {}).values()) if type(thing).__module__.startswith("wsim.") else []


@dataclass
class Room:
    """Memory for `copies` of a scene at once, by which a fit takes differences of so many parameters."""

    parameters: int
    copies: int
    each: int              # bytes of a copy
    free: float            # bytes
    where: str             # the device's name

    @staticmethod
    def on(device, parameters: int, copies: int, each: int) -> "Room":
        """The room of a device with what is free there now."""
        return Room(parameters, copies, each, checkpoints.free(device), str(device))

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
        size = checkpoints.size
        return Problem("memory", f"a fit of {self.parameters} parameters runs {self.copies} copies of the scene at once, which "
                       f"hold {self.need} bytes ({size(self.need)}, {size(self.each)} each), and {size(self.free)} are free on "
                       f"{self.where}: {self.fit} copies fit; {mend}")
