"""Joints and contacts whose passes are launched one by one, as on a GPU, move bodies by the bits of one launch."""

import numpy as np
import pytest

from wsim.physics.rigid import forms
from wsim.physics.rigid.joints.joint import revolute_joint
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Motion, Plane, Scene, Sphere
from wsim.simulation.simulation import Simulation


def pendulum_on_a_floor(restitution: float) -> Scene:
    """Two balls: one hangs from the world and swings into the other, which lies on a floor."""
    scene = Scene(fps=60.0, substeps=4, iterations=4, frames=30, coordinates="maximal")
    balls = []
    for k, (x, y) in enumerate(((-0.3, 0.37), (0.11, 0.05))):
        shape = Collider(f"/ball{k}/shape", Sphere(0.05), restitution=restitution)
        balls.append(Body(f"/ball{k}", [shape], Motion.at_place((x, y, 0.0)), mass=1.0))
        scene.add(balls[-1])
    scene.add(revolute_joint("/hinge", None, balls[0], at=(0.0, 0.37, 0.0), axis=(0.0, 0.0, 1.0)))
    scene.collider("/floor", Plane("Y"))
    return scene


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_launched_passes_give_the_bits_of_one_launch(restitution, monkeypatch):
    ends = []
    for apart in (False, True):
        monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes,
                            apart=apart: forms.ContactPassForm("coloured", apart=apart))
        simulation = Simulation(pendulum_on_a_floor(restitution), device="cpu")
        simulation.run(30)
        assert ("contacts" in simulation.plan.method("rigid").contacts.form.kernels) == apart
        ends.append(np.array([pose for _, pose in sorted(simulation.poses().items())]))
    assert np.array_equal(*ends)
    assert np.linalg.norm(ends[0][1][:3, 3] - (0.11, 0.05, 0.0)) > 0.01, "the second ball was struck"
