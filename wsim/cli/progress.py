"""One line on a terminal that says how far a run is: frame, time a frame, time left. Without a terminal: a line of its own,
every EVERY seconds.

The time a frame is the mean of the latest frames; the first one also compiles and is left out.
"""

import os
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from wsim.simulation.duration import format_duration

WIDTH = 24              # characters of the bar
REDRAW = 0.05           # [s] between two drawings: a terminal shows no more, and a frame may take 3 ms
LATEST = 32             # frames in the mean
EVERY = 5.0             # [s] between two lines where there is no terminal: a log stays short


class Progress:
    """frames: how many there will be. `stream` None is stderr; the line is drawn over and over on a terminal only.

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
        self.drawn = float("-inf") if self.shown else self.clock()
        self.logged = not quiet and not self.shown

    def say(self, text: str) -> None:
        """A step before the frames: loading, compiling."""
        self._draw_progress(text)

    def frame(self, done: int) -> None:
        """`done` frames are finished."""
        now = self.clock()
        self.ends.append(now)
        if now - self.drawn < (EVERY if self.logged else REDRAW) and (self.logged or done < self.frames):
            return
        part = done / self.frames if self.frames else 1.0
        bar = "#" * round(part * WIDTH)
        text = f"[{self._tint_bar(bar)}{'.' * (WIDTH - len(bar))}] " if self.shown else ""
        text += f"frame {done}/{self.frames}"
        if len(self.ends) > 1:
            each = (self.ends[-1] - self.ends[0]) / (len(self.ends) - 1)
            taken = f"{1e3 * each:.3g} ms" if each < 1.0 else f"{each:.3g} s"
            text += f"  {taken}/frame  {format_duration(each * (self.frames - done))} left"
        self._draw_progress(text)
        self.drawn = now

    def note(self, text: str) -> None:
        """A step of something that has no frames; no more often than others."""
        now = self.clock()
        if now - self.drawn >= (EVERY if self.logged else REDRAW):
            self.drawn = now
            self._draw_progress(text)

    def clear(self) -> None:
        """Leaves an empty line behind."""
        self._draw_progress("")

    def _tint_bar(self, text: str) -> str:
        return f"\x1b[32m{text}\x1b[0m" if self.colour and text else text

    def _draw_progress(self, text: str) -> None:
        if self.shown:
            self.stream.write(f"\r\x1b[2K{text}")
            self.stream.flush()
        elif self.logged and text.startswith(("frame", "run")):
            self.stream.write(f"{text}\n")
            self.stream.flush()


@contextmanager
def progress_line(*args, **more) -> Iterator[Progress]:
    """A progress line that is cleared at the end, whatever happens."""
    progress = Progress(*args, **more)
    try:
        yield progress
    finally:
        progress.clear()
