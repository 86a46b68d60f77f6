"""All steps of a frame in one launch that threads of a CPU take together (kernels/motion/fast_paths/thread_team.py): the
kernels of a step, phase by phase, over the same rows.

    clear;  mark blocks;  find neighbours, count;  start;  place;  settle, scatter to tiles;  nodes;  particles;  next step

Behind each phase all threads wait for each other. In it they come for rows in turn: who has lost his core to others takes
fewer. Bits do not depend on who takes what, since each block and each node is one thread's.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.fast_paths.thread_team import Team, join, leave, meet, since, together
from wsim.kernels.motion.fused.body import MODULE, kernel_body
from wsim.kernels.particles.mpm.actions.flow import birth_kernels, birth_table, sink_kernel
from wsim.kernels.particles.mpm.blocks import EMPTY, block_kernels
from wsim.kernels.particles.mpm.cpu.atomics import shared_add
from wsim.kernels.particles.mpm.cpu.tiles import tile_transfers
from wsim.kernels.particles.mpm.steps import MOST, step_kernels
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.transfers import node_kernel, particle_kernel, sorted_kernels

QUEUES = 10                # phases whose rows are taken in turn
BEFORE = wp.constant(10)   # in the queue: blocks of the step before, whose counts are to be cleared
CHUNK = wp.constant(2048)  # rows that a thread takes at a time
FEW = wp.constant(16)      # blocks, where these take a thread a moment


@cache
def step_table(real):
    """Struct: what steps share."""
    t = types(real)

    @wp.struct
    class SharedSteps:
        dt: real                           # of the frame [s]
        nodes: wp.array(dtype=t.vec4)
        tiles: wp.array2d(dtype=t.vec4)    # (blocks, 216)
        more: wp.array(dtype=real)         # these as in kernels/particles/mpm/steps.py
        pace: wp.array(dtype=real)
        clock: wp.array(dtype=real)
        going: wp.array(dtype=int)
        word: wp.array(dtype=int)
        queue: wp.array(dtype=int)         # rows that threads have come for, (QUEUES + 1,)
        births: int                        # threads that look for what comes, see kernels/particles/mpm/actions/flow.py

    return SharedSteps


@cache
def owned_functions(kinds: tuple[str, ...], laws: tuple[str, ...], real) -> SimpleNamespace:
    """Functions of a block whose particles follow each other in the order: scatter, to its tile, and move, by its tile."""
    T, Steps, Colliders, by_tile = point_tables(real), step_table(real), collider_type(real), tile_transfers(real)
    scatter_point = kernel_body(sorted_kernels(real, MODULE).scatter_to_tiles, 0)
    move_point = kernel_body(particle_kernel(kinds, laws, False, real, MODULE, True), 0)

    @wp.func
    def end_row(g: T.BlockGrid, b: int):
        """One behind the last row of a block's particles."""
        last = CELLS * b + CELLS - 1
        return g.first[last] + g.count[last]

    @wp.func
    def scatter_block(b: int, s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        by_tile.clear_tile(b, s.tiles)
        for n in range(g.first[CELLS * b], end_row(g, b)):
            scatter_point(n, points, materials, g, s.clock, s.tiles)

    @wp.func
    def move_block(b: int, s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, c: Colliders):
        begin = g.first[CELLS * b]
        end = end_row(g, b)
        if begin < end:
            by_tile.fill_tile(g, b, s.nodes, s.tiles)
        for n in range(begin, end):
            move_point(n, g, s.tiles, materials, c, s.clock, points, s.word, s.pace)

    return SimpleNamespace(scatter=scatter_block, move=move_block)


@cache
def block_step_kernels(kinds: tuple[str, ...], laws: tuple[str, ...], real, module) -> SimpleNamespace:
    """Kernels over blocks, the same launch by launch: scatter_blocks, move_blocks."""
    T, Steps, Colliders, own = point_tables(real), step_table(real), collider_type(real), owned_functions(kinds, laws, real)

    def scatter_blocks(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        b = wp.tid()
        if b < wp.min(g.used[0], g.key.shape[0]):
            own.scatter(b, s, points, materials, g)

    def move_blocks(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, c: Colliders):
        b = wp.tid()
        if b < wp.min(g.used[0], g.key.shape[0]):
            own.move(b, s, points, materials, g, c)

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join((*kinds, *laws))}_{types(real).name}", module=module,
                                    enable_backward=False) for k in (scatter_blocks, move_blocks)}
    return SimpleNamespace(**made)


@cache
def phase_functions(kinds: tuple[str, ...], laws: tuple[str, ...], flow: bool, real) -> SimpleNamespace:
    """Functions of a thread's part in each phase."""
    T, Steps, Colliders = point_tables(real), step_table(real), collider_type(real)
    by_block = block_kernels(real, MODULE, flow, True)
    mark, count, near, start, place, settle = (kernel_body(getattr(by_block, name), 0) for name in (
        "mark_blocks", "count_points", "near_blocks", "start_cells", "place_points", "settle_cells"))
    own, move_node = owned_functions(kinds, laws, real), kernel_body(node_kernel(kinds, False, real, MODULE, True), 0)

    @wp.func
    def clear(s: Steps, g: T.BlockGrid):
        k = shared_add(s.queue, 0, 1)
        cells = CELLS * s.queue[BEFORE]
        while k * CHUNK < wp.max(g.slot.shape[0], cells):
            for i in range(k * CHUNK, wp.min((k + 1) * CHUNK, g.slot.shape[0])):
                g.slot[i] = EMPTY
            for i in range(k * CHUNK, wp.min((k + 1) * CHUNK, cells)):
                g.count[i] = 0
            k = shared_add(s.queue, 0, 1)

    @wp.func
    def mark_points(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        all = points.row.shape[0]
        k = shared_add(s.queue, 1, 1)
        while k * CHUNK < all:
            for p in range(k * CHUNK, wp.min((k + 1) * CHUNK, all)):
                mark(p, points, materials, g)
            k = shared_add(s.queue, 1, 1)

    @wp.func
    def find_near(s: Steps, g: T.BlockGrid):
        all = 27 * wp.min(g.used[0], g.key.shape[0])
        k = shared_add(s.queue, 2, 1)
        while k * CHUNK < all:
            for n in range(k * CHUNK, wp.min((k + 1) * CHUNK, all)):
                near(n, g)
            k = shared_add(s.queue, 2, 1)

    @wp.func
    def count_points(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        all = points.row.shape[0]
        k = shared_add(s.queue, 3, 1)
        while k * CHUNK < all:
            for p in range(k * CHUNK, wp.min((k + 1) * CHUNK, all)):
                count(p, points, materials, g)
            k = shared_add(s.queue, 3, 1)

    @wp.func
    def start_blocks(s: Steps, g: T.BlockGrid):
        all = wp.min(g.used[0], g.key.shape[0])
        k = shared_add(s.queue, 4, FEW)
        while k < all:
            for b in range(k, wp.min(k + FEW, all)):
                start(b, g, s.word)
            k = shared_add(s.queue, 4, FEW)

    @wp.func
    def place_points(s: Steps, points: T.PointRows, g: T.BlockGrid):
        all = points.row.shape[0]
        k = shared_add(s.queue, 5, 1)
        while k * CHUNK < all:
            for p in range(k * CHUNK, wp.min((k + 1) * CHUNK, all)):
                place(p, points, g)
            k = shared_add(s.queue, 5, 1)

    @wp.func
    def end_row(g: T.BlockGrid, b: int):
        """One behind the last row of a block's particles."""
        last = CELLS * b + CELLS - 1
        return g.first[last] + g.count[last]

    @wp.func
    def scatter_blocks(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        blocks = wp.min(g.used[0], g.key.shape[0])
        b = shared_add(s.queue, 6, 1)
        while b < blocks:
            cells = int(CELLS)
            for c in range(cells):
                settle(CELLS * b + c, g)
            own.scatter(b, s, points, materials, g)
            b = shared_add(s.queue, 6, 1)

    @wp.func
    def move_nodes(s: Steps, materials: T.MaterialRows, g: T.BlockGrid, c: Colliders):
        blocks = wp.min(g.used[0], g.key.shape[0])
        b = shared_add(s.queue, 7, 1)
        while b < blocks:
            cells = int(CELLS)
            for n in range(cells):
                move_node(CELLS * b + n, g, s.tiles, materials, c, s.clock, s.nodes)
            b = shared_add(s.queue, 7, 1)

    @wp.func
    def move_particles(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, c: Colliders):
        blocks = wp.min(g.used[0], g.key.shape[0])
        b = shared_add(s.queue, 8, 1)
        while b < blocks:
            own.move(b, s, points, materials, g, c)
            b = shared_add(s.queue, 8, 1)

    return SimpleNamespace(clear=clear, mark=mark_points, near=find_near, count=count_points, start=start_blocks,
                           place=place_points, scatter=scatter_blocks, move_nodes=move_nodes, move_particles=move_particles)


@cache
def team_kernel(kinds: tuple[str, ...], laws: tuple[str, ...], births: bool, sinks: tuple[str, ...], real, module):
    """Kernel over 1, of each thread of a team: the steps of a frame. births: some particles come; sinks: kinds of what takes
    some."""
    T, Steps, Colliders, Births = point_tables(real), step_table(real), collider_type(real), birth_table(real)
    flow = births or bool(sinks)
    f = phase_functions(kinds, laws, flow, real)
    next_step = kernel_body(step_kernels(laws, real, MODULE, flow).next_step, 0)
    wake = kernel_body(birth_kernels(laws, True, real, MODULE, True).wake_particles, 0) if births else None
    take = kernel_body(sink_kernel(sinks, real, MODULE), 0) if sinks else None

    @wp.func
    def wake_births(s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, b: Births, rank: int, lanes: int):
        if wp.static(births):
            for i in range(s.births * rank // lanes, s.births * (rank + 1) // lanes):
                wake(i, points, materials, b, g.dx, s.clock, s.pace)

    @wp.func
    def take_points(s: Steps, points: T.PointRows, g: T.BlockGrid, sink: Colliders):
        if wp.static(bool(sinks)):
            all = points.row.shape[0]
            k = shared_add(s.queue, 9, 1)
            while k * CHUNK < all:
                for p in range(k * CHUNK, wp.min((k + 1) * CHUNK, all)):
                    take(p, points, sink, g.dx, s.clock)
                k = shared_add(s.queue, 9, 1)

    @wp.func
    def end_step(s: Steps, g: T.BlockGrid):
        """By one thread."""
        next_step(0, s.dt, g.key.shape[0], s.more, s.pace, s.clock, s.going, s.word)
        queues = int(QUEUES)
        for q in range(queues):
            s.queue[q] = 0
        s.queue[BEFORE] = wp.min(g.used[0], g.key.shape[0])
        g.used[0] = 0
        g.used[1] = 0

    def take_steps(team: Team, s: Steps, points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, c: Colliders,
                   b: Births, sink: Colliders):
        rank = join(team)
        if rank < 0:
            return
        step = since(team, rank)
        lanes = together(team, rank, 0, step, MOST)
        while s.going[0] != 0:
            if wp.static(births):
                wake_births(s, points, materials, g, b, rank, lanes)
            if wp.static(bool(sinks)):
                if wp.static(births):
                    meet(team, rank, lanes)
                take_points(s, points, g, sink)
            f.clear(s, g)
            meet(team, rank, lanes)
            f.mark(s, points, materials, g)
            meet(team, rank, lanes)
            f.near(s, g)
            f.count(s, points, materials, g)
            meet(team, rank, lanes)
            f.start(s, g)
            meet(team, rank, lanes)
            f.place(s, points, g)
            meet(team, rank, lanes)
            f.scatter(s, points, materials, g)
            meet(team, rank, lanes)
            f.move_nodes(s, materials, g, c)
            meet(team, rank, lanes)
            f.move_particles(s, points, materials, g, c)
            meet(team, rank, lanes)
            if rank == 0:
                end_step(s, g)
            meet(team, rank, lanes)
            lanes = together(team, rank, lanes, step, MOST * s.going[0])
            step += 1
        leave(team, rank, lanes)

    form = "births_" * births + "".join(f"{kind}_" for kind in sinks)
    name = f"mpm_take_steps_{'_'.join((*kinds, *laws))}_{form}{types(real).name}"
    return wp.kernel(take_steps, name=name, module=module, enable_backward=False)
