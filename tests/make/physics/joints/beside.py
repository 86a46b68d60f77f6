"""What tests/physics/joints/test_beside.py shares with other tests: run."""

from tests.physics.joints.make import errors, places
from wsim.physics.rigid import forms
from wsim.physics.rigid.joints.joint import Drive, revolute_joint, spherical_joint
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Plane, Scene, Sphere
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def link(path: str, at, shape, **more) -> Body:
    return Body(path, [Collider(path + "/shape", shape)], Motion.at_place(at), **more)


def walkers(n: int = 3) -> Scene:
    """Boxes with two legs on driven hinges and a ball on each leg, over a plane."""
    scene = Scene(fps=60, substeps=8)
    scene.collider("/floor", Plane())
    for k in range(n):
        body = scene.add(link(f"/w{k}", (1.5 * k, 0.9, 0.1 * k), Box((0.3, 0.1, 0.2)), spin=(0.0, 1.0, 0.2 * k)))
        for s in (-1, 1):
            leg = scene.add(link(f"/w{k}_{'lr'[s > 0]}", (1.5 * k + 0.25 * s, 0.55, 0.1 * k), Box((0.04, 0.25, 0.04))))
            foot = scene.add(link(f"{leg.path}_foot", (1.5 * k + 0.25 * s, 0.25, 0.1 * k), Sphere(0.08)))
            at = (1.5 * k + 0.25 * s, 0.8, 0.1 * k)
            scene.add(revolute_joint(f"{leg.path}_hip", body, leg, -1.0, 1.0, at=at, axis=(0.0, 0.0, 1.0),
                                     drives={"rotX": Drive(200.0, 20.0)}))
            scene.add(spherical_joint(f"{leg.path}_ankle", leg, foot, at=(at[0], 0.3, at[2])))
    return scene


def run(name: str, device: str, monkeypatch, frames: int = 40):
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes: forms.form_by_name(name, device))
    sim = Simulation(walkers(), device=device, precision="float64")
    sim.run(frames)
    assert max(errors(sim)) < 1e-5 and places(sim)[:, 1].min() > 0.05
    return sim.plan.method("rigid")
