"""Cuts where colliders take part, and what they leave. Equations: kernels/contact/selfcontact/obstacles.py, step_clamp.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import motion_bounds, pairs, step_clamp
from wsim.kernels.contact.selfcontact import obstacles as kernels
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct, struct_values

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.contact.selfcontact.near import NearPairList
    from wsim.physics.contact.selfcontact.obstacles import SurfaceObstacles

LANES = motion_bounds.FOLD ** 2          # partial sums of what colliders do


class InfeasibleContacts:
    """frames: with the rigid motion that cuts are towards."""

    def __init__(self, model: Model, near: NearPairList, obstacles: SurfaceObstacles):
        real, module, device = model.real, model.module, model.device
        self.model, self.near, self.obstacles = model, near, obstacles
        self.weigh, self.pick = kernels.obstacle_weight_kernel(real, module), kernels.cut_frame_kernel(real, module)
        self.count = kernels.infeasible_pair_kernel(real, module)
        t, data, n = types(real), near.surfaces.data, near.surfaces.total
        point = model.upload(self.obstacles.points, int)
        self.solid = fill_struct(type(data),
                                 **{**struct_values(data), "point": point, "w": wp.zeros(n, dtype=real, device=device)})

        def allocate_motion_frames():
            return fill_struct(motion_bounds.frame_type(real), rigid=wp.zeros(4, dtype=t.vec3, device=device),
                               frame=wp.zeros(2, dtype=t.transform, device=device))
        self.own, self.frames = allocate_motion_frames(), allocate_motion_frames()
        self.moments = [wp.zeros((LANES // motion_bounds.FOLD**k, motion_bounds.COLUMNS), dtype=real, device=device)
                        for k in range(3)]

    def lead(self, at) -> None:
        """Launches the choice of the motion, of the points that are claimed."""
        near, launch, m = self.near, self.model.launch, self.moments
        launch(self.weigh, len(self.solid.point), [self.solid.point, near.words, near.sums], [self.solid.w])
        self.own.rigid.zero_()
        launch(near.tally, LANES, [self.solid, at, self.own, LANES], [m[0]])
        for rows, out in zip(m[:-1], m[1:], strict=True):
            launch(near.fold, (out.shape[0], motion_bounds.COLUMNS), [rows], [out])
        launch(near.fit, 1, [m[-1], 1], [self.own])
        launch(self.pick, 1, [m[-1], self.own, near.frames], [self.frames])

    def words(self, said: np.ndarray) -> str:
        """Words for what has no way out."""
        numbers = sorted({int(step_clamp.MOST - said[step_clamp.FORMER]), int(said[step_clamp.LATTER]) - 1})
        names = " and ".join(self.obstacles.contacts.rows.colliders[n].path for n in numbers)
        return (f"is pinched: {names} left it no room, {said[step_clamp.PINCHED]} pairs of surfaces, counted in each substep, "
                "had no way out; give more room there, or a smaller thickness")

    def tell(self, said: wp.array) -> None:
        """Counts pairs that are left without a proof, to the words of the frame."""
        near = self.near

        def count_unproven_pairs() -> None:
            inputs = [near.surfaces.data, self.obstacles.first, near.threads, near.table]
            self.model.launch(self.count, near.threads, inputs, [near.words, said])
        wp.capture_if(near.word(pairs.PINCH), count_unproven_pairs)
