"""Gradients of whole runs through plastic flow, against differences of order 8. Where a tet begins to flow in another substep
the loss has a kink: steps are so small that no difference meets one."""

import numpy as np
import pytest

from tests.make.gradient.gradients import Run
from tests.make.physics.cloth.rest_shape import by_rest_shape
from tests.make.physics.soft.plastic_adjoint import LEAPFROG, NEWTON, yielding
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.simulation.simulation import Simulation


def material(run: Run, name: str, value: float, step: float) -> None:
    """By a relative step so small that rounding of the losses leaves 1e-8 of their differences."""
    run.check(value * run.gradient.material(name), lambda s: (run.path, name, value * (1.0 + s)), step, 2e-8)


@pytest.mark.parametrize("model, more, step", [("corotational", LEAPFROG, 1e-7), ("neo_hookean", NEWTON, 2e-6)])
def test_a_bar_that_flows(model, more, step):
    """By where it flows, by what it is made of, by its start and by its shape."""
    scene = yielding(model, **more)
    run = Run(scene)
    assert run.sim.indicators()["plastic_strain"] > 0.03
    material(run, "young", 2e4, 1e-4)
    material(run, "damping", 1e-3, 1e-3 if more is NEWTON else 1e-4)
    run.state("positions", step)
    run.state("velocities", step)
    by_rest_shape(run, step, 2e-9)
    plain = Simulation(scene, device="cpu", precision="float64", gradients=more is NEWTON)
    if more is LEAPFROG:                                     # Newton's method runs to a tolerance there
        plain.run(3)
        assert np.abs(plain.positions() - run.recording.positions(3)).max() < 1e-14


@pytest.mark.parametrize("more", [LEAPFROG, {"integrator": "rk4", "substeps": 60}, NEWTON])
def test_by_the_yield(more):
    """Of what has one."""
    scene = yielding("neo_hookean" if more is NEWTON else "corotational", **more)
    run = Run(scene)
    material(run, "yield_strain", 0.02, 1e-4 if more is NEWTON else 1e-5)


def test_products_of_what_has_flowed_before():
    """A recording begins with what its tets have become, and so do its copies."""
    sim = Simulation(yielding("neo_hookean", **NEWTON), device="cpu", precision="float64", gradients=True)
    sim.run(2)
    assert sim.indicators()["plastic_strain"] > 0.01
    f, way = Rollout(Recording(sim, 1), ["gravity"]), np.array([0.3, -0.5, 0.8])
    y = f.run()
    assert np.abs(f.copies().run() - y).max() < 1e-12
    assert f.vjp(y)["gravity"] @ way == pytest.approx((y * f.jvp({"gravity": way}, step=1e-2).value).sum(), rel=1e-7)


def test_large_flow():
    """A bar that begins far from its rest shape: the rounds that find how far it flows are not at their end there."""
    scene = yielding(**LEAPFROG)
    scene.softs[0].rest_points = scene.softs[0].points * np.float32((0.5, 1.4, 1.3))
    run = Run(scene, frames=1)
    assert run.sim.indicators()["plastic_strain"] > 0.3
    run.state("positions", 1e-7)
    by_rest_shape(run, 1e-7, 2e-9)


@pytest.mark.parametrize("more", [LEAPFROG, NEWTON])
def test_checkpoints_and_a_run_under_way(more):
    """Shapes at rest are kept with the rest of a state; a recording begins with those that a run has left."""
    scene = yielding("neo_hookean" if more is NEWTON else "corotational", **more)
    found = []
    for keep in ("all", "checkpoints"):
        sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
        sim.run(2)
        recording = Recording(sim, 4, keep)
        assert recording.checkpoints == (keep == "checkpoints")
        found.append(recording.backward({4: recording.positions(0)}))
        again = recording.backward({4: recording.positions(0)})
        assert np.array_equal(again.positions(), found[-1].positions())
    a, b = found
    assert np.abs(a.positions() - b.positions()).max() < 1e-12 * np.abs(a.positions()).max()
    assert np.abs(a.rest_shape() - b.rest_shape()).max() < 1e-12 * np.abs(a.rest_shape()).max()
    assert a.material("yield_strain") == pytest.approx(b.material("yield_strain"), rel=1e-12)
    plain = Simulation(scene, device="cpu", precision="float64", gradients=True)
    plain.run(2)
    F = plain.plan.solids[0].plastic.F
    before = F.numpy()
    Recording(plain, 1)                                      # records, and leaves the state as it was
    assert np.array_equal(F.numpy(), before) and np.abs(before - np.eye(3)).max() > 0.01


def test_a_yield_among_the_inputs_of_products():
    """Where all of a body that flows has the same."""
    scene = yielding(**LEAPFROG)
    f = Rollout(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 2), ["/bar:yield_strain"])
    s = np.random.default_rng(3).normal(size=f.shape) * [[[[1.0]]], [[[0.01]]]]
    assert f.values()["/bar:yield_strain"] == 0.02
    by = f.vjp(s)["/bar:yield_strain"]
    f.inputs["/bar:yield_strain"].write_value(0.03)
    assert f.values()["/bar:yield_strain"] == 0.03 and f.vjp(s)["/bar:yield_strain"] != by != 0.0
