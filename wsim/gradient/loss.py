"""Derivatives of a loss by a motion, of points, rigid bodies and fluids, and by what pins bear, as they are given."""

from typing import Any

import numpy as np
import warp as wp

from wsim.gradient.reactions.adjoint import PinnedPointGradients
from wsim.model.tape import add_and_clear_gradient
from wsim.scene import Problem, SceneError


class LossCotangents:
    """Cotangents dL/dx that a loss adds to the states of a recording, frame by frame in the backward pass."""

    def __init__(self, recording, positions: dict | None, velocities: dict | None, reactions: dict | None,
                 poses: dict | None = None, twists: dict | None = None, fluids: dict | None = None):
        self.recording, state = recording, recording.state
        positions, grain_positions = split_by_owner(recording, positions, "positions")
        velocities, grain_velocities = split_by_owner(recording, velocities, "velocities")
        self.grains = recording.grains.losses(grain_positions, grain_velocities) if recording.grains else None
        given = (("x", dense_cotangents(recording, positions, "positions")),
                 ("v", dense_cotangents(recording, velocities, "velocities")))
        self.arrays = [(getattr(state, name), each) for name, each in given if recording.moved]
        if (poses or twists) and recording.bodies is None:
            raise SceneError(Problem("poses", "the scene has no rigid bodies"))
        self.bodies = recording.bodies.losses(recording.frames, poses, twists) if recording.bodies else None
        if fluids and recording.fluids is None:
            raise SceneError(Problem("fluids", "the scene has no fluids"))
        self.fluids = recording.fluids.losses(recording.frames, fluids) if recording.fluids else None
        self.pulls = recording.pulls.begin(reactions) if reactions else None

    def add(self, frame: int) -> None:
        """The loss's own derivatives after so many frames."""
        if self.pulls:
            self.pulls.back(frame)
        for base, values in [*((base, given[frame]) for base, given in self.arrays if frame in given),
                             *(self.bodies.at(frame) if self.bodies else ()),
                             *(self.fluids.at(frame) if self.fluids else ()),
                             *(self.grains.at(frame) if self.grains else ())]:
            root = next((r for r in self.recording.roots if r.base.ptr == base.ptr), None)
            assert root is not None                      # to give clears what is given
            add_and_clear_gradient(wp.clone(values) if isinstance(values, wp.array) else
                                   wp.array(values, dtype=base.dtype, device=base.device), root.carried)

    def take(self) -> None:
        """A frame was undone."""
        if self.fluids:
            self.fluids.take()

    def end(self) -> PinnedPointGradients | None:
        """Cotangents of reaction forces that are known after the last frame; None: no reactions."""
        return self.pulls.end() if self.pulls else None


def split_by_owner(recording, given: dict | None, what: str) -> tuple[dict, dict]:
    """Derivatives by frame: of points of the solver, as they are, and of material points, by (path, world)."""
    points: dict[int, Any] = {}
    grains: dict[int, dict] = {}
    for frame, values in (given or {}).items():
        if not recording.grains or isinstance(values, wp.array):
            points[frame] = values
            continue
        if not 0 <= frame <= recording.frames:
            raise SceneError(Problem(what, f"found frame {frame}; allowed are 0 to {recording.frames}"))
        for key, each in (values if isinstance(values, dict) else {None: values}).items():
            path, world = key if isinstance(key, tuple) else (key, 0)
            if own := recording.grain_path(path):
                grains.setdefault(frame, {})[own, world] = each
            else:
                points.setdefault(frame, {})[key] = each
    return points, grains


def dense_cotangents(recording, given: dict | None, what: str) -> dict[int, Any]:
    """Derivatives over all points in solver order, by frame: arrays of NumPy, or of the device where such were given."""
    model = recording.sim.model
    found: dict[int, Any] = {}
    for frame, values in (given or {}).items():
        if not 0 <= frame <= recording.frames:
            raise SceneError(Problem(what, f"found frame {frame}; allowed are 0 to {recording.frames}"))
        if isinstance(values, wp.array):
            x = recording.state.x
            if (values.dtype, values.shape, values.device) != (x.dtype, x.shape, x.device):
                each_, allowed = (f"{a.dtype.__name__}, {a.shape}, on {a.device}" for a in (values, x))
                raise SceneError(Problem(what, f"found an array of {each_}; allowed is {allowed}, in the solver's order"))
            found[frame] = values
            continue
        found[frame] = np.zeros((model.points, 3), model.dtype)
        for key, each in (values if isinstance(values, dict) else {None: values}).items():
            path, world = key if isinstance(key, tuple) else (key, 0)
            index, each = model.body(path, world).index, np.asarray(each, np.float64)
            if each.shape != (len(index), 3) or not np.isfinite(each).all():
                raise SceneError(Problem(path or what, f"derivatives must be finite with shape ({len(index)}, 3); found "
                                         f"{each.shape}"))
            if model.alias is None:
                found[frame][index] += each
            for k in range(3 if model.alias is not None else 0):            # a tenth of np.add.at's time
                found[frame][:, k] += np.bincount(index, each[:, k], model.points)
    return found
