"""The list that pairs ended the last substep with, a part of the state. Equations: kernels/carrier/warm.py."""

from typing import TYPE_CHECKING

from wsim.kernels.carrier import pairs as lists
from wsim.kernels.carrier import warm as kernels
from wsim.model.stage import Clock
from wsim.model.state import Field, Part, State
from wsim.model.structs import filled

if TYPE_CHECKING:
    from wsim.physics.carrier.pairs import Pairs

FIELDS = (Field("push", "N s", True, "impulse of a pair at the end of the last substep"), Field("n", "", True, "its normal"),
          Field("key_a", "", True, "key of its first feature", "long"), Field("key_b", "", True, "of its second", "long"))


class Warm:
    def __init__(self, pairs: "Pairs", state: State, name: str, capacity: int):
        real, module = pairs.real, pairs.model.module
        self.pairs = pairs
        self.part = Part.allocate(name, FIELDS, 0, real, pairs.device, capacity)
        state.add(self.part)
        self.keep_kernel, self.recall_kernel = kernels.keep(real, module), kernels.recall(real, module)
        self.give_kernels = [kernels.give(a.formulas, b.formulas, real, module) for a, b in pairs.combinations]
        self.empty()

    def empty(self, first: int = 0) -> None:
        """No pairs from this row on, and in the snapshot."""
        for name in ("key_a", "key_b"):
            for array in self.part.saved[name]:
                array[first:].fill_(int(lists.ABSENT))

    def list(self):
        return filled(kernels.lasts(self.pairs.real), **self.part.arrays)

    def recall(self, clock: Clock) -> None:
        pairs = self.pairs
        pairs.launch(self.recall_kernel, pairs.capacity, [pairs.list, self.list(), self.part.capacity], [pairs.list.push])
        pairs.walk(clock, self.give_kernels)

    def keep(self) -> None:
        pairs = self.pairs
        pairs.launch(self.keep_kernel, pairs.capacity, [pairs.list], [self.list()])

    def grow(self) -> None:
        """Grows to the room that the pairs have."""
        before = self.part.capacity
        self.part.enlarge(self.pairs.capacity, self.pairs.real, self.pairs.device)
        self.empty(before)
