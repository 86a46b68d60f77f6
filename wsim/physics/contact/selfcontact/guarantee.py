"""No pair passes through itself in a substep: proof, projection, cut. See kernels/contact/selfcontact/separation_proof.py and
step_clamp.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from wsim.kernels.contact.selfcontact import pairs, separation_proof, step_clamp
from wsim.physics.contact.selfcontact import fast
from wsim.physics.contact.selfcontact.modules import search_proof_module

if TYPE_CHECKING:
    import numpy as np

    from wsim.model.model import Model
    from wsim.physics.contact.selfcontact.method import SelfContactMethod
    from wsim.physics.contact.selfcontact.near import NearPairList

LOSS = 5               # percent of its motion that a point may lose in a substep before the frame is repeated


class StepGuarantee:
    def __init__(self, model: Model, near: NearPairList, whole: bool = False):
        """whole: normals and weights of all pairs are read where a substep begins, not of those that meet alone."""
        real, module = model.real, search_proof_module(model)
        self.model, self.near, self.surfaces, self.whole = model, near, near.surfaces, whole
        self.inspect, self.share = (separation_proof.pair_inspection_kernel(real, module),
                                    separation_proof.uncertified_share_kernel(real, module))
        self.project, self.proceed = (separation_proof.pair_projection_kernel(real, module),
                                      separation_proof.proof_round_kernel(module))
        self.add = pairs.settle_sums(real, module)
        self.claim, self.shorten = step_clamp.cut_claim_kernel(real, module), step_clamp.cut_factor_kernel(real, module)
        self.cut, self.tell = step_clamp.motion_cut_kernel(real, module), step_clamp.frame_report_kernel(real, module)
        self.pinch: Any = None  # `wsim.physics.contact.selfcontact.infeasible.InfeasibleContacts`, where there are colliders
        if self.surfaces.obstacles:
            from wsim.physics.contact.selfcontact.infeasible import InfeasibleContacts
            self.pinch = InfeasibleContacts(model, near, self.surfaces.obstacles)

    def each(self, kernel, inputs: list, outputs: list) -> None:
        """Launches a kernel over all pairs."""
        self.model.launch(kernel, self.near.threads, [*inputs, self.near.threads, self.near.table], outputs)

    def keep(self, at, d: wp.array, again, said: wp.array) -> None:
        """Makes the end of a substep one that is proven. again: launches what a new list needs; said: words of the frame."""
        near = self.near
        near.move(at, 0)
        near.look(at)
        self.prove_listed_pairs(at)
        wp.capture_if(near.word(pairs.UNPROVEN), lambda: self.finish_proof(at, d, again, said))
        self.close(said)

    def finish_proof(self, at, d: wp.array, again, said: wp.array) -> None:
        """What follows a first pass that did not prove all pairs, or was of a list that points had left."""
        near = self.near
        wp.capture_if(near.word(pairs.STRAYED), lambda: self.relist_strayed_points(at, again))
        wp.capture_while(near.word(pairs.GOING), lambda: self.push(at, d, again))
        wp.capture_while(near.word(pairs.LEFT), lambda: self.cut_unproven_pairs(at, d, again, said))
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

    def relist_strayed_points(self, at, again) -> None:
        """Points are out of their tubes: a list of where they are, and its pairs are proven."""
        self.anew(at, again)
        self.prove_listed_pairs(at)

    def begin(self, at, solved: bool = False) -> None:
        """Looks at pairs where the substep begins. solved: `at` holds where it ends, not what is predicted."""
        if not solved:
            self.near.pairs.rows.zero_()
        ends = -int(solved) - 2 * int(self.whole)
        self.each(self.inspect, [self.surfaces.data, at, ends], [self.near.words])

    def seek_separation_proofs(self, at, ends: int = 1) -> None:
        """Looks for a proof of every pair. ends: 2 behind cuts, where no collider takes part."""
        self.each(self.inspect, [self.surfaces.data, at, ends], [self.near.words])

    def prove_listed_pairs(self, at) -> None:
        self.seek_separation_proofs(at)
        self.model.launch(self.proceed, 1, [], [self.near.words, 0, step_clamp.ROUNDS])

    def push(self, at, d: wp.array, again) -> None:
        """One projection of what is not certified; behind the last of a list those that led points out of their tubes have a
        new one."""
        near, data, points = self.near, self.surfaces.data, self.surfaces
        self.each(self.share, [data, at], [near.sums])
        self.each(self.project, [data, at], [near.sums])
        self.model.launch(self.add, len(points.points), [data.point, d, 1], [near.sums, d])
        self.seek_separation_proofs(at)
        near.look(at)
        self.model.launch(self.proceed, 1, [], [near.words, 1, step_clamp.ROUNDS])
        wp.capture_if(near.word(pairs.STRAYED), lambda: self.relist_strayed_points(at, again))

    def cut_unproven_pairs(self, at, d: wp.array, again, said: wp.array) -> None:
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
        self.seek_separation_proofs(at, 1 if self.pinch else 2)
        self.model.launch(self.proceed, 1, [], [near.words, 2, step_clamp.ROUNDS])


def frame_warnings(method: SelfContactMethod, said: np.ndarray) -> list[tuple[tuple, float, str]]:
    """Warnings of a frame, by its words."""
    found: list[tuple[tuple, float, str]] = []
    if said[step_clamp.CLOSE]:
        found.append((("self-contact", "close"), float(said[step_clamp.CLOSE]), "{worst} pairs of surfaces began a substep "
                      "intersecting or closer than what a file can tell apart; nothing is proven of them"))
    if said[step_clamp.FAST]:
        found.append((("self-contact", "fast"), float(method.fast.needed_substeps(said)),
                      f"{fast.WHY}; {{worst}} substeps would do"))
    if said[step_clamp.LOST] > LOSS:
        found.append((("self-contact", "cut"), float(said[step_clamp.LOST]),
                      "surfaces were about to pass through each other, and "
                      "a point lost {worst} % of its motion in a substep; give more substeps"))
    if said[step_clamp.STAYED]:
        found.append((("self-contact", "held"), float(said[step_clamp.STAYED]), "surfaces were held where they were in {worst} "
                      "substeps: nothing else kept them from passing through each other; is something pinched?"))
    if said[step_clamp.PINCHED]:
        body = next(b for b in method.model.bodies if said[step_clamp.WHERE] <= b.last)
        found.append((("self-contact", "pinched"), float(said[step_clamp.PINCHED]), f"colliders left no room for {body.path}: "
                      "{worst} pairs of surfaces, counted in each substep, had no way out, and pass through each other"))
    return found
