"""Sparse systems over points: their structure, from who touches whom, and their solution. See kernels/solver/pcg.py.

    springs     (m, 2) points of each spring; row i of the system has an entry for each spring end at point i
    spans       `wsim.physics.cloth.curvature.Spans` or None: row i has a block for each other point that a curvature depends on
                with i
    elements    (m, k) each, triangles and tets say, which leave a block of each pair of their points (0 1), (0 2) .. (1 2) ..
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.cloth.hessian import TURNED, WHOLE
from wsim.kernels.math.block import BLOCK
from wsim.kernels.math.real import types
from wsim.kernels.solver import newton, pcg
from wsim.model.model import Model, PointBody

FUSE = {"cuda": 1500, "cpu": 2**31}     # points up to which one block solves a body. H200, 4 x 1: 4k points by one block
                                        # 12.5 ms a frame, 10k points by several 5.4; 1k points by one 2.0
CHUNKS = 512           # blocks of a larger body, at most: each sums what all have found
EACH = 4               # iterations between two looks at whether some body goes on; even
EACH_COARSE = 2        # of those with a coarse space, which are few and long
STRICT = 0.25          # their tolerance over that of block Jacobi, which leaves less at the same: 5 times less residual force


@dataclass
class SpringEntries:
    """Springs by point: entries first[i] .. first[i + 1] of point i, each with the `other` end and the spring's number."""

    first: np.ndarray
    other: np.ndarray
    number: np.ndarray


def spring_entries(springs: np.ndarray, n: int) -> SpringEntries:
    """Springs of each of n points, ascending."""
    first, number = topology.incident_rows(springs, n)
    own = np.repeat(np.arange(n), np.diff(first))
    return SpringEntries(first, springs[number].sum(axis=1) - own, number)


@dataclass
class PointBlocks:
    """Blocks by point, and what each is the sum of.

    first, column     blocks first[i] .. first[i + 1] of point i, each with its other point
    part, item        items part[b] .. part[b + 1] of block b: first rows of J of two spans (3 span), or of an
                      element's block (pairs element + pair, one kind after the other) and WHOLE or TURNED
    corner, pull      places pull[corner[i] .. corner[i + 1]] of the corners at point i: 4 hinge + corner, then elements
    """

    first: np.ndarray
    column: np.ndarray
    part: np.ndarray
    item: np.ndarray
    corner: np.ndarray
    pull: np.ndarray


def pairs_within_groups(group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (a, b), a != b, of the members of each group; group (m,) ascends."""
    first = np.searchsorted(group, group)
    size = np.searchsorted(group, group, side="right") - first
    a = np.repeat(np.arange(len(group)), size)
    b = first[a] + np.arange(len(a)) - np.repeat(np.cumsum(size) - size, size)
    return a[a != b], b[a != b]


def point_blocks(hinges: np.ndarray, spans: Any, elements: list[np.ndarray], n: int) -> PointBlocks:
    """Blocks of n points; their items in the order spans, elements, ascending. hinges (h, 4): whose corners have forces."""
    keys, items, begin = [np.zeros(0, np.int64)], [np.zeros((0, 2), np.int64)], 0
    if spans:
        both = np.stack(pairs_within_groups(spans.triangle), axis=1)
        keys.append(spans.point[both[:, 0]] * n + spans.point[both[:, 1]])
        items.append(3 * both)
    for ids in elements:
        every, pairs = np.arange(len(ids)), {pair: k for k, pair in enumerate(combinations(range(ids.shape[1]), 2))}
        for a, b in permutations(range(ids.shape[1]), 2):
            keys.append(ids[:, a].astype(np.int64) * n + ids[:, b])
            items.append(np.stack([begin + len(pairs) * every + pairs[min(a, b), max(a, b)],
                                   np.full(len(ids), WHOLE if a < b else TURNED)], axis=1))
        begin += len(pairs) * len(ids)
    key, item = np.concatenate(keys), np.concatenate(items)
    order = topology.order_of(key)
    key, item = key[order], item[order]
    new = np.flatnonzero(np.r_[np.ones(min(len(key), 1), bool), key[1:] != key[:-1]])
    first = np.searchsorted(key[new], np.arange(n + 1, dtype=np.int64) * n)
    corner, pull = topology.incident_rows(np.concatenate([ids.ravel() for ids in (hinges, *elements)])[:, None], n)
    return PointBlocks(first, key[new] % n, np.r_[new, len(key)], item, corner, pull)


class System:
    """A y = f over the points of all bodies, each body a system of its own, or each world (`Model.starts`). joined: what makes
    one of all bodies of a world where their surfaces are near each other."""

    joined: Any = None                   # `wsim.physics.contact.selfcontact.rows.newton_rows.NewtonContactRows`

    def __init__(self, model: Model, w: wp.array, springs: np.ndarray, hinges: np.ndarray, elements: list[np.ndarray],
                 coarse: Sequence[PointBody] = (), spans: Any = None, schwarz: bool = False):
        """w: inverse masses [1/kg]; the others as above, empty (0, k) where there are none. coarse: bodies with a coarse
        space; schwarz: all are solved by domains (`wsim.physics.solver.schwarz`)."""
        self.model, n, t, s = model, model.points, types(model.real), newton.newton_structs(model.real)
        self.rows, self.A, self.v = s.Rows(), s.Matrix(), pcg.pcg_vectors(model.real)()
        self.rows.w = w
        if len(springs):
            e = spring_entries(springs, n)
            self.put(self.rows, spring=e.first, other=e.other, number=e.number)
            self.A.link = self.zeros(len(e.other), t.vec4)
        paired = len(hinges) + sum(map(len, elements)) > 0
        if paired:
            b = point_blocks(hinges, spans, elements, n)
            self.put(self.rows, pair=b.first, column=b.column, part=b.part, corner=b.corner, pull=b.pull)
            self.rows.item = model.upload(b.item.astype(np.int32), wp.vec2i)
            self.A.block = self.zeros(len(b.column), t.mat33)
        self.coarse = self.schwarz = self.cluster = None
        if schwarz:
            from wsim.physics.solver.schwarz.solver import Schwarz
            self.schwarz = Schwarz(model, b.first, b.column)
        if coarse:
            from wsim.physics.solver.coarse_space import CoarseMultigrid
            self.coarse = CoarseMultigrid(model, coarse, max(e.shape[1] for e in elements), b.first, b.column)
        self.A.own, self.A.P, self.A.aside = self.zeros(n, t.scalar), self.zeros(n, t.mat33), self.zeros(1, t.scalar)
        for name in "yrzwps":
            setattr(self.v, name, self.zeros(n, t.vec3))
        self.starts, self.systems = model.starts, len(model.starts) - 1
        self.first = self.rows.first = model.upload(self.starts.astype(np.int32), int)
        self.of = model.upload(np.repeat(np.arange(self.systems), np.diff(self.starts)).astype(np.int32), int)
        self.drop, self.count = self.zeros(self.systems, wp.float64), self.zeros(self.systems, int)
        own = self.coarse.module if self.coarse else model.sweep_module
        kinds = model.real, model.step or own, len(springs) > 0, paired
        if paired and model.device.is_cuda and not (len(springs) or coarse or schwarz):
            from wsim.physics.motion.fused.conjugate import pcg_cluster_for
            one = self.systems // model.worlds                     # of a world, whose bits do not depend on how many there are
            self.cluster = pcg_cluster_for(model, int(np.diff(self.starts).max()), one, int(np.diff(b.first).max()))
        self.large = bool(coarse) or int(np.diff(self.starts).max()) > FUSE["cuda" if model.device.is_cuda else "cpu"]
        if self.schwarz:
            pass                                       # has kernels of its own
        elif self.cluster:
            from wsim.kernels.motion.fused.conjugate import cluster_pcg_kernel
            self.kernel = cluster_pcg_kernel(model.real, model.module_of(self.cluster.threads), self.cluster)
        elif self.large:
            self.kernels, self.chunks = pcg.pcg_chunk_kernels(*kinds, bool(coarse)), self.cut(self.starts)
        else:
            self.kernel = pcg.pcg_body_kernel(*kinds)

    def zeros(self, shape, dtype) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self.model.device)

    def put(self, struct, **values: np.ndarray) -> None:
        for name, array in values.items():
            setattr(struct, name, self.model.upload(array.astype(np.int32), int))

    def cut(self, starts: np.ndarray):
        """Systems that start there, in chunks of points, each for a block."""
        model, chunks = self.model, pcg.Chunks()
        sizes = np.diff(starts)
        each = -(-sizes // np.maximum(BLOCK, -(-sizes // CHUNKS)))
        body, own = np.repeat(np.arange(len(sizes)), each), np.r_[0, np.cumsum(each)]
        first = starts[body] + sizes[body] * (np.arange(len(body)) - own[body]) // each[body]
        self.put(chunks, body=body, first=np.r_[first, model.points], own=own)
        chunks.gamma, chunks.delta = self.zeros((2, len(body)), wp.float64), self.zeros(len(body), wp.float64)
        chunks.last, chunks.done = self.zeros((2, len(sizes)), wp.vec4d), self.zeros((2, len(sizes)), int)
        chunks.going = self.zeros(1, int)
        return chunks

    def solve(self, f: wp.array, tolerance: float, cap: int, at: tuple = (), A=None) -> None:
        """Launches conjugate gradients: v.y becomes A^-1 f; see `pcg.pcg_body_kernel` for drop and count. at: positions and
        displacements (points,) of A, for the coarse space. A: a `Matrix`, None: that of the system."""
        A = self.A if A is None else A
        if self.joined:
            self.joined.when_near(lambda: self.joined.solve_joined(A, f, tolerance, cap),
                                  lambda: self.alone(A, f, tolerance, cap, at))
        else:
            self.alone(A, f, tolerance, cap, at)

    def alone(self, A, f: wp.array, tolerance: float, cap: int, at: tuple) -> None:
        """Each system by itself."""
        if self.schwarz:
            self.schwarz.setup(self.rows, A, *at)
            self.schwarz.solve(self.rows, A, f, tolerance, cap, self.v, self.drop, self.count)
            return
        if self.cluster:
            self.model.launch_blocks(self.kernel, self.systems * self.cluster.size, self.cluster.threads,
                                     [self.rows, A, f, tolerance, cap, self.v], [self.drop, self.count])
            return
        if not self.large:
            self.launch(self.kernel, [self.rows, A, f, tolerance, cap, self.v], [self.drop, self.count])
            return
        c, size = self.chunks, self.chunks.body.size

        def iterate_chunk_cg() -> None:
            for k in range(EACH_COARSE if self.coarse else EACH):
                self.launch(self.kernels.multiply, [c, self.rows, A, k % 2, self.v], [], size)
                self.launch(self.kernels.advance, [c, A, tolerance, cap, k % 2, self.v], [self.drop, self.count], size)
                self.correct(1 - k % 2)
        if self.coarse:
            tolerance *= STRICT
            self.coarse.setup(self.rows, A, *at)
        self.launch(self.kernels.start, [c, A, f, self.v], [self.drop], size)
        self.correct(0)
        wp.capture_while(c.going, iterate_chunk_cg)

    def correct(self, side: int) -> None:
        """z gets its part of the coarse space, row `side` of gamma its part of r.z."""
        if self.coarse:
            c = self.chunks
            self.coarse.cycle(c.going, self.v.r, self.launch)
            self.launch(self.coarse.blocks.prolong, [c, self.coarse.g, side, self.v], [], c.body.size)

    def launch(self, kernel, inputs: list, outputs: list, count: int = 0) -> None:
        """A block of threads for each body, or `count` blocks; on the CPU a thread for each."""
        model, count = self.model, count or self.systems
        if model.device.is_cuda:
            wp.launch(kernel, count * BLOCK, inputs, outputs, device=model.device, block_dim=BLOCK)
        else:
            wp.launch(kernel, count, inputs, outputs, device=model.device)
