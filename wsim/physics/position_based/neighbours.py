"""Who is near whom among particles, on the device: see kernels/position_based/neighbours.py. Several methods may have one each,
of particles and distances of their own."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import prefix_sum_kernels
from wsim.kernels.position_based import neighbours as kernels
from wsim.kernels.position_based import packets
from wsim.kernels.position_based.packets.lists import cell_list_kernel
from wsim.model.model import Model
from wsim.model.structs import fill_struct

BLOCK, BLOCKS = 128, 2048        # threads of a block on CUDA; blocks of a sum at most
FILLED = 2                       # cells of a world over its particles, at least
LEAST = 4                        # cells along an axis, at least


class ParticleLaunches:
    """Launches of kernels of a module of their own, which other scenes share."""

    def __init__(self, model: Model, part: str, *what: Any):
        self.model, self.cuda = model, model.device.is_cuda
        self.module = model.shared_module(part, *what, threads=BLOCK)

    def launch(self, kernel: Any, count: int, inputs: list, outputs: list) -> None:
        """A thread each."""
        from wsim.model.compiler import recorded
        recorded.launch(kernel, count, inputs, outputs, device=self.model.device, **({"block_dim": BLOCK} if self.cuda else {}))

    def zeros(self, count: int, dtype: Any = None) -> wp.array:
        return wp.zeros(max(count, 1), dtype=dtype or self.model.real, device=self.model.device)


@dataclass
class SearchedPoints:
    """Points of the state that are looked for.

    point   places in the state's arrays, (n,)             reach   distance R up to which pairs are wanted [m], (n,)
    world   (n,)                                           group   pairs of one group >= 0 are none, (n,)
    shift   origin of its object from that of the first (n, 3) [m]
    start   places from the first origin (n, 3) [m], which the box of cells follows
    """

    point: np.ndarray
    reach: np.ndarray
    world: np.ndarray
    group: np.ndarray
    shift: np.ndarray
    start: np.ndarray

    @staticmethod
    def of(bodies: list, reach: list[np.ndarray], group: list[int]) -> "SearchedPoints":
        """Points of bodies of the model. reach: of each body's points; group: of each body."""
        first, join = bodies[0].origin, np.concatenate
        shift = [np.tile(body.origin - first, (body.count, 1)) for body in bodies]
        return SearchedPoints(join([np.arange(body.first, body.last) for body in bodies]), join(reach),
                              join([np.full(body.count, body.world) for body in bodies]),
                              join([np.full(body.count, each) for body, each in zip(bodies, group, strict=True)]), join(shift),
                              join([body.places for body in bodies]) + join(shift))


class NeighbourSearch:
    """`rows`, `cells`, `lists`: what kernels read. count: particles of all worlds."""

    def __init__(self, launches: ParticleLaunches, points: SearchedPoints, skin: float, room: int, arrivals: Any = None):
        """skin [m]; room: entries of a list at first; arrivals: the method that says which points are there, None: all are."""
        model, real, reach = launches.model, launches.model.real, points.reach
        self.launches, self.model, self.count, self.skin = launches, model, len(reach), skin
        t, S = types(real), kernels.neighbour_structs(real)
        self.rows = fill_struct(S.ParticleTable, point=model.upload(points.point.astype(np.int32), int),
                                reach=model.upload(reach.astype(model.dtype), real),
                                group=model.upload(points.group.astype(np.int32), int),
                                world=model.upload(points.world.astype(np.int32), int),
                                shift=model.upload(points.shift.astype(model.dtype), t.vec3),
                                **({"there": arrivals.there} if arrivals else {}))
        edge = 2.0 * float(reach.max()) + skin
        n, zeros, worlds = _cells_along_axes(points.start, edge, self.count // model.worlds), launches.zeros, model.worlds
        size = int(np.prod(n))
        self.cells = fill_struct(S.CellTable, edge=edge, n=wp.vec3i(*map(int, n)), size=size, skin=skin,
                                 flag=zeros(1, int), count=zeros(worlds * size + 1, int), rank=zeros(self.count, int),
                                 first=zeros(worlds * size + 2, int), order=zeros(self.count, int),
                                 place=zeros(self.count, int), y0=zeros(self.count, t.vec3), near=zeros(self.count, t.vec3),
                                 reach=zeros(self.count))
        self.forget()
        self.structs = S
        self.lists: Any = None
        self.make_room(room)
        module = launches.module
        makers = {"travel": kernels.travel_kernel, "clear": kernels.clear_kernel, "count": kernels.count_kernel,
                  "order": kernels.order_kernel, "place": kernels.place_kernel,
                  "list": kernels.list_kernel if launches.cuda or packets.LANES == 1 else cell_list_kernel,
                  **({"settle": kernels.settle_kernel} if launches.cuda else {})}
        self.kernels = {name: make(real, module) for name, make in makers.items()}
        self.sums = prefix_sum_kernels(module)
        self.blocks = min(-(-worlds * size // BLOCK), BLOCKS) if launches.cuda else 1
        self.part, self.start = zeros(self.blocks, int), zeros(self.blocks, int)

    def forget(self) -> None:
        """Lists are made anew at the next substep."""
        self.cells.y0.fill_(kernels.NOWHERE)

    def make_room(self, room: int) -> None:
        """Lists of so many entries each."""
        zeros = self.launches.zeros
        self.lists = fill_struct(self.structs.PairLists, room=room, size=self.count, count=zeros(self.count, int),
                                 other=zeros(room * self.count, int),
                                 wanted=self.lists.wanted if self.lists else zeros(1, int))
        self.forget()

    def update(self, x: wp.array, d: wp.array, anew: bool = False) -> None:
        """Launches what makes lists of the predicted places x + d, where a particle has gone too far for those that are; or
        anew, so that their order does not depend on when lists were made before."""
        cells, lists, n = self.cells, self.lists, self.count
        cells.flag.fill_(int(anew))
        self._run("travel", n, [self.rows, cells, x, d])
        self._run("clear", len(cells.count), [cells])
        self._run("count", n, [self.rows, cells, x, d])
        self._sum(cells.count, cells.first)
        self._run("order", n, [cells])
        if self.launches.cuda:
            self._run("settle", len(cells.count), [cells])
        self._run("place", n, [self.rows, cells])
        self._run("list", n, [self.rows, cells, lists])

    def _run(self, name: str, count: int, inputs: list) -> None:
        self.launches.launch(self.kernels[name], count, inputs, [])

    def _sum(self, count: wp.array, first: wp.array) -> None:
        parts, starts, firsts = self.sums
        each, blocks = BLOCK if self.launches.cuda else 1, self.blocks
        self.launches.launch(parts, blocks * each, [count, blocks, self.cells.flag], [self.part])
        self.launches.launch(starts, each, [self.part, blocks, self.cells.flag], [self.start])
        self.launches.launch(firsts, blocks * each, [count, self.start, blocks, self.cells.flag], [first])

    @property
    def launch_count(self) -> int:
        return 9 + self.launches.cuda

    @property
    def bytes(self) -> int:
        """Bytes that a substep moves where lists are kept."""
        return 3 * self.count * 12


def _cells_along_axes(start: np.ndarray, edge: float, count: int) -> np.ndarray:
    """Cells along each axis, powers of two: FILLED for each particle or more together, in the proportions of the layers of
    cells that have particles at the start, however far apart these are."""
    n = np.full(3, LEAST)
    across = np.array([len(np.unique(layers)) for layers in np.floor(start / edge).T])
    while np.prod(n) < FILLED * count:
        n[np.argmax(across / n)] *= 2
    return n
