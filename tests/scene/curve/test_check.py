"""What curves do between and outside of their keys is judged before a scene runs, and is what runs read."""

import numpy as np
import pytest

from wsim.scene import Scene, SceneError, Varying, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


def scene(curve: Curve, name: str = "bend") -> Scene:
    made = Scene(frames=20, fps=10.0, substeps=8, solver="xpbd", integrator="backward_euler")
    cloth = made.cloth("/cloth", *shapes.sheet(1.0, 1.0, 2, 2, cut="quads"), material=Fabric(bend=1e-4))
    made.pin("/pin", cloth, [0, 2])
    made.varying.append(Varying("/cloth", name, curve))
    return made


def fatal(made: Scene) -> str:
    return "\n".join(p.text for p in check_scene(made) if p.fatal)


STEP = [1e-4, 1e-6, 1e-6, 1e-4]


def test_a_value_that_a_curve_takes_out_of_its_range_is_refused_and_the_monotone_one_is_not():
    said = fatal(scene(Curve(np.arange(4.0) / 2, STEP, "catmull_rom")))
    assert "a curve of kind catmull_rom leaves that range between its keys" in said and "kind monotone" in said
    assert fatal(scene(Curve(np.arange(4.0) / 2, STEP, "monotone"))) == ""
    assert "outside of them" in fatal(scene(Curve([0.0, 0.5], [2e-4, 1e-4], after="linear")))


def test_a_frame_reads_the_curve_at_its_middle():
    curve = Curve(np.arange(4.0) / 2, [1e-4, 3e-4, 2e-4, 4e-4], "monotone", after="oscillate")
    sim = Simulation(scene(curve), device="cpu")
    for frame in range(3):
        sim.step()
        assert sim.plan.followed["/cloth", "bend"] == pytest.approx(curve.at((frame + 0.5) / 10.0), rel=1e-12)


def test_muscles_that_a_curve_takes_below_nothing_are_refused():
    made = Scene(frames=2)
    made.net("/net", [[0.0, 0, 0], [1, 0, 0]], [[0, 1]], [10.0], [1.0],
             actuation=Curve([0.0, 1.0, 2.0, 3.0], [[0.9], [0.01], [0.01], [0.9]], "catmull_rom"))
    assert "factors of actuation down to -" in fatal(made)
    with pytest.raises(SceneError, match="factors of actuation"):
        Simulation(made, device="cpu")


def test_loads_and_muscles_of_any_kind_do_what_their_curve_says():
    """A force on a free point of 2 kg: its velocity is the integral, by leapfrog to the order of the step."""
    push = Curve([0.0, 1.0, 2.0], [[0.0, 0, 0], [4.0, 0, 0], [1.0, 0, 0]], "catmull_rom")
    errors = []
    for substeps in (8, 16):
        made = Scene(frames=15, fps=10.0, substeps=substeps, gravity=(0.0, 0.0, 0.0), integrator="leapfrog")
        net = made.net("/net", [[0.0, 0, 0], [1, 0, 0]], [[0, 1]], [1e-9], [2.0])
        made.force("/push", net, [0], push)
        sim = Simulation(made, device="cpu", precision="float64")
        sim.run(15)
        t = (np.arange(150_000) + 0.5) / 100_000
        errors.append(abs(sim.velocities("/net")[0, 0] - push.sampled(t)[:, 0].sum() / 100_000 / 2.0))
    assert errors[1] < errors[0] / 3.5 and errors[1] < 1e-4
