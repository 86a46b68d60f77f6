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

TOLERANCE = 1e-4           # root mean square of the strain of a step that sweeps leave [1]; with 1e-3 a slope of 29 degrees,
                           # where the angle is 30, slides by 54 mm before it stands; with 1e-4 by 2 mm
MOST_SWEEPS = 200          # of a step
GROUP = 20                 # sweeps between looks at the residual


class GranularGrid(explicit.SparseGrid):
    """A `SparseGrid` of sand alone. Corners of cells lie at multiples of dx, and so on a floor there."""

    shift, waves = 0.5, False

    def _make_kernels(self, laws: tuple[str, ...], kinds: tuple[str, ...]) -> None:
        real, module = self.real, self.module
        self.by_grain = sand_kernels(kinds, real, module)
        self.by_cell, self.by_solve = sweep_kernels(kinds, real, module), solve_kernels(real, module)
        self.walls = bool(kinds)
        self.total, self.sweeps = self.zeros(3, wp.int64), self.zeros(3, int)
        self.sweeping = self.sweeps[:1]
        self.tolerance, self.most = TOLERANCE, MOST_SWEEPS

    def make_room(self, blocks: int) -> None:
        super().make_room(blocks)
        t, T, n = types(self.real), granular_tables(self.real), CELLS * blocks
        self.cells = fill_struct(T.SandCells, rule=self.zeros(n, t.vec4), S=self.zeros(n, t.vec3), R=self.zeros(n, t.vec3),
                                 sum=self._table((8, n), t.vec4), G=self._table((3, n), t.vec4),
                                 G_last=self._table((3, n), t.vec4), S_last=self.zeros(n, t.vec3), R_last=self.zeros(n, t.vec3))
        self.corners = fill_struct(T.SandCorners, v=self.zeros(n, t.vec4), held=self.zeros(n, t.vec3),
                                   last=self.zeros(n, t.vec3), free=self.zeros(n, t.vec3), count=self.zeros(n, int))
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
        if self.acts:
            self.acts.begin_step(self)
        k, g, points, materials, corners = self.by_grain, self.grid, self.points, self.materials, CELLS * self.blocks
        self.launch(k.sum_corners, 8 * corners, [points, materials, g, self.cells])
        self.launch(k.average_cells, corners, [points, materials, g, self.cells])
        self.launch(k.move_corners, corners,
                    [g, self.cells, materials, self.wall_rows, self.clock, self.corners, self.contacts])
        self.launch(self.by_solve.begin_solve, 1, [self.total, self.sweeps])
        self.launch_hold(0.0)
        wp.capture_while(self.sweeping, lambda: self.sweep_group(self.solve_word))
        self.launch(k.move_grains, self.count,
                    [g, self.cells, self.corners, self.wall_rows, self.clock, points, word, self.pace])
        self.launch(self.by_step.next_step, 1,
                    [self.real(dt), self.blocks, self.more, self.pace, self.clock, self.going, word])

    def sweep_group(self, word: Any) -> None:
        """Launches some sweeps, and a look at what the last of them has left."""
        real, n = self.real, 8 * self.blocks
        for sweep in range(GROUP):
            tolerance = self.tolerance if sweep == GROUP - 1 else 0.0
            for color in range(COLOURS):
                self.launch(self.by_cell.sweep_color, n, [self.grid, self.cells, self.corners, color, real(tolerance),
                                                          self.clock, self.total])
            beta = sweep / (sweep + 3.0) if sweep < GROUP - 1 else 0.0
            self.launch(self.by_cell.extrapolate_cells, CELLS * self.blocks, [self.grid, self.cells, real(beta), self.sweeps])
            self.launch_hold(beta)
        self.launch(self.by_solve.check_residual, 1, [GROUP, self.most, self.total, self.sweeps, word])

    def launch_hold(self, beta: float) -> None:
        """Launches what colliders do to corners, which go on by beta of their last change."""
        self.launch(self.by_cell.hold_corners, CELLS * self.blocks,
                    [self.grid, self.corners, self.contacts, self.real(beta), self.sweeps, self.clock])
