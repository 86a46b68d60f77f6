"""A step of the host on a tape: NumPy forward or backward, between arrays of the state."""

from collections.abc import Callable

import numpy as np
import warp as wp

from wsim.model.tape import Tape, add_and_clear_gradient, without_gradient


def record_host_step(tape: Tape, arrays: list[wp.array], forward: Callable[[], None],
                     backward: Callable[[list[np.ndarray]], list[np.ndarray]], kept: dict) -> None:
    """forward() takes `arrays` of the state from there and writes them; backward(gradients of what it has written) gives those
    of what it has read. kept: what forward() leaves for backward(). No graph holds such a stretch (`Tape.eager`)."""
    tape.eager = True
    tape.host.append(kept)
    read = [tape.read(a) for a in arrays]
    for a in arrays:
        tape.write(a, True)
    wrote = [tape.read(a) for a in arrays]                        # they are kept

    def run_host_step() -> None:
        for a, version in zip(arrays, read, strict=True):
            wp.copy(a, without_gradient(version))
        forward()
        for a, version in zip(arrays, wrote, strict=True):
            wp.copy(without_gradient(version), a)

    def host_step_backward() -> None:
        found = backward([version.grad.numpy() for version in wrote])
        for version, after, grad in zip(read, wrote, found, strict=True):
            after.grad.zero_()
            add_and_clear_gradient(wp.array(grad, dtype=version.dtype, device=version.device), version.grad)
    tape.do(run_host_step)
    tape.adjoints.append(host_step_backward)
