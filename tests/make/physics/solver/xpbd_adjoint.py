"""What tests/physics/solver/test_xpbd_adjoint.py shares with other tests: Fresh, SWEEPS, everything_of_wind."""

import numpy as np
import pytest

from tests.make.gradient.gradients import Run, sheet
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver.xpbd import xpbd_projection_kernel
from wsim.model.structs import fill_struct
from wsim.physics.solver import xpbd_adjoint

SWEEPS = {"solver": "xpbd", "substeps": 8, "iterations": 4}


def everything_of_wind(made: type[Run], **more) -> Run:
    """By its velocity, and by drag and lift of the cloth (which are not live: scenes with others, and plain differences)."""
    def run_of(drag=1.0, lift=0.6) -> Run:
        scene = sheet("springs", damping=2e-4, **more)
        scene.cloths[0].drag, scene.cloths[0].lift, scene.wind = drag, lift, (1.0, 3.0, 4.0)
        return made(scene)
    run, way = run_of(), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.wind() @ way, lambda s: ("/", "wind", (1.0, 3.0, 4.0) + s * way), 0.02)
    run.material("stretch", 40.0)
    run.state("positions", 1e-6)
    by = run.gradient.air_coefficient("drag") - 2.0 * run.gradient.air_coefficient("lift")
    losses = [run_of(1.0 + s, 0.6 - 2.0 * s).loss() for s in (1e-4, -1e-4)]
    assert by == pytest.approx((losses[0] - losses[1]) / 2e-4, rel=1e-6)
    return run


class Fresh(xpbd_adjoint.SweepAdjoint):
    """The reference: each colour writes a buffer of its own, and Warp differentiates it. Hinges, whose angles at rest follow
    their neighbours, are left as they are: differences hold them."""

    def __init__(self, batch, model):
        super().__init__(batch, model)
        self.fresh = xpbd_projection_kernel(batch.row.equation, real=model.real, module=model.module, multipliers=True,
                                            damped=batch.damped, backward=True)[1]

    def record(self, tape, x, a, d, clock):
        b = self.batch
        if self.aimed:
            super().record(tape, x, a, d, clock)
            return
        if clock.i == 0:
            tape.zero(b.lam)
        at = fill_struct(point_states(self.model.real), x=x, d=d, a=a)
        for first, last in zip(b.starts[:-1], b.starts[1:], strict=True):
            tape.launch(self.fresh, int(last - first), [b.data, at, int(first), 1.0 / clock.effective_step, b.omega(clock),
                                                                    b.lam], [d, b.lam], device=self.model.device)
