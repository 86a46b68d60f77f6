"""The coarse space of large stiff bodies: which nodes there are, and the cycle of launches. Kernels: coarse_space.py,
coarse_cycle.py.

Points of a body stand in boxes of about CELLS edges a side; those of a box that the mesh joins there are a node. Boxes of
nodes, FACTOR a side, make the next level, until no node has a neighbour.

It pays where many iterations are saved. A sound wave passes kappa = h c / edge points in a step, c^2 = (lam + 2 mu) / rho,
and block Jacobi takes about 5 kappa iterations to 1e-2, as far as the body is kappa points long (cubes of 16^3 to 32^3 cells,
bars of 64 x 8 x 8, h 1/60 and 1/240 s: 4.3 to 5.4 kappa; with the coarse space 12 to 21 for the same error).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.math.block import BLOCK
from wsim.kernels.math.real import types
from wsim.kernels.solver import coarse_cycle as cycle
from wsim.kernels.solver import coarse_space as kernels
from wsim.model.model import Model, PointBody

CELLS = 4.0            # edges a side of the first boxes. 32^3 cells, h 1/60 s: 14 iterations with 4, 3, 15 with 5; 108 of none
FACTOR = 2             # boxes a side that make one of the next level. 3: 17 iterations for 14, for one level less
EDGE = 0.87            # of the mean distance to neighbours: the edge of a cube that is cut in five tets
DAMPED = 0.9           # of the largest omega that is sure to be stable
SMALL = {"cuda": 64, "cpu": 2**31}      # nodes of a body in a level up to which one block goes on to the last
# (points of a body from which on, least kappa), more points last. CPU: 25k tets, kappa 9.9: 45 iterations or 17, equal time;
# 164k tets, kappa 18.7: 88 or 21, 1.3 times as fast; 976k tets, kappa 33.8: 217 or 24, 1.8 times. H200: a cycle is a dozen
# launches; 205k points, kappa 33.8: 174 iterations or 27, 25 ms or 17; 42k points, 19.8: 94 or 21, 4.4 ms or 5.2
PAYS = {"cuda": ((150_000, 14.0),), "cpu": ((3_000, 12.0),)}
THREADS = 64           # of a block


@dataclass
class CoarseLevel:
    """Nodes of one level; those of one system stand together, in the order of the systems.

    of        node of each point, or of each node of the level below; -1: none
    place     the point where a node is: its member nearest to the mean of all
    span      first node of each system, and their number, (systems + 1,)
    first, column     blocks first[K] .. first[K + 1] of node K, each with its other node
    part, pair        items part[b] .. part[b + 1] of block b: (block below, its row)
    """

    of: np.ndarray
    place: np.ndarray
    span: np.ndarray
    first: np.ndarray
    column: np.ndarray
    part: np.ndarray
    pair: np.ndarray

    @property
    def size(self) -> int:
        return len(self.place)

    @property
    def most(self) -> int:
        """Nodes of the largest system."""
        return int(np.diff(self.span).max())


def smallest_reached_rows(group: np.ndarray, first: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Smallest row that each row reaches through rows of its group, (n,), in the graph of rows first, column."""
    owner = np.repeat(np.arange(len(group)), np.diff(first))
    inside = group[owner] == group[column]
    owner, column = owner[inside], column[inside]
    label = np.arange(len(group))
    starts = np.flatnonzero(np.r_[True, owner[1:] != owner[:-1]]) if len(owner) else owner
    while len(owner):
        new = label.copy()
        rows = owner[starts]
        new[rows] = np.minimum(label[rows], np.minimum.reduceat(label[column], starts))
        new = new[new]
        if (new == label).all():
            break
        label = new
    return label


def edge_of(places: np.ndarray, system: np.ndarray, first: np.ndarray, column: np.ndarray, systems: int) -> np.ndarray:
    """Length of an edge [m] of each system, (systems,); 1 where there are none."""
    owner = np.repeat(np.arange(len(places)), np.diff(first))
    inside = system[owner] >= 0
    owner, column = owner[inside], column[inside]
    length = np.linalg.norm(places[owner] - places[column], axis=1)
    count = np.bincount(system[owner], minlength=systems)
    mean = np.bincount(system[owner], length, systems) / np.maximum(count, 1)
    return np.where((count > 0) & (mean > 0.0), EDGE * mean, 1.0)


def coarse_levels(places: np.ndarray, system: np.ndarray, first: np.ndarray, column: np.ndarray,
                  systems: int) -> list[CoarseLevel]:
    """All levels over points at `places` [m], (n, 3), of `system` (n,), -1: in no node; first, column: who shares a block."""
    wanted = system >= 0
    low, high = np.full((systems, 3), np.inf), np.full((systems, 3), -np.inf)
    np.minimum.at(low, system[wanted], places[wanted])
    np.maximum.at(high, system[wanted], places[wanted])
    extent = np.where(high >= low, high - low, 0.0)
    edge = edge_of(places, system, first, column, systems)[:, None]
    boxes = np.maximum(1, np.round(extent / (CELLS * edge))).astype(np.int64)
    share = (places - low[system]) / np.maximum(extent[system], 1e-300)
    box = np.clip((share * boxes[system]).astype(np.int64), 0, boxes[system] - 1)
    found: list[CoarseLevel] = []
    place = np.arange(len(places))
    while True:
        level, member = _coarse_level(places, place, system, box, first, column, systems)
        found.append(level)
        if not len(level.column):
            return found
        fewer = -(-boxes // FACTOR)
        box = box[member] * fewer[system[member]] // boxes[system[member]]
        place, system, first, column, boxes = level.place, system[member], level.first, level.column, fewer


def _coarse_level(places, place, system, box, first, column, systems: int) -> tuple[CoarseLevel, np.ndarray]:
    """One level over rows at places[place], and a row of each node."""
    wide = box.max(axis=0) + 1
    group = np.where(system >= 0, ((system * wide[0] + box[:, 0]) * wide[1] + box[:, 1]) * wide[2] + box[:, 2], -1)
    label = smallest_reached_rows(group, first, column)
    n, rows = len(place), np.flatnonzero(group >= 0)
    order = np.lexsort((label[rows], group[rows]))
    rows = rows[order]
    new = np.r_[True, (group[rows][1:] != group[rows][:-1]) | (label[rows][1:] != label[rows][:-1])]
    of = np.full(n, -1, np.int64)
    of[rows] = np.cumsum(new) - 1
    nodes = int(new.sum())
    x = places[place]
    total = np.stack([np.bincount(of[rows], x[rows, k], nodes) for k in range(3)], axis=1)
    mean = total / np.bincount(of[rows], minlength=nodes)[:, None]
    away = ((x[rows] - mean[of[rows]])**2).sum(axis=1)
    nearest = np.lexsort((rows, away, of[rows]))
    middle = rows[nearest[np.searchsorted(of[rows][nearest], np.arange(nodes))]]
    span = np.searchsorted(system[middle], np.arange(systems + 1))
    owner = np.repeat(np.arange(n), np.diff(first))
    J = of[column]
    K = of[owner]
    across = np.flatnonzero((K >= 0) & (J >= 0) & (K != J))
    key = K[across] * nodes + J[across]
    sort = topology.order_of(key)
    across, key = across[sort], key[sort]
    begin = np.flatnonzero(np.r_[np.ones(min(len(key), 1), bool), key[1:] != key[:-1]])
    start = np.searchsorted(key[begin], np.arange(nodes + 1, dtype=np.int64) * nodes)
    return CoarseLevel(of, place[middle], span, start, key[begin] % nodes, np.r_[begin, len(key)],
                       np.stack([across, owner[across]], axis=1)), middle


def wants_coarse_space(model: Model, h: float) -> tuple[list[PointBody], str]:
    """Soft bodies that a step of h [s] makes stiff and large enough, and what they are solved by and why, in words."""
    found, rows, said = [], PAYS["cuda" if model.device.is_cuda else "cpu"], []
    for body in (b for b in model.bodies if len(b.tets)):
        kappa, enough = sound_wave_edges(body, h), [least for points, least in rows if body.count >= points]
        if enough and kappa >= enough[-1]:
            found.append(body)
        if body.world == 0:
            said.append((bool(enough) and kappa >= enough[-1], kappa, enough[-1] if enough else 0.0))
    coarse, kappa, least = max(said, default=(False, 0.0, 0.0))
    words = f"a wave passes {kappa:.3g} points a step"
    if coarse:
        return found, f"multigrid, since {words}"
    return found, f"block Jacobi, since {words}, under {least:g}" if least else f"block Jacobi, under {rows[0][0]} points"


def sound_wave_edges(body, h: float) -> float:
    """kappa of a soft body: edges that a sound wave passes in h [s], at most all there are."""
    p = body.rest[body.edges - body.first]
    edge = EDGE * float(np.linalg.norm(p[:, 1] - p[:, 0], axis=1).mean())
    speed = max(((1.0 - m.poisson) / ((1.0 + m.poisson) * (1.0 - 2.0 * m.poisson)) * m.young / m.density)**0.5
                for m in body.source.materials)
    return min(h * speed, float(np.ptp(body.rest, axis=0).max())) / edge


class CoarseMultigrid:
    """Tables and launches. bodies: those that have nodes; corners: of the largest element; first, column: blocks of points."""

    def __init__(self, model: Model, bodies: Sequence[PointBody], corners: int, first: np.ndarray, column: np.ndarray):
        self.model, starts = model, model.starts
        system = np.full(model.points, -1, np.int64)
        for b in bodies:
            system[np.unique(model.shared(b.tets))] = model.system(b.number)
        places = np.concatenate([b.places + b.origin for b in model.bodies])
        self.levels = coarse_levels(places, system, first, column, len(starts) - 1)
        self.node = np.r_[0, np.cumsum([level.size for level in self.levels])]           # first of each level
        self.block = np.r_[0, np.cumsum([len(level.column) for level in self.levels])]
        self.g = self.table(DAMPED * 2.0 / corners)
        span = np.concatenate([level.span[:-1] + at for level, at in zip(self.levels, self.node, strict=False)])
        self.span = model.upload(np.r_[span, self.node[-1]].astype(np.int32), int)
        most = SMALL["cuda" if model.device.is_cuda else "cpu"]
        self.fused = next((k for k, level in enumerate(self.levels) if level.most <= most), len(self.levels))
        cuda = model.device.is_cuda
        own = f"{model.module}_multigrid" if cuda else f"wsim_multigrid_{types(model.real).name}"     # as `Model.step`
        thin, thick = own, own + "_blocks" * cuda
        model.modules[thin] = THREADS if cuda else 1
        model.modules[thick] = BLOCK if cuda else 1
        self.setups, self.steps, self.blocks = (kernels.coarse_setup_kernels(model.real, thin),
                                                cycle.level_cycle_kernels(model.real, thin),
                                                cycle.small_cycle_kernels(model.real, thick))
        self.module = thick

    def table(self, omega: float):
        """The struct of all levels on the device."""
        model, t, vec6 = self.model, types(self.model.real), wp.types.vector(6, self.model.real)
        g, nodes, blocks = kernels.coarse_spaces(model.real)(), int(self.node[-1]), int(self.block[-1])
        below = [0, *self.node[:-2]]
        child = [topology.incident_rows(np.maximum(level.of, 0)[:, None], level.size) for level in self.levels]
        if (self.levels[0].of < 0).any():
            inside = np.flatnonzero(self.levels[0].of >= 0)
            begin, item = topology.incident_rows(self.levels[0].of[inside][:, None], self.levels[0].size)
            child[0] = begin, inside[item]
        parts, items = np.r_[0, np.cumsum([len(v.pair) for v in self.levels])], np.r_[0, np.cumsum([len(c[1]) for c in child])]

        def upload_node_rows(name: str, values: list, more: tuple = (), dtype=int) -> None:
            setattr(g, name, model.upload(np.concatenate([*values, *more]).astype(np.int32), dtype))
        each = list(zip(self.levels, self.node, self.block, strict=False))
        upload_node_rows("node", [self.levels[0].of])
        upload_node_rows("parent", [level.of + at for level, at in zip(self.levels[1:], self.node[1:], strict=False)],
                         (np.full(self.levels[-1].size, -1),))
        upload_node_rows("place", [level.place for level in self.levels])
        upload_node_rows("first", [c[0][:-1] + at for c, at in zip(child, items, strict=False)], ([items[-1]],))
        upload_node_rows("child", [c[1] + at for c, at in zip(child, below, strict=True)])
        upload_node_rows("row", [level.first[:-1] + b for level, _, b in each], ([blocks],))
        upload_node_rows("owner", [np.repeat(np.arange(level.size), np.diff(level.first)) + n for level, n, _ in each])
        upload_node_rows("column", [level.column + n for level, n, _ in each])
        upload_node_rows("part", [level.part[:-1] + at for level, at in zip(self.levels, parts, strict=False)], ([parts[-1]],))
        lower = [(0, 0), *zip(self.block[:-2], self.node[:-2], strict=True)]
        upload_node_rows("pair", [level.pair + at for level, at in zip(self.levels, lower, strict=True)], (), wp.vec2i)
        g.arm = wp.zeros(model.points, dtype=t.vec3, device=model.device)
        g.S = wp.zeros(model.points, dtype=t.mat33, device=model.device)
        for name, count in (("A", blocks), ("share", model.points), ("D", nodes), ("inverse", nodes), ("Q", nodes)):
            setattr(g, name, wp.zeros(6 * count, dtype=vec6, device=model.device))
        for name in "ret":
            setattr(g, name, wp.zeros(6 * nodes, dtype=model.real, device=model.device))
        g.omega = omega
        return g

    def launch(self, kernel, dim: int, inputs: list) -> None:
        if not dim:
            return
        wp.launch(kernel, dim, inputs, device=self.model.device, block_dim=THREADS if self.model.device.is_cuda else 256)

    def setup(self, rows, A, x: wp.array, d: wp.array) -> None:
        """Launches the matrices of the levels at displacements d."""
        k, g = self.setups, self.g
        self.launch(k.arms, self.model.points, [A, x, d, g])
        self.launch(k.shares, 6 * self.model.points, [rows, A, g])
        for n, level in enumerate(self.levels):
            K, b, blocks = int(self.node[n]), int(self.block[n]), len(level.column)
            self.launch(k.own_nodes if n else k.own_points, 6 * level.size, [K, g])
            self.launch(k.pairs_nodes if n else k.pairs_points, 6 * blocks, [b, *([] if n else [rows, A]), g])
            self.launch(k.factor, level.size, [K, x, d, g])
            below = self.levels[n - 1].size if n else 0
            self.launch(k.scale, blocks + below, [b, blocks, int(self.node[n - 1]) if n else 0, g])

    def cycle(self, going: wp.array, r: wp.array, blocks) -> None:
        """Launches t = B r; blocks: `System.launch`."""
        k, g, last = self.steps, self.g, len(self.levels) - 1
        sizes, at = [6 * level.size for level in self.levels], [int(K) for K in self.node]
        for n in range(self.fused):
            self.launch(k.down if n else k.gather, sizes[n], [at[n], going, *([] if n else [r]), g])
            if n < last:
                self.launch(k.residual, sizes[n], [at[n], going, g])
        if self.fused <= last:
            blocks(self.blocks.small, [self.fused, last + 1, self.span, going, r, g], [])
        for n in reversed(range(min(self.fused, last))):
            self.launch(k.up, sizes[n], [at[n], going, g])
            self.launch(k.post, sizes[n], [at[n], going, g])
