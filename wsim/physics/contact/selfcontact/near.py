"""The list of near pairs: when it is made, and what it holds on. See kernels/contact/selfcontact/search.py and
motion_bounds.py.

Kernels read the list from a struct on the device (`wsim.model.structs.PlacedStruct`), and their threads are as many whatever
room it has: graphs stay valid when it grows. A list that is half full at the end of a frame gets more room before the next one,
and keeps what it holds. A list that overflows within a frame makes the frame be repeated.
"""

from __future__ import annotations

from copy import copy
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import motion_bounds, pairs, search
from wsim.kernels.math.real import types
from wsim.model.structs import PlacedStruct, fill_struct, struct_values
from wsim.physics.contact.selfcontact.modules import search_proof_module
from wsim.physics.contact.selfcontact.tree import SurfaceTree, SurfaceTrees, TreeOrder

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.contact.selfcontact.surfaces import ContactSurfaces

LANES, MANY = 256, 16384         # partial sums of moments; points from which there are FOLD times as many, as on a GPU
EACH = 16              # pairs a point that there is room for at first: crumpled sheets have 6 to 9, ropes of cloth 80 to 170
MORE = 4               # times the pairs that were wanted that there is room for from then on
AROUND = 12            # candidates a point that there is room for besides: those of a flat cloth
EPOCHS = 1 << 16       # substeps that a frame has fewer of
LEAST, THREADS = 1 << 14, 1 << 18      # threads that go through pairs and candidates on a GPU
SHORT = 64             # pairs of a list of which one counts
SORTED = 8             # frames after which trees are sorted anew: boxes of what has folded overlap


class NearPairList:
    """listed_at, found_at: the list and candidates for it; threads: of a launch over either; words: what decides on the device
    (kernels/contact/selfcontact/pairs.py); sums: what pairs add up."""

    def __init__(self, model: Model, surfaces: ContactSurfaces, turns: bool = False):
        """turns: pairs may be pressed in turn (kernels/contact/selfcontact/rows.py)."""
        self.model, self.surfaces = model, surfaces
        self.narrow = motion_bounds.TURNS if turns else motion_bounds.NARROW
        real, module, device, t = model.real, search_proof_module(model), model.device, types(model.real)
        self.tally, self.fold, self.fit = (motion_bounds.motion_moment_kernel(real, module),
                                           motion_bounds.moment_fold_kernel(real, module),
                                           motion_bounds.rigid_fit_kernel(real, module))
        self.axes, self.watch, self.thin = (motion_bounds.tube_axis_kernel(real, module),
                                            motion_bounds.tube_watch_kernel(real, module),
                                            motion_bounds.thin_tube_kernel(real, module))
        self.sift, self.listed = search.candidate_sift_kernel(real, module), search.list_made_kernel(real, module)
        zeros, n = partial(wp.zeros, device=device), surfaces.total
        self.words = zeros(pairs.WORDS, dtype=int)
        self.sums = fill_struct(pairs.sum_type(real), move=zeros(3 * n, dtype=wp.int64), share=zeros(n, dtype=int),
                                taken=zeros(1, dtype=wp.int64),
                                factor=wp.ones(n, dtype=real, device=device), cut=zeros(n, dtype=int))
        self.frames = fill_struct(motion_bounds.frame_type(real), rigid=zeros(4, dtype=t.vec3),
                                  frame=zeros(2, dtype=t.transform),
                                  start=zeros(n, dtype=t.vec3), way=zeros(n, dtype=t.vec3), lead=zeros(1, dtype=int),
                                  beta=wp.full(n, surfaces.beta, dtype=real, device=device), off=zeros(n, dtype=real),
                                  most=zeros(1, dtype=real), part=wp.ones(1, dtype=real, device=device),
                                  least=wp.ones(1, dtype=real, device=device),
                                  dense=wp.ones(1, dtype=real, device=device))
        self.lanes = LANES * motion_bounds.FOLD if device.is_cuda or len(surfaces.points) >= MANY else LANES
        self.moments = [zeros((self.lanes // motion_bounds.FOLD**k, motion_bounds.COLUMNS), dtype=real) for k in range(4)
                        if motion_bounds.FOLD**k <= self.lanes]
        self._order_points(model, surfaces)
        self.alone: Any = None                   # edges of bodies, where strands have edges as well
        if surfaces.own["edges"] < surfaces.free["edges"]:
            self.alone = model.upload(np.arange(surfaces.own["edges"]), int)
        self.trees = [SurfaceTree(model, surfaces, kind, span) for kind, span in self._tree_row_spans()]
        self.ball_edges = model.upload(np.arange(len(surfaces.edges), dtype=np.int32)[surfaces.ball_edges], int)
        searches = self._tree_searches()
        margins = [surfaces.ball_margin * any(order is own for own in (self.ball_tips, self.ball_edges))
                   for _, order, _ in searches]
        self.forest = SurfaceTrees(model, self.trees, searches, margins)
        self.age = self.rounds = self.capacity = 0
        self.solves = False                      # True: Newton steps solve for rows
        self.listed_at, self.found_at = PlacedStruct(pairs.pair_type(real), device), PlacedStruct(pairs.BoxPairs, device)
        self.listed_at.put(**{name: zeros(n, dtype=int) for name, n in (("count", 1), ("rows", 1), ("active", 2))})
        self.found_at.put(count=zeros(1, dtype=int))
        self.threads = min(max(LEAST, 8 * len(surfaces.points)), THREADS) if device.is_cuda else 1
        self.epoch, self.running = 1, 0          # running: substeps at the end of the frame before in which points lost much
        self.room(max(1024, EACH * len(surfaces.points)))

    def _order_points(self, model: Model, surfaces: ContactSurfaces) -> None:
        """tips: points that look for triangles, those of surfaces, balls, strands and colliders, where there are some."""
        looking, balls = surfaces.looking, surfaces.looking + len(surfaces.balls)
        each = np.split(surfaces.points, [looking, balls, surfaces.own["points"], surfaces.free["points"]])
        orders = [TreeOrder(model, surfaces, 2, [own]) if len(own) else None for own in (*each[:2], *each[3:])]
        self.tips = [order for order in orders if order]
        self.solid_tips = [order.item for order in orders[:2] if order]
        self.ball_tips: Any = orders[1].item if orders[1] else None

    def beside(self) -> NearPairList:
        """A short list of the same surfaces: a search for it leaves this one as it is."""
        other, device = copy(self), self.model.device
        other.words, other.capacity = wp.zeros_like(self.words), 0
        other.frames = fill_struct(motion_bounds.frame_type(self.model.real),
                                   **{k: wp.clone(v) for k, v in struct_values(self.frames).items()})
        other.listed_at, other.found_at = (PlacedStruct(pairs.pair_type(self.model.real), device),
                                           PlacedStruct(pairs.BoxPairs, device))
        other.listed_at.put(**{name: wp.zeros(1, dtype=int, device=device) for name in ("count", "rows", "active")})
        other.found_at.put(count=wp.zeros(1, dtype=int, device=device))
        other.room(SHORT)
        return other

    def _tree_row_spans(self) -> list[tuple[int, slice]]:
        """Kind and stretch of each tree: triangles and edges that are no collider's, then those that are."""
        free, found = self.surfaces.free, [(0, "triangles"), (1, "edges")]
        own, ends = [(kind, slice(0, free[name])) for kind, name in found], (None, self.surfaces.ball_edges.start)
        return own + [(kind, slice(free[name], ends[kind])) for kind, name in found if self.surfaces.obstacles]

    def _tree_searches(self) -> list[tuple[int, wp.array, int]]:
        """(kind as `search.box_candidate_kernel` has it, points or edges that look, tree that they look into): no collider into
        another, no strand into one, and no ball into a ball."""
        edges = self.trees[1].tree.item
        found = [*((0, tips.item, 0) for tips in self.tips), (search.AMONG, edges, 1)]
        more = edges if self.alone is None else self.alone
        if self.surfaces.obstacles:
            found += [*((0, item, 2) for item in self.solid_tips), (1, more, 3)]
        if len(self.ball_edges):
            found += [(1, self.ball_edges, 1)]
        return [each for each in found if self.trees[each[2]].number]            # rods have edges alone

    @property
    def pairs(self):
        """The list, as the host knows it."""
        return self.listed_at.struct

    @property
    def table(self) -> wp.array:
        """The list, as kernels read it."""
        return self.listed_at.at

    def room(self, capacity: int) -> None:
        """Arrays for so many pairs; the list is to be made anew."""
        self.allocate(capacity)
        for count in (self.pairs.count, self.pairs.rows, self.pairs.active, self.found_at.struct.count):
            count.zero_()
        self.anew()

    def allocate(self, capacity: int) -> None:
        """Empty arrays for so many pairs and for their candidates."""
        zeros, t = partial(wp.zeros, capacity, device=self.model.device), types(self.model.real)
        scalars, vectors = ("keep", "away", "gap", "least"), ("n", "push", "past")
        self.capacity = capacity
        self.listed_at.put(
            capacity=capacity, ids=zeros(dtype=wp.vec4i), four=zeros(dtype=wp.vec4i), b=zeros(dtype=t.vec4),
            swept=wp.zeros(4 * capacity, dtype=t.vec4, device=self.model.device),
            **{k: zeros(dtype=int) for k in ("kind", "on", "seen", "bad", "row")},
            **{k: zeros(dtype=t.scalar) for k in scalars}, **{k: zeros(dtype=t.vec3) for k in vectors})
        if self.solves:
            self.solve()
        room = AROUND * len(self.surfaces.points) + search.CANDIDATES * capacity
        self.found_at.put(capacity=room, pair=wp.zeros(room, dtype=wp.vec2i, device=self.model.device))

    def solve(self) -> None:
        """Arrays of rows that Newton steps solve for, for as many as there is room for."""
        zeros, t = partial(wp.zeros, self.capacity, device=self.model.device), types(self.model.real)
        self.solves = True
        self.listed_at.put(force=zeros(dtype=t.vec3), **{k: zeros(dtype=t.scalar) for k in ("stiff", "last", "rho")})

    def grow(self, wanted: int) -> None:
        """Room for more than so many pairs: a frame ends at the first list that has none, and may only be repeated a few times.
        """
        self.room(MORE * wanted)

    def widen(self, most: int) -> bool:
        """Makes room after a frame in which a list held so many pairs, if that is more than half of what there is room for.
        The list stays as it is. True: there is more room."""
        if 2 * most <= self.capacity:
            return False
        before = struct_values(self.pairs)
        self.allocate(MORE * most)
        for name, array in struct_values(self.pairs).items():
            if isinstance(array, wp.array) and array is not before[name] and len(before[name]):
                wp.copy(array, before[name], count=len(before[name]))
        return True

    def anew(self) -> None:
        """Clears what a frame that was given up has left."""
        self.frames.rigid.zero_()
        self.frames.off.zero_()
        self.frames.most.zero_()
        self.frames.part.fill_(1.0)
        self.frames.dense.fill_(1.0)
        self.frames.beta.fill_(self.surfaces.beta)
        words = self.words.numpy()
        words[:] = 0
        words[pairs.SOON], words[pairs.EPOCH], words[pairs.ROUNDS] = 1, self.epoch, self.rounds
        words[pairs.RUN] = self.running
        self.epoch += EPOCHS
        self.words.assign(words)
        self.sums.share.zero_()
        self.sums.taken.zero_()
        self.sums.move.zero_()
        self.sums.factor.fill_(1.0)

    def build(self, at=None, step: np.ndarray | None = None) -> None:
        """Sorts what looks and what is looked into, first by where points start, and then makes room for the pairs of a first
        list, if `at` and how far points go in a substep are given [m]; not captured."""
        if self.age == 0:
            self.frames.start.assign(self.surfaces.start(self.model).astype(self.model.dtype))
        if self.age % SORTED == 0:
            for order in (*self.tips, *(tree.order for tree in self.trees)):
                order.sort(self.frames)
        self.age += 1
        if self.age == 1 and at is not None:
            at.d.assign(at.e.numpy() + step)
            self.estimate_pair_room(at)

    def estimate_pair_room(self, at) -> None:
        """Room for the pairs of a list that is made and forgotten, before a frame is recorded that has none: to record one of
        XPBD again takes a CPU longer than to step it."""
        self.search(at, begins=1)
        while wanted := int(self.word(pairs.LACKED).numpy()[0]):
            self.grow(wanted)
            self.search(at, begins=1)
        self.anew()

    def set_projection_rounds(self, rounds: int) -> None:
        """Projections that a substep has at most, in frames to come."""
        if rounds != self.rounds:
            self.rounds = rounds
            self.word(pairs.ROUNDS).fill_(rounds)

    def word(self, k: int) -> wp.array:
        """One word, as conditions of a graph take it."""
        return self.words[k:k + 1]

    def move(self, at, fresh: int) -> None:
        """The rigid motion of the substep, by what `at` holds; fresh 1: A begins anew."""
        launch, m = self.model.launch, self.moments
        launch(self.tally, self.lanes, [self.surfaces.data, at, self.frames, self.lanes], [m[0]])
        for rows, out in zip(m[:-1], m[1:], strict=True):
            launch(self.fold, (out.shape[0], motion_bounds.COLUMNS), [rows], [out])
        launch(self.fit, 1, [m[-1], fresh], [self.frames])

    def search(self, at, most: int = motion_bounds.LEAD, begins: int = 0, solved: bool = False, tube: float = 1.0) -> None:
        """Makes the list, by what `at` holds, for so many substeps at most. begins 1: before the substep is solved;
        solved: behind that, where it may be for a proof of this substep alone; tube: as `kernels.selfcontact.tubes.axes`."""
        launch, s, f = self.model.launch, self.surfaces, self.frames
        self.move(at, 1)
        f.lead.fill_(most)
        launch(self.axes, len(s.points), [s.data, at, self.narrow, tube, self.words], [f])
        f.part.fill_(1.0)
        if solved:
            launch(self.thin, len(s.points), [s.data, self.words], [f])
        self.pairs.count.zero_()
        self.found_at.struct.count.zero_()
        self.forest.fit(s.data, f)
        self.forest.look(s, f, self.found_at.at)
        launch(self.sift, self.threads, [s.data, f, self.found_at.at, self.threads], [self.listed_at.at])
        launch(self.listed, 1, [self.found_at.at, begins, len(s.points)], [self.listed_at.at, f, self.words])

    def look(self, at, fresh: int = 0) -> None:
        """Looks whether points are in their tubes where the substep ends. fresh: as `kernels.selfcontact.tubes.watch`."""
        self.model.launch(self.watch, len(self.surfaces.points), [self.surfaces.data, at, self.frames, fresh], [self.words])

    def pushing(self, free: bool) -> tuple[np.ndarray, np.ndarray]:
        """Rows that push in the last substep, (rows, 4, 4) by pairs.B ..., and their points, (rows, 4): those of its sweeps,
        since a list that was made behind them has no push yet."""
        near, words = self.pairs, self.words.numpy()
        count = int(near.rows.numpy()[0]) if words[pairs.BEHIND] == words[pairs.EPOCH] and not free else 0
        if not count:
            return np.zeros((0, 4, 4)), np.zeros((0, 4), int)
        swept = near.swept[:4 * count].numpy().reshape(-1, 4, 4)
        touch = swept[:, pairs.PUSH, :3].any(axis=1)
        return swept[touch], near.four[:count].numpy()[touch]

    def told(self, free: bool) -> dict[str, float]:
        """near_pairs: of surfaces, in the last list; surface_contacts: those that push; touching: their points; thin: part of
        them that is nearer than half of what they keep; least_gap [m] of all, where the last substep began (of what does not
        meet a bound below it); flicker: part of what is pushed with, in that substep and the one before, that is of pairs which
        push in one of them only: none at rest (where the list was made between them nothing is known of it). free: nothing was
        near in the last frame."""
        near = self.pairs
        count = 0 if free else min(int(near.count.numpy()[0]), near.capacity)
        touch, ids = self.pushing(free)
        points = np.unique(ids[touch[:, pairs.B] != 0.0])
        thin = touch[:, pairs.NORMAL, 3] < 0.5 * touch[:, pairs.PUSH, 3]
        found = {"near_pairs": float(count), "surface_contacts": float(len(touch)), "touching": float(len(points)),
                 "thin": float(thin.mean()) if len(touch) else 0.0}
        if count:
            found["least_gap"] = float(near.gap.numpy()[:count].min())
        if count and self.word(pairs.AGE).numpy()[0] > 1:
            push, past = (np.linalg.norm(a.numpy()[:count].astype(np.float64), axis=1) for a in (near.push, near.past))
            whole, once = push + past, (push > 0.0) != (past > 0.0)
            found["flicker"] = float(whole[once].sum() / whole.sum()) if whole.any() else 0.0
        return found
