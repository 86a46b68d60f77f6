"""Frames without contacts: those in which no point can go so far that it meets a collider.

Such a scene has two forms of a frame over the same state. One has contacts. The other leaves out all of their stages, and an
integrator on which nothing else acts within a substep takes whole frames then
(`wsim.physics.motion.fast_paths.one_launch.FreeFrames`). It
measures how far each point may go in the frame (kernels/motion/free_flight_test.py, where it is shown that this is enough), and
looks in every substep whether one goes further: then the frame is repeated with contacts, from where it began.

Which form is tried first follows from the state alone, so that a restart goes on to the bit: a frame with contacts marks the
points that touched, or whose clearance where it ended was less than AHEAD frames of their speed, and the next frame has
contacts again where there is a mark. A frame without contacts marks points whose clearance would not last for NEXT frames of
their speed, colliders going on as they do: the next one would be repeated. Where a point of any world or body may meet
something, the frame has contacts for all.

Always with contacts: colliders that throw points back, meshes that joints deform, so many colliders that a tree finds them,
and recordings with gradients.
"""

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import free_flight_test as kernels
from wsim.model.stage import FREE, MET, Clock, Stage
from wsim.scene import Plane, Scene, Surface
from wsim.scene.curve import Curve
from wsim.scene.methods import method_colliders

REACHED = "a collider may be met"         # status word: in this frame without contacts; after one with contacts: in the next
SOON = "a collider may be met soon"       # status word: in the frame behind this one, which has no contacts
NEXT = 2.25            # frames, this one and the next, with a quarter for what accelerates
AHEAD = 2.0            # frames at the speed of a point that it must be away from contacts. A frame that is repeated has cost
                       # its time without contacts in vain; one that has contacts and needs none, theirs


def allows_free_flight(scene: Scene, gradients: bool) -> bool:
    """True if frames without contacts are tried in a scene that has colliders."""
    return not (gradients or method_colliders(scene) or not colliders_are_predictable(scene)
                or any(c.restitution > 0.0 for c in scene.colliders))


def colliders_are_predictable(scene: Scene) -> bool:
    """True if it is known where colliders are in a frame: no joints deform them, no tree finds them."""
    from wsim.physics.contact.contacts import MANY
    skins = any(isinstance(c.shape, Surface) and c.shape.poses is not None and not stays_in_key_ball(c.shape.poses)
                for c in scene.colliders)
    return not skins and count_bounded_colliders(scene) < MANY


def stays_in_key_ball(poses) -> bool:
    """True if the points of a mesh are never outside of the ball that its keys are in."""
    return isinstance(poses, Curve) and (poses.plain or not poses.moves)


def count_bounded_colliders(scene: Scene) -> int:
    """Colliders that do not go on for ever."""
    return sum(not isinstance(c.shape, Plane) for c in scene.colliders)


def has_deforming_mesh(scene: Scene) -> bool:
    """True if a mesh deforms."""
    return any(isinstance(c.shape, Surface) and c.shape.poses is not None and c.shape.poses.moves for c in scene.colliders)


class FreeFlightTest:
    """Clearances of the contacts of a plan."""

    def __init__(self, contact, clock: Clock, whole: bool):
        """contact: the method; whole: an explicit integrator takes frames without contacts whole, and looks at the bounds
        itself."""
        self.model, self.state, self.contacts, self.status = contact.model, contact.state, contact.contacts, contact.status
        self.clock, self.whole, model, state, contacts = clock, whole, contact.model, contact.state, contact.contacts
        real, module, kinds, t = model.real, model.module, contacts.kinds, types(model.real)
        self.prolonged = contact.prolonged
        contact.status.reserve(REACHED)
        contact.status.reserve(SOON)
        self.room = wp.zeros(model.points, dtype=real, device=model.device)
        rows, m = contacts.rows, kernels.frame_movements(real)()
        radius = np.where(np.isfinite(rows.radius), rows.radius, -1.0)
        m.ball = model.upload(np.concatenate([rows.centers(), radius[:, None]], axis=1)[rows.collider], t.vec4)
        keeps = np.array([0 if mesh is None or mesh.moves else mesh.id for mesh in rows.meshes], np.uint64)
        m.mesh = model.upload(keeps[rows.collider], wp.uint64)
        from wsim.physics.contact.poses.swept_bounds import SweptBounds
        self.outline = SweptBounds(contacts)
        m.now, m.ahead, self.moves = self.outline.now, NEXT * clock.dt, m
        self.measure, self.near = (kernels.frame_clearance_kernel(kinds, real, module),
                                   kernels.near_contact_kernel(kinds, real, module))
        self.stray = None if whole and not contact.points.integrator.stages else kernels.clearance_test_kernel(real, module)
        k, width = state.points.names.index("x"), state.points.capacity
        self.start = state.points.aside[k * width:(k + 1) * width]             # positions where the frame began
        self.said: bool | None = None        # whether the frame tried last might meet something
        n, size = model.points, np.dtype(model.dtype).itemsize
        what = f"{len(model.scene.colliders)} x {n} points"
        self.stages = [Stage("clearance", "pose", self.begin, 1, n * (16 + 6 * size), "frame", what, FREE),
                       Stage("near", "deform", self.end, 1, n * (8 + 8 * size), "frame", what, MET)]
        if not whole:
            self.stages.append(Stage("stray", "collide", self.look, 1, n * 10 * size, what="points", frames=FREE))

    @property
    def word(self) -> wp.array:
        return self.status.word(REACHED)

    def choose_frame_form(self, clock: Clock) -> None:
        """The form that a frame takes first."""
        if self.said is not None and not clock.starting:
            near, before = clock.touching or self.said, clock.free
        else:
            marks = self.contacts.mark.numpy()
            near, before = clock.touching or bool(marks.any()), bool((marks & kernels.SOON).any())
        clock.free, clock.after_free = not near, self.whole and (before or not near)

    def missed_contacts(self) -> bool:
        """True if the frame that has ended had no contacts and should have."""
        reached = bool(self.status.said(REACHED)[0])
        self.said = reached or bool(self.status.said(SOON)[0])
        return reached and self.clock.free

    def begin(self, clock: Clock) -> None:
        c = self.contacts
        self.outline.send()
        at = c.read(x=self.state.x, v=self.state.v)
        self.model.launch(self.measure, self.model.points, [c.table, c.points, self.moves, at, c.slots],
                          [self.room, c.struck, self.status.word(SOON)])

    def look(self, clock: Clock) -> None:
        """Looks at a substep that is predicted."""
        s, goes_on = self.state, self.prolonged and self.prolonged.asked(clock)
        d = self.prolonged.reach() if goes_on else s.d
        self.model.launch(self.stray, self.model.points, [self.start, s.x, d, self.room], [self.word])

    def look_at(self, x: wp.array, d: wp.array) -> None:
        """Looks at displacements [m] since the frame began at x."""
        self.model.launch(self.stray, self.model.points, [x, x, d, self.room], [self.word])

    def end(self, clock: Clock) -> None:
        c, s = self.contacts, self.state
        self.outline.send()
        self.model.launch(self.near, self.model.points, [c.table, c.points, self.moves, s.x, s.v, AHEAD * clock.dt, c.slots],
                          [self.word])
