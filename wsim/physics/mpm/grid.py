"""The sparse grid of all bodies on the device, its kernels, and a step:

    particles by cell;  momentum behind each other;  nodes;  particles

(kernels/particles/mpm/). A grid has room for so many blocks; a frame that needs more is repeated with more."""

from math import ceil, log2
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.blocks import block_kernels
from wsim.kernels.particles.mpm.steps import energy_kernel, step_kernels
from wsim.kernels.particles.mpm.tables import CELLS, LAYER, point_tables
from wsim.kernels.particles.mpm.transfers import cell_kernel, gather_kernel, node_kernel, particle_kernel, sorted_kernels
from wsim.model.model import Model
from wsim.model.structs import fill_struct

BLOCK = 128                # threads of a block on CUDA
MEASURERS = 1 << 14        # threads that look for the fastest particle on CUDA
MORE = 1.1                 # steps over what particles need as one begins


def gathers(device: Any) -> bool:
    """True where threads run side by side: nodes then gather what particles give, else particles add to nodes in turn."""
    return device.is_cuda


def key_bits(worlds: int) -> int:
    """Bits of a block's key for each axis: 63 less those of the world."""
    return min(20, (63 - ceil(log2(max(worlds, 1)))) // 3)


def wave_stiffness(material: Any) -> float:
    """lambda + 2 mu [Pa]."""
    mu, lam = material.numbers()[:2]
    return lam + 2.0 * mu


class SparseGrid:
    """points, materials: structs of the particles. colliders: the scene's `ColliderTable`, or None. flow: a `MaterialFlow`
    where particles come and go, else None. acts: `wsim.physics.mpm.actions.outside.OutsideActions`, or None."""

    shift = 0.0            # of nodes from multiples of dx of the world [cells]
    waves = True           # steps are as short as waves need
    least_blocks = 64      # that there is room for beside those at the start; on a GPU their threads are launched, and end

    def __init__(self, model: Model, count: int, dx: float, laws: tuple[str, ...], colliders: Any, blocks: int,
                 flow: Any = None, acts: Any = None):
        self.flow, self.model, self.count, self.dx, self.colliders, self.acts = flow, model, count, dx, colliders, acts
        self.cuda, self.gathers = model.device.is_cuda, gathers(model.device)
        self.module = module = model.module_of(BLOCK) if self.cuda else model.module
        real, kinds = model.real, colliders.kinds if colliders else ()
        self.real, self.tables = real, point_tables(real)
        self.by_step = step_kernels(laws, real, module, bool(flow))
        self._make_sorting()
        self.measure_energy = energy_kernel(laws, real, module)
        self._make_kernels(laws, kinds)
        if acts:
            acts.make_kernels(self)
        self.solve_word: Any = None            # of the frame's status, where steps are solved for
        self.points: Any = None
        self.materials: Any = None
        self.clock, self.pace, self.more = (self.zeros(n) for n in (2, 2, 1))
        self.going = self.zeros(1, int)
        self.used = self.zeros(2, int)
        if colliders:
            self.wall_rows = colliders.rows
        else:
            from wsim.kernels.contact.collider.colliders import collider_type as wall_table
            self.wall_rows = wall_table(real)()
        self.make_particle_room(count, blocks)

    def make_particle_room(self, count: int, blocks: int) -> None:
        """Arrays for so many particles and blocks."""
        self.count = count
        self.own = {name: self.zeros(count, int) for name in ("order", "block", "rank")}
        kept = count if self.gathers else 0
        self.rows = fill_struct(self.tables.SortedRows, **{name: self.zeros(kept, types(self.real).vec4) for name in "mxyz"})
        self.make_room(blocks)

    def _make_sorting(self) -> None:
        """Kernels that sort particles."""
        self.by_block = block_kernels(self.real, self.module, bool(self.flow))

    def _make_kernels(self, laws: tuple[str, ...], kinds: tuple[str, ...]) -> None:
        """Kernels of a step."""
        real, module = self.real, self.module
        momentum = sorted_kernels(real, module)
        self.sort_momentum = momentum.sort_momentum if self.gathers else momentum.scatter_momentum
        self.sum_cells = cell_kernel(real, module)
        held = bool(self.acts and self.acts.hard)              # then nodes have their momentum before they move
        self.gather_nodes = gather_kernel(real, module) if held and self.gathers else None
        self.move_nodes = node_kernel(kinds, held or not self.gathers, real, module)
        self.move_particles = particle_kernel(kinds, laws, not self.gathers, real, module)

    def complete_kernels(self) -> None:
        """Makes kernels that depend on what comes and goes."""

    def send_helpers(self) -> None:
        """Before a frame: other threads of a CPU may come to it."""

    def look_back(self, steps: int) -> None:
        """Behind a frame of so many steps."""

    def zeros(self, count: int, dtype: Any = None) -> Any:
        """Zeros on the device."""
        return wp.zeros(max(count, 1), dtype=self.real if dtype is None else dtype, device=self.model.device)

    def make_room(self, blocks: int) -> None:
        """Arrays for so many blocks."""
        self.blocks = blocks
        slots = 1 << ceil(log2(2 * blocks))
        self.slot = self.zeros(slots, wp.int64)
        self.cell_count = self.zeros(CELLS * blocks, int)
        self.nodes = self.zeros(CELLS * blocks, types(self.real).vec4)
        shape = (27, CELLS * blocks) if self.gathers else (1, 1)
        self.sums = wp.zeros(shape, dtype=self.nodes.dtype, device=self.model.device)
        if self.acts:
            self.acts.make_room(blocks)
        self.grid = fill_struct(
            self.tables.BlockGrid, slot=self.slot, number=self.zeros(slots, int), key=self.zeros(blocks, wp.int64),
            near=self.zeros(27 * blocks, int), used=self.used, count=self.cell_count, first=self.zeros(CELLS * blocks, int),
            bits=key_bits(self.model.worlds), dx=self.real(self.dx), **self.own)

    @property
    def bytes(self) -> int:
        """Bytes of the grid and of what is sorted."""
        g = self.grid
        arrays = [self.slot, self.nodes, self.sums, self.cell_count, g.number, g.near, g.first, g.key]
        return sum(a.capacity for a in arrays) + self.count * (12 + 16 * wp.types.type_size_in_bytes(self.real))

    def set_material(self, row: int, now: Any, particles: np.ndarray) -> None:
        """Gives a row of materials other numbers, and its particles, by which steps are chosen, the stiffness at rest."""
        t = np.float64 if self.real is wp.float64 else np.float32
        for array, value in ((self.materials.numbers, now.numbers()), (self.materials.density, now.density)):
            values = array.numpy()
            values[row] = np.asarray(value, t)
            array.assign(values)
        a = self.points.a.numpy()
        a[particles] = wave_stiffness(now)
        self.points.a.assign(a)

    def launch(self, kernel: Any, count: int, inputs: list) -> None:
        """Launches a kernel of this grid."""
        how: dict[str, Any] = {"block_dim": BLOCK} if self.cuda else {}
        wp.launch(kernel, count, inputs, device=self.model.device, **how)

    # a frame

    def run_frame(self, dt: float, word: Any) -> None:
        """Launches all steps of a frame [s]."""
        self.begin_frame(dt)
        self.run_steps(dt, word)

    def begin_frame(self, dt: float) -> None:
        """Launches what chooses the first step."""
        real = self.real
        self.pace.zero_()
        if self.acts:
            self.acts.begin_frame(self)
        threads = min(self.count, MEASURERS if self.cuda else 1)
        self.launch(self.by_step.measure_pace, threads,
                    [self.points, self.materials, real(self.dx), real(dt), threads, self.pace])
        if self.flow:
            self.flow.launch_frame(self)
        self.launch(self.by_step.begin_steps, 1, [real(dt), self.more, self.pace, self.clock, self.going])

    def run_steps(self, dt: float, word: Any) -> None:
        """Launches steps as long as the clock goes on."""
        wp.capture_while(self.going, lambda: self._take_step_with_flow(dt, word))
        if self.flow:                                          # what comes and goes in the last step
            self.flow.launch_step(self)

    def _take_step_with_flow(self, dt: float, word: Any) -> None:
        if self.flow:
            self.flow.launch_step(self)
        self.take_step(dt, word)

    def take_step(self, dt: float, word: Any) -> None:
        """Launches one step."""
        self.sort_cells(word)
        g, points, materials, acts = self.grid, self.points, self.materials, self.acts
        if acts:
            acts.begin_step(self)
        self.give_momentum()
        self.launch(self.move_nodes, CELLS * self.blocks,
                    [g, self.sums, materials, self.wall_rows, self.clock, self.nodes])
        if acts:
            acts.hold_velocity(self)
        self.launch(self.move_particles, self.count,
                    [g, self.nodes, materials, self.wall_rows, self.clock, points, word, self.pace])
        if acts:
            acts.end_step(self)
        self.launch(self.by_step.next_step, 1,
                    [self.real(dt), self.blocks, self.more, self.pace, self.clock, self.going, word])

    def give_momentum(self) -> None:
        """Launches what gives momentum to cells, or to nodes."""
        if not self.gathers:
            self.nodes.zero_()
        self.launch(self.sort_momentum, self.count,
                    [self.points, self.materials, self.grid, self.clock, self.rows if self.gathers else self.nodes])
        if self.gathers:
            self.launch(self.sum_cells, 32 * CELLS * self.blocks, [self.grid, self.rows, self.sums])
            if self.gather_nodes:
                self.launch(self.gather_nodes, CELLS * self.blocks, [self.grid, self.sums, self.nodes])
        if self.acts:
            self.acts.hold_momentum(self)

    def sort_cells(self, word: Any) -> None:
        """Launches what finds blocks, and the particles of each cell."""
        g, k, n = self.grid, self.by_block, self.count
        self.slot.zero_()
        self.cell_count.zero_()
        self.used.zero_()
        self.launch(k.mark_blocks, n, [self.points, self.materials, g])
        self.launch(k.count_points, n, [self.points, self.materials, g])
        self.launch(k.near_blocks, 27 * self.blocks, [g])
        self.launch(k.start_cells, CELLS // LAYER * self.blocks, [g, word])
        self.launch(k.place_points, n, [self.points, g])
        if self.gathers:                                       # else threads come in ascending order
            self.launch(k.settle_cells, CELLS * self.blocks, [g])
