"""The projection of a velocity: its divergence, the pressure by conjugate gradients with a multigrid cycle or, in a box without
obstacles, a direct solve; sealed regions."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid import conjugate, pressure
from wsim.kernels.fluid.conjugate import CHECK, START, STEP, TURN
from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.solver import islands, regions
from wsim.kernels.fluid.solver.divergence import divergence_kernel
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.direct import Direct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES, PressureMultigrid
from wsim.physics.fluid.grid.obstacles import FluidObstacles
from wsim.physics.fluid.grid.threads import Threads

MOST = 60                # iterations: the residual falls tenfold in each
AGAIN = 6                # of a direct solve: it falls by as much as numbers have digits


class Conjugate:
    """Numbers and loop of conjugate gradients on the device. words: of the status, once there are some; what: of "solves"
    (iterations of a frame, most of one solve) or another word; "missed": solves that were left with a larger residual."""

    def __init__(self, threads: Threads, size: int, words: dict[str, wp.array], what: str = "solves"):
        real, module = threads.model.real, threads.module
        self.threads, self.words, self.what, self.parts = threads, words, what, threads.blocks(size)
        self.dot, self.advance = conjugate.grid_dot_kernel(real, module), conjugate.grid_cg_kernel(real, module)
        self.turn = conjugate.grid_direction_kernel(real, module)
        self.conclude_kernel = conjugate.grid_scalars_kernel(module)
        self.part = threads.zeros(self.parts, wp.vec2d)
        self.numbers = threads.zeros(conjugate.NUMBERS, wp.float64)
        self.going = threads.zeros(1, int)

    def conclude(self, what: int, tolerance: float = 0.0, cap: int = MOST) -> None:
        self.threads.sum(self.conclude_kernel, 1, [self.part, what, wp.float64(tolerance), cap],
                         [self.numbers, self.going, self.words[self.what], self.words["missed"]])

    def sum(self, a: wp.array, b: wp.array) -> None:
        self.threads.sum(self.dot, self.parts, [a, b], [self.part])

    def step(self, x: wp.array, r: wp.array, p: wp.array, w: wp.array) -> None:
        """x and r along p, whose product w and its sum are there."""
        self.conclude(STEP)
        self.threads.sum(self.advance, self.parts, [self.numbers, p, w], [x, r, self.part])


class PressureProjection:
    """obstacles: None where there are none. work: arrays of at least as many rows as there are cells, which others use in turn;
    with "free" among them the solve is direct. region: numbers of the sealed regions, (cells,), -1: none; None: all one."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, obstacles: FluidObstacles | None,
                 expansion: wp.array | None, work: dict[str, wp.array], words: dict[str, wp.array]):
        real, module, dim = threads.model.real, threads.module, layout.dim
        self.threads, self.layout, self.grid, self.none = threads, layout, grid, fill_struct(grid_structs(real).Faces)
        open = obstacles.open if obstacles else None
        fractions, moving = obstacles is not None, obstacles is not None and obstacles.moving
        self.open, self.expansion = open or self.none, expansion
        self.solid = obstacles.solid if obstacles and obstacles.moving else self.none
        forming = obstacles is not None and "forming" in obstacles.shapes.kinds
        self.p, self.r, self.z, self.d, self.w = (work[name][:layout.cells] for name in ("p", "r", "z", "d", "w"))
        self.low, self.high = types(real).vec3(*layout.low), types(real).vec3(*layout.high)
        self.divergence = divergence_kernel(dim, fractions, moving, expansion is not None, forming, real, module)
        self.multiply = (conjugate.refinement_kernel if "free" in work else conjugate.pressure_product_kernel)(dim, fractions,
                                                                                                               real, module)
        self.project_kernels = [pressure.projection_kernel(dim, a, fractions, moving, real, module) for a in range(dim)]
        self.multigrid = PressureMultigrid(threads, layout, open, self.z, self.r, "free" not in work)
        self.direct = Direct(threads, layout, self.z, self.r, (self.w, work["free"])) if "free" in work else None
        self.solver = Conjugate(threads, layout.cells, words)
        self.tolerance = 1e-4
        self.sealed = int(layout.sealed)                       # regions
        self.region: wp.array | None = None
        self.bodies: Any = None                                # that it pushes (`wsim.physics.fluid.grid.floating`)
        self.gather, self.level = (make(fractions, real, module)
                                   for make in (regions.region_sum_kernel, regions.region_level_kernel))
        self.mean_kernel = regions.region_mean_kernel(module)
        self.inside = regions.open_region_kernel(dim, real, module) if moving and layout.sealed else None
        self.sums = threads.zeros(self.solver.parts, wp.vec2d)
        self.islands = Islands(threads, layout, False) if moving else None

    def set_sealed_regions(self, region: wp.array | None, count: int) -> None:
        """Regions of cells that are sealed from open sides, known before the first frame."""
        self.region, self.sealed = region, count
        self.multigrid.sealed = count == 1

    def find_region(self) -> None:
        """Finds the regions that obstacles seal which move; and in a sealed box all cells with an open face, as one."""
        table = self.multigrid.grids[0].table
        if self.inside:
            self.threads.over(self.inside, self.layout.cells, [table], [self.region])
        if self.islands and not self.bodies:                   # bodies that give way leave no region shut
            self.islands.find(table)

    def _level(self) -> None:
        """What the right-hand side sums to in sealed regions, off."""
        if self.islands and not self.bodies:
            self.solver.sum(self.r, self.r)
            self.islands.level(self.r, self.solver.part)
        for k in range(self.sealed):
            self.threads.sum(self.gather, self.solver.parts, [self.region, k, self.r], [self.sums])
            self.threads.sum(self.mean_kernel, 1, [self.sums, int(self.sealed == 1)], [self.solver.numbers])
            self.threads.over(self.level, self.layout.cells, [self.region, k, self.solver.numbers], [self.r])

    def solve(self, u: Any) -> None:
        """The pressure p that takes the divergence off u, and moves bodies."""
        if self.bodies:
            self.bodies.rates()
        self.threads.over(self.divergence, self.layout.cells, [self.grid, u, self.open, self.solid, self.expansion,
                                                                 self.multigrid.grids[0].table], [self.r])
        self.find()
        if self.bodies:
            self.bodies.push(self.p)

    def find(self) -> None:
        """The pressure p of the right-hand side r, which becomes what is left of it."""
        self._level()
        if not self.direct:
            self.p.zero_()
        self.solver.sum(self.r, self.r)
        self.solver.conclude(START, self.tolerance)
        if self.direct:
            self._direct_step()                                # almost always enough, and a loop costs a graph some us
        wp.capture_while(self.solver.going, self._direct_step if self.direct else self._iterate)

    def _direct_step(self) -> None:
        s = self.solver
        if self.direct:
            self.direct.cycle()                                # of r into z
        self.threads.sum(self.multiply, s.parts, [self.multigrid.grids[0].table, self.z, s.numbers], [self.p, self.r, s.part])
        s.conclude(CHECK, self.tolerance, AGAIN)

    def _iterate(self) -> None:
        s, threads = self.solver, self.threads
        self.multigrid.cycle()                                 # of r into z
        s.sum(self.r, self.z)
        s.conclude(TURN)
        threads.over(s.turn, self.layout.cells, [s.numbers, self.z], [self.d])
        threads.sum(self.multiply, s.parts, [self.multigrid.grids[0].table, self.d], [self.w, s.part])
        if self.bodies:
            self.bodies.add(self.d, self.w)
            s.sum(self.d, self.w)
        s.step(self.p, self.r, self.d, self.w)
        s.conclude(CHECK, self.tolerance)

    def project(self, u: Any, out: Any) -> None:
        """u without what p pushes, into `out`, which may be u."""
        for a, kernel in enumerate(self.project_kernels):
            o, s, now, new = (getattr(f, AXES[a]) for f in (self.open, self.solid, u, out))
            self.threads.over(kernel, now.size, [self.grid, self.low, self.high, self.p, o, s, now], [new])


class Islands:
    """Sealed regions that change, found in each step: a wall that moves parts a box in two, a liquid fills what is closed."""

    def __init__(self, threads: Threads, layout: Layout, free: bool):
        """free: of a liquid."""
        real, module, n = threads.model.real, threads.module, layout.cells
        self.threads, self.cells = threads, n
        self.find_kernels, self.level_kernels = (islands.island_finder_kernels(layout.dim, free, real, module),
                                                 islands.island_level_kernels(real, module))
        arrays = {name: threads.zeros(n, int) for name in ("parent", "label", "vented", "count")}
        self.forest = fill_struct(islands.Forest, sum=threads.zeros(n, wp.int64), **arrays)
        self.scale = threads.zeros(1, wp.float64)

    def find(self, table: wp.array) -> None:
        """Regions of the openings of a level of the multigrid solver, the finest."""
        k = self.find_kernels
        for kernel in (k.plant, k.join, k.settle):
            self.threads.over(kernel, self.cells, [table, self.forest], [])

    def level(self, b: wp.array, part: wp.array) -> None:
        """What b sums to in each sealed region, off. part: sums of b.b of blocks."""
        k, over = self.level_kernels, self.threads.over
        self.threads.sum(k.scale, 1, [part, self.cells], [self.scale])
        over(k.clear, self.cells, [self.forest], [])
        over(k.gather, self.cells, [b, self.scale, self.forest], [])
        over(k.level, self.cells, [self.forest, self.scale], [b])


def label_sealed_regions(layout: Layout, openings: list[np.ndarray]) -> tuple[np.ndarray, int]:
    """Sealed regions of openings of the faces of each axis: number of each cell, (cells,), -1 where it is none's, and how many
    there are. NumPy; a region is sealed where no face of it is an open side's."""
    from wsim.geometry.topology import labels_of_islands as joined
    index = np.arange(layout.cells).reshape(layout.n)
    edges, vented, used = [], np.zeros(layout.cells, bool), np.zeros(layout.cells, bool)
    for a, o in enumerate(openings):
        face = o.reshape(layout.faces(a)) > 0.0
        if layout.periodic[a]:
            pairs = np.stack([np.roll(index, 1, a)[face], index[face]], 1)
        else:
            inner = np.take(face, range(1, layout.n[a]), a)
            pairs = np.stack([np.delete(index, -1, a)[inner], np.delete(index, 0, a)[inner]], 1)
            for side, factor in ((0, layout.low[a]), (layout.n[a], layout.high[a])):
                if factor > 0.0:
                    vented[np.take(index, min(side, layout.n[a] - 1), a)[np.take(face, side, a)]] = True
        edges.append(pairs)
    every = np.concatenate(edges)
    used[every.ravel()] = True
    used |= vented
    whole = joined(layout.cells, every)
    open_ = np.unique(whole[vented])
    shut = np.unique(whole[used & ~np.isin(whole, open_)])
    found = np.full(layout.cells, -1, np.int32)
    hit = np.isin(whole, shut) & used
    found[hit] = np.searchsorted(shut, whole[hit])
    return found, len(shut)
