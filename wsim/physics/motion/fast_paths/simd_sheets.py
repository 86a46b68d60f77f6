"""Membranes and hinges in packets, as a march on a CPU takes them. See kernels/motion/fast_paths/simd_sheets.py.

The tables of elements (`wsim.physics.cloth.elements`) are read as they stand, so that live values are seen; what is made here,
and nowhere else, are the places of the corners of each packet, and which forces each point gathers. Elements of the last packet
that are missing repeat the last one, and nobody gathers their forces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.geometry.topology import incident_rows
from wsim.kernels.cloth.curvature import SLOTS
from wsim.kernels.math.real import types
from wsim.kernels.motion.fast_paths import sheet_march
from wsim.kernels.motion.fast_paths import simd_sheets as kernels
from wsim.kernels.motion.fast_paths.simd_springs import EIGHT, FOUR, LINE, padded_row_length
from wsim.kernels.motion.fast_paths.threads import MOST
from wsim.model.model import Model
from wsim.physics.motion.fast_paths.threads import Abreast

if TYPE_CHECKING:
    from wsim.physics.cloth.elements import CornerElements

POINTS = kernels.TRIANGLE, kernels.HINGE       # of elements
BLOCK = 8              # groups of EIGHT points of a block, of which the furthest is known
LEAST = 400            # elements of a thread


def sheet_threads(elements: int) -> int:
    """Threads that so many elements are worth."""
    return max(1, min(MOST, elements // LEAST))


def padded_array(array: wp.array) -> wp.array:
    """The same values in an array that goes on to a whole packet, by zeros."""
    n = len(array)
    whole = wp.zeros(-(-n // EIGHT) * EIGHT, dtype=array.dtype, device=array.device)
    wp.copy(whole, array, count=n)
    return whole[:n]


def packet_corners(ids: np.ndarray) -> np.ndarray:
    """Places of the corners of packets of elements (m, k), (packets, k, EIGHT)."""
    last = np.repeat(ids[-1:], -len(ids) % EIGHT, axis=0)
    return np.concatenate([ids, last]).reshape(-1, EIGHT, ids.shape[1]).swapaxes(1, 2)


def packet_force_slots(count: int, corners: int) -> np.ndarray:
    """Places of the forces at the corners of elements, (count, corners): packet by packet, lanes 0 4 1 5 2 6 3 7."""
    packet, lane = np.divmod(np.arange(count), EIGHT)
    return ((packet[:, None] * corners + np.arange(corners)) * EIGHT) + (2 * (lane % FOUR) + lane // FOUR)[:, None]


def eight_list_rows(start: np.ndarray, items: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lists items[start[i]:start[i + 1]] of EIGHT i beside each other: first row of each eight, and rows (rows, EIGHT), -1 past
    the last item of a list."""
    counts = np.diff(start)
    most = counts.reshape(-1, EIGHT).max(axis=1)
    begin = np.append(0, np.cumsum(most))
    found = np.full((begin[-1], EIGHT), -1)
    of = np.repeat(np.arange(len(counts)), counts)
    found[begin[of // EIGHT] + np.arange(len(of)) - start[of], of % EIGHT] = items[:len(of)]
    return begin, found


class PacketSheets:
    """All membranes and hinges of a model."""

    def __init__(self, model: Model, elements: list[CornerElements], damped: bool, threads: int):
        """threads: at most."""
        self.model, self.damped = model, damped
        self.of = {e.kind: e for e in elements}
        self.renewed = False             # tables are other arrays than they were
        n = model.points
        groups = -(-n // EIGHT)
        order = np.append(np.arange(n), np.full(EIGHT * groups - n, -1))
        group = np.append(np.arange(0, groups, BLOCK), groups)
        self.blocks = len(group) - 1
        self.table = kernels.sheet_of(model.real)()
        self.table.row = padded_row_length(len(order))
        self.put(order=order, group=group)
        ids = [self.triangles(self.of.get("membrane")), self.hinges(self.of.get("dihedral"))]
        self.gather(ids, len(order))
        reals = EIGHT * sum(kernels.KEPT[k] * -(-len(i) // EIGHT) for k, i in zip(POINTS, ids, strict=True))
        forces = sum(EIGHT * k * -(-len(i) // EIGHT) for k, i in zip(POINTS, ids, strict=True))
        curved = len(self.table.count) if self.table.count else 0
        self.space = wp.zeros(kernels.ROWS * self.table.row + forces + curved + 4 + reals // FOUR + 2 * LINE,
                              dtype=types(model.real).vec4, device=model.device)
        self.abreast = Abreast(model, np.zeros((min(threads, sheet_threads(sum(map(len, ids)))), 4), int))

    def put(self, **tables: np.ndarray) -> None:
        """Uploads tables; again: in place of those before, as long as they are as large."""
        t = types(self.model.real)
        for name, values in tables.items():
            real, before = values.dtype.kind == "f", getattr(self.table, name)
            values = values if real else values.ravel().astype(np.int32)
            if before and len(before) == len(values):
                before.assign(values)
                continue
            self.renewed = self.renewed or before is not None
            dtype = (t.vec4 if values.ndim == 2 else t.scalar) if real else int
            setattr(self.table, name, self.model.upload(values, dtype))

    def triangles(self, e: CornerElements | None) -> np.ndarray:
        """Fills the table of triangles; points of each, (t, 3)."""
        if e is None:
            return np.zeros((0, kernels.TRIANGLE), int)
        self.share(e)
        for name in ("rest", "stiffness", "tau"):
            setattr(self.table, name, getattr(e.data, name))
        corners = packet_corners(e.ids)
        self.put(corner=FOUR * corners)
        self.table.triangles = len(corners)
        return e.ids

    def hinges(self, e: CornerElements | None) -> np.ndarray:
        """Fills the tables of hinges and curvatures; points of each hinge, (h, 4)."""
        if e is None:
            return np.zeros((0, kernels.HINGE), int)
        self.share(e)
        for name, own in (("angle", "rest"), ("bend", "stiffness"), ("relax", "tau")):
            setattr(self.table, name, getattr(e.data, own))
        corners = packet_corners(e.ids)
        self.put(hinge=FOUR * corners)
        self.table.hinges = len(corners)
        self.curve(e)
        return e.ids

    def share(self, e: CornerElements) -> None:
        """Gives the tables of elements their padding, where others find them."""
        for name in ("rest", "stiffness", "tau"):
            array = padded_array(getattr(e.data, name))
            setattr(e.data, name, array)
            if name != "stiffness":
                setattr(e.table.data, name, array)

    def curve(self, e: CornerElements) -> None:
        """Uploads the curvatures of hinges."""
        self.seen = [r.coupling for r in e.rows]
        found, missing = e.curvature.tables(), -len(e.ids) % EIGHT
        value = np.append(np.pad(found["value"], ((0, 0), (0, 1))), np.zeros((1, FOUR)), axis=0)
        start = np.append(np.append(found["begin"], found["end"][-1]), np.full(missing, found["end"][-1]))
        begin, item = eight_list_rows(start, found["item"])
        item = np.where(item < 0, len(value) - 1, item)
        reals = {"own": np.pad(found["own"], (0, missing)), "value": value, "moment": value[item.ravel()]}
        self.put(slot=found["slot"], count=found["count"], begin=begin, home=item // SLOTS)
        self.put(**{name: values.astype(self.model.dtype) for name, values in reals.items()})

    def gather(self, ids: list[np.ndarray], places: int) -> None:
        """Which forces each point sums: of triangles, then of hinges."""
        model, packets = self.model, [self.table.triangles, self.table.hinges]
        first = EIGHT * kernels.TRIANGLE * packets[0]
        at = np.concatenate([packet_force_slots(len(ids[0]), kernels.TRIANGLE).ravel(),
                             first + packet_force_slots(len(ids[1]), kernels.HINGE).ravel()])
        starts, items = incident_rows(np.concatenate([i.ravel() for i in ids])[:, None], model.points)
        begin, item = eight_list_rows(np.append(starts, np.full(places - model.points, starts[-1])), items)
        self.put(first=begin, force=FOUR * np.where(item < 0, first + EIGHT * kernels.HINGE * packets[1], at[item]))

    def march(self, module, bounded: bool):
        """Kernel of frames, or substeps. bounded: frames are watched."""
        return sheet_march.sheet_march_kernel(self.model.real, module, self.damped, bounded)

    def refresh(self) -> bool:
        """Follows a new rest shape; True if a launch has other arrays from now on."""
        e, self.renewed = self.of.get("dihedral"), False
        if e is not None and any(r.coupling is not seen for r, seen in zip(e.rows, self.seen, strict=True)):
            self.curve(e)
        if self.renewed:
            self.abreast.key = ()
        return self.renewed
