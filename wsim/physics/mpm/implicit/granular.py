"""Implicit steps of sand on the device: rigid until it flows, whatever the length of the step.

    particles by cell;  cells and corners;  sweeps over cells until the residual is met;  particles

(kernels/particles/mpm/implicit/). The first guess of the stress is that of the step before, which particles carry.
"""

from typing import Any

import warp as wp

import wsim.physics.mpm.grid as explicit
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.granular_sweeps import COLOURS, solve_kernels, sweep_kernels
from wsim.kernels.particles.mpm.implicit.granular_tables import CONTACTS, granular_tables
from wsim.kernels.particles.mpm.implicit.granular_transfers import sand_kernels
from wsim.kernels.particles.mpm.tables import CELLS
from wsim.model.structs import fill_struct

TOLERANCE = 1e-3           # root mean square of the strain of a step that sweeps leave [1]; column, a = 1: run-out 1.795 L0,
                           # with 1e-4 and 400 sweeps 1.796, in a tenth of the time
MOST_SWEEPS = 100          # of a step
GROUP = 10                 # sweeps between looks at the residual
OMEGA = 1.0                # over-relaxation


class GranularGrid(explicit.SparseGrid):
    """A `SparseGrid` of sand alone. Corners of cells lie at multiples of dx, and so on a floor there."""

    shift, waves = 0.5, False

    def _make_kernels(self, laws: tuple[str, ...], kinds: tuple[str, ...]) -> None:
        real, module = self.real, self.module
        self.by_grain = sand_kernels(kinds, real, module)
        self.by_cell, self.by_solve = sweep_kernels(kinds, real, module), solve_kernels(real, module)
        self.walls = bool(kinds)
        self.total, self.sweeps = self.zeros(2, wp.int64), self.zeros(2, int)
        self.sweeping = self.sweeps[:1]
        self.tolerance, self.most, self.omega = TOLERANCE, MOST_SWEEPS, OMEGA

    def make_room(self, blocks: int) -> None:
        super().make_room(blocks)
        t, T, n = types(self.real), granular_tables(self.real), CELLS * blocks
        self.cells = fill_struct(T.SandCells, rule=self.zeros(n, t.vec4), S=self.zeros(n, t.vec3), R=self.zeros(n, t.vec3),
                                 sum=self._table((8, n), t.vec4))
        self.corners = fill_struct(T.SandCorners, v=self.zeros(n, t.vec4), held=self.zeros(n, t.vec3),
                                   free=self.zeros(n, t.vec3), count=self.zeros(n, int))
        shape = (CONTACTS, n if self.walls else 1)
        self.contacts = fill_struct(T.CornerContacts, n=self._table(shape, t.vec4), u=self._table(shape, t.vec4),
                                    gap=self._table(shape, self.real))

    def _table(self, shape: tuple[int, int], dtype: Any) -> Any:
        return wp.zeros(shape, dtype=dtype, device=self.model.device)

    def run_frame(self, dt: float, word: Any) -> None:
        real = self.real
        self.pace.zero_()
        threads = min(self.count, explicit.MEASURERS if self.cuda else 1)
        self.launch(self.by_grain.measure_speed, threads,
                    [self.points, self.materials, real(self.dx), real(dt), threads, self.pace])
        if self.flow:
            self.flow.launch_frame(self)
        self.launch(self.by_step.begin_steps, 1, [real(dt), self.more, self.pace, self.clock, self.going])
        self.run_steps(dt, word)

    def take_step(self, dt: float, word: Any) -> None:
        self.sort_cells(word)
        k, g, points, materials, corners = self.by_grain, self.grid, self.points, self.materials, CELLS * self.blocks
        self.launch(k.sum_corners, 8 * corners, [points, materials, g, self.cells])
        self.launch(k.average_cells, corners, [points, materials, g, self.cells])
        self.launch(k.move_corners, corners,
                    [g, self.cells, materials, self.wall_rows, self.clock, self.corners, self.contacts])
        self.launch(self.by_solve.begin_solve, 1, [self.total, self.sweeps])
        wp.capture_while(self.sweeping, lambda: self.sweep_group(self.solve_word))
        self.launch(k.move_grains, self.count,
                    [g, self.cells, self.corners, self.wall_rows, self.clock, points, word, self.pace])
        self.launch(self.by_step.next_step, 1,
                    [self.real(dt), self.blocks, self.more, self.pace, self.clock, self.going, word])

    def sweep_group(self, word: Any) -> None:
        """Launches some sweeps, and a look at what the last of them has left."""
        real, n = self.real, 8 * self.blocks
        for sweep in range(GROUP):
            self.launch_hold()
            tolerance = self.tolerance if sweep == GROUP - 1 else 0.0
            for color in range(COLOURS):
                self.launch(self.by_cell.sweep_color, n, [self.grid, self.cells, self.corners, color, real(self.omega),
                                                          real(tolerance), self.clock, self.total])
        self.launch_hold()
        self.launch(self.by_solve.check_residual, 1, [GROUP, self.most, self.total, self.sweeps, word])

    def launch_hold(self) -> None:
        """Launches what colliders do to corners."""
        if self.walls:
            self.launch(self.by_cell.hold_corners, CELLS * self.blocks, [self.grid, self.corners, self.contacts, self.clock])
