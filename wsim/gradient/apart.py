"""How far a recording is from a simulation of the same frames: implicit solves of recordings go on to their residual, a
simulation's take so many Newton steps."""

import numpy as np
import warp as wp

MOST = 1e-3            # of how far points move: what a simulation may end from a recording without a warning


def apart(recording) -> float:
    """Distance between the ends of a recording that has run and of a simulation [m]. Warns where that is much; costs such a
    run."""
    plan, state = recording.plan, recording.state
    kept = [plan.status.array, *(array for array, _ in state.copies())]
    ends = [wp.clone(array) for array in kept]
    here = state.x.numpy() + state.e.numpy()
    recording.rewind()
    begun = state.x.numpy() + state.e.numpy()
    for frame in range(recording.frames):
        recording.pose(frame)
        plan.frame()
        plan.clock.starting = False
    plain = state.x.numpy() + state.e.numpy()
    for array, end in zip(kept, ends, strict=True):
        wp.copy(array, end)
    away, way = (float(np.linalg.norm(x - here, axis=1).max()) for x in (plain, begun))
    if not away <= MOST * way:
        recording.warn(f"/: gradients: a simulation of these frames ends up to {away:.2g} m from where the recording does, "
                       f"which solves each step to its residual ({100.0 * away / max(way, 1e-300):.2g} % of how far points "
                       "move); take more iterations or substeps")
    return away
