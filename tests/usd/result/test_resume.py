"""Going on from the fields that a run left: every solver, with and without what acts within a substep, to the bit."""

import numpy as np
import pytest

from wsim.scene import Plane, Scene, SceneError, Sphere, Surface, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

CPU = {"device": "cpu"}
UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, -0.05], [0, -1, 0, 0], [0, 0, 0, 1]])


def swung(**more) -> Scene:
    """A net of 8 x 8 points whose two pins move."""
    scene = Scene(fps=60.0, **({"substeps": 8, "iterations": 4} | more))
    points, edges, k, masses = shapes.spring_sheet(0.5, 8, stretch=300.0, diagonal=300.0, cross=0.3, density=0.2)
    net = scene.net("/net", points, edges, k, masses)
    places = np.tile(np.eye(4), (3, 1, 1))
    places[:, 2, 3] = 0.0, 0.1, -0.1
    scene.pin("/pin", net, [0, 7], motion=Motion(np.array([0.0, 0.1, 0.2]), places))
    return scene


def blown(**more) -> Scene:
    scene = swung(wind=(3.0, 0.0, 1.0), **more)
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 6, 6), material=Fabric(stretch=300.0, bend=1e-4, damping=1e-3), drag=1.2,
                lift=1.0)
    scene.pin("/held", scene.cloths[0], [0])
    return scene


def draped(**more) -> Scene:
    """A cloth over a ball, a closed mesh that comes and goes, and a floor."""
    scene = Scene(fps=60.0, **({"substeps": 12, "iterations": 4} | more))
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 8, 8, horizontal=True), material=Fabric(stretch=300.0, bend=1e-4))
    scene.collider("/ball", Sphere(0.12), at=(0.02, -0.13, 0.01))
    scene.collider("/mesh", Surface(*shapes.sphere(0.08, 12)), at=(0.2, -0.1, 0.2))
    scene.collider("/floor", Plane(), motion=Motion.still(UP))
    return scene


@pytest.mark.parametrize("make, solver, integrator", [
    (swung, "explicit", "leapfrog"), (blown, "explicit", "leapfrog"), (draped, "explicit", "leapfrog"),
    (blown, "explicit", "rk4"), (draped, "xpbd", "backward_euler"), (draped, "xpbd", "bdf2"),
    (draped, "implicit", "backward_euler"), (draped, "implicit", "implicit_midpoint")])
def test_a_restart_from_the_fields_is_exact(make, solver, integrator):
    scene = make(solver=solver, integrator=integrator, **({"substeps": 96} if solver == "explicit" else {}))
    paths = [b.path for b in scene.bodies()]
    through = Simulation(scene, **CPU)
    through.run(6)
    fields = {path: through.fields(path) for path in paths}
    through.run(6)
    again = Simulation(scene, **CPU)
    again.restart(6, fields)
    again.run(6)
    for path in paths:
        assert np.array_equal(again.positions(path), through.positions(path))
        assert np.array_equal(again.velocities(path), through.velocities(path))


def test_a_repeated_frame_of_an_explicit_run_is_the_same_to_the_bit():
    """The rounding remainder of the velocity is put back with the rest."""
    sim = Simulation(swung(solver="explicit", integrator="leapfrog", substeps=48), **CPU)
    sim.run(4)
    kept = sim.fields()
    sim.plan.before_frame(sim.time)
    sim._replay()
    sim.state.restore_snapshot()
    assert all(np.array_equal(kept[name], now) for name, now in sim.fields().items()) and np.any(kept["r"])


@pytest.mark.parametrize("solver, integrator, lacking", [("explicit", "leapfrog", "b"), ("xpbd", "bdf2", "s")])
def test_a_restart_that_lacks_a_field_begins_without_history(solver, integrator, lacking):
    scene = draped(solver=solver, integrator=integrator, substeps=48)
    sim = Simulation(scene, **CPU)
    sim.run(1)
    fields = sim.fields()
    again = Simulation(scene, **CPU)
    again.restart(1, {"/cloth": fields})
    assert not again.plan.clock.starting
    del fields[lacking]
    again.restart(1, {"/cloth": fields})
    assert again.plan.clock.starting
    again.restart(1, {})
    assert again.plan.clock.starting


def test_fields_that_are_not_those_of_the_run_are_said_or_refused():
    scene = draped(solver="xpbd", integrator="bdf2", substeps=48)
    sim = Simulation(scene, **CPU)
    fields = sim.fields()
    for given, said in (({k: v for k, v in fields.items() if k != "s"}, "its restart fields lack s"),
                        ({**fields, "odd": fields["s"]}, "its restart fields hold more than this run has: odd")):
        before = list(sim.warnings)
        sim.restart(1, {"/cloth": given})
        (warning,) = [w for w in sim.warnings if w not in before]
        assert sim.plan.clock.starting and warning.startswith(f"warning: /cloth: {said}: the run goes on from frame 1 without")
    sim.restart(1, {"/cloth": fields})
    assert not sim.plan.clock.starting
    for wrong in (fields["x"][:, :2], fields["x"].ravel(), np.zeros(())):
        with pytest.raises(SceneError, match="/cloth: its restart field x has shape .*; allowed is "):
            sim.restart(1, {"/cloth": {**fields, "x": wrong}})


@pytest.mark.parametrize("wrong", [-3, 2.5, True, None, "3", float("nan"), 10**9])
def test_frames_that_are_no_count_are_refused(wrong):
    sim = Simulation(draped(), **CPU)
    with pytest.raises(SceneError, match="frame: found .*; allowed is a whole number, 0 to 1000000"):
        sim.restart(wrong, {})
    for ask in (sim.run, sim.frames):
        if wrong is not None:
            with pytest.raises(SceneError, match="frames: found .*; allowed is a whole number, 0 to 1000000"):
                ask(wrong)
    assert sim.frame == 0 and list(sim.frames(np.int64(0))) == []
