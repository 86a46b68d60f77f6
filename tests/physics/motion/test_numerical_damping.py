"""What a report says of the energy that an integrator takes, against closed forms; and where it says nothing."""

import numpy as np
import pytest

from wsim import Bulk, Plane, Scene, Simulation
from wsim.scene import shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation import report

OMEGA, H, FRAMES = 10.0, 1.0 / 240.0, 15
DOUBLE = {"device": "cpu", "precision": "float64"}


def oscillator(**more) -> Scene:
    """1 kg on a spring of 1 m, pulled out by 1/8 m: linear along its line, 10 rad/s."""
    given = {"gravity": (0.0, 0.0, 0.0), "fps": 60.0, "substeps": 4, "iterations": 2, "solver": "implicit"}
    scene = Scene(**given | more)
    net = scene.net("/net", [[0, 0, 0], [1.125, 0, 0]], [[0, 1]], [OMEGA**2], [1.0], lengths=[1.0])
    scene.pin("/pin", net, [0])
    return scene


def told(scene: Scene, frames: int = FRAMES, **more) -> dict:
    sim = Simulation(scene, **DOUBLE | more)
    sim.run(frames)
    return sim.report(profile=False)


@pytest.mark.parametrize("solver", ["implicit", "xpbd"])
def test_backward_euler_takes_what_it_must(solver):
    """Kinetic and elastic energy fall by 1 + (h omega)^2 a step."""
    found = told(oscillator(solver=solver, integrator="backward_euler"))
    wanted = (1.0 + (H * OMEGA)**2) ** (-4 * FRAMES) - 1.0
    assert found["error"]["energy_change"] == pytest.approx(wanted, rel=1e-6)
    assert found["error"]["energy_change_seconds"] == 0.25
    assert f" {100.0 * wanted:+.2g} % in 0.25 s (numerical damping of backward_euler)" in report.report_text(found)


def test_the_midpoint_takes_nothing():
    assert abs(told(oscillator(integrator="implicit_midpoint"))["error"]["energy_change"]) < 1e-9


def test_a_body_that_swings_loses_a_part_of_what_was_turned_over():
    """A pendulum let go level, after any number of swings: never more than all of it, and more the longer it swings."""
    found = []
    for frames in (30, 60, 120):
        scene = Scene(solver="implicit", integrator="backward_euler", substeps=8, iterations=2, fps=60.0)
        net = scene.net("/net", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [1e5], [1.0])
        scene.pin("/pin", net, [0])
        found.append(told(scene, frames)["error"]["energy_change"])
    assert 0.0 > found[0] > found[1] > found[2] > -1.0


def block(**more) -> Scene:
    scene = Scene(**{"fps": 60.0, "substeps": 2, "iterations": 2, "solver": "implicit", "integrator": "backward_euler"} | more)
    body = scene.soft("/bar", *shapes.block((0.3, 0.1, 0.1), (3, 1, 1)), material=Bulk(1e5))
    scene.pin("/wall", body, range(4), places=body.points[:4])
    return scene


def test_of_a_soft_body_it_is_the_change_of_its_indicators_and_asking_changes_nothing():
    """Let go from the rest shape; the largest energy seen is what gravity gave."""
    asked, left = (Simulation(block(), device="cpu") for _ in range(2))
    first = asked.indicators()
    for sim in (asked, left):
        sim.run(6)
    now, found = asked.indicators(), asked.report(profile=False)["error"]
    given = first["gravity_energy"] - now["gravity_energy"]
    assert found["energy_change"] == pytest.approx((now["energy"] - first["energy"]) / given, rel=1e-6)
    assert found.items() >= now.items() == asked.indicators().items()
    for sim in (asked, left):
        sim.run(2)
    assert np.array_equal(asked.positions(), left.positions())


def leaky(what: str) -> Scene:
    """The block with one thing that takes energy, or gives it."""
    scene = block(air_drag=0.1) if what == "air" else block(solver="explicit", integrator="auto") if what == "explicit" \
        else block()
    if what == "damping":
        scene.softs[0].material = Bulk(1e5, damping=0.01)
    if what == "collider":
        scene.collider("/ground", Plane("Z"), at=(0.0, 0.0, -9.0))
    if what == "moving pin":
        scene.pins[0].motion = Motion([0.0, 1.0], np.stack([np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])]))
    if what == "pulling pin":
        scene.pins[0].places = scene.pins[0].places + np.float32(0.01)
    if what == "soft pin":
        scene.pins[0].stiffness = 1e4
    if what == "cloth in air":
        scene.cloth("/cloth", *shapes.sheet(0.1, 0.1, 2, 2), material=Fabric(), drag=1.0)
    return scene


@pytest.mark.parametrize("what", ["air", "damping", "collider", "moving pin", "pulling pin", "soft pin", "cloth in air",
                                  "explicit"])
def test_where_something_else_counts_nothing_is_said(what):
    sim = Simulation(leaky(what), device="cpu")
    sim.plan.clock.starting = True
    from wsim.simulation.measure.indicators import begin_integrator_balance
    assert begin_integrator_balance(sim) is None and begin_integrator_balance(Simulation(block(), device="cpu")) is not None


def test_it_counts_from_where_points_were_placed_last_and_not_past_a_live_parameter():
    sim = Simulation(oscillator(integrator="backward_euler"), **DOUBLE)
    sim.run(5)
    sim.set("/net", "positions", np.array([[0.0, 0, 0], [2.0, 0, 0]]))
    sim.set("/net", "velocities", np.zeros((2, 3)))
    sim.run(3)
    found = sim.report(profile=False)["error"]
    assert found["energy_change_seconds"] == 0.05
    assert found["energy_change"] == pytest.approx((1.0 + (H * OMEGA)**2) ** -12 - 1.0, rel=1e-6)
    sim.set("/net", "stiffness", 50.0)
    sim.run(1)
    assert "energy_change" not in sim.report(profile=False)["error"]


def test_of_what_rests_nothing_is_said():
    scene = oscillator(integrator="backward_euler")
    scene.springs[0].lengths = np.float32([1.125])
    assert "energy_change" not in told(scene)["error"]
