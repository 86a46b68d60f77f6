"""CPU threads that march abreast: which part of the points each takes, and how they are called. See
kernels/motion/fast_paths/threads.py.

The order of the points follows from the net alone, the parts from the order and the number of threads, and the bits of a
result from the order alone. Nothing here waits: helpers that are late or missing leave the frame to the thread that leads it.
"""

import ctypes
import os
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread

import numpy as np
import warp as wp

from wsim.geometry.ordering import level_order
from wsim.kernels.motion.fast_paths import threads as kernels
from wsim.model import kernel_cache
from wsim.model.compiler.core_team import count_cores as count_cores
from wsim.physics.motion.fast_paths.simd_springs import MOVE, Packets

# Frames of 55 substeps, 2 threads against 1, least times of 300: 1400 springs 1.12, 2200 springs 0.83, 3200 springs 0.80,
# 4400 springs 0.75, 5800 springs 0.69, 13,000 springs 0.59; EPYC at about 3.6 GHz
LEAST = 1000           # springs of a thread
ENOUGH = 4             # threads for which the points stay in the order of the arrays: grids lose a quarter of the speed without
SLACK = 0.75           # most of a part that a tail and the head behind it may take: with 1 every wait is on time at best
STALLED = 1.0 / 16.0   # long waits a substep from which a frame does not gain by its threads
LONGEST = 64           # frames until they are tried again, at most


def spring_threads(springs: int) -> int:
    """Threads that so many springs are worth."""
    return max(1, min(kernels.MOST, springs // LEAST))


def march_parts(ids: np.ndarray, cost: np.ndarray, most: int) -> np.ndarray:
    """First of each part, ends of its head, its middle and its tail, (parts, 4): so many parts of equal cost up to `most` as
    can work at a time. ids: pairs (m, 2) of what hangs together, of n in a row, blocks or points; cost: of each, (n,)."""
    n, low, high = len(cost), ids.min(1), ids.max(1)
    cost, reach = np.append(0.0, np.cumsum(cost)), np.arange(n)
    np.maximum.at(reach, low, high)
    reach = np.maximum.accumulate(reach)                     # the furthest that hangs on one from here or before
    for count in range(most, 1, -1):
        cut = np.searchsorted(cost, cost[-1] * np.arange(1, count) / count)
        head, tail = reach[cut - 1] + 1, np.searchsorted(reach, cut)
        fits = cost[head] - cost[tail] <= SLACK * cost[-1] / count
        if fits.all() and (head[:-1] <= tail[1:]).all():
            return np.stack([np.append(0, cut), np.append(0, head), np.append(tail, n), np.append(cut, n)], axis=1)
    return np.array([[0, n, n, n]])


def march_order(points: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Order in which a march takes the points of a body, (n,): as they stand, or by levels of the mesh where only so there are
    parts of which none reaches further than the next. points: at rest [m] (n, 3); ids: springs (m, 2)."""
    n, most = len(points), min(spring_threads(len(ids)), ENOUGH)

    def part_count(ids: np.ndarray) -> int:
        return len(march_parts(ids, np.bincount(ids.min(1), minlength=n) + MOVE, most))
    if part_count(ids) < most:
        found, place = level_order(points, ids), np.empty(n, np.int64)
        place[found] = np.arange(n)
        if part_count(place[ids]) > part_count(ids):
            return found
    return np.arange(n)


def march_orders(rows: list, bodies: list) -> np.ndarray:
    """`march_order` of all bodies, (points,): of each by its own springs, so that worlds have the same bits. rows: springs."""
    own = {}
    for b in bodies:
        if b.world == 0:
            ids = [r.ids - b.first for r in rows if r.body is b]
            own[b.path] = march_order(b.rest, np.concatenate(ids)) if ids else np.arange(b.count)
    return np.concatenate([b.first + own[b.path] for b in bodies])


def net_parts(packets: Packets, most: int) -> np.ndarray:
    """Parts of a net; most: threads at most."""
    return march_parts(packets.joined_blocks(), packets.cost, min(most, spring_threads(packets.springs)))


class Abreast:
    """The threads of one march, and what they say to each other."""

    def __init__(self, model, part: np.ndarray):
        """part: of each thread, as `march_parts` has it."""
        self.nap = _nap_address()
        self.model, self.count = model, len(part) if self.nap else 1
        self.call = 0                            # of the last leader: number of its arguments
        self.key: tuple[float, ...] = ()         # and what they were made of
        self.graphs: list[wp.Graph] = []         # of the helpers, with the same arguments
        self.busy = [False] * (self.count - 1)   # helpers
        self.rest, self.pause = 0, 1             # frames without helpers: still, and next time
        self.part = model.upload(part.ravel(), int)
        self.desk = wp.zeros((kernels.DONE + self.count + 1) * kernels.APART, dtype=int, device=model.device)
        self.words = self.desk.numpy()[-self.desk.ptr % (4 * kernels.APART) // 4::kernels.APART]
        self.words[kernels.DOOR] = kernels.SHUT

    def team(self, call: int):
        found = kernels.team_type()()
        found.desk, found.part, found.count, found.call, found.nap = self.desk, self.part, self.count, call, wp.uint64(self.nap)
        return found

    def lead(self, key: tuple):
        """Arguments of the launch that takes the frame. key: the same for the same arguments; first the substeps."""
        if self.count > 1 and key != self.key:
            self.call, self.key, self.graphs = self.call + 1, key, []
        return self.team(self.call)

    def send(self, key: tuple, launch: Callable) -> None:
        """Sends helpers to the frame to come, if it has the arguments of the one before. launch(team): as one of them."""
        if self.count == 1 or key != self.key or key[0] < 4 * self.count or self.helpers_rest(key[0]):
            return
        for number in range(self.count - 1):
            if len(self.graphs) == number:
                with kernel_cache.capture_graph(self.model.device) as capture:
                    launch(self.team(-self.call))
                self.graphs.append(capture.graph)
            if not self.busy[number]:
                self.busy[number] = True
                worker_queue(number).put((self, number, self.graphs[number]))

    def helpers_rest(self, substeps: int) -> bool:
        """True if others want the cores: waits were long in the last frame with helpers, and it is too early for another."""
        if self.rest == 0 and self.words[kernels.FORMED] == self.words[kernels.DOOR] >> 6:
            if self.words[kernels.STALLS] > STALLED * substeps:
                self.rest, self.pause = self.pause + 1, min(2 * self.pause, LONGEST)
            else:
                self.pause = 1
        self.rest = max(self.rest - 1, 0)
        return self.rest > 0


WORKERS: list[SimpleQueue] = []
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=WORKERS.clear)        # threads are not forked


def worker_queue(number: int) -> SimpleQueue:
    """Queue of a thread that does its jobs one after the other; all marches share it."""
    while len(WORKERS) <= number:
        WORKERS.append(SimpleQueue())
        Thread(target=_work_through, args=(WORKERS[-1], _current_processor()), name=f"march {len(WORKERS)}",
               daemon=True).start()
    return WORKERS[number]


def _work_through(jobs: SimpleQueue, leader: int) -> None:
    """On any processor but the leader's: there it may be woken, and stay for milliseconds, while others are idle."""
    if hasattr(os, "sched_setaffinity"):
        with suppress(OSError):
            os.sched_setaffinity(0, os.sched_getaffinity(0) - {leader})
    while True:
        team, number, graph = jobs.get()
        with suppress(RuntimeError):                         # who leads goes on without
            wp.capture_launch(graph)
        team.busy[number] = False
        del team, graph


def _current_processor() -> int:
    """Of the calling thread; -1 where the C library does not say."""
    with suppress(AttributeError, TypeError, OSError):
        return ctypes.CDLL(None).sched_getcpu()
    return -1


def _nap_address() -> int:
    """Address of usleep, by which a thread gives up its core for a time; 0 where the C library has none: one thread then."""
    with suppress(AttributeError, TypeError, OSError):
        return ctypes.cast(ctypes.CDLL(None).usleep, ctypes.c_void_p).value or 0
    return 0
