"""Implicit steps of elastic bodies and of snow on the device: backward Euler by Newton's method with conjugate gradients.

    particles by cell;  nodes without stress;  [forces, residual, [force along a direction]*]*;  particles

(kernels/particles/mpm/implicit/elastic_*.py).
"""

from typing import Any

import warp as wp

import wsim.physics.mpm.grid as explicit
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.elastic_nodes import node_rows, start_kernel
from wsim.kernels.particles.mpm.implicit.elastic_points import finish_kernels, force_kernels, linear_rows
from wsim.kernels.particles.mpm.implicit.elastic_precondition import precondition_kernel, shift_kernels
from wsim.kernels.particles.mpm.implicit.elastic_solve import SUMMERS, decision_kernels, dot_kernel, solve_kernels
from wsim.kernels.particles.mpm.tables import CELLS, LAYER
from wsim.kernels.particles.mpm.transfers import cell_kernel, sorted_kernels
from wsim.model.structs import fill_struct

TOLERANCE = 1e-5           # root mean square of the error of the way of a node in a step [cells]
SHARE = 0.1                # of the residual of a step of Newton that conjugate gradients leave
MOST_STEPS = 20            # of Newton
MOST_ITERATIONS = 1000     # of conjugate gradients, a step of Newton


class ElasticGrid(explicit.SparseGrid):
    """A `SparseGrid` of elastic bodies and snow."""

    waves = False

    def _make_kernels(self, laws: tuple[str, ...], kinds: tuple[str, ...]) -> None:
        real, module, cpu = self.real, self.module, not self.gathers
        momentum = sorted_kernels(real, module)
        self.sort_momentum = momentum.scatter_momentum if cpu else momentum.sort_momentum
        self.sum_cells = cell_kernel(real, module)
        self.start_nodes = start_kernel(kinds, cpu, real, module)
        self.by_force, self.by_finish = force_kernels(laws, cpu, real, module), finish_kernels(kinds, laws, cpu, real, module)
        self.by_node, self.dot_nodes = solve_kernels(cpu, real, module), dot_kernel(cpu, real, module)
        self.precondition_nodes = precondition_kernel(real, module)
        self.by_decision = decision_kernels(real, self.model.module_of(SUMMERS) if self.cuda else module)
        held = bool(self.acts and self.acts.hard)
        self.number, self.still = self.zeros(6, wp.float64), self.zeros(2)
        self.flag = wp.array([0, 0, 0, 0, MOST_STEPS, 0, int(bool(kinds) or held)], dtype=int, device=self.model.device)
        self.newton, self.gradients, self.turns, self.last = self.flag[:1], self.flag[1:2], self.flag[2:3], self.number[5:]
        self.by_shift = shift_kernels(cpu, real, module, self.model.module_of(SUMMERS) if self.cuda else module)
        self.shift = self.zeros(self.model.worlds, types(real).vec4)
        self.by_one = decision_kernels(real, module).begin_gradients
        self.tolerance = TOLERANCE

    def make_particle_room(self, count: int, blocks: int) -> None:
        t = types(self.real)
        shapes = {"U": t.mat33, "M": t.mat33, "s": t.vec3, "D": t.vec3, "off": t.vec3, "flip": t.vec3, "twist": t.vec3}
        self.linear = fill_struct(linear_rows(self.real), **{k: self.zeros(count, v) for k, v in shapes.items()})
        super().make_particle_room(count, blocks)

    def make_room(self, blocks: int) -> None:
        super().make_room(blocks)
        t, n = types(self.real), CELLS * blocks
        names = ("star", "v", "f", "r", "z", "w", "p", "s", "y", "hold", "wall")
        self.solve = fill_struct(node_rows(self.real), rub=self.zeros(n), load=self.zeros(n), drag=self.zeros(n),
                                 inverse=self.zeros(n, t.mat33),
                                 **{name: self.zeros(n, t.vec4) for name in names})
        self.impulses = self.solve.f
        self.rank, self.parts = self.zeros(blocks, int), self.zeros(CELLS // LAYER * blocks, wp.vec2d)
        self.lost, self.lost_world = self.zeros(CELLS // LAYER * blocks, wp.vec4d), self.zeros(CELLS // LAYER * blocks, int)

    def run_frame(self, dt: float, word: Any) -> None:
        real = self.real
        self.pace.zero_()
        if self.acts:
            self.acts.begin_frame(self)
        threads = min(self.count, explicit.MEASURERS if self.cuda else 1)
        self.launch(self.by_finish.measure_motion, threads,
                    [self.points, self.materials, real(self.dx), real(dt), threads, self.pace])
        if self.flow:
            self.flow.launch_frame(self)
        self.launch(self.by_step.begin_steps, 1, [real(dt), self.more, self.pace, self.clock, self.going])
        self.run_steps(dt, word)

    def take_step(self, dt: float, word: Any) -> None:
        self.sort_cells(word)
        g, points, materials, nodes = self.grid, self.points, self.materials, CELLS * self.blocks
        if self.acts:
            self.acts.begin_step(self)
        if self.gathers:
            self.launch(self.by_node.rank_blocks, self.blocks, [g, self.rank])
        self._transfer(self.sort_momentum, [points, materials, g, self.still])
        self.launch(self.start_nodes, nodes, [g, self.sums, materials, self.wall_rows, self.clock, self.solve])
        if self.acts:
            self.acts.hold_solve(self)
        self.turns.zero_()
        self.newton.fill_(1)
        self.last.fill_(1e30)
        wp.capture_while(self.newton, self.newton_step)
        self.launch(self.by_finish.finish_points, self.count,
                    [g, self.solve.v, materials, self.wall_rows, self.clock, points, word, self.pace])
        if self.acts:
            self.acts.end_step(self)
        self.launch(self.by_step.next_step, 1,
                    [self.real(dt), self.blocks, self.more, self.pace, self.clock, self.going, word])

    def _transfer(self, kernel: Any, inputs: list) -> None:
        """Launches what particles give to nodes."""
        if self.gathers:
            ends = [self.rows] if kernel is self.sort_momentum else [self.rows, self.impulses]
            self.launch(kernel, self.count, [*inputs, *ends])
            self.launch(self.sum_cells, 32 * CELLS * self.blocks, [self.grid, self.rows, self.sums])
        else:
            self.impulses.zero_()
            ends = [self.impulses] if kernel is self.sort_momentum else [self.rows, self.impulses]
            self.launch(kernel, self.count, [*inputs, *ends])

    def newton_step(self) -> None:
        """Launches forces, the residual, and what solves for a change of velocities."""
        g, n, force = self.grid, CELLS * self.blocks, [self.points, self.materials, self.grid, self.clock]
        self._transfer(self.by_force.set_forces, [*force, self.solve.v, self.linear])
        self.launch(self.by_node.set_residual, n, [g, self.sums, self.clock, self.number, self.flag, self.solve])
        self.launch(self.precondition_nodes, n, [g, self.points, self.materials, self.clock, self.solve])
        self.launch(self.by_one, 1, [self.number, self.flag])
        wp.capture_while(self.gradients, self.gradient_step)
        self._add_change()
        self._decide(True)

    def _add_change(self) -> None:
        g, threads = self.grid, SUMMERS if self.cuda else 1
        self.launch(self.by_shift.sum_residuals, CELLS // LAYER * self.blocks,
                    [g, self.rank, self.solve, self.lost, self.lost_world])
        how: dict[str, Any] = {"block_dim": SUMMERS} if self.cuda else {}
        wp.launch(self.by_shift.sum_shifts, threads * self.model.worlds, [g, self.lost, self.lost_world, threads, self.shift],
                  device=self.model.device, **how)
        self.launch(self.by_shift.add_change, CELLS * self.blocks, [g, self.shift, self.solve])

    def gradient_step(self) -> None:
        """Launches an iteration of conjugate gradients."""
        g, n = self.grid, CELLS * self.blocks
        self._transfer(self.by_force.multiply_forces,
                       [self.points, self.materials, g, self.clock, self.solve.z, self.linear])
        self.launch(self.by_node.multiply_nodes, n, [g, self.sums, self.solve])
        self._decide(False)
        self.launch(self.by_node.update_nodes, n, [g, self.number, self.solve])

    def _decide(self, ends: bool) -> None:
        real, threads, g = self.real, SUMMERS if self.cuda else 1, self.grid
        self.launch(self.dot_nodes, CELLS // LAYER * self.blocks, [g, self.rank, self.solve, ends, self.parts])
        kernel, own = self.by_decision.check_gradients, [real(SHARE), MOST_ITERATIONS]
        if ends:
            kernel, own = self.by_decision.check_newton, [real(self.tolerance), self.clock]
        inputs = [g, self.parts, threads, *own, self.number, self.flag, self.solve_word]
        how: dict[str, Any] = {"block_dim": SUMMERS} if self.cuda else {}
        wp.launch(kernel, threads, inputs, device=self.model.device, **how)
