"""Balls that come and go among surfaces: those that are not there are in no pair, and have no row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.contact.selfcontact import pairs

if TYPE_CHECKING:
    from wsim.physics.contact.selfcontact.method import SelfContactMethod


class BallPresence:
    """arrivals: who says which points are there (`there`)."""

    def __init__(self, method: SelfContactMethod, arrivals: Any):
        self.method, self.model, self.there = method, method.model, arrivals.there
        surfaces, upload = method.surfaces, method.model.upload
        surfaces.data.there, self.balls = self.there, upload(surfaces.balls, int)
        self.known = upload(np.full(len(surfaces.balls), -1, np.int32), int)
        self.kernel = pairs.presence_kernel(self.model.shared_module("ball_presence"))

    def update(self) -> None:
        """Launches what asks for a new list where a ball has come or gone, and takes its inverse mass."""
        self.model.launch(self.kernel, len(self.balls), [self.balls, self.there], [self.known, self.method.near.words])
        self.method.surfaces.weigh(self.method.points.constants.w)
