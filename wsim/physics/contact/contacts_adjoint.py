"""Adjoints of a recorded search for contacts and of their projections. See kernels/contact/project_adjoint.py,
search_adjoint.py."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.contact import project_adjoint as kernels
from wsim.kernels.contact.collider_gradients import collider_gradient_sum_kernel, corner_type
from wsim.kernels.contact.project import slot_type
from wsim.kernels.contact.search_adjoint import search_adjoint
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.model.structs import fill_struct, struct_values
from wsim.model.tape import Tape, adjoint_of, without_gradient

LANES = 256            # threads that sum what an object gives a collider, at most
EACH = 64              # points that one of them takes at least


@dataclass
class SearchResult:
    """A recorded search: what it has read, and how often its contacts were projected since."""

    at: Any
    projected: int = 0


def motion_bends_in_frames(motion, fps: float) -> bool:
    """True if a motion turns, is a curve, or has keys within frames."""
    at = motion.times * fps
    turning = np.abs(motion.values[:, :3, :3] - motion.values[:1, :3, :3]).max(initial=0.0) > 0.0
    return not motion.plain or motion.moves and bool(turning or np.abs(at - np.round(at)).max() > 1e-6)


@dataclass
class MeshPointGradients:
    """Gradients of a frame by the corners of meshes on which its contacts were found, a row each: substep, point, row of the
    table of colliders, faces (3,) and gradients (9, 3) of `wsim.kernels.contact.collider_gradients.corner_type`."""

    substep: np.ndarray
    point: np.ndarray
    row: np.ndarray
    face: np.ndarray
    by: np.ndarray

    @staticmethod
    def of(found, points: int) -> "MeshPointGradients":
        row = found.row.numpy()
        k, slot = np.nonzero(row >= 0)
        by = found.by.numpy()[k, slot].astype(np.float64)
        return MeshPointGradients(k, slot % points, row[k, slot], found.face.numpy()[k, slot], by)


class ContactAdjoint:
    """The adjoint of contacts with colliders. Lists are not kept: the search runs once more, of the same arrays, before the
    first adjoint that wants them. The side of a closed mesh that a point is on is always told by the winding number, whatever
    was before, so that the
    same is found."""

    def __init__(self, contacts, model: Model):
        """contacts: `wsim.physics.contact.contacts.ColliderContacts`, whose lists have room for all: they do not grow while
        they are recorded."""
        contacts.grow(contacts.rows.most)
        self.contacts, self.model, self.real = contacts, model, model.real
        skinned = any(hasattr(m.surface.poses, "skeleton") for m in contacts.meshes.values())
        self.search_kernel = search_adjoint(contacts.kinds, model.real, model.module, skinned)
        self.project_kernel, self.sum_kernel = (make(model.real, model.module)
                                                for make in (kernels.project_adjoint, collider_gradient_sum_kernel))
        t, n = types(model.real), model.points
        size = contacts.push.size

        def zeros_for_adjoint(count, dtype):
            return wp.zeros(count, dtype=dtype, device=model.device)
        self.n, self.b, self.u, self.push = (zeros_for_adjoint(size, t.vec3), zeros_for_adjoint(size, t.scalar),
                                             zeros_for_adjoint(size, t.vec3), zeros_for_adjoint(size, t.vec3))
        self.d, self.a = zeros_for_adjoint(n, t.vec3), zeros_for_adjoint(n, t.vec3)
        self.friction, self.gap, self.motion = (zeros_for_adjoint(size, t.vec2), zeros_for_adjoint(size, t.scalar),
                                                zeros_for_adjoint(size, kernels.motion_gradient_type(model.real)))
        starts = [*(b.first for b in model.bodies), n]
        lanes = int(np.clip(np.diff(starts).max() // EACH, 1, LANES))
        self.starts = wp.array(starts, dtype=int, device=model.device)
        self.sums = wp.zeros((len(model.bodies), contacts.rows.most, lanes), dtype=self.motion.dtype, device=model.device)
        # where a motion is no straight way within its frames: sums of each substep
        self.steps = [wp.zeros_like(self.sums) for _ in range(contacts.table.of.step.shape[0])] if any(
            motion_bends_in_frames(c.motion, model.scene.fps) for c in contacts.rows.colliders) else []
        self.corners = corner_type(model.real)()         # gradients by the corners of skinned meshes
        self.touched: list[MeshPointGradients] = []      # of frames, the last one first
        self.skinned = skinned
        if skinned:
            shape, by = (contacts.table.of.step.shape[0], size), wp.types.matrix((9, 3), model.real)
            for name, dtype in (("row", int), ("face", wp.vec3i), ("by", by)):
                setattr(self.corners, name, wp.zeros(shape, dtype=dtype, device=model.device))
        self.wanted = zeros_for_adjoint(1, int)
        self.found: SearchResult | None = None
        self.vjp = {contacts.search_kernel: lambda inputs: self.search_tape_adjoint(inputs[2]),
                    contacts.project_kernel: lambda inputs: self.projected()}
        if contacts.settle_kernel:
            self.vjp[contacts.settle_kernel] = lambda inputs: self.reading_tape_adjoint(contacts.settle_kernel)

    def shaped(self, k: int) -> None:
        """The shapes of meshes that the next search works on."""
        model = self.model

        def reshape_meshes() -> None:
            before, model.tape = model.tape, None            # Warp's meshes have one place
            self.contacts.shape(k)
            model.tape = before
        model.tape.do(reshape_meshes)

    def search_tape_adjoint(self, at):
        """Adjoint that a tape takes of the search that is launched next; at: what that reads."""
        tape: Tape = self.model.tape
        found = self.found = SearchResult(tape.read(at))

        def search_backward(read: list, wrote: list) -> None:
            if not found.projected:
                self.again(found)
            (_, points, at), (slots, d_out, a_out, push_out, _) = read, wrote
            push_out.grad.zero_()                            # pushes begin at zero
            o = self.gradients()
            o.x, o.d, o.d_out, o.a_out = at.x.grad, at.d.grad, d_out.grad, a_out.grad
            self.model.launch(self.search_kernel, self.contacts.count,
                              [self.contacts.table, points, slots, at, o, self.corners, at.k], [])
            if self.steps:
                self.sum(self.steps[at.k])
        return search_backward

    def projected(self):
        """Adjoint that a tape takes of the projection that is launched next."""
        ready = self.reader()

        def projection_backward(read: list, wrote: list) -> None:
            ready()
            (table, points, slots, at, g), (d_out, push_out) = read, wrote
            o = self.gradients()
            o.d_out, o.push_out, o.d, o.a, o.push = d_out.grad, push_out.grad, at.d.grad, at.a.grad, at.push.grad
            self.model.launch(self.project_kernel, self.contacts.count, [table, points, slots, at, o, g], [])
        return projection_backward

    def reader(self):
        """Reader of a launch to come that reads the contacts found last: what its adjoint calls first. The last to read them
        is the first to find them again."""
        found = self.found
        assert found is not None
        found.projected += 1
        number = found.projected
        return lambda: self.again(found) if number == found.projected else None

    def reading_tape_adjoint(self, kernel):
        """Adjoint that a tape takes of a launch that reads contacts: Warp's, with the gradients of contacts where those
        of the search want them."""
        model, ready = self.model, self.reader()
        how = {"device": model.device, **({"block_dim": model.block} if model.device.is_cuda else {})}

        def reading_backward(read: list, wrote: list) -> None:
            ready()
            read = [self.slots(value) if value is self.contacts.slots else value for value in read]
            wp.launch(kernel, self.contacts.count, read, wrote, adj_inputs=[adjoint_of(value) for value in read],
                      adj_outputs=[adjoint_of(value) for value in wrote], adjoint=True, **how)
        return reading_backward

    def slots(self, given):
        """Contacts whose arrays have the gradients that the search's adjoint reads: Warp finds those of structs there only."""
        arrays = {name: without_gradient(getattr(given, name)) for name in ("n", "b", "u")}
        for name, array in arrays.items():
            array.grad = getattr(self, name)
        return fill_struct(slot_type(self.model.real), **struct_values(given) | arrays)

    def gradients(self):
        o = kernels.gradient_type(self.real)()
        o.n, o.b, o.u = self.n, self.b, self.u
        o.friction, o.gap, o.motion = self.friction, self.gap, self.motion
        return o

    def again(self, found: SearchResult) -> None:
        """The contacts of that search, with gradients that are zero."""
        c = self.contacts
        c.shape(found.at.k)
        again = fill_struct(slot_type(self.model.real), **struct_values(c.slots) | {"wanted": self.wanted})
        self.model.launch(c.search_kernel, c.count, [c.table, c.points, found.at], [again, self.d, self.a, self.push, None])
        for array in (self.n, self.b, self.u):
            array.zero_()

    # by colliders

    def zero(self) -> None:
        for array in (self.friction, self.gap, self.motion):
            array.zero_()
        self.touched.clear()

    def take_motion(self) -> wp.array | list[wp.array]:
        """Gradient with respect to the motions of an object's colliders in a frame, (objects, rows, lanes, 4, 3), which are
        zeros then: shift and turn where it begins, and where it ends. Where a motion is a curve: those of each substep. Those
        by corners of skinned meshes are read besides, which waits for the frame."""
        if self.skinned:
            self.touched.append(MeshPointGradients.of(self.corners, self.contacts.count))
        if self.steps:
            return [wp.clone(step) for step in self.steps]
        self.sum(self.sums)
        return wp.clone(self.sums)

    def sum(self, out: wp.array) -> None:
        self.model.launch(self.sum_kernel, out.shape, [self.starts, self.contacts.count, self.motion], [out])

    def by_rows(self, array: wp.array) -> np.ndarray:
        """A gradient of the points by the rows of their objects, (rows, points, ...) in float64."""
        found = array.numpy().astype(np.float64)
        return found.reshape(-1, self.contacts.count, *found.shape[1:])[:self.contacts.rows.most]


class ReadingAdjoint:
    """The adjoint of another kernel that reads contacts."""

    def __init__(self, contacts, kernel):
        self.vjp = {kernel: lambda inputs: contacts.adjoint.reading_tape_adjoint(kernel)}
