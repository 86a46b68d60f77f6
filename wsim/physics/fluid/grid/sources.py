"""Sources of a fluid on the device: kernels/fluid/sources.py."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid import sources as kernels
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.shapes import FluidShapeRows
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.objects import Source
from wsim.scene.curve import Curve


class SmokeSources:
    def __init__(self, threads: Threads, layout: Layout, grid: Any, sources: list[Source], corner: np.ndarray, cell: float,
                 scalars: dict[str, wp.array], tiles: Any = None):
        real, module, dim, model = threads.model.real, threads.module, layout.dim, threads.model
        self.threads, self.layout, self.grid, self.sources, self.scalars = threads, layout, grid, sources, scalars
        self.holds = tiles.holds if tiles else None
        self.shapes = FluidShapeRows(model, sources, corner, layout.axes, cell)
        kinds, n, vec3 = self.shapes.kinds, len(sources), types(real).vec3
        expanding = any(s.expansion != 0.0 for s in sources)
        self.expansion = threads.zeros(layout.cells) if expanding else None
        carried = "_".join(name for name in ("smoke", "heat") if name in scalars) or "nothing"
        self.emit_kernel = kernels.emission_kernel(dim, kinds, (carried, tiles is not None), expanding, real, module)
        self.drive = ([kernels.driven_faces_kernel(dim, a, kinds, real, module) for a in range(dim)]
                      if any(s.velocity is not None for s in sources) else [])
        self.table = fill_struct(kernels.source_tables(real), shapes=self.shapes.table, what=threads.zeros(n, int),
                                 smoke=threads.zeros(n),
                                 heat=threads.zeros(n), expansion=threads.zeros(n), velocity=threads.zeros(n, vec3),
                                 strength=threads.zeros(n, types(real).vec2))
        self.emits = bool(scalars) or expanding
        self.upload([{} for _ in sources])

    def upload(self, changed: list[dict]) -> None:
        """Numbers of the sources, as the scene has them but for what was changed."""
        def changed_values(name: str) -> list:
            return [new.get(name, getattr(s, name)) for s, new in zip(self.sources, changed, strict=True)]
        dtype, axes = self.threads.model.dtype, list(self.layout.axes)
        what = [(kernels.HELD if s.hold else kernels.RATES) | kernels.SPEED * (s.velocity is not None) for s in self.sources]
        self.table.what.assign(np.array(what, np.int32))
        for name, array in (("smoke", self.table.smoke), ("temperature", self.table.heat), ("expansion", self.table.expansion)):
            array.assign(np.array(changed_values(name), dtype))
        velocity = np.zeros((len(self.sources), 3), dtype)
        for k, v in enumerate(changed_values("velocity")):
            if v is not None:
                velocity[k, :self.layout.dim] = np.asarray(v)[axes]
        self.table.velocity.assign(velocity)
        curves = [(s.strength, np.asarray(new.get("strength", s.strength.values), np.float64))
                  for s, new in zip(self.sources, changed, strict=True)]
        self.known: list | None = None                         # those that were uploaded last
        self.strengths = [Curve(curve.times, np.broadcast_to(values, curve.values.shape)) for curve, values in curves]
        self.shapes.shift = np.array(changed_values("place")) - [s.place for s in self.sources]

    def pose(self, time: float, dt: float) -> None:
        """A frame begins at `time` [s]."""
        self.shapes.pose(time, dt)
        if self.known is self.strengths and not any(curve.moves for curve in self.strengths):
            return
        self.known = self.strengths
        self.table.strength.assign(np.array([[float(s.at(t)) for t in (time, time + dt)] for s in self.strengths],
                                            self.threads.model.dtype))

    def emit(self, live: wp.array, clock: wp.array, u: Any) -> None:
        """Puts what sources emit into the scalars and into u in a step."""
        if self.emits:
            self.threads.over(self.emit_kernel, self.layout.cells, [self.grid, self.table, live, clock],
                              [self.scalars.get("smoke"), self.scalars.get("heat"), self.expansion, self.holds])
        for a, kernel in enumerate(self.drive):
            out = getattr(u, AXES[a])
            self.threads.over(kernel, out.size, [self.grid, self.table, clock], [out])
