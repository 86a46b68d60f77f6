"""Memory of what a recording keeps: arrays cut from a few pieces, in the order in which they are wanted."""

from math import prod

import warp as wp

CHUNK = 1 << 16        # scalars of the first piece of memory that slots are cut from; each is twice the one before
PIECE = 1 << 30        # scalars of the largest: an array has less than 2^31 entries


class ArraySlots:
    """Arrays, handed out in order; `rewind` hands out the same again. `plain` has no gradients."""

    def __init__(self, device, real, gradients: bool = True):
        self.device, self.real, self.copies = device, real, 1 + gradients
        self.chunks: list[list[wp.array]] = []
        self.at, self.most = (0, 0), (0, 0)
        if gradients:
            self.plain = ArraySlots(device, real, False)

    def rewind(self) -> None:
        self.at = (0, 0)
        if self.copies > 1:
            self.plain.rewind()

    def take(self, dtype, shape: tuple[int, ...]) -> wp.array:
        """An array of that type and shape, with its gradient if these have some."""
        size = prod(shape) * (wp.types.type_size_in_bytes(dtype) // wp.types.type_size_in_bytes(self.real))
        chunk, first = self.at
        while chunk < len(self.chunks) and first + size > self.chunks[chunk][0].size:
            chunk, first = chunk + 1, 0
        if chunk == len(self.chunks):
            self.add(max(size, min(CHUNK << chunk, PIECE)))
        self.at = chunk, first + size
        self.most = max(self.most, self.at)
        value, *grad = (_cut_from_chunk(array, first, dtype, shape) for array in self.chunks[chunk])
        if grad:
            value.grad = grad[0]
        return value

    def clear(self, first: tuple[int, int], end: tuple[int, int]) -> None:
        """Gradients become zero between two values of `at` (capturable)."""
        for number in range(first[0], end[0] + 1):
            grad = self.chunks[number][1]
            part = grad[first[1] * (number == first[0]):end[1] if number == end[0] else grad.size]
            if part.size:
                part.zero_()

    def drop(self) -> None:
        """Forgets everything."""
        self.chunks, self.at, self.most = [], (0, 0), (0, 0)
        if self.copies > 1:
            self.plain.drop()

    def reserve(self, scalars: tuple[int, ...]) -> None:
        """Room for so many scalars (`used`), where nothing was handed out yet: one piece, but for what no array can have."""
        left = scalars[0]
        while left > 0:
            self.add(min(left, PIECE))
            left -= PIECE
        if self.copies > 1:
            self.plain.reserve(scalars[1:])

    def add(self, size: int) -> None:
        self.chunks.append([wp.zeros(size, dtype=self.real, device=self.device) for _ in range(self.copies)])

    @property
    def used(self) -> tuple[int, ...]:
        """Scalars that were handed out at most, and those of `plain`."""
        own = self.most[1] + sum(chunk[0].size for chunk in self.chunks[:self.most[0]])
        return (own, *(self.plain.used if self.copies > 1 else ()))

    @property
    def bytes(self) -> int:
        own, *plain = self.used
        return wp.types.type_size_in_bytes(self.real) * (self.copies * own + sum(plain))


def _cut_from_chunk(array: wp.array, first: int, dtype, shape: tuple[int, ...]) -> wp.array:
    return wp.array(ptr=array.ptr + first * wp.types.type_size_in_bytes(array.dtype), dtype=dtype, shape=shape,
                    device=array.device, requires_grad=False)
