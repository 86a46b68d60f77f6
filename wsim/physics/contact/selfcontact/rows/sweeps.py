"""Sweeps over contact rows of surfaces, in turn with contacts of points with colliders. Where these are by points alone, all
sweeps of a call are one launch; else each part of a sweep is a launch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import wsim.kernels.contact.selfcontact.sweep as kernels
from wsim.kernels.contact.selfcontact import rows
from wsim.kernels.contact.selfcontact.moment_correction import held_type
from wsim.kernels.math.block import CLUSTERS
from wsim.kernels.math.real import types
from wsim.model.launches import has_large_clusters
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact.modules import contact_sweep_module

if TYPE_CHECKING:
    from wsim.model.stage import Clock
    from wsim.physics.contact.selfcontact.method import SelfContactMethod

TOGETHER = True                  # one launch; tests compare
BLOCKS, CLUSTER = 64, (16, 8)    # blocks at most; those of a cluster where as many were run, and elsewhere

HELD = 1 << 14                   # pairs that a CPU keeps as sweeps read them


def concurrent_blocks(multiprocessors: int, cluster: int) -> int:
    """Blocks that surely run at once, one a multiprocessor: whole clusters, of which half of the device is sure to hold all."""
    if not cluster:
        return min(BLOCKS, multiprocessors)
    return max(1, min(BLOCKS, multiprocessors // 2) // cluster) * cluster


class SurfaceSweeps:
    """turns: as `rows.pair_sweep_kernel`."""

    def __init__(self, method: SelfContactMethod, turns: bool):
        import warp as wp
        real, module = method.model.real, contact_sweep_module(method.model, turns)
        self.lean, self.press = rows.active_row_kernel(real, module), rows.pair_sweep_kernel(real, module, turns)
        self.method, self.model, self.turns = method, method.model, turns
        device = self.model.device
        self.on = TOGETHER and not self.model.gradients                        # wanted
        self.block, self.blocks, self.cluster = 1, 1, 0
        if device.is_cuda:
            self.block, self.cluster = kernels.BLOCK, CLUSTER[not has_large_clusters(device)] if device.arch >= CLUSTERS else 0
            self.blocks = concurrent_blocks(device.sm_count, self.cluster)
        self.words = wp.zeros(kernels.WORDS, dtype=int, device=device)
        self.moved = wp.zeros(method.surfaces.total, dtype=int, device=device)
        self.held = wp.zeros(0 if device.is_cuda else HELD, dtype=held_type(real)[0], device=device)
        self.kernel: Any = None

    def fits(self) -> bool:
        """True if a call of sweeps is one launch: contacts are by points alone, none of which turns, and not a Newton
        step's own."""
        c = self.method.contact
        alone = c is None or c.movers is None and not c.within and c.contacts.edges is None and not c.contacts.spins
        return self.on and alone

    def meet(self) -> None:
        """Makes the kernel, once colliders are known."""
        contact = self.method.contact
        if self.fits():
            real, touches = self.model.real, contact is not None
            how = ["touches"] * touches + ["turns"] * self.turns
            name = "_".join(map(str, ["wsim_selfcontact_sweep", types(real).name, *how, self.block, self.cluster]))
            self.model.modules[name] = self.block
            self.kernel = kernels.all_sweeps_kernel(real, self.block, touches, self.turns, name, self.cluster)

    def sweep(self, clock: Clock, count: int, leads: bool, anew: int, spared: int) -> None:
        """Launches so many sweeps. anew: of them, behind which it is asked anew what takes part; spared: number of the one that
        is left out where pairs are taken in turn."""
        if self.fits():
            self._launch(clock, count, leads, anew, spared)
        else:
            self._parts(clock, count, leads, anew, spared)

    def _parts(self, clock: Clock, count: int, leads: bool, anew: int, spared: int) -> None:
        """A launch for each part of a sweep."""
        import warp as wp
        method, near, launch = self.method, self.method.near, self.model.launch
        data, at, climb, calm = method.surfaces.data, method.at(), rows.RECOVERY * clock.h, rows.CALM * clock.h
        threads, listed = near.threads, near.table
        for k in range(count):
            last = int(k == count - 1)
            if k % anew == 0 or last:
                (near.pairs.active[:1] if k else near.pairs.active).zero_()
                launch(self.lean, threads, [at, climb, calm, wp.vec2i(k, count), threads, listed], [near.sums])
            again = int(last or k == count - 2 or k % anew == anew - 1)
            more = k if leads else rows.SPARED if k == spared else -1
            launch(self.press, threads, [data, at, climb, more, threads, listed, near.words], [near.sums])
            launch(method.guarantee.add, len(method.surfaces.points), [data.point, at.d, again, near.sums], [at.d])
            if method.contact:
                method.contact.project(clock, beside=True)

    def _launch(self, clock: Clock, count: int, leads: bool, anew: int, spared: int) -> None:
        """One launch."""
        method, near, contact = self.method, self.method.near, self.method.contact
        How, Touched = kernels.sweep_order_types(self.model.real)
        touch = Touched()
        at, free = method.at(), 0
        if contact:
            c, free = contact.contacts, contact.contacts.count
            touch = fill_struct(Touched, rows=c.table, points=c.points, slots=c.slots, push=c.push)
        how = fill_struct(How, climb=rows.RECOVERY * clock.h, calm=rows.CALM * clock.h, count=count, anew=anew,
                          leads=int(leads),
                          spared=spared, free=free, threads=self.blocks * self.block, words=self.words, moved=self.moved,
                          held=self.held, g=contact.step(clock) if contact else clock.effective_step)
        self.words.zero_()
        self.model.launch_blocks(self.kernel, self.blocks, self.block, [method.surfaces.data, at, how, touch, near.table,
                                                                        near.words], [near.sums])
