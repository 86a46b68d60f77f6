"""How a cluster of blocks shares a net of springs: whose memory holds which points. See
kernels/motion/fast_paths/cluster.py."""

from dataclasses import dataclass, replace

import numpy as np

THREADS, ENTRIES, PUSHES = 512, 16, 4      # of a block at most; springs and places of a lane, for which there are registers
FULL = {4: 12, 8: 6}   # springs of a lane for which blocks of THREADS have registers, by bytes of a number
ENOUGH, SHORT = 128, 6 # threads of a block that keep four schedulers at work; springs that a lane takes without much delay
ROOM = 49152 - 64      # bytes of shared memory beside the barriers


@dataclass(frozen=True)
class SpringCluster:
    """Blocks of so many points; `slots` places in the memory of a block: its own points, and those it hangs on."""

    lanes: int                 # threads of a point
    entries: int               # springs of a lane
    points: int                # of a block
    size: int                  # blocks
    slots: int = 0
    pushes: int = 1            # places in other blocks that a lane writes

    @property
    def threads(self) -> int:
        """Threads of a block."""
        return self.points * self.lanes


@dataclass(frozen=True)
class Halo:
    """Places of points in the memory of blocks."""

    slot: np.ndarray           # of the other end, for each entry, (entries,) int32
    push: np.ndarray           # block << 16 | slot, or -1, (points * pushes * lanes,) int32
    guests: np.ndarray         # points of others in a block's memory, (size,) int32


def cluster_for(n: int, most: int, size: int = 16, real: int = 4) -> SpringCluster | None:
    """The cluster of so many blocks that takes n points of at most `most` springs, or None where registers do not suffice.

    The fewest lanes that give a block enough threads and a lane few springs: what a point does besides is done by each lane.
    H200, 12 springs a point, a substep [us] with 8, 4, 2, 1 lanes: 256 points 0.33, 0.33, 0.42, -; 1k 0.63, 0.47, 0.42, 0.73;
    2k -, 0.57, 0.49, 0.82; 4k -, -, 0.74, 0.87; 6.4k and 8.1k with 1 lane 1.00, 1.06, by launches 4.9, 5.2. A frame of one
    of 4096 worlds of 1k points, 89 substeps: 1.7 us with 16 blocks, 2.1 with 4. real: bytes of a number."""
    best = None
    for lanes in (8, 4, 2, 1):
        whole = 32 // lanes                               # points of a warp
        found = SpringCluster(lanes, -(-most // lanes), -(-n // (size * whole)) * whole, size)
        fits = found.threads <= THREADS and found.entries <= (FULL[real] if found.threads > THREADS // 2 else ENTRIES)
        if fits and (best is None or (found.threads >= ENOUGH and found.entries <= SHORT)):
            best = found
    return best


def exchange_halo(cluster: SpringCluster, n: int, point: np.ndarray, other: np.ndarray,
                  real: int) -> tuple[SpringCluster, Halo] | None:
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
    if pushes > PUSHES or 3 * slots * real * (4 if real == 4 else 3) > ROOM:
        return None
    table, order = np.full((n, pushes * cluster.lanes), -1, np.int32), np.argsort(guest, kind="stable")
    table[guest[order], np.arange(len(order)) - np.repeat(np.cumsum(times) - times, times)] = (holder << 16 | place)[order]
    return replace(cluster, slots=slots, pushes=pushes), Halo(slot.astype(np.int32), table.ravel(), counts.astype(np.int32))
