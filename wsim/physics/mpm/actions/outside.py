"""What acts on material points from outside, on the device: loads, air and pins (kernels/particles/mpm/actions), as launches
around the parts of a step. Only scenes with such things have any of it."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.actions.forces import air_kernel, force_tables, load_kernel
from wsim.kernels.particles.mpm.actions.pins import pin_kernels, pin_tables
from wsim.kernels.particles.mpm.tables import CELLS
from wsim.model.structs import fill_struct
from wsim.physics.mpm.actions.choice import air_acts, air_drags, loads_on_points
from wsim.physics.mpm.actions.pins import HeldParticles, PinTable
from wsim.scene import Problem, SceneError
from wsim.scene.curve import Motion
from wsim.scene.nodal.loads import given_curve


class LoadTable:
    """Loads of all worlds: `borne`, of each its load, curve, rows and world."""

    def __init__(self, method: Any, b: Any):
        model, self.dt, self.changed = method.model, b.clock.dt, True
        self.borne: list[list[Any]] = [[load, load.curve, method.part.rows[load.body, world][load.points], load.parts, world]
                                       for load in loads_on_points(b.scene) for world in range(model.worlds)]
        rows, share = (np.concatenate([each[k] for each in self.borne]) for k in (2, 3))
        load = np.repeat(np.arange(len(self.borne)), [len(each[2]) for each in self.borne])
        order = np.argsort(rows, kind="stable")
        point, first = np.unique(rows[order], return_index=True)
        t, zeros = types(model.real), np.zeros((len(self.borne), 3), model.dtype)
        self.count = len(point)
        self.rows = fill_struct(
            force_tables(model.real).LoadRows, point=model.upload(point.astype(np.int32), int),
            first=model.upload(np.append(first, len(rows)).astype(np.int32), int),
            load=model.upload(load[order].astype(np.int32), int),
            share=model.upload(share[order].astype(model.dtype), model.real), start=model.upload(zeros, t.vec3),
            end=model.upload(zeros, t.vec3), dt=model.real(self.dt))

    def aim(self, time: float) -> None:
        """A frame begins at a time [s]: uploads values at its ends, where they have changed."""
        moves = any(curve.moves for _, curve, *_ in self.borne)
        if moves or self.changed:
            self.changed = moves
            for array, at in ((self.rows.start, time), (self.rows.end, time + self.dt)):
                array.assign(np.stack([curve.at(at) for _, curve, *_ in self.borne]).astype(array.numpy().dtype))

    def set_value(self, path: str, name: str, value: Any, world: int | None) -> bool:
        """Takes a force [N] of a load, as `wsim.scene.nodal.loads.given_curve` does."""
        hit = [each for each in self.borne if each[0].path == path and each[0].name == name and world in (None, each[4])]
        for each in hit:
            each[1] = given_curve(each[0], each[1], value)
        self.changed |= bool(hit)
        return bool(hit)


class OutsideActions:
    """Of a `MaterialPointMethod`, whose particles have their rows. `hard`, `soft`: pins, or None."""

    def __init__(self, method: Any, b: Any):
        model, scene = method.model, b.scene
        self.model, self.things, self.dx = model, method.things, model.real(method.cell)
        held = [HeldParticles(pin, world, method.part.rows[thing.path, world], thing.placed_points())
                for thing in self.things for pin in thing.pins for world in range(model.worlds)]
        self.hard, self.soft = (PinTable(model, own, method.corner, method.cell, self._heaviest(method), b.clock.dt)
                                if (own := [each for each in held if each.hard == hard]) else None for hard in (True, False))
        self.loads = LoadTable(method, b) if loads_on_points(scene) else None
        self.air: Any = None
        if air_acts(scene):
            self._fill_air(scene)
        self.nodes: Any = None                                 # `PinNodes`, of hard pins

    def _heaviest(self, method: Any) -> float:
        return max(float(method.masses(k).max(initial=0.0)) for k in range(len(self.things)))

    def _fill_air(self, scene: Any) -> None:
        model, t = self.model, types(self.model.real)
        drag = [thing.drag * scene.air_density for thing in self.things for _ in thing.materials] * model.worlds
        self.air = fill_struct(
            force_tables(model.real).AirRows,
            wind=model.upload(np.tile(np.asarray(scene.wind, model.dtype), (model.worlds, 1)), t.vec3),
            decay=model.upload(np.full(model.worlds, scene.air_drag, model.dtype), model.real),
            drag=model.upload(np.array(drag, model.dtype), model.real))

    def make_kernels(self, grid: Any) -> None:
        """Kernels of what there is, for a grid."""
        real, module = self.model.real, grid.module
        self.explicit = grid.waves
        if self.loads:
            self.push_points = load_kernel(real, module)
        if self.air:
            self.blow_points = air_kernel(air_drags(self.things), real, module)
        if self.hard or self.soft:
            self.by_pin = pin_kernels(real, module)

    def make_room(self, blocks: int) -> None:
        """Arrays for so many blocks of a grid."""
        if self.hard:
            n, t, device = CELLS * blocks, types(self.model.real), self.model.device
            self.nodes = fill_struct(
                pin_tables(self.model.real).PinNodes, sum=wp.zeros(4 * n, dtype=wp.int64, device=device),
                **{name: wp.zeros(n, dtype=t.vec4, device=device) for name in ("held", "given")})

    # around a frame

    def aim(self, time: float) -> None:
        """A frame begins at a time [s]."""
        for table in (self.hard, self.soft, self.loads):
            if table:
                table.aim(time)

    def set_value(self, path: str, name: str, value: Any, world: int | None) -> bool:
        """Takes a motion of a pin, a force [N] of a load, the wind [m/s] or the decay by air [1/s]."""
        if name == "motion" and isinstance(value, Motion):
            return any([pins.set_motion(path, value, world) for pins in (self.hard, self.soft) if pins])
        if path == "/" and self.air and name in ("wind", "air_drag"):
            array = self.air.wind if name == "wind" else self.air.decay
            now = array.numpy()
            now[slice(None) if world is None else world] = value
            array.assign(now)
            return True
        return self.loads is not None and self.loads.set_value(path, name, value, world)

    # reactions

    def paths(self) -> list[str]:
        """Paths of all pins."""
        return list(dict.fromkeys(each.pin.path for pins in (self.hard, self.soft) if pins for each in pins.pins))

    def takes(self, path: str | None) -> bool:
        """True if a path is that of a pin here."""
        return path in self.paths()

    def of(self, path: str, world: int, time: float) -> np.ndarray:
        """Mean forces of a pin on its particles in the last frame [N], (k, 3). Raises SceneError."""
        if not self.explicit:
            raise SceneError(Problem(path, "its forces are not measured: material points take implicit steps here; fix: give "
                                     'them integrator="explicit"'))
        for pins in (self.hard, self.soft):
            found = pins.forces(path, world) if pins else None
            if found is not None:
                return found
        raise SceneError(Problem(path, f"is no pin of world {world}; material points have {', '.join(self.paths()) or 'none'}"))

    # launches, of a grid (`wsim.physics.mpm.grid`)

    def begin_frame(self, grid: Any) -> None:
        """Pinned particles are where the pin has them as the frame begins."""
        if self.hard:
            grid.launch(self.by_pin.begin_pins, self.hard.count, [self.hard.rows, grid.points, self.dx])

    def begin_step(self, grid: Any) -> None:
        """Changes velocities of particles, which are sorted."""
        if self.loads:
            grid.launch(self.push_points, self.loads.count, [self.loads.rows, grid.points, grid.materials, grid.clock])
        if self.air:
            grid.launch(self.blow_points, grid.count, [grid.points, grid.materials, grid.grid, self.air, grid.clock])
        if self.soft:
            grid.launch(self.by_pin.pull_points, self.soft.count,
                        [self.soft.rows, grid.points, grid.materials, self.dx, grid.clock])
        if self.hard:
            self.nodes.sum.zero_()
            grid.launch(self.by_pin.sum_pins, self.hard.count,
                        [self.hard.rows, grid.points, grid.materials, grid.grid, grid.clock, self.nodes])

    def hold_momentum(self, grid: Any) -> None:
        """Nodes of pins get the momentum that they have with the pin; `grid.nodes` has that of all."""
        if self.hard:
            grid.launch(self.by_pin.hold_momentum, CELLS * grid.blocks,
                        [self.hard.rows, grid.grid, grid.materials, grid.clock, self.nodes, grid.nodes, grid.nodes])

    def hold_velocity(self, grid: Any) -> None:
        """Nodes of pins get the velocity of the pin, whatever else has held them."""
        if self.hard:
            grid.launch(self.by_pin.hold_velocity, CELLS * grid.blocks, [grid.grid, self.nodes, grid.nodes, grid.nodes])

    def hold_solve(self, grid: Any) -> None:
        """The same for a grid whose velocities are solved for."""
        if self.hard:
            grid.launch(self.by_pin.hold_solve, CELLS * grid.blocks,
                        [self.hard.rows, grid.grid, grid.clock, self.nodes, grid.solve])

    def end_step(self, grid: Any) -> None:
        """Pinned particles go with the pin."""
        if self.hard:
            grid.launch(self.by_pin.end_pins, self.hard.count,
                        [self.hard.rows, grid.points, grid.materials, grid.grid, grid.clock, self.nodes])
