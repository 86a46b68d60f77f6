"""Frames of leapfrog in one launch of blocks that share sheets, in which others act on points within every substep: contacts,
soft pins, tethers, strain limits. See kernels/motion/fused/contact.py."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.topology import incident_rows
from wsim.kernels.contact.project import contact_tables, slot_type
from wsim.kernels.contact.restitution import bounce_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused.contact import Acts, written_frames
from wsim.kernels.motion.fused.hold import point_holdings
from wsim.kernels.motion.fused.limits import strain_limits
from wsim.model.stage import Clock, Methods
from wsim.model.structs import fill_struct

LANED = 512            # threads of a block that have registers for it. H200, ms a frame, one thread a point and lanes: squeezed
                       # cube (256 threads) 4.0, 3.3; bear (448) 0.43, 0.40; cape (640) 10.3, 11.1


class ActedFrames:
    """one: `wsim.physics.motion.fast_paths.one_launch.OneLaunch` of explicit steps that have `taken` others."""

    contact: Any = None          # methods whose tables are read where they are when a frame is launched
    pins: Any = None
    tethers: Any = None          # `wsim.physics.solver.batch.ColouredBatch`
    limits: Any = None           # the same

    def __init__(self, one):
        self.one, self.method, self.model, self.pull, self.send = one, one.method, one.model, one.pull, one.send
        self.hold, self.kernel = point_holdings(one.model.real)(), None

    def connect_ports(self, others: Methods) -> None:
        """Takes what acts, before kernels are compiled."""
        taken, model, plan = self.method.taken, self.model, self.pull.cluster
        if "contact" in taken:
            self.contact = others.ports.contact
        if "soft pins" in taken:
            self.pins = others.ports.soft_pins
            first, item = incident_rows(self.pins.place["soft"].numpy()[:, None], model.points)
            self.hold.first, self.hold.item = (model.upload(a.astype(np.int32), int) for a in (first, item))
        if "xpbd" in taken:
            self.hold_back({batch.kind: batch for batch in others.ports.xpbd_batches})
        from wsim.kernels.motion.fused.march import acted_frame_kernel
        c = self.contact.contacts if self.contact else None
        acts = Acts(c.kinds if c else (), bool(c and c.meshes), bool(c and self.contact.bounce), bool(self.pins),
                    bool(self.tethers), limits=plan if self.limits else None, damped=self.pull.damped)
        fits = c is not None and c.rows.most <= plan.lanes and plan.threads <= LANED
        if fits and not (acts.listed or acts.throws or acts.pinned or acts.tethered or acts.limits):
            acts = replace(acts, lanes=plan.lanes)
        elif acts.listed and plan.lanes > 1:
            acts = replace(acts, shared=plan.lanes)
        self.kernel = acted_frame_kernel(model.real, model.module_of(plan.threads), plan, self.pull.damped, acts)

    def hold_back(self, batches: dict[str, Any]) -> None:
        """Takes tethers and strain limits."""
        model, self.tethers, self.limits = self.model, batches.get("tether"), batches.get("limit")
        if self.tethers:
            ends, tether = self.tethers.data.point.numpy(), np.full(model.points, -1, np.int32)
            tether[ends[:, 1]] = np.arange(len(ends))
            self.hold.tether = model.upload(tether, int)
        if self.limits:
            plan, found = self.pull.cluster, self.pull.domains.limits
            head, every = found.lists(np.argsort(self.limits.order))
            size = (plan.inbox + 2 * plan.guests) * plan.size * plan.grid
            self.bounds = fill_struct(strain_limits(model.real), head=model.upload(head, int), list=model.upload(every, int),
                                      mail=wp.zeros(size, dtype=types(model.real).vec4, device=model.device),
                                      longest=self.limits.data.rest)
            self.hold.limits = self.bounds

    def whole(self, clock: Clock):
        """Half a kick in the first substep where no velocity of half a step before is known."""
        step = self.one.whole(clock)
        step.kick = (0.5 if clock.halved else 1.0) * clock.h
        return step

    def held(self, clock: Clock):
        """Struct of what holds points."""
        hold, net = self.hold, self.pull.net
        hold.h, hold.stride, hold.pin, hold.target = clock.h, self.method.stride, net.pin, net.target
        if self.pins:
            hold.alpha, hold.damping = self.pins.soft.alpha, self.pins.soft.damping
            hold.goal, hold.lam = self.pins.target["soft"], self.pins.lam
        if self.tethers:
            hold.ends, hold.length = self.tethers.data.point, self.tethers.data.rest
        return hold

    def by_cluster(self, clock: Clock) -> None:
        pull, s, real = self.pull, self.method.state, self.model.real
        pull.domains.begin()
        if self.limits:
            self.model.zero(self.bounds.mail)
        out = fill_struct(written_frames(real), x=s.x, e=s.e, v=s.v, r=s.r, half=s.b, halved=int(clock.halved),
                          iterations=clock.iterations)
        met: list = [contact_tables(real)[0](), contact_tables(real)[1](), slot_type(real)()]
        if self.contact:
            c, bounce = self.contact.contacts, self.contact.bounce
            met, out.push = [c.table, c.points, c.slots], c.push
            if bounce:
                out.bounces = fill_struct(bounce_type(real), restitution=bounce.restitution, h=clock.h,
                                          g=clock.effective_step, bend=2.0)
        self.model.launch_blocks(self.kernel, pull.cluster.size, pull.cluster.threads,
                                 [pull.net, pull.shares, self.whole(clock), out, *met, self.held(clock)], [])
        if self.contact and "solid" in self.contact.contacts.kinds:
            self.model.zero(self.contact.contacts.table.deep)        # what started inside is marked
