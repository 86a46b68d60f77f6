"""How a gradient grows on its way back through the frames, and where it stops being a number.

Where neighbouring motions part exponentially a gradient is exact and says nothing: it is as large as the amplification, and
its rounding is amplified as much. A frame multiplies the norm of the gradient by the positions by what it has after over what
it had before; what a loss adds between frames does not count. The largest product of such ratios, on the way back, is the
amplification; the slope of its logarithm over time is the rate, of the adjoint and so of the motion: a Lyapunov exponent over
the recording.
"""

import numpy as np
import warp as wp

from wsim.kernels.solver import newton_adjoint
from wsim.model import kernel_cache
from wsim.scene import Problem, SceneError

MOST = {"float32": 300.0, "float64": 1e8}    # of amplification without a warning. Sheets that slide over a ball, float32 beside
                                             # float64: grown 1.8e3 times 2e-3 apart, 1.5e8 times no digit; below 2 times 2e-4
LANES = 1024           # sums of a GPU


class GradientGrowth:
    """Norms of the gradient by the positions, before and after each frame on the way back."""

    def __init__(self, frames: int, device, real):
        lanes = LANES if device.is_cuda else 1
        self.sums = wp.zeros((2, frames, lanes), dtype=wp.float64, device=device)
        self.dot = newton_adjoint.dot(real, "unique")
        kernel_cache.load_kernel_module(self.dot.module, device)

    def note(self, grad: wp.array, frame: int, after: bool) -> None:
        part = self.sums[int(after)][frame]
        wp.launch(self.dot, part.size, [grad, grad], [part], device=grad.device)

    def check(self, start: int, fps: float, precision: str) -> str:
        """A warning, or "". Raises SceneError where the gradient is no number."""
        before, after = np.sqrt(self.sums.numpy().sum(axis=2))
        if not np.isfinite(after).all():
            frame = start + int(np.flatnonzero(~np.isfinite(after)).max())
            raise SceneError(Problem("backward", f"the gradient by the positions is no number at frame {frame}, and was one "
                                     "after it; record fewer frames, or take smaller substeps"))
        seen = np.flatnonzero((before > 0.0) & (after > 0.0))[::-1]
        if len(seen) < 3:
            return ""
        logs = np.cumsum(np.log(after[seen] / before[seen]))
        grown, rate = np.exp(logs.max()), -np.polyfit(seen / fps, logs, 1)[0]
        if grown < MOST[precision] or rate <= 0.0:
            return ""
        return (f"/: gradients: changes grow {grown:.1e} times over the recording, by {rate:.3g} a second (e-fold): what is "
                "that sensitive is chance in practice. Record fewer frames, or judge by something smoother than positions")
