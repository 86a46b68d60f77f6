"""Which bodies conjugate gradients are solved for by a cluster of blocks each, in one launch:
kernels/motion/fused/conjugate.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.model.launches import LARGE_CLUSTER_ARCH, has_large_clusters
from wsim.physics.motion.fast_paths.cluster import THREADS

if TYPE_CHECKING:
    from wsim.kernels.motion.fused.conjugate import PcgCluster
    from wsim.model.model import Model

ROOM = 216             # bytes of A in a thread's registers: six blocks in float32
SHORT = 3              # blocks of a row that a lane takes without much delay


def pcg_cluster_for(model: Model, n: int, systems: int, most: int) -> PcgCluster | None:
    """The cluster for systems of at most n points, of at most `most` blocks each; None where registers do not suffice, the
    device has no clusters, or not all of a world run at once."""
    device = model.device
    if not device.is_cuda or min(device.arch, device.get_cuda_compile_arch()) < LARGE_CLUSTER_ARCH:
        return None
    size = 16 if has_large_clusters(device) else 8
    return None if systems * size > device.sm_count else plan_pcg_cluster(n, most, size, np.dtype(model.dtype).itemsize)


def plan_pcg_cluster(n: int, most: int, size: int, real: int) -> PcgCluster | None:
    """The same of `size` blocks: the fewest threads a point that have little to do each. real: bytes of a number."""
    from wsim.kernels.motion.fused.conjugate import PcgCluster
    best = None
    for lanes in (8, 4, 2, 1):
        whole = 32 // lanes                               # points of a warp
        found = PcgCluster(lanes, max(1, -(-most // lanes)), -(-n // (size * whole)) * whole, size)
        fits = found.threads <= THREADS and 9 * real * found.entries <= ROOM
        if fits and (best is None or found.entries <= SHORT):
            best = found
    return best
