"""Cuts where colliders take part, and what they leave. Equations: kernels/selfcontact/obstacles.py, cut.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import cut, pairs, tubes
from wsim.kernels.selfcontact import obstacles as kernels
from wsim.model.structs import filled, values

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.physics.selfcontact.near import Near
    from wsim.physics.selfcontact.obstacles import Obstacles

LANES = tubes.FOLD ** 2          # partial sums of what colliders do


class Pinch:
    """frames: with the rigid motion that cuts are towards."""

    def __init__(self, model: Model, near: Near, obstacles: Obstacles):
        real, module, device = model.real, model.module, model.device
        self.model, self.near, self.obstacles = model, near, obstacles
        self.weigh, self.pick = kernels.weigh(real, module), kernels.pick(real, module)
        self.count = kernels.pinched(real, module)
        t, data, n = types(real), near.surfaces.data, near.surfaces.total
        point = model.upload(self.obstacles.points, int)
        self.solid = filled(type(data), **{**values(data), "point": point, "w": wp.zeros(n, dtype=real, device=device)})

        def frames():
            return filled(tubes.frames(real), rigid=wp.zeros(4, dtype=t.vec3, device=device),
                          frame=wp.zeros(2, dtype=t.transform, device=device))
        self.own, self.frames = frames(), frames()
        self.moments = [wp.zeros((LANES // tubes.FOLD**k, tubes.COLUMNS), dtype=real, device=device) for k in range(3)]

    def lead(self, at) -> None:
        """Launches the choice of the motion, of the points that are claimed."""
        near, launch, m = self.near, self.model.launch, self.moments
        launch(self.weigh, len(self.solid.point), [self.solid.point, near.words, near.sums], [self.solid.w])
        self.own.rigid.zero_()
        launch(near.tally, LANES, [self.solid, at, self.own, LANES], [m[0]])
        for rows, out in zip(m[:-1], m[1:], strict=True):
            launch(near.fold, (out.shape[0], tubes.COLUMNS), [rows], [out])
        launch(near.fit, 1, [m[-1], 1], [self.own])
        launch(self.pick, 1, [m[-1], self.own, near.frames], [self.frames])

    def words(self, said: np.ndarray) -> str:
        """Words for what has no way out."""
        numbers = sorted({int(cut.MOST - said[cut.FORMER]), int(said[cut.LATTER]) - 1})
        names = " and ".join(self.obstacles.contacts.rows.colliders[n].path for n in numbers)
        return (f"is pinched: {names} left it no room, {said[cut.PINCHED]} pairs of surfaces, counted in each substep, had no "
                "way out; give more room there, or a smaller thickness")

    def tell(self, said: wp.array) -> None:
        """Counts pairs that are left without a proof, to the words of the frame."""
        near = self.near

        def count() -> None:
            inputs = [near.surfaces.data, self.obstacles.first, near.threads, near.table]
            self.model.launch(self.count, near.threads, inputs, [near.words, said])
        wp.capture_if(near.word(pairs.PINCH), count)
