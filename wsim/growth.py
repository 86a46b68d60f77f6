"""How a gradient grows on its way back through the frames, and where it stops being a number.

Where neighbouring motions part exponentially a gradient is exact and says nothing: it is as large as the amplification, and its
rounding is amplified as much. With |g_k| the norm of the gradient by the positions after k frames, the largest over the first
one that is not 0, on the way back, is the amplification; the slope of log |g_k| over time is the rate, of the adjoint and so of
the motion: a Lyapunov exponent over the recording.
"""

from functools import cache

import numpy as np
import warp as wp

from wsim.scene import Problem, SceneError

MOST = {"float32": 300.0, "float64": 1e8}    # of amplification without a warning. Sheets that slide over a ball, float32 beside
                                             # float64: grown 1.8e3 times 2e-3 apart, 1.5e8 times no digit; below 2 times 2e-4


@cache
def square(dtype):
    """Kernel: adds |g|^2 to entry `frame`, in float64."""

    @wp.kernel(module="unique", enable_backward=False)
    def square(g: wp.array(dtype=dtype), frame: int, sum_out: wp.array(dtype=wp.float64)):
        v = g[wp.tid()]
        for k in range(3):
            wp.atomic_add(sum_out, frame, wp.float64(v[k]) * wp.float64(v[k]))

    return square


class Growth:
    """Norms of the gradient by positions, after each frame."""

    def __init__(self, frames: int, device):
        self.sums = wp.zeros(frames + 1, dtype=wp.float64, device=device)

    def clear(self) -> None:
        self.sums.zero_()

    def note(self, grad: wp.array, frame: int) -> None:
        wp.launch(square(grad.dtype), grad.size, [grad, frame], [self.sums], device=grad.device)

    def check(self, start: int, fps: float, precision: str) -> str:
        """A warning, or "". Raises SceneError where the gradient is no number."""
        norms = np.sqrt(self.sums.numpy())
        if not np.isfinite(norms).all():
            frame = start + int(np.flatnonzero(~np.isfinite(norms)).max())
            raise SceneError(Problem("backward", f"the gradient by the positions is no number at frame {frame}, and was one "
                                     "after it; record fewer frames, or take smaller substeps"))
        seen = np.flatnonzero(norms)
        if len(seen) < 3:
            return ""
        grown, rate = norms[seen].max() / norms[seen[-1]], -np.polyfit(seen / fps, np.log(norms[seen]), 1)[0]
        if grown < MOST[precision] or rate <= 0.0:
            return ""
        return (f"/: gradients: changes grow {grown:.1e} times over the recording, by {rate:.3g} a second (e-fold): what is "
                "that sensitive is chance in practice. Record fewer frames, or judge by something smoother than positions")
