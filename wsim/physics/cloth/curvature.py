"""Curvatures of all sheets on the device: see `wsim.physics.cloth.bending` and kernels/cloth/curvature.py."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.topology import order_of
from wsim.kernels.cloth import curvature as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.model import Model
from wsim.physics.cloth.bending import SLOTS

NONE = 1e-12           # of the largest value of a triangle: what is less is rounding
LANES = 4096           # threads that sum an energy


class Curvature:
    """Curvatures of the hinges of some rows, which stand in a table in `order`."""

    def __init__(self, model: Model, rows: list[Any], order: np.ndarray | None = None, apart: bool = False):
        """rows: of `wsim.physics.cloth.constraints`, of hinges; order: row of the table at each place, None: the same; apart:
        `need` is called by whoever launches something."""
        self.model, self.rows, t = model, rows, types(model.real)
        self.hinges = sum(len(r.ids) for r in rows)
        self.triangles = sum(len(r.coupling.slot) for r in rows)
        self.place = np.arange(self.hinges)
        if order is not None:
            self.place[order] = np.arange(self.hinges)
        self.seen, self.rank = [r.coupling for r in rows], np.full(0, 0)
        self.data = d = kernels.sheet_curvatures(model.real)()
        for name, values in self.tables().items():
            setattr(d, name, model.upload(values, {"value": t.vec3, "own": t.scalar}.get(name, int)))
        if not apart:
            self.need()

    def need(self, stored: bool = False) -> None:
        """Makes the kernel of sums, before the module is compiled, and what it works on. stored: G has a place."""
        self.sums = kernels.curvature_sum_kernel(self.model.real, self.model.module)
        self.room(stored)

    def room(self, stored: bool = False) -> None:
        """Makes arrays that change, where there are none."""
        if self.data.z is not None:
            return
        model, d, t = self.model, self.data, types(self.model.real)

        def curvature_zeros(count: int, dtype) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=model.device)
        d.slope, d.kept = curvature_zeros(self.hinges, t.scalar), curvature_zeros(self.hinges, t.scalar)
        d.z, d.C, d.G = (curvature_zeros(self.hinges, t.scalar), curvature_zeros(self.triangles, t.vec3),
                         curvature_zeros(3 * self.hinges * stored, t.vec3))
        if model.gradients:
            d.y, d.Y = curvature_zeros(self.hinges, t.scalar), curvature_zeros(self.triangles, t.vec3)

    @property
    def sizes(self) -> np.ndarray:
        """Triangles of each row."""
        return np.array([len(r.coupling.slot) for r in self.rows])

    def slots(self) -> tuple[np.ndarray, np.ndarray]:
        """Place of the hinge of each slot, (t, SLOTS), and which are in use. Gradients may be by what is 0."""
        first = np.cumsum([0, *(len(r.ids) for r in self.rows)])
        slot = np.concatenate([np.where(r.coupling.slot >= 0, r.coupling.slot + k, -1)
                               for r, k in zip(self.rows, first, strict=False)])
        size = np.abs(np.concatenate([r.coupling.value for r in self.rows])).max(axis=2)
        used = (slot >= 0) & (self.model.gradients | (size > NONE * size.max(axis=1, keepdims=True)))
        return np.where(slot >= 0, self.place[np.maximum(slot, 0)], 0), used

    def tables(self) -> dict[str, np.ndarray]:
        """Arrays of the struct that stay. A slot that was in use once stays where it was."""
        slot, used = self.slots()
        if not self.rank.size:
            self.rank = np.full(slot.shape, SLOTS)
        new = used & (self.rank == SLOTS)
        self.rank[new] = np.where(self.rank < SLOTS, self.rank, -1).max(axis=1).repeat(new.sum(axis=1)) + 1
        self.own, used = np.argsort(self.rank, axis=1, kind="stable"), self.rank < SLOTS
        slot, used = (np.take_along_axis(a, self.own, axis=1) for a in (slot, used))
        value = np.take_along_axis(np.concatenate([r.coupling.value for r in self.rows]), self.own[..., None], axis=1)
        at = np.flatnonzero(used.ravel())
        order = np.argsort(slot.ravel()[at], kind="stable")
        item = np.zeros(slot.size, np.int32)
        item[:len(at)] = at[order]
        own = np.bincount(slot.ravel()[at], (value**2).sum(axis=2).ravel()[at], self.hinges)
        ends = np.cumsum(np.bincount(slot.ravel()[at], minlength=self.hinges))
        begin = np.r_[0, ends[:-1]].astype(np.int32)
        return {"slot": slot.ravel().astype(np.int32), "count": used.sum(axis=1).astype(np.int32), "item": item,
                "begin": begin, "end": ends.astype(np.int32), "value": value.reshape(-1, 3), "own": own}

    def refresh(self) -> None:
        """Uploads values anew where rows have others, into the same arrays."""
        now = [r.coupling for r in self.rows]
        if all(a is b for a, b in zip(now, self.seen, strict=True)):
            return
        self.seen = now
        for name, values in self.tables().items():
            getattr(self.data, name).assign(values if values.dtype == np.int32 else values.astype(self.model.dtype))

    def by_rows(self, by: np.ndarray) -> list[np.ndarray]:
        """A gradient by `value` as each row has it, (t, SLOTS, 3)."""
        found = np.empty((self.triangles, SLOTS, 3))
        np.put_along_axis(found, self.own[..., None], by.reshape(-1, SLOTS, 3), axis=1)
        return np.split(found, np.cumsum(self.sizes)[:-1])

    def spans(self, ids: np.ndarray) -> "Spans":
        """Points that each curvature depends on. ids (hinges, 4): points, in the order of the table."""
        slot = self.data.slot.numpy().reshape(-1, SLOTS)
        t, s = np.nonzero(np.arange(SLOTS) < self.data.count.numpy()[:, None])
        hinge, each = slot[t, s], np.arange(4)
        points, corners = ids[hinge].astype(np.int64).ravel(), (4 * hinge[:, None] + each).ravel()
        places, n = np.repeat(SLOTS * t + s, 4), int(points.max(initial=0)) + 1
        key = np.repeat(t, 4) * n + points
        order = order_of(key)
        new = np.flatnonzero(np.diff(key[order], prepend=-1))
        return Spans(key[order][new] // n, key[order][new] % n, np.r_[new, len(key)],
                     np.stack([places, corners], axis=1)[order])

    def launch_sums(self) -> None:
        """C of z."""
        self.model.launch(self.sums, self.triangles, [self.data], [])

    def energy_kernels(self, module: str) -> list:
        return [f(self.model.real, module)
                for f in (kernels.stored_bending_kernel, kernels.curvature_sum_kernel, kernels.bending_energy_kernel)]

    def energy(self, table, rest: wp.array, x: wp.array, d: wp.array, module: str) -> float:
        """[J] at x + d. table: struct of the hinges' points and compliances; rest: their angles at rest."""
        self.room()
        out = wp.zeros(min(LANES, self.triangles), dtype=wp.vec3d, device=self.model.device)
        kernels_of = self.energy_kernels(module)
        kernel_cache.load_module_of_kernel(kernels_of[-1], self.model)
        self.sum_energy(kernels_of, table, rest, x, d, out, 1)
        return float(out.numpy()[:, 2].sum())

    def sum_energy(self, kernels_of: list, table, rest: wp.array, x: wp.array, d: wp.array, out: wp.array, worlds: int) -> None:
        """Launches the sums of `energy` into out (threads,), as many for each world."""
        launch, (stored, sums, energy) = self.model.launch, kernels_of
        launch(stored, self.hinges, [table, rest, x, d, self.data], [])
        launch(sums, self.triangles, [self.data], [])
        launch(energy, out.size, [self.data, self.triangles, self.hinges, worlds], [out])


@dataclass
class Spans:
    """The parts that each curvature has of each of its points: triangle and point (s,), and items part[s] .. part[s + 1],
    (slot, corner of a hinge): see `wsim.kernels.cloth.hessian.curvature_span_kernel`. Those of a triangle stand together."""

    triangle: np.ndarray
    point: np.ndarray
    part: np.ndarray
    item: np.ndarray
