"""The sparse grid of explicit steps on a CPU: transfers by tiles, and threads that take all steps of a frame in one launch
(kernels/particles/mpm/cpu/steps.py). Bits are those of launch by launch, whatever the number of threads."""

from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.fast_paths.threads import DOOR, FORMED
from wsim.kernels.motion.fast_paths.threads import MOST as MOST_THREADS
from wsim.kernels.particles.mpm.actions.flow import birth_table
from wsim.kernels.particles.mpm.cpu.steps import QUEUES, block_step_kernels, step_table, team_kernel
from wsim.kernels.particles.mpm.cpu.tiles import NODES
from wsim.kernels.particles.mpm.tables import CELLS
from wsim.kernels.particles.mpm.transfers import node_kernel, sorted_kernels
from wsim.model.structs import fill_struct
from wsim.physics.motion.fast_paths.threads import LONGEST, Abreast, count_cores
from wsim.physics.mpm.grid import SparseGrid

TEAM = True            # False: kernels are launched one by one
SHARE = 500            # particles that a thread is worth
STEPS = 64             # of a frame, as far as the team is told


class StepTeam(Abreast):
    """Threads of frames, which rest for some frames where a step took longer with them than without: others want the cores."""

    began = 0.0            # when the frame began [s]
    alone = np.inf         # time of a step without helpers [s]

    def begin_frame(self, key: tuple | None, launch: Any) -> None:
        """Sends helpers to the frame to come, unless they rest, or no frame without them was measured."""
        if key is not None and self.alone < np.inf:
            self.send(key, launch)
        self.began = perf_counter()

    def helpers_rest(self, substeps: int) -> bool:
        self.rest = max(self.rest - 1, 0)
        return self.rest > 0

    def end_frame(self, steps: int) -> None:
        """Looks at the time that a frame of so many steps took."""
        each = (perf_counter() - self.began) / max(steps, 1)
        if self.words[FORMED] != self.words[DOOR] >> 6 or self.words[FORMED] == 0:
            self.alone = each if self.rest > 0 else min(self.alone, each)
        elif each > self.alone:
            self.rest, self.pause = self.pause + 1, min(2 * self.pause, LONGEST)
        else:
            self.pause = 1


class TileGrid(SparseGrid):
    """A `SparseGrid` whose frames are one launch; with gradients a launch for each kernel."""

    least_blocks = 1024                    # a block that is not used costs nothing here
    sent: tuple = None, None               # key and launch of the last frame

    def _make_sorting(self) -> None:
        self.whole = TEAM and not self.model.gradients
        if not self.whole:
            super()._make_sorting()

    def _make_kernels(self, laws: tuple[str, ...], kinds: tuple[str, ...]) -> None:
        real, module = self.real, self.module
        self.names, self.queue = (kinds, laws), self.zeros(QUEUES + 1, int)
        threads = max(1, min(count_cores(), MOST_THREADS, self.count // SHARE)) if self.whole else 1
        self.team = StepTeam(self.model, np.zeros((threads, 4), int))
        self.take_steps: Any = None
        if not self.whole:                                     # none is compiled for nothing
            self.sort_momentum = sorted_kernels(real, module).scatter_momentum       # to nodes, for derivatives
            self.by_owner = block_step_kernels(kinds, laws, real, module)
            self.move_nodes = node_kernel(kinds, False, real, module, True)

    def complete_kernels(self) -> None:
        if self.whole:
            sinks = self.flow.table.kinds if self.flow and self.flow.table else ()
            self.take_steps = team_kernel(*self.names, bool(self.flow and self.flow.shapes), sinks, self.real, self.module)

    def make_room(self, blocks: int) -> None:
        super().make_room(blocks)
        self.tiles = wp.zeros((blocks, NODES), dtype=types(self.real).vec4, device=self.model.device)

    @property
    def bytes(self) -> int:
        return super().bytes + self.tiles.capacity

    def share_steps(self, dt: float, word: Any) -> Any:
        """The struct of what steps share."""
        return fill_struct(step_table(self.real), dt=self.real(dt), nodes=self.nodes, tiles=self.tiles, more=self.more,
                           pace=self.pace, clock=self.clock, going=self.going, word=word, queue=self.queue,
                           births=self.flow.threads if self.flow else 0)

    def take_step(self, dt: float, word: Any) -> None:
        self.sort_cells(word)
        g, shared = self.grid, self.share_steps(dt, word)
        own = [shared, self.points, self.materials, g]
        self.launch(self.by_owner.scatter_blocks, self.blocks, own)
        self.launch(self.move_nodes, CELLS * self.blocks,
                    [g, self.tiles, self.materials, self.wall_rows, self.clock, self.nodes])
        self.launch(self.by_owner.move_blocks, self.blocks, [*own, self.wall_rows])
        self.launch(self.by_step.next_step, 1,
                    [self.real(dt), self.blocks, self.more, self.pace, self.clock, self.going, word])

    def run_steps(self, dt: float, word: Any) -> None:
        if not self.whole:
            super().run_steps(dt, word)
            return
        flow = self.flow
        births = flow.births if flow and flow.births is not None else birth_table(self.real)()
        sinks = flow.table.rows if flow and flow.table else collider_type(self.real)()
        given = [self.share_steps(dt, word), self.points, self.materials, self.grid, self.wall_rows, births, sinks]
        places = [self.tiles, self.points.v, self.points.row, word, *([births.row] if flow and flow.shapes else [])]

        def launch_steps(team: Any) -> None:
            wp.launch(self.take_steps, 1, [team, *given], device=self.model.device)
        key = STEPS, dt, given[0].births, *(array.ptr for array in places)
        self.queue[:QUEUES].zero_()
        self.used.zero_()
        launch_steps(self.team.lead(key))
        self.sent = key, launch_steps
        if flow:                                               # what comes and goes in the last step
            flow.launch_step(self)

    def send_helpers(self) -> None:
        if self.whole:
            self.team.begin_frame(*self.sent)

    def look_back(self, steps: int) -> None:
        if self.whole:
            self.team.end_frame(steps)
