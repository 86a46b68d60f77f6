"""Trees over triangles or edges, sorted along a curve: see kernels/selfcontact/tree.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.selfcontact import tree as kernels
from wsim.model.structs import filled

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.selfcontact.surfaces import Surfaces

BITS = 20              # of a place along each axis of a curve
EMPTY = 1e30           # of the boxes of empty leaves, which end before they begin [m]


def curve(x: np.ndarray) -> np.ndarray:
    """Order of places along a Morton curve, (n,). x: any unit, (n, 3)."""
    low, size = x.min(axis=0, initial=np.inf), float(np.ptp(x, axis=0).max()) if len(x) else 0.0
    cell = ((x - low) * (2.0**BITS - 1.0) / max(size, 1e-30)).astype(np.uint64)
    key = np.zeros(len(x), np.uint64)
    for bit in range(BITS):
        for axis in range(3):
            key |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(key, kind="stable")


class Tree:
    """One tree for each world. tree: struct."""

    def __init__(self, model: Model, surfaces: Surfaces, kind: int, span: slice):
        """kind: 0 of triangles, 1 of edges; span: those of the tables of surfaces."""
        self.model, self.surfaces, self.kind = model, surfaces, kind
        self.lay, self.join = kernels.lay(model.real, model.module), kernels.join(model.module)
        table = (surfaces.triangles, surfaces.edges)[kind]
        self.corners, self.first = table[span], span.start
        self.world = surfaces.world[self.corners[:, 0]]
        most = int(np.bincount(self.world, minlength=model.worlds).max(initial=1))
        self.leaves = 1 << (most - 1).bit_length()
        boxes = np.tile(np.array([EMPTY, -EMPTY, EMPTY, -EMPTY], np.float32)[:, None], (model.worlds * 2 * self.leaves, 1, 3))
        self.tree = filled(kernels.Tree, leaves=self.leaves, box=wp.array(boxes, dtype=kernels.Box, device=model.device),
                           item=wp.full(model.worlds * self.leaves, -1, dtype=int, device=model.device))

    def sort(self, x: np.ndarray) -> None:
        """Leaves by where points are, (total, 3); not captured."""
        item = np.full((self.model.worlds, self.leaves), -1, np.int32)
        middle = x[self.corners].mean(axis=1)
        for world, row in enumerate(item):
            own = np.flatnonzero(self.world == world)
            row[:len(own)] = self.first + own[curve(middle[own])]
        self.tree.item.assign(item.ravel())

    def fit(self, frames) -> None:
        """Boxes of all nodes, about tubes."""
        launch, leaves = self.model.launch, self.leaves
        launch(self.lay, len(self.tree.item), [self.surfaces.data, frames, self.kind], [self.tree])
        while leaves > 1:
            leaves //= 2
            launch(self.join, leaves * self.model.worlds, [leaves], [self.tree])
