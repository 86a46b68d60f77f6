"""The part of a fluid that is solved, where its `margin` asks for a part: what smoke, heat, sources and moving obstacles fill,
and the margin around it. It follows them from frame to frame; elsewhere air is at rest.

Its sides are those of the domain where it reaches them, else open ones. Between frames it is made anew, with another graph, if
the margin is not kept, or twice as many cells as that takes are solved; a frame in whose end half of the margin is gone is
repeated with a larger one. How wrong open sides are, by margin: kernels/fluid/passes/window.py, tools/results/fluids.md.
"""

from dataclasses import replace
from math import ceil, prod
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.passes import window as kernels
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.direct import MOST
from wsim.physics.fluid.grid.domain import FluidDomain
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.start import bounding_radius

ROUND = 8                # cells: sides stand at multiples of it
LEAST = 4                # cells of margin at least
# how far off what has risen is by, from a margin on: puff, ring and plume of tools/bench/fluid/margin.py
MEASURED = ((1.0, "up to 0.2 %"), (0.75, "0.1 to 0.5 %"), (0.5, "0.1 to 1 %"), (0.0, "more than 1 %"))
Box = tuple[np.ndarray, np.ndarray]                    # first cell and that behind the last one, along the grid's axes


def state_windows(windows: list["FluidWindow"]) -> str:
    """Words of a plan about parts that are solved."""
    margin = min(window.fluid.margin for window in windows)
    off = next(said for least, said in MEASURED if margin >= least)
    return (f", of which {sum(window.domain.layout.cells for window in windows)} are solved at first: a margin of {margin:g} "
            f"around smoke, heat and sources; what rises is {off} off")


def joined_boxes(one: Box | None, other: Box | None) -> Box | None:
    if one is None or other is None:
        return one or other
    return np.minimum(one[0], other[0]), np.maximum(one[1], other[1])


def box_holds(outer: Box, inner: Box) -> bool:
    return bool((outer[0] <= inner[0]).all() and (outer[1] >= inner[1]).all())


class FluidWindow:
    """method: the `Fluids` whose fluid k it is of. domain: what is solved now."""

    def __init__(self, method: Any, k: int, sources: list):
        self.method, self.k, self.sources = method, k, sources
        (self.fluid, self.world), self.layout = method.pairs[k], method.layouts[k]
        real, module, dim = method.model.real, method.threads.module, self.layout.dim
        names = method.carried[k]
        self.take, self.give, self.rest = (make(dim, real, module)
                                           for make in (kernels.window_take_kernel, kernels.window_give_kernel,
                                                        kernels.window_rest_kernel))
        self.reach = kernels.window_extent_kernel(dim, "smoke" in names, "heat" in names, real, module)
        self.state = {**{name: method.field(k, name) for name in ("u", "v", "w")[:dim]},
                      **{name: method.field(k, name) for name in names}}
        self.begun: Box | None = None                  # box that was filled when the frame began
        self.short, self.known = False, False          # the last frame must be repeated; its words are there
        found = self.around(self.filled_now(), self.things(0.0, 0.0))
        self.make(self.roomy_box(found if found else (np.zeros(3, int), np.minimum(self.layout.n, 2 * ROUND))))

    # where there is something, in cells

    def things(self, time: float, dt: float) -> Box | None:
        """Box of sources and of obstacles that move, in the frame at `time` [s]."""
        found: Box | None = None
        axes, n = list(self.layout.axes), self.layout.n[:self.layout.dim]
        moving = [c for c in self.method.scene.colliders if c.motion.moves]
        for thing in (*self.sources, *moving):
            for t in (time, time + dt):
                place, radius = thing.motion.at(t)[:3, 3][axes], bounding_radius(thing.shape)
                low, high = ((place + s * radius - self.fluid.low[axes]) / self.fluid.cell for s in (-1.0, 1.0))
                low, high = np.clip(np.floor(low), 0, n), np.clip(np.ceil(high), 0, n)
                if (low < high).all():
                    fill = [0] * (3 - self.layout.dim)
                    found = joined_boxes(found, (np.array([*low, *fill], int), np.array([*high, *(1 for _ in fill)], int)))
        return found

    def filled_now(self) -> Box | None:
        """Box of smoke and heat, from the state."""
        bounds = {"smoke": kernels.SMOKE, "heat": kernels.HEAT}
        some = np.zeros(self.layout.n, bool)
        for name, least in bounds.items():
            if name in self.state:
                some |= np.abs(self.state[name].numpy().reshape(self.layout.n)) > least
        places = np.argwhere(some)
        return (places.min(axis=0), places.max(axis=0) + 1) if len(places) else None

    def filled(self) -> Box | None:
        """Box of smoke and heat, as the frame before has left it in the words of its status."""
        words = self.method.status.said("fluid: reach")[6 * self.k:6 * self.k + 6]
        return (np.array(self.layout.n) - words[:3], np.array(words[3:])) if words[3:].any() else None

    def around(self, *boxes: Box | None, part: float = 1.0) -> Box | None:
        """`part` of the margin around boxes; whole along periodic axes."""
        box, dim, n = None, self.layout.dim, np.array(self.layout.n)
        for each in boxes:
            box = joined_boxes(box, each)
        if box is None:
            return None
        size = max(int((box[1] - box[0])[:dim].min()), 1)
        m = ceil(part * max(self.fluid.margin * size, LEAST))
        wide = np.array([m * (a < dim) for a in range(3)])
        low, high = np.maximum(box[0] - wide, 0), np.minimum(box[1] + wide, n)
        periodic = np.array(self.layout.periodic) > 0
        return np.where(periodic, 0, low), np.where(periodic, n, high)

    # what is solved

    def roomy_box(self, least: Box) -> Box:
        """A box and a little more, so that it does for some frames."""
        n, dim = np.array(self.layout.n), self.layout.dim
        more = np.array([LEAST * (a < dim) for a in range(3)])
        low = np.maximum((least[0] - more) // ROUND * ROUND, 0)
        high = np.minimum(-(-(least[1] + more) // ROUND) * ROUND, n)
        return np.where(low <= ROUND, 0, low), np.where(n - high <= ROUND, n, high)

    def make(self, box: Box) -> None:
        """The domain of a box."""
        self.box, dim, n = box, self.layout.dim, self.layout.n
        low, high = box
        fluid, method, axes = self.fluid, self.method, self.layout.axes
        corners, sides = [fluid.low.copy(), fluid.high.copy()], list(fluid.sides)
        for a, axis in enumerate(axes):
            for side, at, end in ((0, low[a], 0), (1, high[a], n[a])):
                corners[side][axis] = fluid.low[axis] + fluid.cell * at
                sides[2 * axis + side] = sides[2 * axis + side] if at == end else "open"
        direct = not method.scene.colliders and sum(self.layout.n) <= MOST
        how = fluid.pressure if fluid.pressure != "auto" else "direct" if direct else "multigrid"
        part = replace(fluid, low=corners[0], high=corners[1], sides=tuple(sides), pressure=how, margin=0.0, velocity=None,
                       smoke=None, temperature=None)
        threads, real = method.threads, method.model.real
        shapes = [tuple(high - low + (np.arange(3) == a) * (1 - np.array(self.layout.periodic))) for a in range(dim)]
        u = fill_struct(grid_structs(real).Faces, **{AXES[a]: threads.zeros(prod(map(int, shapes[a]))) for a in range(dim)})
        scalars = {name: threads.zeros(int(prod(high - low))) for name in method.carried[self.k]}
        self.domain = FluidDomain(threads, part, self.world, method.scene.colliders, self.sources, u, scalars)

    def follow(self, time: float, dt: float) -> bool:
        """True if another part is solved from the frame at `time` [s] on: the domain is another, and is not settled yet."""
        filled = self.filled() if self.known else self.filled_now()
        if self.short:
            filled = joined_boxes(filled, self.begun)
        else:
            self.begun = filled
        self.known, self.short = True, False
        box = self.around(filled, self.things(time, dt))
        if box is None:
            return False
        cells = [prod(map(int, high - low)) for low, high in (self.box, box)]
        if box_holds(self.box, box) and cells[0] <= 2 * cells[1] + 8 * ROUND ** self.layout.dim:
            return False
        before, box = self.box, self.roomy_box(box)
        if box_holds(before, box) and box_holds(box, before):
            return False
        self.make(box)
        if not box_holds(box, before):
            self._fill_outside_air()
        return True

    def lacks(self) -> bool:
        """True if half of the margin is gone in the frame that has ended, at a side that is not one of the whole box."""
        box = self.around(self.filled(), part=0.5)
        self.short = box is not None and not box_holds(self.box, box)
        return self.short

    def _window_rows(self, name: str) -> list:
        """Shapes of a field in the window and in the whole box, and where it begins there."""
        axis = "uvw".find(name) if name in ("u", "v", "w") else -1
        own = self.domain.layout
        shapes = [layout.faces(axis) if axis >= 0 else layout.n for layout in (own, self.layout)]
        return [wp.vec3i(*map(int, s)) for s in (*shapes, self.box[0])]

    def part(self, name: str) -> wp.array:
        """Array of a field of the domain."""
        return getattr(self.domain.u, AXES["uvw".index(name)]) if name in ("u", "v", "w") else self.domain.scalars[name]

    def _fill_outside_air(self) -> None:
        """Air outside of the window is as it is at the start."""
        for name, q in self.state.items():
            value = self.method.air(self.k)["uvw".index(name)] if name in ("u", "v", "w") else 0.0
            self.method.threads.over(self.rest, q.size, [*self._window_rows(name), self.method.model.real(value)], [q])

    def frame(self, dt: float, least: int, most: int) -> None:
        """Launches a frame."""
        over = self.method.threads.over
        for name, q in self.state.items():
            over(self.take, self.part(name).size, [*self._window_rows(name), q], [self.part(name)])
        self.domain.frame(dt, least, most)
        for name, q in self.state.items():
            over(self.give, self.part(name).size, [*self._window_rows(name), self.part(name)], [q])
        words = self.method.status.word("fluid: reach")[6 * self.k:6 * self.k + 6]
        scalars = self.domain.scalars
        over(self.reach, self.domain.layout.cells, [*self._window_rows("smoke"), scalars.get("smoke"), scalars.get("heat")],
             [words])

    def arrays(self) -> dict[str, np.ndarray]:
        """Fields of the window, float64, in the shapes of its layout."""
        return {name: self.part(name).numpy().astype(np.float64).reshape(
            tuple(self._window_rows(name)[0])) for name in self.state}
