"""Implicit steps of sand against statics, conservation laws, and shorter steps."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly

FLOOR = wsim.Box((5, 0.5, 5))


def make_scene(gravity=(0, -9.81, 0), floor=-0.5, friction=0.5):
    """A floor at floor + 0.5 and a ball, so that all tests share compiled kernels."""
    scene = wsim.Scene(fps=60, gravity=gravity)
    scene.collider("/floor", FLOOR, at=(0, floor, 0), static_friction=friction, dynamic_friction=friction)
    scene.collider("/ball", wsim.Sphere(0.15), at=(0.05, 0.2 + 0.5 + floor, 0), static_friction=0.3, dynamic_friction=0.3)
    return scene


def add_sand(scene, shape, at, cell=0.04, path="/sand", **more):
    scene.mpm(path, shape, at=at, cell=cell, integrator="implicit", material=Granular(friction_angle=0.6), **more)


def find_method(simulation):
    return next(m for m in simulation.plan.methods if m.name == "mpm")


def test_free_fall_is_that_of_symplectic_euler():
    scene = make_scene(floor=-50)
    add_sand(scene, wsim.Box((0.1, 0.1, 0.1)), (0, 0, 0), velocity=(0.3, 0, 0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    x = simulation.samples()[0].positions
    simulation.run(3)
    assert find_method(simulation).status.said("mpm: grid")[3] == 1
    way = simulation.samples()[0].positions - x
    assert np.allclose(way, [0.3 * 3 / 60, -9.81 * 3 * 4 / 2 / 3600, 0], rtol=1e-9, atol=1e-12)


def test_momentum_stays_and_energy_falls_when_two_heaps_collide():
    """What a sweep adds to the corners of a cell sums to zero: float64 loses a rounding a sweep."""
    scene = make_scene(gravity=(0, 0, 0), floor=-50)
    add_sand(scene, wsim.Box((0.12, 0.12, 0.12)), (0, 0, 0), path="/a", velocity=(1, 0.2, 0), spin=(0, 2, 3))
    add_sand(scene, wsim.Sphere(0.12), (0.26, 0.06, 0.01), path="/b", velocity=(-1, 0, 0.3))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    method, p, energy = find_method(simulation), [], []
    for _ in range(12):
        now = [method.read_particles(k) for k in range(2)]
        p.append(sum(each["m"] @ each["v"] for each in now))
        energy.append(method.indicators(None, None)["mpm_kinetic"])
        simulation.step()
    assert np.abs(np.array(p) - p[0]).max() < 1e-12 * np.abs(now[0]["m"] @ now[0]["v"]).max() * 1e2
    assert np.diff(energy).max() <= 0.0 and energy[-1] < 0.5 * energy[0]


def test_a_block_rests_under_its_weight():
    """Sand that coheres stands as a block: the mean vertical stress of a layer of cells is the weight above its middle over its
    area. (Cells of a layer differ like fields of a chess board, which no velocity of their corners can see.)"""
    scene = make_scene()
    scene.colliders.pop()
    scene.collider("/ball", wsim.Sphere(0.15), at=(9, 0, 0), static_friction=0.3, dynamic_friction=0.3)
    scene.mpm("/sand", wsim.Box((0.16, 0.12, 0.16)), at=(0, 0.12, 0), cell=0.04, integrator="implicit",
              material=Granular(friction_angle=0.6, cohesion=1e4))
    simulation = wsim.Simulation(scene, device="cpu")
    method = find_method(simulation)
    method.grid.tolerance, method.grid.most = 1e-4, 400
    x = simulation.samples()[0].positions
    simulation.run(6)
    pressed = -method.part.arrays["T"].numpy()[method.place][:, 1]
    middle = (np.floor(x[:, 1] / 0.04) + 0.5) * 0.04
    for height in np.unique(middle):
        assert np.abs(pressed[middle == height].mean() / (1600 * 9.81 * (0.24 - height)) - 1) < 0.01
    assert np.abs(method.read_particles(0)["v"]).max() < 1e-3 and not simulation.warnings


def test_run_out_hardly_depends_on_the_step():
    """A cylinder that collapses: frames of 1/60 s against a third of them."""
    found = []
    for fps in (60, 180):
        scene = make_scene()
        scene.fps = fps
        scene.colliders.pop()
        scene.collider("/ball", wsim.Sphere(0.15), at=(9, 0, 0), static_friction=0.3, dynamic_friction=0.3)
        add_sand(scene, wsim.Cylinder(0.16, 0.24), (0, 0.12, 0), cell=0.04)
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(fps * 2 // 3)                           # 4 times the time of a fall by its height
        x = simulation.samples()[0].positions
        found.append(np.quantile(np.hypot(x[:, 0], x[:, 2]), 0.98))
    assert abs(found[0] / found[1] - 1) < 0.05 and found[0] > 0.2


def run_on_ball(worlds=1, frames=24):
    scene = make_scene()
    add_sand(scene, wsim.Box((0.16, 0.08, 0.16)), (0, 0.55, 0))
    simulation = wsim.Simulation(scene, device="cpu", worlds=worlds)
    energy, method = [], find_method(simulation)
    for _ in range(frames):
        simulation.step()
        found = method.indicators(None, None)
        energy.append(found["mpm_energy"])
        assert found["mpm_penetration"] == 0.0
    return simulation, energy


def test_nothing_passes_a_ball_energy_falls_and_worlds_are_copies():
    simulation, energy = run_on_ball(worlds=2)
    again, _ = run_on_ball()
    assert np.diff(energy).max() < 0.0
    x = [simulation.samples(world)[0].positions for world in range(2)]
    assert np.array_equal(x[0], x[1]) and np.array_equal(x[0], again.samples()[0].positions)


def test_a_run_restarts_to_the_bit_and_the_choice_goes_to_a_file(tmp_path):
    from dataclasses import replace

    from wsim.cli.run import prepare_recorded_run

    scene = make_scene()
    add_sand(scene, wsim.Box((0.12, 0.06, 0.12)), (0, 0.5, 0))
    wsim.save(scene, str(tmp_path / "s.usda"))
    assert wsim.load(str(tmp_path / "s.usda")).things("MaterialPoints")[0].integrator == "implicit"

    def run(output, frames, restart=None):
        job = prepare_recorded_run(replace(wsim.load(str(tmp_path / "s.usda")), frames=frames), str(tmp_path / output),
                                   lambda s: wsim.Simulation(s, device="cpu"), restart=restart and str(tmp_path / restart))
        job.frames()
        return job.simulation

    whole, _ = run("o.usdc", 16), run("half.usdc", 12)
    rest = run("rest.usdc", 16, "half.usdc")
    for field in find_method(whole).part.kept:
        a, b = (find_method(s).part.arrays[field.name].numpy() for s in (whole, rest))
        assert np.array_equal(a, b), field.name


def test_a_residual_that_is_missed_is_told():
    scene = make_scene()
    add_sand(scene, wsim.Box((0.2, 0.2, 0.2)), (0, 0.2, 0))
    simulation = wsim.Simulation(scene, device="cpu")
    find_method(simulation).grid.tolerance = 1e-9
    simulation.step()
    assert any("times the residual" in text for text in simulation.warnings)


@pytest.mark.parametrize("young, integrator", [(1e4, "explicit"), (1e9, "implicit")])
def test_stiff_sand_takes_implicit_steps_by_itself(young, integrator):
    from wsim.physics.mpm.implicit.choice import chosen_integrator
    scene = make_scene()
    scene.mpm("/a", wsim.Sphere(0.1), material=Granular(young=young))
    assert chosen_integrator(scene.things("MaterialPoints"), 60) == integrator


@pytest.mark.parametrize("first, more, text", [
    ("backward", {}, "integrator is 'backward'"),
    ("implicit", {"integrator": "explicit"}, "one for all bodies"),
    ("implicit", {"material": Jelly()}, "the scene's materials are neo_hookean, sand"),
])
def test_bad_choices_get_one_line(first, more, text):
    scene = make_scene()
    scene.mpm("/a", wsim.Sphere(0.1), material=Granular(), integrator=first)
    scene.mpm("/b", wsim.Sphere(0.1), at=(1, 0, 0), **({"material": Granular()} | more))
    with pytest.raises(wsim.SceneError, match=text):
        wsim.Simulation(scene, device="cpu")
