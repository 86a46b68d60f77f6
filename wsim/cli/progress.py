"""One line on a terminal that says how far a run is: frame, time a frame, time left. Without a terminal: nothing.

The time a frame is the mean of the latest frames; the first one also compiles and is left out.
"""

import os
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from wsim.simulation.duration import duration

WIDTH = 24              # characters of the bar
REDRAW = 0.05           # [s] between two drawings: a terminal shows no more, and a frame may take 3 ms
LATEST = 32             # frames in the mean


class Progress:
    """frames: how many there will be. `stream` None is stderr; the line is drawn only on a terminal.

    colour: None asks the NO_COLOR convention (no-color.org) and TERM.
    """

    def __init__(self, frames: int, stream=None, quiet: bool = False, colour: bool | None = None,
                 clock: Callable[[], float] = perf_counter):
        self.frames, self.clock = frames, clock
        self.stream = sys.stderr if stream is None else stream
        self.shown = not quiet and self.stream.isatty()
        plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"
        self.colour = not plain if colour is None else colour
        self.ends: deque[float] = deque(maxlen=LATEST + 1)      # when the latest frames ended
        self.drawn = float("-inf")

    def say(self, text: str) -> None:
        """A step before the frames: loading, compiling."""
        self._draw(text)

    def frame(self, done: int) -> None:
        """`done` frames are finished."""
        now = self.clock()
        self.ends.append(now)
        if done < self.frames and now - self.drawn < REDRAW:
            return
        part = done / self.frames if self.frames else 1.0
        bar = "#" * round(part * WIDTH)
        text = f"[{self._tint(bar)}{'.' * (WIDTH - len(bar))}] frame {done}/{self.frames}"
        if len(self.ends) > 1:
            each = (self.ends[-1] - self.ends[0]) / (len(self.ends) - 1)
            text += f"  {1e3 * each:.3g} ms/frame  {duration(each * (self.frames - done))} left"
        self._draw(text)
        self.drawn = now

    def clear(self) -> None:
        """Leaves an empty line behind."""
        self._draw("")

    def _tint(self, text: str) -> str:
        return f"\x1b[32m{text}\x1b[0m" if self.colour and text else text

    def _draw(self, text: str) -> None:
        if self.shown:
            self.stream.write(f"\r\x1b[2K{text}")
            self.stream.flush()


@contextmanager
def line(*args, **more) -> Iterator[Progress]:
    """A progress line that is cleared at the end, whatever happens."""
    progress = Progress(*args, **more)
    try:
        yield progress
    finally:
        progress.clear()
