"""Adjoint of a frame of the material point method (`wsim.physics.mpm.grid.SparseGrid`), the last step first.

    state of each step, once more;  nodes, once more;  particles, nodes, particles     (kernels/particles/mpm/adjoint)

A frame runs once more from its start. Its steps leave their states where memory holds them all; else each `stride`-th does, and
the steps behind it run a third time. Lengths of steps count as constants: they are whole parts of what is left of a frame, and
change with nothing that changes little.
"""

from math import ceil, sqrt
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.adjoint.tables import cotangent_rows
from wsim.kernels.particles.mpm.adjoint.transfers import give_kernel, node_kernels, particle_kernels
from wsim.kernels.particles.mpm.steps import WORDS
from wsim.kernels.particles.mpm.tables import CELLS, NUMBERS
from wsim.kernels.particles.mpm.transfers import node_kernel
from wsim.model.structs import fill_struct

ROOM = 1 << 29         # bytes for states of steps; on a GPU a part of the memory that is free
PART = 0.25


class MaterialPointAdjoint:
    """by: cotangents of the arrays of the state, of the end of a frame before `frame_back` and of its begin behind it."""

    def __init__(self, method: Any):
        self.method, self.grid, self.model = method, method.grid, method.model
        grid, part, real = method.grid, method.part, method.model.real
        kinds = grid.colliders.kinds if grid.colliders else ()
        module = f"{grid.module}_back"
        self.nodes = node_kernels(kinds, grid.gathers, real, module)
        self.move_nodes = node_kernel(kinds, True, real, module)         # nodes hold momentum already
        self.give = give_kernel(grid.gathers, real, module)
        self.particles = particle_kernels(kinds, method.laws, real, module)
        self.arrays = [array for array, _ in part.copies()]
        self.reals = [a for a in self.arrays if a.dtype is not wp.int32]
        self.by = [wp.zeros_like(a) for a in self.reals]
        numbers = wp.types.vector(NUMBERS, wp.float64)
        self.numbers, self.mass, self.g = (grid.zeros(part.count, dtype) for dtype in (numbers, wp.float64, wp.vec3d))
        own = {name: self.cotangent(name) for name in "ovCbsTSq"}
        self.rows = fill_struct(cotangent_rows(real), **own, numbers=self.numbers, mass=self.mass, g=self.g)
        self.word, self.room = grid.zeros(WORDS, int), 0
        self.momentum: Any = None
        self.states: list[list[wp.array]] = []

    def cotangent(self, name: str) -> wp.array:
        """Cotangent of a field of the particles: the place in `by` that the field has in the state."""
        field = self.method.part.arrays[name]
        for base, by in zip(self.reals, self.by, strict=True):
            if base.ptr <= field.ptr < base.ptr + base.capacity:
                first = (field.ptr - base.ptr) // wp.types.type_size_in_bytes(field.dtype)
                return by[first:first + field.shape[0]]
        raise AssertionError(f"{name} is no part of the state")

    def zero_numbers(self) -> None:
        """Numbers of materials and gravity begin at 0."""
        for array in (self.numbers, self.mass, self.g):
            array.zero_()

    # a frame

    def frame_back(self, dt: float, steps: int) -> None:
        """The adjoint of a frame of so many steps, of the state that the method has now."""
        stride, states = self._choose_stride(steps), []
        self._begin_replay(dt)
        for step in range(steps):
            if step % stride == 0:
                states.append(self._save(len(states)))
            self.grid.take_step(dt, self.word)
        if stride == 1:
            for state in reversed(states):
                self._restore(state)
                self.step_back()
            return
        for number in reversed(range(len(states))):
            self._restore(states[number])
            own = [states[number]]
            for _ in range(min(stride, steps - number * stride) - 1):
                self.grid.take_step(dt, self.word)
                own.append(self._save(len(states) + len(own) - 1))
            for state in reversed(own):
                self._restore(state)
                self.step_back()

    def _choose_stride(self, steps: int) -> int:
        """Steps from one state that is kept to the next: 1 where there is memory for all."""
        each = sum(a.capacity for a in self.arrays)
        device, have = self.model.device, len(self.states) * each
        room = have + PART * device.free_memory if device.is_cuda else ROOM
        return 1 if steps * each <= room else ceil(sqrt(steps))

    def _begin_replay(self, dt: float) -> None:
        self.word.zero_()
        self.grid.begin_frame(dt)

    def _kept(self) -> list[wp.array]:
        """What a step begins with."""
        return [*self.arrays, self.grid.clock, self.grid.pace]

    def _save(self, number: int) -> list[wp.array]:
        """Copies what the step begins with to a place."""
        if number == len(self.states):
            self.states.append([wp.empty_like(a) for a in self._kept()])
        for a, b in zip(self.states[number], self._kept(), strict=True):
            wp.copy(a, b)
        return self.states[number]

    def _restore(self, state: list[wp.array]) -> None:
        for a, b in zip(self._kept(), state, strict=True):
            wp.copy(a, b)

    # a step

    def step_back(self) -> None:
        """Launches the adjoint of the step that begins with the present state and clock."""
        grid, method = self.grid, self.method
        if self.room != grid.blocks:
            self.room, self.momentum = grid.blocks, grid.zeros(CELLS * grid.blocks, types(self.model.real).vec4)
        points, materials, g, nodes = grid.points, grid.materials, grid.grid, grid.nodes
        count, cells = method.part.count, CELLS * grid.blocks
        grid.sort_cells(self.word)
        grid.give_momentum()
        grid.launch(self.nodes.keep_momentum, cells, [g, grid.sums, self.momentum, nodes])
        grid.launch(self.move_nodes, cells, [g, grid.sums, materials, grid.wall_rows, grid.clock, nodes])
        grid.launch(self.particles.particle_back, count, [g, nodes, materials, grid.wall_rows, grid.clock, points, self.rows])
        if not grid.gathers:
            nodes.zero_()
        grid.launch(self.give, count, [points, self.rows, g, grid.rows if grid.gathers else nodes])
        if grid.gathers:
            grid.launch(grid.sum_cells, 32 * cells, [g, grid.rows, grid.sums])
        grid.launch(self.nodes.node_back, cells,
                    [g, grid.sums, self.momentum, materials, grid.wall_rows, grid.clock, nodes])
        grid.launch(self.particles.momentum_back, count, [g, nodes, materials, grid.clock, points, self.rows])
