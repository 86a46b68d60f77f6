"""No pair passes through itself in a substep: proof, projection, cut. See kernels/selfcontact/certificate.py and cut.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from wsim.kernels.selfcontact import certificate, cut, pairs
from wsim.physics.selfcontact import fast
from wsim.physics.selfcontact.modules import core

if TYPE_CHECKING:
    import numpy as np

    from wsim.model.model import Model
    from wsim.physics.selfcontact.method import SelfContact
    from wsim.physics.selfcontact.near import Near

LOSS = 5               # percent of its motion that a point may lose in a substep before the frame is repeated


class Guarantee:
    def __init__(self, model: Model, near: Near, whole: bool = False):
        """whole: normals and weights of all pairs are read where a substep begins, not of those that meet alone."""
        real, module = model.real, core(model)
        self.model, self.near, self.surfaces, self.whole = model, near, near.surfaces, whole
        self.inspect, self.share = certificate.inspect(real, module), certificate.share(real, module)
        self.project, self.proceed = certificate.project(real, module), certificate.proceed(module)
        self.add = pairs.settle_sums(real, module)
        self.claim, self.shorten = cut.claim(real, module), cut.shorten(real, module)
        self.cut, self.tell = cut.cut(real, module), cut.tell(real, module)
        self.pinch: Any = None           # `wsim.physics.selfcontact.pinch.Pinch`, where there are colliders
        if self.surfaces.obstacles:
            from wsim.physics.selfcontact.pinch import Pinch
            self.pinch = Pinch(model, near, self.surfaces.obstacles)

    def each(self, kernel, inputs: list, outputs: list) -> None:
        """Launches a kernel over all pairs."""
        self.model.launch(kernel, self.near.threads, [*inputs, self.near.threads, self.near.table], outputs)

    def keep(self, at, d: wp.array, again, said: wp.array) -> None:
        """Makes the end of a substep one that is proven. again: launches what a new list needs; said: words of the frame."""
        near = self.near
        near.move(at, 0)
        near.look(at)
        self.prove(at)
        wp.capture_if(near.word(pairs.UNPROVEN), lambda: self.finish_proof(at, d, again, said))
        self.close(said)

    def finish_proof(self, at, d: wp.array, again, said: wp.array) -> None:
        """What follows a first pass that did not prove all pairs, or was of a list that points had left."""
        near = self.near
        wp.capture_if(near.word(pairs.STRAYED), lambda: self.astray(at, again))
        wp.capture_while(near.word(pairs.GOING), lambda: self.push(at, d, again))
        wp.capture_while(near.word(pairs.LEFT), lambda: self.shrink(at, d, again, said))
        if self.pinch:
            self.pinch.tell(said)

    def close(self, said: wp.array) -> None:
        """Tells the frame what a substep needed."""
        near = self.near
        self.model.launch(self.tell, 1, [near.moments[-1]], [near.sums, near.words, said])

    def anew(self, at, again) -> None:
        """Points left their tubes: a list along the paths that were solved for, in which they are."""
        self.near.word(pairs.OUT).zero_()
        again()

    def astray(self, at, again) -> None:
        """Points are out of their tubes: a list of where they are, and its pairs are proven."""
        self.anew(at, again)
        self.prove(at)

    def begin(self, at, solved: bool = False) -> None:
        """Looks at pairs where the substep begins. solved: `at` holds where it ends, not what is predicted."""
        if not solved:
            self.near.pairs.rows.zero_()
        ends = -int(solved) - 2 * int(self.whole)
        self.each(self.inspect, [self.surfaces.data, at, ends], [self.near.words])

    def certify(self, at, ends: int = 1) -> None:
        """Looks for a proof of every pair. ends: 2 behind cuts, where no collider takes part."""
        self.each(self.inspect, [self.surfaces.data, at, ends], [self.near.words])

    def prove(self, at) -> None:
        self.certify(at)
        self.model.launch(self.proceed, 1, [], [self.near.words, 0, cut.ROUNDS])

    def push(self, at, d: wp.array, again) -> None:
        """One projection of what is not certified; behind the last of a list those that led points out of their tubes have a
        new one."""
        near, data, points = self.near, self.surfaces.data, self.surfaces
        self.each(self.share, [data, at], [near.sums])
        self.each(self.project, [data, at], [near.sums])
        self.model.launch(self.add, len(points.points), [data.point, d, 1], [near.sums, d])
        self.certify(at)
        near.look(at)
        self.model.launch(self.proceed, 1, [], [near.words, 1, cut.ROUNDS])
        wp.capture_if(near.word(pairs.STRAYED), lambda: self.astray(at, again))

    def shrink(self, at, d: wp.array, again, said: wp.array) -> None:
        """One round of cuts. What is cut falls behind its tube, which leads ahead: then there is a list of where it is."""
        near, data = self.near, self.surfaces.data
        self.each(self.claim, [near.words], [near.sums])
        frames = near.frames
        if self.pinch:
            self.pinch.lead(at)
            frames = self.pinch.frames
        self.each(self.shorten, [data, at, frames, near.words], [near.sums])
        self.model.launch(self.cut, self.surfaces.free["points"], [data, at, frames, near.words, near.sums], [d, said])
        near.look(at)
        wp.capture_if(near.word(pairs.OUT), lambda: self.anew(at, again))
        self.certify(at, 1 if self.pinch else 2)
        self.model.launch(self.proceed, 1, [], [near.words, 2, cut.ROUNDS])


def frame_warnings(method: SelfContact, said: np.ndarray) -> list[tuple[tuple, float, str]]:
    """Warnings of a frame, by its words."""
    found: list[tuple[tuple, float, str]] = []
    if said[cut.CLOSE]:
        found.append((("self-contact", "close"), float(said[cut.CLOSE]), "{worst} pairs of surfaces began a substep "
                      "intersecting or closer than what a file can tell apart; nothing is proven of them"))
    if said[cut.FAST]:
        found.append((("self-contact", "fast"), float(method.fast.needed(said)), f"{fast.WHY}; {{worst}} substeps would do"))
    if said[cut.LOST] > LOSS:
        found.append((("self-contact", "cut"), float(said[cut.LOST]), "surfaces were about to pass through each other, and "
                      "a point lost {worst} % of its motion in a substep; give more substeps"))
    if said[cut.STAYED]:
        found.append((("self-contact", "held"), float(said[cut.STAYED]), "surfaces were held where they were in {worst} "
                      "substeps: nothing else kept them from passing through each other; is something pinched?"))
    if said[cut.PINCHED]:
        body = next(b for b in method.model.bodies if said[cut.WHERE] <= b.last)
        found.append((("self-contact", "pinched"), float(said[cut.PINCHED]), f"colliders left no room for {body.path}: "
                      "{worst} pairs of surfaces, counted in each substep, had no way out, and pass through each other"))
    return found
