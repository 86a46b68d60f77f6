"""The direct solve of a box, against A itself: axes with ends that are alike, which are folded, and others."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from wsim.physics.fluid.grid.direct import Direct, axis_operator
from wsim.physics.fluid.grid.layout import AROUND, CLOSED, OPEN, Layout


def threads() -> SimpleNamespace:
    """Launches in float64 on the CPU, in a module of their own."""
    def launch(kernel, count, inputs, outputs):
        wp.launch(kernel, count, inputs, outputs, device="cpu")

    def upload(values, dtype):
        return wp.array(values, dtype=dtype, device="cpu")
    model = SimpleNamespace(real=wp.float64, dtype=np.float64, upload=upload)
    return SimpleNamespace(model=model, module="test_direct", over=launch, sum=launch)


@pytest.mark.parametrize(("n", "low", "high", "even"), [
    ((12, 7, 10), (OPEN, CLOSED, CLOSED), (OPEN, CLOSED, CLOSED), [6, 4, 5]),
    ((70, 5, 66), (OPEN, CLOSED, CLOSED), (OPEN, OPEN, CLOSED), [35, 5, 33]),
    ((8, 6, 64), (AROUND,) * 3, (AROUND,) * 3, [4, 3, 32]),
    ((9, 130, 1), (OPEN, CLOSED, 0.0), (CLOSED, OPEN, 0.0), [9, 130])])
def test_what_is_solved_has_the_right_hand_side(n, low, high, even):
    dim = 2 if n[2] == 1 else 3
    layout = Layout(tuple(range(dim)), n, (int(AROUND in low),) * 3, low, high)
    right = np.random.default_rng(0).standard_normal(layout.cells)
    if OPEN not in (*low, *high):
        right -= right.mean()                                  # nothing else is solvable in a sealed box
    x, b, one, two = (wp.array(v, dtype=wp.float64, device="cpu") for v in (0.0 * right, right, 0.0 * right, 0.0 * right))
    direct = Direct(threads(), layout, x, b, (one, two))
    direct.cycle()
    assert direct.even == even and np.array_equal(b.numpy(), right)
    grid = x.numpy().reshape(n)
    A = [axis_operator(n[a], low[a], high[a], bool(layout.periodic[a])) for a in range(dim)]
    found = sum(np.moveaxis(np.tensordot(A[a], grid, (1, a)), 0, a) for a in range(dim))
    assert found.ravel() == pytest.approx(right, abs=1e-11)
