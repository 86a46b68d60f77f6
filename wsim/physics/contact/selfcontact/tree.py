"""Trees over triangles or edges, sorted along a curve: see kernels/contact/selfcontact/tree.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import search
from wsim.kernels.contact.selfcontact import tree as kernels
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact.modules import search_proof_module

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.contact.selfcontact.surfaces import ContactSurfaces

LEVELS = 3             # of trees that one launch fits
WALKS, SHARES = 1 << 16, 32            # threads of a search on a GPU, and those that share a walk, at most
EMPTY = 1e30           # of the boxes of empty leaves, which end before they begin [m]


class TreeOrder:
    """Triangles (kind 0), edges (1) or points (2), in stretches of their own."""

    def __init__(self, model: Model, surfaces: ContactSurfaces, kind: int, rows: list[np.ndarray]):
        """rows: of one length; -1: none."""
        self.model, self.surfaces, self.kind, self.each = model, surfaces, kind, len(rows[0])
        self.number = kernels.morton_order_kernel(model.real, search_proof_module(model))
        own = np.concatenate(rows).astype(np.int32)
        self.room = wp.array(np.concatenate([own, own]), dtype=int, device=model.device)        # twice: what sorting takes
        self.key = wp.zeros(len(self.room), dtype=wp.int64, device=model.device)
        self.item, self.bits = self.room[:len(own)], 3 * kernels.BITS + 1 + (len(rows) - 1).bit_length()

    def sort(self, frames) -> None:
        """Sorts by where points are in the last list; not captured."""
        s, n = self.surfaces, len(self.item)
        self.model.launch(self.number, n, [s.data, frames, self.kind, self.each, s.edge, self.item], [self.key])
        wp.utils.radix_sort_pairs(self.key, self.room, n, end_bit=self.bits)


class SurfaceTree:
    """One tree for each world. tree: struct."""

    def __init__(self, model: Model, surfaces: ContactSurfaces, kind: int, span: slice):
        """kind: 0 of triangles, 1 of edges; span: those of the tables of surfaces."""
        self.model, self.surfaces, self.kind = model, surfaces, kind
        table = (surfaces.triangles, surfaces.edges)[kind][span]
        self.number, world = len(table), surfaces.world[table[:, 0]]
        own = [span.start + np.flatnonzero(world == k) for k in range(model.worlds)]
        self.leaves = 1 << (max(max(map(len, own)), 1) - 1).bit_length()
        self.order = TreeOrder(model, surfaces, kind, [np.pad(o, (0, self.leaves - len(o)), constant_values=-1) for o in own])
        boxes = np.tile(np.array([EMPTY, -EMPTY, EMPTY, -EMPTY], np.float32)[:, None], (model.worlds * 2 * self.leaves, 1, 3))
        self.tree = fill_struct(kernels.BoxTree, leaves=self.leaves, item=self.order.item,
                                box=wp.array(boxes, dtype=kernels.Box, device=model.device),
                                front=wp.zeros(0 if model.device.is_cuda else 2 * self.leaves, dtype=int, device=model.device))


class SurfaceTrees:
    """All trees, and who looks into which: see kernels/contact/selfcontact/search.py."""

    def __init__(self, model: Model, trees: list[SurfaceTree], searches: list[tuple[int, wp.array, int]],
                 margins: Sequence[float] = ()):
        """searches: kind as `search.box_candidate_kernel` has it, points or edges that look, tree that they look into; margins:
        how much more than the thickness of surfaces pairs of each keep at most [m], 0 where none are given."""
        self.model, self.each = model, trees
        self.lay, self.meet = (kernels.leaf_box_kernel(model.real, search_proof_module(model)),
                               search.box_candidate_kernel(model.real, search_proof_module(model), model.device.is_cpu))
        self.leaves, self.fitted = self._walk_launch_rows([(tree.kind, tree.tree.item, k, 1) for k, tree in enumerate(trees)])
        each = [(kind, order, k, self.shares(len(order), trees[k].leaves)) for kind, order, k in searches]
        self.seekers, self.looks = self._walk_launch_rows(each, search.SIDE_BY_SIDE if model.device.is_cpu else 1, margins)
        self.join, self.joined = kernels.node_box_kernel(search_proof_module(model)), self._tree_level_launches()

    def _tree_level_launches(self) -> list[tuple[int, wp.array]]:
        """Threads of each launch that fits some levels of all trees, and what they do."""
        found, left = [], {k: tree.leaves for k, tree in enumerate(self.each) if tree.leaves > 1}
        while left:
            first, looks, worlds = 0, [], self.model.worlds
            for k, nodes in left.items():
                levels = min(LEVELS, nodes.bit_length() - 1)
                left[k] = nodes >> levels
                looks.append(fill_struct(kernels.TreeQuery, first=first, kind=levels, shares=left[k], into=self.each[k].tree))
                first += worlds * left[k]
            found.append((first, wp.array(looks, dtype=kernels.TreeQuery, device=self.model.device)))
            left = {k: nodes for k, nodes in left.items() if nodes > 1}
        return found

    def _walk_launch_rows(self, rows: list[tuple[int, wp.array, int, int]], each: int = 1,
                          margins: Sequence[float] = ()) -> tuple[int, wp.array]:
        """Threads of a launch, and what they do: kind, what looks, its tree, threads that share a walk. each: of one."""
        first = np.cumsum([0, *(-(-shares * len(order) // each) for _, order, _, shares in rows)])
        looks = [fill_struct(kernels.TreeQuery, first=int(n), kind=kind, shares=shares, order=order, into=self.each[k].tree,
                             margin=more)
                 for n, (kind, order, k, shares), more in zip(first[:-1], rows, margins or [0.0] * len(rows), strict=True)]
        return int(first[-1]), wp.array(looks, dtype=kernels.TreeQuery, device=self.model.device)

    def shares(self, looking: int, leaves: int) -> int:
        """Threads that share a walk through a tree: few that look leave a GPU idle, and walks are long where surfaces fold."""
        return min(leaves, SHARES, 1 << max(WALKS // looking, 1).bit_length() - 1) if self.model.device.is_cuda else 1

    def fit(self, data: Any, frames: Any) -> None:
        """Boxes of all nodes, about tubes."""
        self.model.launch(self.lay, self.leaves, [data, frames, self.fitted], [])
        self.join_boxes()

    def join_boxes(self) -> None:
        """Boxes of all nodes above leaves."""
        for threads, looks in self.joined:
            self.model.launch(self.join, threads, [looks], [])

    def look(self, surfaces: ContactSurfaces, frames: Any, found: wp.array) -> None:
        """Lists candidates."""
        self.model.launch(self.meet, self.seekers, [surfaces.data, frames, self.looks, surfaces.thickness], [found])
