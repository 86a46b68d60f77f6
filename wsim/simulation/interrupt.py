"""Ctrl-C, on the command line: one line and exit code 130, whenever it comes.

    leave    while nothing is being written (imports, loading, starting Warp) the process ends at once: an exception would be
             swallowed by what is half imported, or come out as another
    wait     during a run it is noted, and `check` raises KeyboardInterrupt between frames, whose results are kept whole; a
             second one raises at once
    throw    elsewhere it raises at once, as Python does; what is swallowed (in a destructor, say) is noted all the same
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = 130
came = False                 # a Ctrl-C that is not answered yet
mode = "throw"


def _handle(*_) -> None:
    global came
    if mode == "leave":
        os.write(2, b"interrupted\n")
        os._exit(INTERRUPTED)
    first, came = not came, True
    if mode == "throw" or not first:
        raise KeyboardInterrupt


def begin(how: str) -> None:
    """Begins to watch for Ctrl-C. Where Ctrl-C is not watched nothing changes."""
    global mode
    if watched():
        mode = how


def check() -> None:
    """Raises KeyboardInterrupt where a Ctrl-C waits."""
    if came and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


def wait() -> None:
    """Waits until Ctrl-C, which is answered by that."""
    global came
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        came = False


def watched() -> bool:
    return signal.getsignal(signal.SIGINT) is _handle


def start(how: str) -> bool:
    """Watches Ctrl-C, unless somebody else does, or it is ignored (a background job); only in the main thread."""
    global came
    if threading.current_thread() is not threading.main_thread() or not (
            watched() or signal.getsignal(signal.SIGINT) is signal.default_int_handler):
        return False
    came = False
    signal.signal(signal.SIGINT, _handle)
    begin(how)
    return True


@contextmanager
def watch(how: str) -> Iterator[None]:
    """`start`, and back to what was before."""
    global came
    before, silent = signal.getsignal(signal.SIGINT), sys.unraisablehook
    if not start(how):
        yield
        return
    sys.unraisablehook = lambda what: None if isinstance(what.exc_value, KeyboardInterrupt) else silent(what)
    try:
        yield
    finally:
        if watched():
            signal.signal(signal.SIGINT, before)
        sys.unraisablehook, came = silent, False


@contextmanager
def whole() -> Iterator[None]:
    """Ctrl-C inside takes effect at the end, as KeyboardInterrupt: what is being written is finished first.

    Where Ctrl-C is ignored (a background job) or somebody else's, and outside the main thread, nothing changes.
    """
    before = signal.getsignal(signal.SIGINT)
    if before not in (signal.default_int_handler, _handle) or threading.current_thread() is not threading.main_thread():
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
