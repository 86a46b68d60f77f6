"""What a frame of a fluid leaves for its adjoint: the fields with which each of its steps began, and velocities within it."""

from typing import Any

import warp as wp

from wsim.physics.fluid.adjoint.launches import AdjointLaunches
from wsim.physics.fluid.grid.multigrid import AXES


def kept_velocity_names(domain: Any) -> tuple[str, ...]:
    """Velocities that are kept: u at the start of a step; v and y before its projections; w behind the first."""
    viscous = domain.viscosity is not None
    return ("u", "v", "w", *["y"] * viscous) if domain.reflects else ("u", *["v"] * viscous)


class Trace:
    """capacity: steps of a frame at most; take(count): an array of so many numbers. `clock` is that of the frame."""

    def __init__(self, launches: AdjointLaunches, capacity: int, take: Any):
        self.launches, domain = launches, launches.domain
        self.domain = domain
        self.slots: dict[str, wp.array] = {}
        for name in kept_velocity_names(domain):
            for a, n in enumerate(domain.sizes):
                self.slots[name + AXES[a]] = take((capacity + (name == "u")) * n)
        for name, q in domain.scalars.items():
            self.slots[name] = take((capacity + 1) * q.size)
        self.clock = take(4)

    def keep(self, name: str, faces: Any) -> None:
        """Velocity of that name in the present step; with u the scalars too."""
        for a in range(self.domain.layout.dim if name + AXES[0] in self.slots else 0):
            self._keep_field(name + AXES[a], getattr(faces, AXES[a]))
        for scalar, q in self.domain.scalars.items() if name == "u" else ():
            self._keep_field(scalar, q)

    def _keep_field(self, name: str, q: wp.array) -> None:
        self.launches.over(self.launches.keep, q.size, [q, self.domain.done], [self.slots[name]])

    def fetch(self, name: str, faces: Any, ahead: int = 0) -> None:
        """The velocity of that name, of the present step or one `ahead`."""
        for a in range(self.domain.layout.dim):
            self.scalar(name + AXES[a], getattr(faces, AXES[a]), ahead)

    def scalar(self, name: str, q: wp.array, ahead: int = 0) -> None:
        self.launches.over(self.launches.fetch, q.size, [self.slots[name], self.domain.done, ahead], [q])
