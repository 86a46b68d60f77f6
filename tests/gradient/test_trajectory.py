"""What a recording says of its frames: in float32 the bits of a simulation, with the remainders that positions carry."""

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import bar, net, sheet
from tests.make.physics.solver.xpbd_adjoint import SWEEPS
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.model.launches import KernelLaunches
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation

LEAPFROG = {"integrator": "leapfrog"}


def pair(scene, frames=3, plain=False) -> tuple[Recording, list]:
    """A recording that has run, and positions and velocities of a simulation after each frame."""
    recording, found = Recording(Simulation(scene, device="cpu", gradients=True), frames), []
    recording.run()
    sim = Simulation(scene, device="cpu", gradients=not plain)

    def look(s):
        found.append((s.positions(), s.velocities()))
    look(sim)
    sim.run(frames, look)
    return recording, found


@pytest.mark.parametrize("scene", [
    net(**LEAPFROG), net(integrator="rk4"), sheet("membrane"), bar("corotational"),
    net(**SWEEPS, integrator="backward_euler"), sheet("springs", **SWEEPS, integrator="bdf2")])
def test_positions_are_the_bits_of_a_simulation(scene):
    recording, found = pair(scene)
    rests = recording.rests.numpy()
    for frame, (x, v) in enumerate(found):
        assert np.array_equal(recording.positions(frame), x) and np.array_equal(recording.velocities(frame), v)
        assert np.abs(rests[frame]).max() > 0.0 or frame == 0


@pytest.mark.parametrize("scene", [sheet("membrane"), bar("linear")])
def test_so_they_are_of_one_without_gradients(scene, monkeypatch):
    """But for springs, and membranes by XPBD, whose strains are taken beyond float32 where gradients are asked for
    (kernels/math/compensated.py), and what explicit steps of a CPU take in packets: here they go launch by launch."""
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    recording, found = pair(scene, plain=True)
    assert all(np.array_equal(recording.positions(frame), x) for frame, (x, _) in enumerate(found))


def test_newtons_method_leaves_its_simulation_where_the_recording_is():
    """It goes to a residual that a simulation does not."""
    sim = Simulation(net(solver="implicit", integrator="bdf2", substeps=2), device="cpu", gradients=True)
    recording = Recording(sim, 2)
    recording.run()
    assert np.array_equal(recording.positions(2), sim.positions()) and np.abs(sim.state.e.numpy()).max() > 0.0


def test_motions_of_rollouts_have_them_too():
    recording, found = pair(net(**LEAPFROG))
    assert np.array_equal(Rollout(recording, ["gravity"]).run()[0], [x for x, _ in found[1:]])


def test_derivatives_may_be_given_on_the_device():
    """In the solver's order; what has another shape is refused."""
    sim = Simulation(sheet("springs", **LEAPFROG), device="cpu", precision="float64", gradients=True)
    recording = Recording(sim, 2)
    x, v = recording.positions(2), recording.velocities(2)
    wanted = recording.backward({2: x - sim.model.bodies[0].origin, 1: x}, {2: v})
    given = wp.clone(sim.state.x)
    found = recording.backward({2: given, 1: x}, {2: sim.state.v})
    assert np.abs(found.positions() - wanted.positions()).max() < 1e-14 * np.abs(wanted.positions()).max()
    assert np.array_equal(given.numpy(), sim.state.x.numpy())
    with pytest.raises(SceneError, match="solver's order"):
        recording.backward({2: given[:5]})
