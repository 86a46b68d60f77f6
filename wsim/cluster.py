"""How a cluster of blocks shares a net of springs: whose memory holds which points. See kernels/cluster.py."""

from dataclasses import dataclass, replace

import numpy as np

from wsim.kernels.stream import BLOCK

SIZES, MANY = (8, 16), 64      # blocks of a cluster: 8 everywhere, 16 where so many multiprocessors are in large groups
ENTRIES, PUSHES = 8, 4         # springs and places of a lane, for which there are registers
ROOM = 49152           # bytes of shared memory


@dataclass(frozen=True)
class Cluster:
    """Blocks of BLOCK // lanes points; `slots` places in the memory of a block: its own points, and those it hangs on."""

    lanes: int
    entries: int               # springs of a lane
    size: int                  # blocks
    slots: int = 0
    pushes: int = 1            # places in other blocks that a lane writes

    @property
    def points(self) -> int:
        """Points of a block."""
        return BLOCK // self.lanes


@dataclass(frozen=True)
class Halo:
    """Where points stand: slot of each entry (point, other), and `push` as the kernel takes it."""

    slot: np.ndarray           # (entries,) int32
    push: np.ndarray           # block << 16 | slot, or -1, (points * pushes * lanes,) int32


def cluster_of(n: int, most: int, sizes: tuple[int, ...] = SIZES) -> Cluster | None:
    """The cluster that takes n points of at most so many springs, or None: the most lanes that registers have room for."""
    for lanes in (8, 4, 2):
        entries = -(-most // lanes)
        for size in sizes:
            if n <= size * BLOCK // lanes and entries <= ENTRIES:
                return Cluster(lanes, entries, size)
    return None


def halo(cluster: Cluster, n: int, point: np.ndarray, other: np.ndarray, real: int) -> tuple[Cluster, Halo] | None:
    """The cluster with its slots and pushes, and who stands where; None where memory or registers do not suffice.

    point, other (entries,): ends of springs among n points, each spring from both ends; real: bytes of a number."""
    block, own = point // cluster.points, other // cluster.points
    slot = (other - own * cluster.points).astype(np.int64)
    far = np.flatnonzero(block != own)
    held, which = np.unique(block[far].astype(np.int64) * n + other[far], return_inverse=True)
    holder, guest = np.divmod(held, n)
    counts = np.bincount(holder, minlength=cluster.size)
    place = cluster.points + np.arange(len(held)) - np.repeat(np.cumsum(counts) - counts, counts)
    slot[far] = place[which]
    slots = cluster.points + (int(counts.max()) if len(held) else 0)
    times = np.bincount(guest, minlength=n)
    pushes = max(1, -(-int(times.max()) // cluster.lanes))
    if pushes > PUSHES or 2 * 4 * slots * real > ROOM:
        return None
    table, order = np.full((n, pushes * cluster.lanes), -1, np.int32), np.argsort(guest, kind="stable")
    table[guest[order], np.arange(len(order)) - np.repeat(np.cumsum(times) - times, times)] = (holder << 16 | place)[order]
    return replace(cluster, slots=slots, pushes=pushes), Halo(slot.astype(np.int32), table.ravel())
