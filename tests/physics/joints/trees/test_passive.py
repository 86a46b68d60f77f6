"""Armature and dry friction of joints: closed forms, MuJoCo, USD."""

import numpy as np
import pytest

import wsim
from tests.physics.joints.trees.chains import chain_scene, trees_of
from wsim import Box, Scene


def slider(**more):
    """A box of 1 kg on a rail along x."""
    scene = Scene(fps=60, substeps=4, coordinates="reduced", gravity=more.pop("gravity", (0, 0, 0)))
    body = scene.body("/box", Box((0.1, 0.1, 0.1)), mass=1.0, velocity=more.pop("velocity", (0, 0, 0)))
    scene.joint("prismatic", "/rail", None, body, axis=(1, 0, 0), **more)
    body.colliders[0].meets = False
    return scene


def test_a_rotor_slows_a_pendulum_by_its_inertia():
    """A rod of 0.5 m that hangs level from a hinge: angular acceleration m g l / (I + a)."""
    scene = Scene(coordinates="reduced")
    rod = scene.body("/rod", Box((0.25, 0.02, 0.02)), at=(0.25, 0.0, 0.0), mass=2.0)
    scene.joint("revolute", "/hinge", None, rod, at=(0, 0, 0), axis=(0, 0, 1), armature=0.3)
    rod.colliders[0].meets = False
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    method, trees = trees_of(simulation)
    inertia = np.sort(method.masses[0].moments)[-1] + 2.0 * 0.25**2
    assert trees.accelerations()[0] == pytest.approx(-2.0 * 9.81 * 0.25 / (inertia + 0.3), rel=1e-12)


def test_the_energy_of_a_rotor_counts():
    """A chain with armature swings for a second: bodies and rotors together keep their energy to the order of rk4."""
    scene = chain_scene(["revolute", "spherical", "revolute"], substeps=8)
    for k, joint in enumerate(scene.things("Joint")):
        joint.armature = dict.fromkeys(joint.free(), 0.1 + 0.1 * k)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.step()
    method, trees = trees_of(simulation)
    first, rotors = method.indicators(None, None)["rigid_energy"], []
    for _ in range(60):
        simulation.step()
        rotors.append(trees.stored_energy())
    assert max(rotors) > 1.0
    assert method.indicators(None, None)["rigid_energy"] == pytest.approx(first, abs=1e-5 * max(rotors))


def test_a_given_velocity_is_kept_beside_a_rotor():
    simulation = wsim.Simulation(slider(velocity=(2.0, 0, 0), armature=5.0), device="cpu", precision="float64")
    simulation.run(30)
    assert trees_of(simulation)[0].velocities()[0, 0] == pytest.approx(2.0, rel=1e-12)


def test_dry_friction_stops_a_slider_where_its_work_is_its_energy():
    """v^2 m / 2 = f s; in the last substep it stops too soon by less than f h^2 / m."""
    simulation = wsim.Simulation(slider(velocity=(2.0, 0, 0), friction=4.0), device="cpu", precision="float64")
    simulation.run(60)
    method, _ = trees_of(simulation)
    assert method.get("x")[0, 0] == pytest.approx(0.5, abs=4.0 / 240.0**2)
    assert abs(method.velocities()[0, 0]) < 1e-12


@pytest.mark.parametrize("pull, holds", [(3.9, True), (4.1, False)])
def test_dry_friction_holds_up_to_its_force(pull, holds):
    simulation = wsim.Simulation(slider(gravity=(pull, 0, 0), friction=4.0), device="cpu", precision="float64")
    simulation.run(60)
    moved = trees_of(simulation)[0].velocities()[0, 0]
    assert moved == pytest.approx(0.0 if holds else pull - 4.0, abs=1e-9)


def test_armature_and_friction_go_through_usd(tmp_path):
    scene = chain_scene(["revolute", "prismatic", "spherical"])
    for joint, values in zip(scene.things("Joint"), ((0.75, 0.5), (3.0, 0.25), (0.125, 2.0)), strict=True):
        joint.armature, joint.friction = (dict.fromkeys(joint.free(), v) for v in values)
    wsim.save(scene, tmp_path / "s.usda")
    for before, after in zip(scene.things("Joint"), wsim.load(tmp_path / "s.usda").things("Joint"), strict=True):
        assert after.armature == before.armature and after.friction == before.friction


def test_maximal_coordinates_say_that_they_have_no_rotors():
    scene = chain_scene(["revolute"], coordinates="maximal")
    scene.things("Joint")[0].armature = {"rotX": 0.1}
    with pytest.raises(wsim.SceneError, match="/j0 have armature, which joints have in reduced coordinates alone"):
        wsim.Simulation(scene, device="cpu")
    scene.things("Joint")[0].armature = {"rotX": -0.1}
    with pytest.raises(wsim.SceneError, match="/j0: armature of rotX is -0.1"):
        wsim.Simulation(scene, device="cpu")
