"""Pins of material points on the device (kernels/particles/mpm/actions/pins.py): where each puts its particles in a frame, and
the forces that they bear."""

from math import isfinite
from typing import Any

import numpy as np

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.actions.pins import pin_tables
from wsim.model.model import Model
from wsim.model.structs import fill_struct
from wsim.physics.mpm.seeding import nearest_nodes
from wsim.scene import Pin


class HeldParticles:
    """A pin of one world: rows of its particles (k,), and their places in its frame [m], (k, 3)."""

    def __init__(self, pin: Pin, world: int, rows: np.ndarray, start: np.ndarray):
        """rows, start: of all particles of its body; start: places in the world [m]."""
        self.pin, self.world, self.rows, self.motion = pin, world, rows[pin.points], pin.motion
        M = pin.motion.at(0.0)
        self.locals = np.asarray(pin.places, np.float64) if pin.places is not None else np.linalg.solve(
            M[:3, :3], (start[pin.points] - M[:3, 3]).T).T

    @property
    def hard(self) -> bool:
        return not isfinite(self.pin.stiffness)

    def targets(self, time: float) -> np.ndarray:
        """Places of its particles at a time [s], world [m] (k, 3)."""
        return self.motion.points(self.locals, time)


class PinTable:
    """The hard pins of a scene, or the soft ones. corner: of the grid's node 0 [m]; mass [kg]: of the heaviest particle."""

    def __init__(self, model: Model, pins: list[HeldParticles], corner: np.ndarray, cell: float, mass: float, dt: float):
        self.pins, self.corner, self.cell, self.changed, self.dt = pins, corner, cell, True, dt
        rows = np.concatenate([each.rows for each in pins])
        t, n, sizes = types(model.real), len(rows), [len(each.rows) for each in pins]
        own = {name: np.repeat([getattr(each.pin, name) for each in pins], sizes) for name in ("stiffness", "damping")}
        real = {name: np.where(np.isfinite(values), values, 0.0).astype(model.dtype) for name, values in own.items()}
        self.count, self.ends = n, np.cumsum([0, *sizes])
        self.rows = fill_struct(
            pin_tables(model.real).PinRows, point=model.upload(rows.astype(np.int32), int), mass=model.real(mass),
            dt=model.real(dt), **{name: model.upload(np.zeros(n, np.int32), int) for name in "ijk"},
            **{name: model.upload(np.zeros((n, 3), model.dtype), t.vec3) for name in ("o", "way", "impulse")},
            **{name: model.upload(values, model.real) for name, values in real.items()})

    def aim(self, time: float) -> None:
        """A frame begins at a time [s]: uploads where it begins and ends, where that has changed."""
        moves = any(each.motion.moves for each in self.pins)
        if not (moves or self.changed):
            return
        self.changed = moves
        start, end = (np.concatenate([each.targets(at) for each in self.pins]) for at in (time, time + self.dt))
        node, offset = nearest_nodes(start, self.corner, self.cell)
        dtype = self.rows.o.numpy().dtype
        for axis, name in enumerate("ijk"):
            getattr(self.rows, name).assign(node[:, axis].astype(np.int32))
        self.rows.o.assign(offset.astype(dtype))
        self.rows.way.assign(((end - start) / self.cell).astype(dtype))

    def set_motion(self, path: str, motion: Any, world: int | None) -> bool:
        """Gives a pin another motion in one world or in all; False where there is no such pin."""
        hit = [each for each in self.pins if each.pin.path == path and world in (None, each.world)]
        for each in hit:
            each.motion = motion
        self.changed |= bool(hit)
        return bool(hit)

    def forces(self, path: str, world: int) -> np.ndarray | None:
        """Mean force of a pin on each of its particles in the last frame [N], (k, 3); None where there is no such pin."""
        for k, each in enumerate(self.pins):
            if each.pin.path == path and each.world == world:
                found = self.rows.impulse.numpy()[self.ends[k]:self.ends[k + 1]].astype(np.float64) / self.dt
                return np.asarray(found)
        return None
