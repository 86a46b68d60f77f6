"""Memory of what a recording keeps: arrays cut from a few pieces, in the order in which they are wanted."""

import warp as wp

CHUNK = 1 << 16        # scalars of the first piece of memory that slots are cut from; each is twice the one before


class Slots:
    """Arrays, handed out in order; `rewind` hands out the same again. `plain` has no gradients."""

    def __init__(self, device, real, gradients: bool = True):
        self.device, self.real, self.copies = device, real, 1 + gradients
        self.chunks: list[list[wp.array]] = []
        self.at, self.most = (0, 0), (0, 0)
        if gradients:
            self.plain = Slots(device, real, False)

    def rewind(self) -> None:
        self.at = (0, 0)
        if self.copies > 1:
            self.plain.rewind()

    def take(self, like: wp.array) -> wp.array:
        """An array of that type and shape, with its gradient if these have some."""
        size = like.size * (wp.types.type_size_in_bytes(like.dtype) // wp.types.type_size_in_bytes(self.real))
        chunk, first = self.at
        while chunk < len(self.chunks) and first + size > self.chunks[chunk][0].size:
            chunk, first = chunk + 1, 0
        if chunk == len(self.chunks):
            self.chunks.append([wp.zeros(max(size, CHUNK << chunk), dtype=self.real, device=self.device)
                                for _ in range(self.copies)])
        self.at = chunk, first + size
        self.most = max(self.most, self.at)
        value, *grad = (_cut(array, first, like) for array in self.chunks[chunk])
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

    @property
    def bytes(self) -> int:
        size = wp.types.type_size_in_bytes(self.real)
        own = self.copies * size * (self.most[1] + sum(chunk[0].size for chunk in self.chunks[:self.most[0]]))
        return own + (self.plain.bytes if self.copies > 1 else 0)


def _cut(array: wp.array, first: int, like: wp.array) -> wp.array:
    return wp.array(ptr=array.ptr + first * wp.types.type_size_in_bytes(array.dtype), dtype=like.dtype, shape=like.shape,
                    device=array.device, requires_grad=False)
