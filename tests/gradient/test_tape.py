"""A tape finds the values that a launch has read where they are written over, in arguments and in structs."""

import numpy as np
import pytest
import warp as wp

from wsim.model.arena import Slots
from wsim.model.structs import filled
from wsim.model.tape import Tape

VECTORS = wp.array(dtype=wp.vec3d)


@wp.struct
class Read:
    x: VECTORS
    c: VECTORS            # a constant


@wp.kernel(module="test_tape_adjoint", enable_backward=True)
def multiply(at: Read, x_out: VECTORS):
    i = wp.tid()
    x_out[i] = wp.cw_mul(wp.cw_mul(at.x[i], at.x[i]), at.c[i])


def test_an_array_of_a_struct_that_is_written_over_keeps_its_derivative():
    """x <- c x^2 three times in place: c^7 x^8, by x 8 c^7 x^7, by c 7 c^6 x^8."""
    rng, n = np.random.default_rng(1), 5
    start, factor, weight = 1.0 + 0.1 * rng.normal(size=(3, n, 3))
    x = wp.array(start, dtype=wp.vec3d, device="cpu")
    c = wp.array(factor, dtype=wp.vec3d, device="cpu", requires_grad=True)
    tape, at = Tape(Slots(wp.get_device("cpu"), wp.float64), []), filled(Read, x=x, c=c)
    tape.write(x, True)                                  # the tape knows it, as methods' arrays are known after their first use
    tape.begin()
    for _ in range(3):
        tape.launch(multiply, n, [at], [x], device="cpu")
    tape.finish()
    constant = filled(Read, c=c)
    assert tape.read(constant) is constant and at.x is x
    assert x.numpy() == pytest.approx(factor**7 * start**8, rel=1e-14)
    (root,) = tape.roots
    root.carried.assign(weight)
    tape.backward()
    assert root.carried.numpy() == pytest.approx(weight * 8 * factor**7 * start**7, rel=1e-13)
    assert c.grad.numpy() == pytest.approx(weight * 7 * factor**6 * start**8, rel=1e-13)
