"""Markers on a rigid body: places that are fixed in its frame, seen in the world at frames. A pose is known by three of them.

    Markers         positions (k, n, 3) [m] of n markers at k frames; `local` (n, 3) [m] where they are in the body's frame
    Markers.of      poses (4, 4) at frames, as four markers: the origin, and the ends of the axes at a distance
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.fitting.observations.observe import Track


@dataclass
class Markers(Track):
    local: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))

    def __post_init__(self):
        super().__post_init__()
        self.local = np.asarray(self.local, np.float64).reshape(-1, 3)

    @staticmethod
    def of(path: str, frames, poses: np.ndarray, size: float = 1.0, **more) -> "Markers":
        """poses (k, 4, 4) of the body's frame to the world [m]; size [m]: what a turn by one radian counts as."""
        local = np.concatenate([np.zeros((1, 3)), size * np.eye(3)])
        M = np.asarray(poses, np.float64).reshape(-1, 4, 4)
        return Markers(path, frames, np.einsum("kij,nj->kni", M[:, :3, :3], local) + M[:, None, :3, 3], local=local, **more)

    def seen(self, poses: np.ndarray) -> np.ndarray:
        """Places of the markers of a body at poses (worlds, 4, 4), (worlds, n, 3)."""
        return np.einsum("wij,nj->wni", poses[:, :3, :3], self.local) + poses[:, None, :3, 3]
