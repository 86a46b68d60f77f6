"""Frames in which no two surfaces come near each other: they leave all stages of self-contact out.

A frame is looked at as a whole where it ends. Every point went from where it began to where it is; if the list of near pairs
was empty, and points are in the tubes that it was made with (kernels/contact/selfcontact/motion_bounds.py), no surfaces have
met on straight ways beside the common motion. Points that have left their tubes ask for a list along the ways of the frame;
where that is empty, the frame holds too. Else it is repeated with all stages. An explicit integrator on which nothing else acts
takes such frames whole. Mesh colliders that move turn as they like within a frame: then all frames have all stages, and so they
have where strands of rods take part.

A frame that is tried without stages in vain has cost its time. So one is tried behind a frame with all stages that would have
held without them, as a look back at its ways says. Behind one that was in vain the next has all stages, behind a second two
in a row, then four, LONGEST at most: a cloth that swings by its corners goes further in a frame than its edges are long, and a
look at the whole frame says too little. How many are to come is kept with the state, so that a restart goes on to the bit:
explicit steps begin otherwise behind frames without stages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import motion_bounds, pairs, step_clamp
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.model.stage import FREE, MET, Clock, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct

if TYPE_CHECKING:
    from wsim.physics.contact.selfcontact.method import SelfContactMethod
    from wsim.physics.contact.selfcontact.near import NearPairList
    from wsim.simulation.methods import Build

ENDLESS = 1e30         # [m] that points may go within explicit frames: they are looked at where these end
TUBE = 0.25            # of the least radius of tubes: of those about ways whose both ends are known
LONGEST = 8            # frames with all stages, at most, behind one that was tried without them in vain
FIELDS = (StateField("surfaces_wait", "1", True, "frames to come that have all stages of self-contact at once", "int"),
          StateField("surfaces_tried", "1", True, "frames in a row that were tried without them in vain", "int"))


class SurfaceFreeFlight:
    """room, word, look_at: what explicit steps ask of bounds of their own
    (`wsim.physics.contact.free_flight_test.FreeFlightTest`)."""

    def __init__(self, method: SelfContactMethod, b: Build, module: str):
        """module: of its kernel."""
        self.method, self.model, self.state = method, b.model, b.state
        real, device, n = b.model.real, b.model.device, b.model.points
        self.way = motion_bounds.frame_displacement_kernel(real, module)
        self.d = wp.zeros(n, dtype=types(real).vec3, device=device)
        self.whole = b.alone
        self.room = wp.full(n, ENDLESS, dtype=real, device=device) if b.alone else None
        self.word = wp.zeros(1, dtype=int, device=device)
        parts = b.state.points
        self.x, self.e = (parts.aside[k * parts.capacity:(k + 1) * parts.capacity] for k in map(parts.names.index, ("x", "e")))
        self.part = StatePart.allocate("near surfaces", FIELDS, 1, real, device)
        self.part.common = True
        self.part.rows = {(method.surfaces.bodies[0].path, 0): np.array([0])}
        b.state.add(self.part)
        self.wait, self.tried, self.vain = 1, 0, False      # vain: the frame has been tried without stages, and repeated
        self.part.arrays["surfaces_wait"].fill_(self.wait)
        size, what = 9 * n * np.dtype(b.model.dtype).itemsize, "tubes of a whole frame"
        self.stages = [Stage("apart", "deform", self.look, 8, size, "frame", what, FREE)][:not method.strands]
        self.aside: Any = None           # a list of its own, that looks back
        if not (method.strands or method.obstacles):
            self.aside = method.near.beside()
            self.stages.append(Stage("apart behind", "deform", self.look_back, 8, size, "frame", what, MET))

    def choose_frame_form(self, clock: Clock) -> None:
        """The form that a frame takes first; colliders have had their say."""
        o, self.vain = self.method.obstacles, False
        apart = self.wait == 0 and not clock.starting and not (o and o.moves)      # straight ways are not those of what turns
        apart = apart and not (self.method.strands or self.method.arrivals)  # whose substeps these are, who come among surfaces
        contact = self.model.scene.colliders
        clock.free = apart and (clock.free or not contact)
        if self.whole:
            clock.after_free = apart

    def end(self, clock: Clock, busy: bool) -> None:
        """A frame holds. busy: surfaces were about to push each other where it ended, or came near each other in it."""
        before = self.wait, self.tried
        self.tried = 0 if clock.free else self.tried + self.vain
        self.wait = 0 if clock.free else min(1 << (self.tried - 1), LONGEST) if self.vain else max(self.wait - 1, int(busy))
        if before != (self.wait, self.tried):
            for name, value in (("surfaces_wait", self.wait), ("surfaces_tried", self.tried)):
                self.part.arrays[name].fill_(value)

    def resume_run(self) -> None:
        """A run goes on exactly where an earlier one has ended."""
        self.wait, self.tried = (int(self.part.arrays[field.name].numpy()[0]) for field in FIELDS)

    def look(self, clock: Clock) -> None:
        """Where a frame ends that had no stages of self-contact."""
        near, s = self.method.near, self.state
        self.model.launch(self.way, self.model.points, [self.x, s.x, s.e], [self.d])
        at = fill_struct(point_states(self.model.real), x=self.x, e=self.e, d=self.d, a=self.e)
        if self.method.surfaces.state:
            at = self.method.surfaces.borrow(self.model, at)
        near.move(at, 0)
        near.look(at)
        wp.capture_if(near.word(pairs.OUT), lambda: self.search_twice(near, at))
        near.word(pairs.OUT).zero_()
        self.method.guarantee.close(self.method.said)

    def look_back(self, clock: Clock) -> None:
        """Where a frame ends that had all stages, and in which nothing is about to push: whether it would have held without
        them. The list of the substeps stays as it is."""
        wp.capture_if(self.method.near.word(pairs.CALM), self.look_aside)

    def look_aside(self) -> None:
        self.model.launch(self.way, self.model.points, [self.x, self.state.x, self.state.e], [self.d])
        self.search_twice(self.aside, fill_struct(point_states(self.model.real), x=self.x, e=self.e, d=self.d, a=self.e))
        wp.copy(self.method.said[step_clamp.NEARBY:step_clamp.NEARBY + 1], self.aside.word(pairs.NEAR))

    def search(self, near: NearPairList, at, tube: float = 1.0) -> None:
        """A list along the ways of the frame. Points that their tubes do not hold on a way that turns count as near, and so do
        more pairs than a short list has room for."""
        if near is self.aside:
            near.word(pairs.LACKED).zero_()
        near.search(at, 1, tube=tube)
        near.word(pairs.OUT).zero_()
        near.look(at, 1)
        for word in (pairs.OUT, pairs.LACKED)[:1 + (near is self.aside)]:
            wp.capture_if(near.word(word), lambda: near.word(pairs.NEAR).fill_(1))

    def search_twice(self, near: NearPairList, at) -> None:
        """The list; where it has pairs, again in tubes that hold these ways and little more."""
        self.search(near, at)
        wp.capture_if(near.word(pairs.NEAR), lambda: self.search(near, at, TUBE))

    def look_at(self, x: wp.array, d: wp.array) -> None:
        """Bounds within a frame: there are none."""
