"""Words that a frame leaves behind for the host, by name: read once after each frame.

A method reserves its words while the plan is built (`reserve`), writes them by kernels (`word`, or `array` with `offset`), and
reads its own after the frame (`said`). All of them are zero when a frame begins. `allocate` ends the build: a frame may be
captured as a graph, and a capture cannot take pinned memory.
"""

import numpy as np
import warp as wp


class FrameStatus:
    def __init__(self, device):
        self.device = wp.get_device(device)
        self.places: dict[str, slice] = {}
        self.size = 0
        self._array: wp.array | None = None
        self._host: wp.array | None = None
        self._words: np.ndarray | None = None        # the memory that a frame leaves them in
        self.mirrors: list[tuple[wp.array, wp.array]] = []             # pinned memory, and what a frame copies to it

    def reserve(self, name: str, count: int = 1) -> None:
        """`count` words of this name; methods may share one. Raises ValueError where it has another count, or when a word is in
        use already."""
        known = self.places.get(name)
        if known and known.stop - known.start == count:
            return
        if known or self._array is not None:
            raise ValueError(f"status words {name!r}: {count} wanted after " + ("others were used" if not known else "another "
                             f"{known.stop - known.start} were"))
        self.places[name] = slice(self.size, self.size + count)
        self.size += count

    def allocate(self) -> None:
        """Takes memory for all words; from then on none can be reserved."""
        if self._array is None:
            self._array = wp.zeros(max(self.size, 1), dtype=int, device=self.device)
            if self.device.is_cuda:                      # pinned memory that a frame copies its words to
                self._host = wp.zeros(max(self.size, 1), dtype=int, device="cpu", pinned=True)
            self._words = (self._array if self._host is None else self._host).numpy()

    def mirrored_array(self, shape: tuple[int, ...], dtype) -> tuple[wp.array, np.ndarray]:
        """Zeros on the device, and their values as the frame that was waited for has left them. These come with the words: to
        read an array of a GPU by itself takes 0.15 ms."""
        array = host = wp.zeros(shape, dtype=dtype, device=self.device)
        if self.device.is_cuda:
            host = wp.zeros(shape, dtype=dtype, device="cpu", pinned=True)
            self.mirrors.append((host, array))
        return array, host.numpy()

    @property
    def array(self) -> wp.array:
        """All words on the device."""
        self.allocate()
        assert self._array is not None
        return self._array

    def offset(self, name: str) -> int:
        """Offset of the first word of this name in `array`."""
        return self.places[name].start

    def word(self, name: str) -> wp.array:
        """The words of this name on the device."""
        return self.array[self.places[name].start:self.places[name].stop]

    def begin(self) -> None:
        """Launches what a frame starts with."""
        self.array.zero_()

    def end(self) -> None:
        """Launches what a frame ends with."""
        if self._host is not None:
            wp.copy(self._host, self.array)
        for host, array in self.mirrors:
            wp.copy(host, array)

    def wait(self) -> None:
        """Waits until the frame launched last is done: then its words are there."""
        if self._host is not None:
            wp.synchronize_stream(self.device.stream)

    def fetch(self) -> None:
        """Brings what the device holds now."""
        self.end()
        self.wait()

    @property
    def words(self) -> np.ndarray:
        """Words as the frame that was waited for has left them; the same memory, not a copy."""
        self.allocate()
        assert self._words is not None
        return self._words

    def said(self, name: str) -> np.ndarray:
        """Words of this name; zeros (one) where nobody has reserved it."""
        place = self.places.get(name)
        return np.zeros(1, np.int32) if place is None else self.words[place]

    def worlds_that_said(self, name: str) -> tuple[int, ...]:
        """Worlds whose word of this name, one for each, is not 0."""
        return tuple(np.flatnonzero(self.said(name)).tolist())
