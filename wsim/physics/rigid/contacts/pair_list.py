"""Broad phase: the list of pairs of shapes that may meet (kernels/rigid/lists/pairs.py)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists import pairs
from wsim.kernels.rigid.narrow.shape import KINDS
from wsim.model.structs import fill_struct


class PairList:
    """Trees of the bounds of shapes, of bodies and of colliders, and the launches that list pairs.

    contacts: `wsim.physics.rigid.contacts.RigidContactTables`, whose tables of shapes are there. first (shapes of bodies,):
    number of pairs up to each shape. arrays: what kernels note of shapes and bodies, for `Work` of kernels/rigid/contact.py."""

    def __init__(self, contacts, module):
        self.contacts, self.model, filters = contacts, contacts.model, contacts.filters
        real, device = contacts.real, contacts.device
        t, n, mine, shapes = types(real), contacts.frames, len(contacts.owners), contacts.shapes
        self.mine, self.shapes = mine, shapes
        self.reach, self.listed = (make(real, module, filters is not None)
                                   for make in (pairs.shape_reach_kernel, pairs.pair_list_kernel))
        self.summed = pairs.prefix_sum_kernel(module)

        def zeros_for_trees(length, dtype):
            return wp.zeros(length, dtype=dtype, device=device)
        low, high, up = (zeros_for_trees(shapes, wp.vec3f) for _ in range(3))
        self.bvh = wp.Bvh(low[:mine], high[:mine])
        endless = np.flatnonzero(contacts.table.ball.numpy() < 0.0).astype(np.int32)
        self.still = wp.Bvh(low[mine:], high[mine:]) if shapes - mine > len(endless) else None
        more = {n: wp.array(v, dtype=int, device=device) for n, v in (filters.tables if filters else {}).items()}
        self.tree = fill_struct(pairs.shape_tree_type(bool(more)), **more, id=self.bvh.id,
                                still=self.still.id if self.still else 0,
                                low=low, high=high, up=up, endless=wp.array(endless, dtype=int, device=device))
        arm, slack = self.extents()
        self.number, self.first = zeros_for_trees(mine, int), zeros_for_trees(mine, int)
        self.arrays: dict[str, Any] = {
            "center": zeros_for_trees(shapes, wp.vec3d), "span": zeros_for_trees(shapes, t.vec2),
            "from_x": zeros_for_trees(n, t.vec3),
            "from_q": zeros_for_trees(n, t.quat), "way": zeros_for_trees(contacts.still_first, real),
            "strayed": zeros_for_trees(1, int), "arm": self.model.upload(arm.astype(self.model.dtype), real),
            "slack": self.model.upload(slack.astype(self.model.dtype), real), "listed": self.first[mine - 1:]}

    def extents(self) -> tuple[np.ndarray, np.ndarray]:
        """Of each body [m]: distance from the centre of mass to the farthest end of what turns; part of the least ball."""
        table = self.contacts.table
        place, ball, kind = table.place.numpy(), table.ball.numpy(), table.kind.numpy()
        arm, slack = np.zeros(self.contacts.still_first), np.full(self.contacts.still_first, np.inf)
        for i, (k, _, _) in enumerate(self.contacts.owners):
            turned = np.linalg.norm(place[i, :3]) + (ball[i] if kind[i] != KINDS["sphere"] else 0.0)
            arm[k], slack[k] = max(arm[k], turned), min(slack[k], float(pairs.SLACK) * ball[i])
        return arm, slack

    def place_colliders(self, k: int, time: float, anew: bool = True) -> None:
        """Bounds of colliders at substep k, and how far they go within a time [s]; anew: builds their tree, else refits it."""
        self.model.launch(self.reach, self.shapes - self.mine, [self.contacts.rig(), self.mine, k, time], [self.tree])
        if self.still:
            (self.still.rebuild if anew else self.still.refit)()

    def list_near_pairs(self, k: int, time: float, wanted: wp.array, anew: bool = True) -> None:
        """Lists the pairs that may meet within a time [s] from substep k on. wanted: a word, how many pairs there were. anew:
        builds the trees; else refits them and adds by one thread, as a branch of a CUDA graph must take no memory."""
        launch, rig = self.model.launch, self.contacts.rig()
        if self.contacts.moves:
            self.place_colliders(k, time, anew)
        launch(self.reach, self.mine, [rig, 0, k, time], [self.tree])
        (self.bvh.rebuild if anew else self.bvh.refit)()
        for write in (0, 1):
            launch(self.listed, self.mine, [rig, self.tree, self.first, write], [self.number, wanted])
            if not write and anew:
                wp.utils.array_scan(self.number, self.first, True)
            elif not write:
                launch(self.summed, 1, [self.number], [self.first])
        self.arrays["strayed"].fill_(1)
