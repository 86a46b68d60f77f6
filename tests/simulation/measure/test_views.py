"""Views of a simulation's memory: NumPy reads what Warp writes, and where PyTorch or JAX are installed, they share it."""

import numpy as np
import pytest

from tests.make.gradient.gradients import bar, net, sheet
from wsim.gradient.recording import Recording
from wsim.simulation.measure.views import arrays
from wsim.simulation.simulation import Simulation


def make(scene, gradients=False, precision="float64") -> Simulation:
    return Simulation(scene, device="cpu", precision=precision, gradients=gradients)


def test_numpy_sees_what_a_simulation_writes_and_an_index_gives_the_authors_order():
    sim = make(sheet("membrane"))
    views = arrays(sim)
    x, v = (np.from_dlpack(views[name]) for name in ("positions", "velocities"))
    sim.run(2)
    where, origin = views["positions"].index["/cloth"], views["positions"].origin["/cloth"]
    assert x[where] + origin == pytest.approx(sim.positions("/cloth"), abs=1e-14)
    assert np.array_equal(v[where], sim.velocities("/cloth"))
    whole = np.from_dlpack(views["state"])
    assert np.shares_memory(whole, x) and views["state"].fields[:3] == ("x", "e", "v")


@pytest.mark.parametrize("change, names", [
    ({"integrator": "leapfrog"}, {"springs.stiffness", "springs.rest", "springs.damping"}),
    ({"solver": "xpbd"}, {"distance.compliance", "distance.damping"}),
    ({"solver": "implicit"}, {"distance.compliance", "distance.damping"})])
def test_materials_that_a_solver_reads(change, names):
    views = arrays(make(net(**change)))
    assert {name for name in views if "." in name} == names
    assert views.keys() - names == {"state", "positions", "remainders", "velocities", "inverse_masses", "gravity", "air_drag"}
    assert all(np.shares_memory(np.from_dlpack(view), view.array.numpy()) for view in views.values())


def test_materials_of_sheets_and_solids():
    assert {"membrane.stiffness", "dihedral.stiffness"} < arrays(make(sheet("membrane"))).keys()
    assert {"corotational.mu", "corotational.lam"} < arrays(make(bar("corotational"))).keys()
    newton = sheet("membrane", solver="implicit", integrator="bdf2", substeps=2)
    assert not any("." in name for name in arrays(make(newton, gradients=True)))


@pytest.mark.parametrize("gradients", [False, True])
def test_what_torch_writes_is_simulated(gradients):
    """Gravity, and the stiffness of each spring by way of its entries. Damping is kept beside it, and is 0 here."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install -e .[torch]")
    sim, other = (make(net(integrator="leapfrog", damping=0.0), gradients) for _ in range(2))
    stiffness, views = np.linspace(30.0, 40.0, 11), arrays(sim)
    g, k = (torch.from_dlpack(views[name]) for name in ("gravity", "springs.stiffness"))
    assert g.data_ptr() == views["gravity"].array.ptr
    g[:] = torch.tensor([1.0, -2.0, 3.0])
    k[:] = torch.tensor(np.append(stiffness, 0.0)[views["springs.stiffness"].index["springs"]][:len(k)])
    other.set("/", "gravity", (1.0, -2.0, 3.0))
    x = torch.from_dlpack(views["positions"])
    before = x.clone()
    sim.run(1)
    assert not torch.equal(x, before)
    other.set("/chain", "stiffness", stiffness)
    other.run(1)
    assert sim.positions() == pytest.approx(other.positions(), abs=1e-13)


def test_a_recording_begins_with_what_torch_writes():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install -e .[torch]")
    recording = Recording(make(net(integrator="leapfrog"), True), 1)
    v = torch.from_dlpack(arrays(recording)["velocities"])
    v[:] = 0.25
    assert (recording.velocities(0) == 0.25).all()


def test_jax_shares_the_state():
    """And copies what begins where memory is not aligned to 64 bytes: velocities of 12 points do."""
    jax = pytest.importorskip("jax", reason="JAX is not installed: pip install -e .[jax]")
    views = arrays(make(net(), precision="float32"))
    for name, shared in (("state", True), ("positions", True), ("gravity", True), ("velocities", False)):
        assert (jax.dlpack.from_dlpack(views[name]).unsafe_buffer_pointer() == views[name].array.ptr) == shared, name
