"""What steps carry on from those before is of their length: where a frame takes others, they begin anew, and nothing jumps."""

import numpy as np
import pytest

from wsim.model.stage import Remedy
from wsim.scene import Scene, Sphere, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

V, G = np.array((1.0, 0.5, -0.2)), np.array((0.0, -9.81, 0.0))


def flying(gravity=(0.0, 0.0, 0.0), **more) -> Scene:
    """A sheet that flies, in still air that it does not feel, past a ball that its box meets: each frame has contacts."""
    scene = Scene(gravity=tuple(gravity), **{"fps": 60.0, "substeps": 4, "iterations": 4} | more)
    points, counts, indices = shapes.sheet(0.2, 0.2, 3, 3, horizontal=True)
    scene.cloth("/sheet", points, counts, indices, material=Fabric(stretch=1.0, bend=0.0), velocities=np.tile(V, (16, 1)))
    scene.collider("/ball", Sphere(0.01), at=(2.0, -1.0, 0.5))
    return scene


def fallen(sim: Simulation) -> np.ndarray:
    """How far points have gone from where they fly without steps [m], (points, 3)."""
    t = sim.time
    return sim.positions() - (np.asarray(sim.given.cloths[0].points) + V * t + 0.5 * np.asarray(sim.scene.gravity) * t * t)


def bdf2(frames: list[int]) -> np.ndarray:
    """Place of a point that falls from 0 by BDF2, a number of steps of each frame; other steps than before begin as a start."""
    x, v, before, u, last = np.zeros(3), V, np.zeros(3), V, 0
    for count in frames:
        h = 1.0 / 60.0 / count
        for _ in range(count):
            new = v + h * G if count != last else v + (v - u) / 3.0 + 2.0 / 3.0 * h * G
            step = h * new if count != last else before / 3.0 + 2.0 / 3.0 * h * new
            x, v, before, u, last = x + step, new, step, v, count
    return x


def shorten_once(sim: Simulation) -> None:
    """The next frame is repeated, as where a position is no number."""
    method, said = sim.plan.ports.points, [Remedy("refine", part="points", row=0)]
    inner = method.find_remedies
    method.find_remedies = lambda status: [said.pop()] if said else inner(status)


@pytest.mark.parametrize("solver", ["xpbd", "implicit"])
def test_bdf2_does_not_jump_where_a_frame_is_repeated_with_shorter_steps(solver):
    """A third of a step of twice the length would be carried on, and thirds of it after that: 1 mm too far."""
    sim = Simulation(flying(G, solver=solver, integrator="bdf2"), device="cpu", precision="float64")
    sim.run(3)
    shorten_once(sim)
    sim.run(2)
    assert sim.plan.clock.substeps == 8 and sim.plan.integrator == "bdf2", sim.warnings
    went = sim.positions() - np.asarray(sim.given.cloths[0].points)
    np.testing.assert_allclose(went, np.tile(bdf2([4, 4, 4, 8, 8]), (16, 1)), atol=1e-12)


@pytest.mark.parametrize("change", ["repeated", "set"])
def test_leapfrog_falls_on_where_its_steps_become_shorter(change):
    """Its velocity is that of half a step before: of a step of another length it would be off by G (h - h') / 2."""
    sim = Simulation(flying(G, solver="explicit", integrator="leapfrog", substeps=24), device="cpu", precision="float64")
    assert sim.state.has_point_field("b")
    sim.plan.clock.touching = True
    sim.run(3)
    before = sim.plan.clock.substeps
    if change == "set":
        sim.set("/sheet", "stretch", 3e5)
    else:
        shorten_once(sim)
    sim.run(2)
    assert sim.plan.clock.substeps > before and sim.forms["met"] == 5
    assert np.abs(fallen(sim)).max() < 1e-9
    np.testing.assert_allclose(sim.velocities(), np.tile(V + G * sim.time, (16, 1)), atol=1e-9)
