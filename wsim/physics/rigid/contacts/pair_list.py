"""Broad phase: the list of pairs of shapes that may meet (kernels/rigid/lists/pairs.py), and the table of their manifolds."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists import pairs, world_pairs
from wsim.kernels.rigid.lists.worlds import set_aside_kernel
from wsim.kernels.rigid.narrow.shape import KINDS
from wsim.model.structs import fill_struct
from wsim.physics.rigid.meetings import FEW

SUMMING = {True: 1024, False: 1}                 # threads that sum counts within a graph: CUDA, CPU


def manifold_table(Contacts, room: int, real, device) -> Any:
    """Zeros for so many manifolds."""
    t = types(real)

    def zeros(length, dtype):
        return wp.zeros(length, dtype=dtype, device=device)
    return fill_struct(Contacts, n=zeros(room, t.vec3), skin=zeros(room, t.vec2), key=zeros(4 * room, int),
                       gap=zeros(4 * room, real), push=zeros(4 * room, real), rim=zeros(4 * room, t.vec2),
                       **{name: zeros(room, int) for name in ("a", "b", "count", "colour")},
                       **{name: zeros(room, t.vec3) for name in ("from_a", "from_b")},
                       **{name: zeros(room, t.quat) for name in ("turn_a", "turn_b")},
                       **{name: zeros(4 * room, t.vec3) for name in ("core_a", "core_b", "first_a", "first_b", "rub", "drift")})


class PairList:
    """Bounds of shapes, of bodies and of colliders, and the launches that list pairs: by trees, or by a table of a world's
    pairs (near), where its shapes are few.

    contacts: `wsim.physics.rigid.contacts.RigidContactTables`, whose tables of shapes are there, and whose `aside` has the list
    before where there are several worlds. first (2, shapes of bodies): number of pairs up to each shape, and in that list.
    arrays: what kernels note of shapes and bodies, for `Work` of kernels/rigid/contact.py."""

    def __init__(self, contacts, module):
        self.contacts, self.model, filters = contacts, contacts.model, contacts.filters
        real, device = contacts.real, contacts.device
        t, n, mine, shapes = types(real), contacts.frames, len(contacts.owners), contacts.shapes
        self.mine, self.shapes = mine, shapes
        self.near = self.world_pair_table()
        if self.near:
            filters = None                                    # the table is without them
        self.reach = pairs.shape_reach_kernel(real, module, filters is not None)
        self.listed = (world_pairs.world_pair_kernel(real, module) if self.near
                       else pairs.pair_list_kernel(real, module, filters is not None))
        self.summed, self.summing = pairs.prefix_sum_kernel(module), SUMMING[device.is_cuda]
        self.setting_aside = set_aside_kernel(real, module) if self.model.worlds > 1 else None

        def zeros_for_trees(length, dtype):
            return wp.zeros(length, dtype=dtype, device=device)
        low, high, up = (zeros_for_trees(shapes, wp.vec3f) for _ in range(3))
        endless = np.flatnonzero(contacts.table.ball.numpy() < 0.0).astype(np.int32)
        self.bvh = self.still = None
        grouped = self.model.worlds > 1 and not self.near
        if not self.near:
            self.bvh = wp.Bvh(low[:mine], high[:mine], groups=wp.clone(contacts.table.world[:mine]) if grouped else None)
            self.still = wp.Bvh(low[mine:], high[mine:]) if shapes - mine > len(endless) else None
        more = {n: wp.array(v, dtype=int, device=device) for n, v in (filters.tables if filters else {}).items()}
        self.tree = fill_struct(pairs.shape_tree_type(bool(more)), **more, id=self.bvh.id if self.bvh else 0,
                                still=self.still.id if self.still else 0, grouped=int(grouped),
                                low=low, high=high, up=up, endless=wp.array(endless, dtype=int, device=device))
        arm, slack = self.extents()
        self.number, self.first, self.sums = (zeros_for_trees(size, int) for size in (mine, (2, mine), self.summing))
        strayed = zeros_for_trees(1 + self.model.worlds, int)
        self.stray = strayed[:1]                         # whether a body of any world has
        self.arrays: dict[str, Any] = {
            "center": zeros_for_trees(shapes, wp.vec3d), "span": zeros_for_trees(shapes, t.vec2),
            "from_x": zeros_for_trees(n, t.vec3),
            "from_q": zeros_for_trees(n, t.quat), "way": zeros_for_trees(contacts.still_first, real),
            "strayed": strayed, "arm": self.model.upload(arm.astype(self.model.dtype), real),
            "slack": self.model.upload(slack.astype(self.model.dtype), real), "listed": self.first[0][mine - 1:]}

    def extents(self) -> tuple[np.ndarray, np.ndarray]:
        """Of each body [m]: distance from the centre of mass to the farthest end of what turns; part of the least ball."""
        table = self.contacts.table
        place, ball, kind = table.place.numpy(), table.ball.numpy(), table.kind.numpy()
        arm, slack = np.zeros(self.contacts.still_first), np.full(self.contacts.still_first, np.inf)
        for i, (k, _, _) in enumerate(self.contacts.owners):
            turned = np.linalg.norm(place[i, :3]) + (ball[i] if kind[i] != KINDS["sphere"] else 0.0)
            arm[k], slack[k] = max(arm[k], turned), min(slack[k], float(pairs.SLACK) * ball[i])
        return arm, slack

    def world_pair_table(self) -> Any:
        """Pairs of shapes of the first world that may ever touch (kernels/rigid/lists/world_pairs.py); None where they are
        many, or worlds are not alike."""
        contacts, worlds = self.contacts, self.model.worlds
        own, stills = self.mine // worlds, self.shapes - self.mine
        number = {body.path: k for k, (body, world) in enumerate(contacts.method.bodies) if world == 0}
        names = [(contacts.method.bodies[k][0].path, c.path) for k, _, c in contacts.owners]
        if own + stills > FEW or names != names[:own] * worlds or [w for _, w, _ in contacts.owners] != [
                w for w in range(worlds) for _ in range(own)]:
            return None
        body = np.array([number[path] for path, _ in names[:own]] + [-1] * stills)
        apart = body[:own, None] == body
        if contacts.filters:
            rows = np.r_[:own, self.mine:self.shapes]
            apart |= contacts.filters.parts_pairs(rows)[:own]
        i, j = np.nonzero(np.triu(~apart, 1))
        first = np.searchsorted(i, np.arange(own + 1))
        tables = {"first": first, "other": j}
        return fill_struct(world_pairs.WorldPairs, **{name: wp.array(value.astype(np.int32), dtype=int, device=contacts.device)
                                                      for name, value in tables.items()})

    def place_colliders(self, k: int, time: float, anew: bool = True) -> None:
        """Bounds of colliders at substep k, and how far they go within a time [s]; anew: builds their tree, else refits it."""
        self.model.launch(self.reach, self.shapes - self.mine, [self.contacts.rig(), self.mine, k, time], [self.tree])
        if self.still:
            (self.still.rebuild if anew else self.still.refit)()

    def list_near_pairs(self, k: int, time: float, wanted: wp.array, anew: bool = True) -> None:
        """Lists the pairs that may meet within a time [s] from substep k on. wanted: a word, how many pairs there were. anew:
        builds the trees; else refits them and adds by few threads, as a branch of a CUDA graph must take no memory, and lists
        those of worlds in which a body has strayed."""
        launch, rig = self.model.launch, self.contacts.rig()
        if anew:
            self.arrays["strayed"].fill_(1)
        elif self.setting_aside:
            launch(self.setting_aside, self.contacts.room, [self.contacts.list], [self.contacts.aside])
            wp.copy(self.first[1], self.first[0])
        if self.contacts.moves:
            self.place_colliders(k, time, anew)
        launch(self.reach, self.mine, [rig, 0, k, time], [self.tree])
        if self.bvh:
            (self.bvh.rebuild if anew else self.bvh.refit)()
        near = [self.near] if self.near else []
        for write in (0, 1):
            given = [rig, self.tree, *near, self.contacts.aside, self.first, write]
            launch(self.listed, self.mine, given, [self.number, wanted])
            if not write and anew:
                wp.utils.array_scan(self.number, self.first[0], True)
            elif not write:
                for step in ((0, 1) if self.summing > 1 else (1,)):
                    launch(self.summed, self.summing, [self.number, self.summing, step], [self.sums, self.first[0]])

    def forget_contacts(self, worlds: set[int]) -> None:
        """The last list forgets what bore where in some worlds, as at a start; rows that hold no pair are cleared too."""
        kept, now = self.contacts.arrays(), self.contacts.list
        world, tables = self.contacts.table.world.numpy(), (kept, {name: getattr(now, name) for name in kept})
        for table in tables:
            a = table["a"].numpy()
            own = (a < 0) | np.isin(world[np.maximum(a, 0)], sorted(worlds))
            for name, array in table.items():
                if name not in "ab":
                    values = array.numpy()
                    values[own if len(values) == len(own) else np.repeat(own, 4)] = -1 if name == "colour" else 0
                    values[~np.isfinite(values)] = 0              # left by a pair that was in the row before
                    array.assign(values)
