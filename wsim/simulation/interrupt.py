"""Ctrl-C, on the command line: one line and exit code 130, whenever it comes.

    leave    while nothing is being written (imports, loading, starting Warp) the process ends at once: an exception would be
             swallowed by what is half imported, or come out as another
    wait     during a run it is noted, and `raise_if_interrupted` raises KeyboardInterrupt between frames, whose results are
    kept whole; a
             second one raises at once
    throw    elsewhere it raises at once, as Python does; what is swallowed (in a destructor, say) is noted all the same

Python answers a signal between two of its own instructions, not within a call of C that lasts: a graph of many substeps, the
compiler. So a thread hears of it too (signal.set_wakeup_fd). In a run it says at the first Ctrl-C that the run ends behind the
frame; at the second it gives the program GRACE to end, then ends the process. Frames that were saved stay.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = 130
GRACE = 0.7                  # [s] from the second Ctrl-C to the end of the process
came = False                 # a Ctrl-C that is not answered yet
mode = "throw"
left = ""                    # what stays of a run that ends at once, for the last line


def _handle_signal(*_) -> None:
    global came
    if mode == "leave":
        os.write(2, b"interrupted\n")
        os._exit(INTERRUPTED)
    first, came = not came, True
    if mode == "throw" or not first:
        raise KeyboardInterrupt


class _SignalListener:
    """A thread that hears of each Ctrl-C at once, whatever the main thread does."""

    def __init__(self):
        self.presses, self.ends, self.lock = 0, (-1, -1), threading.Lock()
        self.ending = threading.Timer(GRACE, _end_process_now)

    def begin(self) -> None:
        """Listens, unless it does already or somebody else listens for signals (an event loop)."""
        self.presses = 0
        if self.ends != (-1, -1) or os.name == "nt":            # Windows wakes sockets alone
            return
        self.ends = os.pipe()
        os.set_blocking(self.ends[1], False)
        before = signal.set_wakeup_fd(self.ends[1], warn_on_full_buffer=False)
        if before != -1:
            signal.set_wakeup_fd(before)
            for end in self.ends:
                os.close(end)
            self.ends = (-1, -1)
            return
        threading.Thread(target=self._read_signals, args=(self.ends[0],), name="ctrl-c", daemon=True).start()

    def end(self) -> None:
        with self.lock:
            self.ending.cancel()
            if self.ends != (-1, -1):
                signal.set_wakeup_fd(-1)
                os.close(self.ends[1])                          # the thread reads the end of the pipe, and ends
                self.ends = (-1, -1)

    def _read_signals(self, end: int) -> None:
        while heard := os.read(end, 64):
            with self.lock:
                for _ in range(heard.count(signal.SIGINT) * (self.ends[0] == end)):      # none of a run that is over
                    self.presses += 1
                    self._answer_press()
        os.close(end)

    def _answer_press(self) -> None:
        if self.presses == 1 and mode == "wait":
            os.write(2, b"\nwsim: the run ends when this frame does; Ctrl-C again ends it at once\n")
        elif self.presses == 2:
            self.ending = threading.Timer(GRACE, _end_process_now)
            self.ending.daemon = True
            self.ending.start()


def _end_process_now() -> None:
    os.write(2, f"\ninterrupted{': ' if left else ''}{left}\n".encode())
    os._exit(INTERRUPTED)


_listener = _SignalListener()


def set_interrupt_mode(how: str, kept: str = "") -> None:
    """Begins to watch for Ctrl-C. Where Ctrl-C is not watched nothing changes. kept: what stays where the process is ended."""
    global mode, left
    if interrupts_are_watched():
        mode, left = how, kept


def raise_if_interrupted() -> None:
    """Raises KeyboardInterrupt where a Ctrl-C waits."""
    if came and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


def wait_for_interrupt() -> None:
    """Waits until Ctrl-C, which is answered by that."""
    global came
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        came = False
        _listener.presses = 0


def interrupts_are_watched() -> bool:
    return signal.getsignal(signal.SIGINT) is _handle_signal


def start_watching_interrupts(how: str) -> bool:
    """Watches Ctrl-C, unless somebody else does, or it is ignored (a background job); only in the main thread."""
    global came
    if threading.current_thread() is not threading.main_thread() or not (
            interrupts_are_watched() or signal.getsignal(signal.SIGINT) is signal.default_int_handler):
        return False
    came = False
    signal.signal(signal.SIGINT, _handle_signal)
    _listener.begin()
    set_interrupt_mode(how)
    return True


@contextmanager
def watch_interrupts(how: str) -> Iterator[None]:
    """`start_watching_interrupts`, and back to what was before."""
    global came
    before, silent = signal.getsignal(signal.SIGINT), sys.unraisablehook
    if not start_watching_interrupts(how):
        yield
        return
    sys.unraisablehook = lambda what: None if isinstance(what.exc_value, KeyboardInterrupt) else silent(what)
    try:
        yield
    finally:
        if interrupts_are_watched():
            signal.signal(signal.SIGINT, before)
        _listener.end()
        sys.unraisablehook, came = silent, False


@contextmanager
def delay_interrupts() -> Iterator[None]:
    """Ctrl-C inside takes effect at the end, as KeyboardInterrupt: what is being written is finished first.

    Where Ctrl-C is ignored (a background job) or somebody else's, and outside the main thread, nothing changes.
    """
    before = signal.getsignal(signal.SIGINT)
    if before not in (signal.default_int_handler, _handle_signal) or threading.current_thread() is not threading.main_thread():
        yield
        return
    found = []
    signal.signal(signal.SIGINT, lambda *_: found.append(True))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if found:
        raise KeyboardInterrupt
