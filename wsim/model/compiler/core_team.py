"""Helpers: threads of this process that take parts of launches on other cores of a CPU (wsim/model/compiler/core_sharing.py).

WSIM_CPU_THREADS says how many threads a launch has at most, who launches among them; without it there is one for each core that
the process may use. Helpers are made when the first module with kernels for them is loaded. Between launches they sleep, and
the process ends without them. A process that is forked has none.
"""

import atexit
import ctypes
import os
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from wsim.kernels.math.marks import OVER_CORES
from wsim.model import warp_private
from wsim.model.compiler import core_sharing as code
from wsim.scene import Problem, SceneError

VARIABLE = "WSIM_CPU_THREADS"
MOST = 16              # threads of a launch


def count_cores() -> int:
    """Threads that work on this process's scenes: as WSIM_CPU_THREADS says, else as many as cores that it may use. Raises
    SceneError for another value than a whole number from 1."""
    named = os.environ.get(VARIABLE, "")
    if named:
        if not named.isdecimal() or int(named) < 1:
            raise SceneError(Problem(VARIABLE, f"found {named!r}; allowed is a whole number from 1; fix: unset it, or give "
                                               "the number of cores that this process may take"))
        return int(named)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class CoreTeam:
    """The desk of a process, and its helpers. `held`: the module whose code they run."""

    def __init__(self) -> None:
        room = np.zeros(code.WORDS + code.LINE, np.uint64)
        skip = -room.ctypes.data % (8 * code.LINE) // 8
        self.desk = room[skip:skip + code.WORDS]
        self.desk[code.CORES] = 1
        for word, time_ns in code.TIMES.items():
            self.desk[word] = time_ns
        self.helpers: list[threading.Thread] = []
        self.forked = False                    # this process is a copy of the one that made the helpers
        self.held: Any = None
        self.work: Callable[[int], None] | None = None
        self.pipe = -1, -1
        self.joined = set[Any]()               # handles of executables that know of the desk, or have no use for it

    def join(self, executable: Any) -> None:
        """Tells a loaded module of the desk, if its kernels share launches."""
        find, name = warp_private.symbol_address, executable.handle
        place = find(executable, code.SYMBOL) if name not in self.joined else 0
        self.joined.add(name)
        if not place:
            return
        if self.work is None:
            if not self._find_tools():
                return
            self.held, self.work = executable, ctypes.CFUNCTYPE(None, ctypes.c_void_p)(find(executable, code.WORK))
        ctypes.c_uint64.from_address(place).value = self.desk.ctypes.data

    def use(self, count: int) -> None:
        """Launches have so many threads from now on, as far as there is a module with work for them."""
        count = max(1, min(count, MOST)) if self.work and not self.forked else 1
        while len(self.helpers) < count - 1:
            helper = threading.Thread(target=self._help, name=f"wsim core {len(self.helpers) + 1}", daemon=True)
            try:
                helper.start()
            except RuntimeError:                                        # the system has no room for more threads
                break
            self.helpers.append(helper)
        self.desk[code.CORES] = min(count, len(self.helpers) + 1)

    def leave(self) -> None:
        """Sends helpers away, before their code is gone."""
        self.desk[code.CORES], self.desk[code.QUIT] = 1, 1
        if self.helpers:
            os.write(self.pipe[1], bytes(len(self.helpers)))
        for helper in self.helpers:
            helper.join(1.0)

    def forget(self) -> None:
        """In a process that was forked: its launches run alone."""
        self.desk[code.CORES], self.helpers, self.forked = 1, [], True

    def _find_tools(self) -> bool:
        """Functions of the C library; False: it has other ones."""
        try:
            library = ctypes.CDLL(None)
            for word, name in ((code.WRITE, "write"), (code.NAP, "usleep"), (code.CLOCK, "clock_gettime")):
                self.desk[word] = ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
            self.desk[code.KIND] = time.CLOCK_MONOTONIC
        except (AttributeError, TypeError, OSError):
            return False
        self.pipe = os.pipe()
        self.desk[code.PIPE] = self.pipe[1]
        return True

    def _help(self) -> None:
        """Each byte of the pipe wakes one."""
        while os.read(self.pipe[0], 1) and not self.desk[code.QUIT]:
            self.work(self.desk.ctypes.data)                                   # type: ignore[misc]


TEAM = CoreTeam()
atexit.register(lambda: TEAM.leave())
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: TEAM.forget())


def join_executables(module: Any, device: Any) -> None:
    """`CoreTeam.join` for what was loaded of a module with marked kernels."""
    if device.is_cpu and any(OVER_CORES in key for key in module.kernels):
        for executable in (warp_private.loaded_executables(module) or {}).values():
            TEAM.join(executable)
        TEAM.use(count_cores())
