"""Frames of strands on a GPU: a launch for each part of an iteration, and one for the last few strands (kernels/rods/apart).
On a CPU strands march in one launch, see method.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.rods.gpu_elimination.parts import FREE, LANES, LAST, OWNED, TOUCH, RodParts, numbers_per_point
from wsim.kernels.rods.gpu_elimination.steps import WARP, apart_step_kernels
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct

if TYPE_CHECKING:
    from wsim.physics.rods.method import RodMethod

HALF = 2            # where 1 / HALF of the strands are on they are listed, and launches go on over these
FEW = 10            # 1 / FEW of the strands are finished by a warp each; all of them so: 31 ms for 8 of 10000 hairs (H200)


class StrandElimination:
    def __init__(self, strands: RodMethod, module: str, device):
        self.strands, table, self.device = strands, strands.table, device
        last = f"{module}_last"
        strands.model.modules[last] = strands.threads
        self.begin, self.touch, self.measure, self.solve, self.take, self.end, self.finish, self.enlist = apart_step_kernels(
            strands.obstacles.kinds, strands.airy, module, last)
        m, count = table.strands, numbers_per_point(strands.airy) + (TOUCH + OWNED) * bool(strands.obstacles.kinds)
        part = np.zeros((count, table.longest + 2, m))
        end = np.arange(table.longest + 2)[:, None] >= table.counts
        for k in (0, 3, 5, LAST):                        # the diagonal
            part[k] = end
        part[FREE] = np.pad(table.hold < 0, ((0, 2), (0, 0))) & ~end
        part[FREE + 1] = np.pad(table.clamped == 0, ((0, 2), (0, 0))) & ~end
        length = np.where(table.values["length"] > 0.0, table.values["length"], np.inf)
        self.parts = fill_struct(
            RodParts, part=wp.array(part, dtype=wp.float64, device=device),
            factor=wp.zeros((2 * LANES**2 + LANES, table.longest, m), dtype=wp.float64, device=device),
            least=wp.array(length.min(axis=0), dtype=wp.float64, device=device),
            **{name: wp.zeros(m, dtype=wp.float64, device=device) for name in ("before", "share", "taken")},
            **{name: wp.zeros(m, dtype=int, device=device) for name in ("count", "at", "on", "done", "moved", "edges", "list")},
            listed=wp.zeros(1, dtype=int, device=device))
        self.all = wp.array(np.arange(m), dtype=int, device=device)
        self.words = wp.zeros(2, dtype=int, device=device)
        self.going = self.words[:1]
        self.few = m // FEW

    def each(self, kernel, inputs: list, outputs: list, threads: int = 0) -> None:
        """threads: of a strand; 0: one a point."""
        table = self.strands.table
        wp.launch(kernel, table.strands * (threads or table.longest), inputs, outputs, device=self.device,
                  block_dim=self.strands.threads)

    def advance(self, clock: Clock) -> None:
        s, A = self.strands, self.parts
        S, H, C, Q, T = s.strands, s.holds, s.obstacles.table, s.moving(), s.trial
        A.h, A.substeps = clock.dt / s.substeps, s.substeps
        s.said.zero_()
        A.at.zero_()
        for word in (A.on, A.done):
            word.fill_(1)
        self.words.fill_(s.table.strands)
        half = max(s.table.strands // HALF, self.few)
        wp.copy(A.list, self.all)
        A.listed.fill_(s.table.strands)
        self.each(self.begin, [S, H, Q, T, A, half], [self.words])
        wp.capture_while(self.going, self._iterate, few=half)
        self._list_active_strands(self.few)
        wp.capture_while(self.going, self._iterate, few=self.few)
        self._list_active_strands(0)
        self.each(self.finish, [S, H, C, Q, T, A], [s.said], WARP)

    def _list_active_strands(self, few: int) -> None:
        """Lists strands that are on. Launches go over these while they are more than `few`."""
        self.parts.listed.zero_()
        self.each(self.enlist, [self.parts, few], [self.words], 1)

    def _iterate(self, few: int) -> None:
        s, A = self.strands, self.parts
        S, C, Q, T = s.strands, s.obstacles.table, s.moving(), s.trial
        if s.obstacles.kinds:
            self.each(self.touch, [S, C, Q, T, A], [])
        self.each(self.measure, [S, C, Q, T, A], [self.words])
        self.each(self.solve, [S, T, A], [self.words, s.said], LANES)
        self.each(self.take, [S, T, A], [])
        self.each(self.end, [S, C, Q, T, A], [s.said])
        self.each(self.begin, [S, s.holds, Q, T, A, few], [self.words])
