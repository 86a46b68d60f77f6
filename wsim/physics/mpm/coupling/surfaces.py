"""Points of cloth and soft bodies that material points push (kernels/particles/mpm/coupling/surfaces.py): what they carry
through a frame, as inverse masses and gravity of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.surfaces import loaded_kernel, surface_kernels, surface_tables
from wsim.model.structs import fill_struct

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


class SurfaceExchange:
    """exchange: `wsim.physics.mpm.coupling.exchange.Exchange`, whose table has the meshes."""

    def __init__(self, b: Build, exchange: Any, laws: tuple[str, ...]):
        self.model, self.state, self.exchange = b.model, b.state, exchange
        self.constants, self.loads = b.ports.constants, None   # type: Any, Any
        real, device = b.model.real, b.model.device
        t, tables = types(real), surface_tables(real)
        rows = np.concatenate([array.numpy() for _, array in sorted(exchange.colliders.points.items())])
        self.count, self.tables = len(rows), tables
        self.points = fill_struct(
            tables.SurfacePoints, row=b.model.upload(rows, int), mass=wp.zeros(self.count, dtype=wp.int64, device=device),
            w=wp.zeros(self.count, dtype=real, device=device),
            **{name: wp.zeros(self.count, dtype=t.vec3, device=device) for name in ("before", "place", "gravity")})
        self.attached: Any = None
        b.clock.fresh = True
        self.kernels = surface_kernels(exchange.colliders.kinds, laws, real, b.model.module)
        self.follow_gravity = loaded_kernel(real, b.model.module)

    def make_room(self, count: int) -> None:
        """Arrays for so many particles."""
        device, t = self.model.device, types(self.model.real)
        self.attached = fill_struct(
            self.tables.Attached, near=wp.zeros(count, dtype=int, device=device),
            corner=wp.zeros(count, dtype=wp.vec3i, device=device),
            **{name: wp.zeros(count, dtype=t.vec3, device=device) for name in ("place", "part", "share")})

    def connect_loads(self, loads: Any) -> None:
        """loads: the method that adds loads to gravity, or None."""
        self.loads = loads
        if loads:
            self.loaded = self.model.upload(np.asarray(loads.point, np.int32), int)

    def _set_weights(self, kernel: Any) -> None:
        c = self.constants
        self.model.launch(kernel, self.count, [self.exchange.walls, self.points, self.state.x, self.state.v], [c.w, c.gravity])
        if self.loads:
            self.model.launch(self.follow_gravity, len(self.loaded), [self.loaded, c.gravity], [self.loads.own])

    def load(self, grid: Any) -> None:
        """Launches what gives points the frame's impulses, and the particles that they carry."""
        grid.launch(self.kernels.attach_particles, grid.count,
                    [grid.points, grid.materials, self.exchange.walls, self.points, self.attached])
        self._set_weights(self.kernels.load_points)

    def unload(self) -> None:
        """Launches what takes the particles off again."""
        self._set_weights(self.kernels.unload_points)

    def release(self, grid: Any) -> None:
        """Launches what gives particles the change of velocity of the points that carried them, and the angular momentum."""
        walls = self.exchange.walls
        grid.launch(self.kernels.release_particles, grid.count,
                    [grid.points, grid.materials, walls, self.points, self.attached, self.state.x, self.state.v])
        grid.launch(self.kernels.turn_particles, grid.count, [grid.points, walls, self.attached])
        walls.pushed.turning.zero_()
