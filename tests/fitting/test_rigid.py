"""Fits of rigid bodies: masses, and frictions of bodies and of colliders that all copies share."""

import numpy as np
import pytest

import wsim
from wsim import Box, Motion, Plane, Scene, Simulation
from wsim.fitting import Markers, Settings
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider

G, FRAMES, NOISE = 9.81, 12, 1e-3
CPU = {"device": "cpu", "precision": "float64"}


def world(**more) -> Scene:
    return Scene(gravity=(0.0, 0.0, -G), up="Z", fps=60.0, frames=FRAMES, substeps=4, **more)


def pushed(mass: float) -> Scene:
    scene = world()
    scene.add(Body("/b", mass=mass, center=np.zeros(3), inertia=np.ones(3), velocity=(3.0, 0.0, 4.0), force=(5.0, 0.0, 0.0)))
    return scene


def sliding(floor: float, own: float = 0.35) -> Scene:
    scene = world(contact_tolerance=1e-10)
    scene.collider("/floor", Plane("Z"), static_friction=floor, dynamic_friction=floor)
    scene.add(Body("/b", [Collider("/b/s", Box((0.2, 0.15, 0.04)), static_friction=own, dynamic_friction=own)],
                   Motion.at_place((0.0, 0.0, 0.04 - 1e-9)), velocity=(2.5, 0.0, 0.0)))
    return scene


def markers(scene: Scene, seed: int) -> Markers:
    """Places of the body in all frames with noise."""
    sim, seen = Simulation(scene, **CPU), []
    for _ in range(FRAMES):
        sim.step()
        seen.append(sim.plan.ports.bodies.placed("/b")[0])
    found = Markers.of("/b", range(1, FRAMES + 1), np.array(seen))
    found.positions += NOISE * np.random.default_rng(seed).normal(size=found.positions.shape)
    found.sigma = NOISE
    return found


@pytest.mark.parametrize("make, name, true, start", [
    (pushed, "mass", 0.4, 0.8), (sliding, "/floor:dynamic_friction", 0.35, 0.5)])
def test_values_come_back_within_their_error_bars(make, name, true, start):
    z = []
    for seed in range(3):
        found = wsim.fit(make(true), [markers(make(true), seed)], name, start={name: start}, settings=Settings(device="cpu"))
        z.append((found.values[name] - true) / found.errors[name])
        assert abs(found.values[name] / true - 1.0) < 0.05
    assert 0.0 < np.abs(z).max() < 3.5


def test_a_mass_that_changes_nothing_is_not_found():
    free = pushed(0.4)
    free.things("Body")[0].force[:] = 0.0
    found = wsim.fit(free, [markers(free, 0)], "mass", start={"mass": 0.8}, settings=Settings(device="cpu"))
    assert "changes nothing that was observed" in found.text()


def test_a_collider_has_a_friction_in_each_world():
    """x = v t - mu g t^2 / 2, with the mean of both frictions; steps of h are off by mu g h t / 2, 1.3 mm."""
    sim = Simulation(sliding(0.3), worlds=3, **CPU)
    for of, friction in enumerate((0.1, 0.5, 0.9)):
        sim.set("/floor", "dynamic_friction", friction, world=of)
        sim.set("/floor", "static_friction", friction, world=of)
    sim.run(6)
    for of, friction in enumerate((0.1, 0.5, 0.9)):
        mu, t = 0.5 * (friction + 0.35), 0.1
        assert abs(sim.poses("/b", of)["/b"][0, 3] - (2.5 * t - 0.5 * mu * G * t * t)) < 2e-3
    sim.set("/floor", "dynamic_friction", 0.2)
    rows = sim.plan.method("rigid").contacts.table.friction.numpy()
    assert (rows[-3:, 1] == 0.2).all()


def test_a_world_that_is_reset_moves_as_at_the_start_with_the_mass_that_was_set():
    sim = Simulation(pushed(0.4), worlds=2, **CPU)
    sim.set("/b", "mass", 1.6, world=1)
    sim.run(3)
    sim.reset(world=1)
    assert np.allclose(sim.plan.ports.bodies.velocities()[1], (3.0, 0.0, 4.0), atol=1e-12)
