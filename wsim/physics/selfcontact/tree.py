"""Trees over triangles or edges, sorted along a curve: see kernels/selfcontact/tree.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.selfcontact import tree as kernels
from wsim.model.structs import filled
from wsim.physics.selfcontact.modules import core

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.selfcontact.surfaces import Surfaces

LEVELS = 3             # of a tree that one launch fits
EMPTY = 1e30           # of the boxes of empty leaves, which end before they begin [m]


class Order:
    """Triangles (kind 0), edges (1) or points (2), in stretches of their own."""

    def __init__(self, model: Model, surfaces: Surfaces, kind: int, rows: list[np.ndarray]):
        """rows: of one length; -1: none."""
        self.model, self.surfaces, self.kind, self.each = model, surfaces, kind, len(rows[0])
        self.number = kernels.number(model.real, core(model))
        own = np.concatenate(rows).astype(np.int32)
        self.room = wp.array(np.concatenate([own, own]), dtype=int, device=model.device)        # twice: what sorting takes
        self.key = wp.zeros(len(self.room), dtype=wp.int64, device=model.device)
        self.item, self.bits = self.room[:len(own)], 3 * kernels.BITS + 1 + (len(rows) - 1).bit_length()

    def sort(self, frames) -> None:
        """Sorts by where points are in the last list; not captured."""
        s, n = self.surfaces, len(self.item)
        self.model.launch(self.number, n, [s.data, frames, self.kind, self.each, s.edge, self.item], [self.key])
        wp.utils.radix_sort_pairs(self.key, self.room, n, end_bit=self.bits)


class Tree:
    """One tree for each world. tree: struct."""

    def __init__(self, model: Model, surfaces: Surfaces, kind: int, span: slice):
        """kind: 0 of triangles, 1 of edges; span: those of the tables of surfaces."""
        self.model, self.surfaces, self.kind = model, surfaces, kind
        self.lay, self.join = kernels.lay(model.real, core(model)), kernels.join(core(model))
        table = (surfaces.triangles, surfaces.edges)[kind][span]
        self.number, world = len(table), surfaces.world[table[:, 0]]
        own = [span.start + np.flatnonzero(world == k) for k in range(model.worlds)]
        self.leaves = 1 << (max(max(map(len, own)), 1) - 1).bit_length()
        self.order = Order(model, surfaces, kind, [np.pad(o, (0, self.leaves - len(o)), constant_values=-1) for o in own])
        boxes = np.tile(np.array([EMPTY, -EMPTY, EMPTY, -EMPTY], np.float32)[:, None], (model.worlds * 2 * self.leaves, 1, 3))
        self.tree = filled(kernels.Tree, leaves=self.leaves, item=self.order.item,
                           box=wp.array(boxes, dtype=kernels.Box, device=model.device),
                           front=wp.zeros(0 if model.device.is_cuda else 2 * self.leaves, dtype=int, device=model.device))

    def fit(self, frames) -> None:
        """Boxes of all nodes, about tubes."""
        launch, leaves = self.model.launch, self.leaves
        launch(self.lay, len(self.tree.item), [self.surfaces.data, frames, self.kind], [self.tree])
        while leaves > 1:
            levels = min(LEVELS, leaves.bit_length() - 1)
            leaves >>= levels
            launch(self.join, leaves * self.model.worlds, [leaves, levels], [self.tree])
