"""The list of near pairs: when it is made, and what it holds on. See kernels/selfcontact/search.py and tubes.py."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.contact.search import roots
from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import pairs, search, tubes
from wsim.model.structs import filled

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.selfcontact.surfaces import Surfaces

LANES, MANY = 256, 16384         # partial sums of moments; points from which there are FOLD times as many
EACH = 4               # pairs a point that there is room for at first
EPOCHS = 1 << 16       # substeps that a frame has fewer of
REBUILT = 48           # frames after which trees are built anew: boxes of what has folded overlap


class Near:
    """pairs: the list; words: what decides on the device (kernels/selfcontact/pairs.py); sums: what pairs add up."""

    def __init__(self, model: Model, surfaces: Surfaces):
        self.model, self.surfaces = model, surfaces
        real, module, device, t = model.real, model.module, model.device, types(model.real)
        self.tally, self.fold, self.fit = tubes.tally(real, module), tubes.fold(real, module), tubes.fit(real, module)
        self.axes, self.watch = tubes.axes(real, module), tubes.watch(real, module)
        self.boxes, self.reach, self.roots = search.boxes(real, module), search.reach(real, module), roots(module)
        self.listed = search.listed(real, module)
        zeros, n = partial(wp.zeros, device=device), surfaces.total
        self.words = zeros(pairs.WORDS, dtype=int)
        self.sums = filled(pairs.sums(real), move=zeros(3 * n, dtype=wp.int64), share=zeros(n, dtype=int),
                           taken=zeros(1, dtype=wp.int64),
                           factor=wp.ones(n, dtype=real, device=device), cut=zeros(n, dtype=int))
        self.frames = filled(tubes.frames(real), rigid=zeros(4, dtype=t.vec3), frame=zeros(2, dtype=t.transform),
                             start=zeros(n, dtype=t.vec3), way=zeros(n, dtype=t.vec3), lead=zeros(n, dtype=int),
                             beta=wp.full(n, surfaces.beta, dtype=real, device=device), off=zeros(n, dtype=real))
        self.lanes = LANES if len(surfaces.points) < MANY else LANES * tubes.FOLD
        self.moments = [zeros((self.lanes // tubes.FOLD**k, tubes.COLUMNS), dtype=real) for k in range(4)
                        if tubes.FOLD**k <= self.lanes]
        self.trees: list[wp.Bvh | None] = []             # None over nothing: rods have edges alone
        self.low, self.high = ([zeros(len(each), dtype=wp.vec3f) for each in (surfaces.triangles, surfaces.edges)]
                               for _ in range(2))
        self.spans = self._spans()
        self.root = [zeros(model.worlds, dtype=int) for _ in self.spans]
        self.age = self.rounds = 0
        self.epoch, self.running = 1, 0          # running: substeps at the end of the frame before in which points lost much
        self.room(max(1024, EACH * len(surfaces.points)))

    def _spans(self) -> list[tuple[int, slice]]:
        """Kind and stretch of each tree: triangles and edges that are no collider's, then those that are."""
        free, found = self.surfaces.free, [(0, "triangles"), (1, "edges")]
        own = [(kind, slice(0, free[name])) for kind, name in found]
        return own + [(kind, slice(free[name], None)) for kind, name in found if self.surfaces.obstacles]

    def _searches(self) -> list[tuple[int, int, int, int]]:
        """(kind, first and number of the points or edges that look, tree that they look into): no collider into another."""
        free, points = self.surfaces.free, len(self.surfaces.points)
        own = [(0, 0, points, 0), (1, 0, free["edges"], 1)]
        return own + [(0, 0, free["points"], 2), (1, 0, free["edges"], 3)] if points > free["points"] else own

    def room(self, capacity: int) -> None:
        """Arrays for so many pairs; the list is to be made anew."""
        zeros, t = partial(wp.zeros, capacity, device=self.model.device), types(self.model.real)
        scalars, vectors = ("keep", "away", "gap", "least"), ("n", "push", "swept", "past")
        self.pairs = filled(
            pairs.lists(self.model.real), capacity=capacity, count=wp.zeros(1, dtype=int, device=self.model.device),
            ids=zeros(dtype=wp.vec4i), b=zeros(dtype=t.vec4), **{k: zeros(dtype=int) for k in ("kind", "on", "bad", "row")},
            **{k: wp.zeros(1, dtype=int, device=self.model.device) for k in ("rows", "active")},
            **{k: zeros(dtype=t.scalar) for k in scalars}, **{k: zeros(dtype=t.vec3) for k in vectors})
        self.anew()

    def anew(self) -> None:
        """Clears what a frame that was given up has left."""
        self.frames.rigid.zero_()
        self.frames.off.zero_()
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

    def build(self) -> None:
        """Trees over boxes where the points start, or anew over what they hold; not captured."""
        if self.trees:
            self.age += 1
            if self.age % REBUILT == 0:
                for tree in filter(None, self.trees):
                    tree.rebuild()
                self._roots()
            return
        start = self.surfaces.start(self.model).astype(self.model.dtype)
        self.frames.start.assign(start)
        self._boxes()
        s = self.surfaces
        groups = [self.model.upload(s.world[each[:, 0]], int) for each in (s.triangles, s.edges)]
        self.trees = [wp.Bvh(self.low[kind][span], self.high[kind][span], groups=groups[kind][span])
                      if len(self.low[kind]) else None for kind, span in self.spans]
        self._roots()

    def _roots(self) -> None:
        for tree, root in zip(self.trees, self.root, strict=True):
            if tree:
                self.model.launch(self.roots, len(root), [tree.id], [root])

    def _boxes(self) -> None:
        for kernel, low, high in zip(self.boxes, self.low, self.high, strict=True):
            if len(low):
                self.model.launch(kernel, len(low), [self.surfaces.data, self.frames], [low, high])

    def allow(self, rounds: int) -> None:
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
            launch(self.fold, (out.shape[0], tubes.COLUMNS), [rows], [out])
        launch(self.fit, 1, [m[-1], fresh], [self.frames])

    def search(self, at, most: int = tubes.LEAD, begins: int = 0) -> None:
        """Makes the list, by what `at` holds, for so many substeps at most. begins 1: before the substep is solved."""
        launch, s, f = self.model.launch, self.surfaces, self.frames
        self.move(at, 1)
        launch(self.axes, len(s.points), [s.data, at, most, self.words], [f])
        self._boxes()
        self.pairs.count.zero_()
        for tree in filter(None, self.trees):
            tree.refit()
        for kind, first, n, k in self._searches():
            start = wp.vec2i(first, self.spans[k][1].start)
            if over := self.trees[k]:
                launch(self.reach, n, [s.data, f, kind, start, over.id, self.root[k], s.thickness], [self.pairs])
        launch(self.listed, 1, [self.pairs.count, begins], [f, self.words])

    def look(self, at, stop: int = 0) -> None:
        """Looks whether points are in their tubes where the substep ends."""
        self.model.launch(self.watch, len(self.surfaces.points), [self.surfaces.data, at, self.frames, stop],
                          [self.sums, self.words])
