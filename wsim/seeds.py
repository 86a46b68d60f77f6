"""Derivatives of a loss by a motion, as they are given, over all points. NumPy only."""

import numpy as np

from wsim.scene import Problem, SceneError


def dense(recording, given: dict | None, what: str) -> dict[int, np.ndarray]:
    """Derivatives over all points in solver order, by frame."""
    model, found = recording.sim.model, {}
    for frame, values in (given or {}).items():
        if not 0 <= frame <= recording.frames:
            raise SceneError(Problem(what, f"found frame {frame}; allowed are 0 to {recording.frames}"))
        found[frame] = np.zeros((model.points, 3), model.dtype)
        for key, each in (values if isinstance(values, dict) else {None: values}).items():
            path, world = key if isinstance(key, tuple) else (key, 0)
            index, each = model.body(path, world).index, np.asarray(each, np.float64)
            if each.shape != (len(index), 3) or not np.isfinite(each).all():
                raise SceneError(Problem(path or what, f"derivatives must be finite with shape ({len(index)}, 3); found "
                                         f"{each.shape}"))
            np.add.at(found[frame], index, each)
    return found
