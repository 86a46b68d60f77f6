"""Integrators of trees by name: the order of each on a double pendulum, and a chain with a heavy end."""

import numpy as np
import pytest

import wsim
from tests.make.physics.joints.chains import heavy_chain
from tests.physics.joints.trees.chains import chain_scene, trees_of
from wsim.physics.rigid.joints.joint import Drive

STIFF = Drive(stiffness=2e4, damping=1000.0, target=0.2)


def pendulum_tip(integrator: str, substeps: int, drive=None, frames=15) -> np.ndarray:
    scene = chain_scene(("spherical", "revolute"), integrator=integrator, substeps=substeps)
    if drive:
        scene.things("Joint")[1].drives = {"rotX": drive}
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(frames)
    return simulation.poses()["/b1"][:3, 3]


@pytest.mark.parametrize("integrator, order, drive", [
    ("rk4", 4, None), ("symplectic_euler", 1, None), ("backward_euler", 1, STIFF), ("auto", 2, STIFF)])
def test_an_integrator_has_its_order_on_a_double_pendulum(integrator, order, drive):
    """Against a run of rk4 with 320 substeps. The drive is soft for that, and so stiff for auto that it takes ros2, whose
    error in such a drive falls faster than its order."""
    exact = pendulum_tip("rk4", 320, drive)
    off = [np.linalg.norm(pendulum_tip(integrator, n, drive) - exact) for n in ((4, 8) if order == 4 else (20, 40))]
    found = np.log2(off[0] / off[1])
    assert found > order - 0.35 and (found < order + 0.35 or integrator == "auto"), off


def test_a_named_integrator_steps_every_tree():
    for name, code in (("rk4", 1), ("symplectic_euler", 2), ("backward_euler", 3), ("auto", 1)):
        simulation = wsim.Simulation(chain_scene(["revolute"], integrator=name), device="cpu")
        simulation.step()
        assert trees_of(simulation)[1].trees.integrator.numpy()[0] == code


def test_the_tip_of_a_chain_with_a_heavy_end_converges_with_order_four():
    """Ten links of 1 kg carry 1000 kg. Substeps that one step of rk4 cannot take are cut: the first all into MOST parts, since
    accelerations are 0 where the chain hangs straight."""
    def tip(substeps):
        simulation = wsim.Simulation(heavy_chain(substeps), device="cpu", precision="float64")
        simulation.run(30)
        return simulation.poses()["/b10"][:3, 3]
    exact, coarse, fine, four = tip(256), tip(32), tip(64), tip(4)
    assert exact[0] > 0.1
    assert abs(np.log2(np.linalg.norm(coarse - exact) / np.linalg.norm(fine - exact)) - 4.0) < 0.6
    assert np.linalg.norm(four - exact) < 1e-5
