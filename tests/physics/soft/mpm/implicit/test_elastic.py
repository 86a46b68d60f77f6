"""Implicit steps of elastic bodies and snow against closed forms and conservation laws. All tests share compiled kernels."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Jelly, Snow


def make_scene(gravity=(0, 0, 0), floor=-50.0, friction=0.3, fps=60):
    scene = wsim.Scene(fps=fps, gravity=gravity)
    scene.collider("/floor", wsim.Plane("Y"), at=(0, floor, 0), static_friction=friction, dynamic_friction=friction)
    scene.mpm("/speck", points=[[40, 0.5, 0]], volumes=1e-6, cell=0.04, material=Snow(), integrator="implicit")
    return scene


def find_method(simulation):
    return next(m for m in simulation.plan.methods if m.name == "mpm")


def start(scene):
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    return simulation, find_method(simulation)


def test_momentum_stays_and_energy_falls_when_two_bodies_collide():
    """What conjugate gradients leave of the total of m v, a shift of the world makes good: float64 loses a rounding a step."""
    scene = make_scene()
    scene.mpm("/a", wsim.Box((0.08, 0.08, 0.08)), cell=0.04, velocity=(1, 0.2, 0), material=Jelly(1e5))
    scene.mpm("/b", wsim.Sphere(0.1), at=(0.2, 0.06, 0), cell=0.04, velocity=(-1, 0, 0.3), material=Snow())
    simulation, method = start(scene)
    p, energy = [], []
    for _ in range(10):
        now = [method.read_particles(k) for k in range(3)]
        p.append(sum(each["m"] @ each["v"] for each in now))
        energy.append(method.indicators(None, None)["mpm_energy"])
        simulation.step()
    assert np.abs(np.array(p) - p[0]).max() < 1e-11
    assert np.diff(energy).max() <= 0.0 and energy[-1] < 0.9 * energy[0] and not simulation.warnings


@pytest.mark.parametrize("model", ["neo_hookean", "corotational"])
def test_a_wave_is_damped_as_backward_euler_says(model):
    """The first axial mode of a free bar, omega = pi / L sqrt(E / density): a step divides its energy by 1 + (omega h)^2."""
    scene = make_scene()
    spacing, length = 0.02, 0.8
    axes = [(np.arange(40) + 0.5) * spacing, (np.arange(4) + 0.5) * spacing, (np.arange(4) + 0.5) * spacing]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    v = 1e-3 * np.cos(np.pi * x[:, :1] / length) * [1, 0, 0]
    scene.mpm("/bar", points=x, volumes=spacing**3, cell=0.04, velocity=v, material=Jelly(1e4, 0.0, model=model))
    simulation, method = start(scene)
    method.grid.tolerance = 1e-9
    C = method.part.arrays["C"].numpy()
    C[method.place[1:], 0, 0] = -1e-3 * np.pi / length * np.sin(np.pi * x[:, 0] / length)
    method.part.arrays["C"].assign(C)
    before = method.indicators(None, None)
    wave, swing, mode = np.pi / length * np.sqrt(1e4 / 1000) / 60, [], np.cos(np.pi * x[:, 0] / length)
    for _ in range(24):
        simulation.step()
        swing.append(method.read_particles(1)["v"][:, 0] @ mode / (1e-3 * mode @ mode))
    theory = [np.real((1.0 - 1j * wave) ** -n) for n in range(1, 25)]
    assert np.abs(np.array(swing) - theory).max() < 0.02              # frequency and damping
    after = method.indicators(None, None)
    ratio = (after["mpm_kinetic"] + after["mpm_elastic"]) / before["mpm_kinetic"]
    assert abs(np.log(ratio) / (-24 * np.log1p(wave**2)) - 1) < 0.05


def test_backward_euler_converges_to_explicit_steps_with_order_one():
    """A jelly swings for 1/20 s: half the step leaves half of the difference of places."""
    def swing(fps, integrator):
        scene = make_scene(fps=fps)
        scene.things("MaterialPoints")[0].integrator = integrator
        axes = np.meshgrid(*[(np.arange(6) + 0.5) * 0.02] * 3, indexing="ij")
        x = np.stack(axes, -1).reshape(-1, 3)
        v = 0.2 * np.cos(np.pi * x[:, :1] / 0.12) * [1, 0, 0]
        scene.mpm("/a", points=x, volumes=0.02**3, cell=0.04, velocity=v, material=Jelly(1e4, 0.0))
        simulation, method = start(scene)
        simulation.run(fps // 20)
        return method.read_particles(1)["x"]

    exact = swing(240, "explicit")
    errors = [np.abs(swing(fps, "implicit") - exact).max() for fps in (480, 960)]
    assert 1.6 < errors[0] / errors[1] < 2.4


def test_stiff_body_rests_under_its_weight():
    """1 GPa on a floor: frames of one step, and the mean of the vertical stress is half of that at the bottom."""
    scene = make_scene(gravity=(0, -9.81, 0), floor=0.0)
    scene.mpm("/a", wsim.Box((0.08, 0.08, 0.08)), at=(0, 0.08, 0), cell=0.04, material=Jelly(1e9))
    simulation, method = start(scene)
    simulation.run(6)
    assert method.status.said("mpm: grid")[3] == 1 and not simulation.warnings
    stress = method.part.arrays["T"].numpy()[method.place[1:], 1]
    assert abs(stress.mean() / (-1000 * 9.81 * 0.08) - 1) < 0.05
    assert method.indicators(None, None)["mpm_penetration"] == 0.0


def test_a_block_slides_as_coulomb_says():
    scene = make_scene(gravity=(0, -9.81, 0), floor=0.0, friction=0.3)
    scene.mpm("/a", wsim.Box((0.16, 0.08, 0.16)), at=(0, 0.08, 0), cell=0.04, velocity=(1.5, 0, 0), material=Jelly(1e6))
    simulation, method = start(scene)
    simulation.run(12)
    speed = method.read_particles(1)["v"][:, 0].mean()
    assert abs((1.5 - speed) / (0.3 * 9.81 * 12 / 60) - 1) < 0.05


def test_worlds_are_copies_and_snow_breaks():
    """A snowball hits a floor: it stays there, its packed parts harden, and both worlds have the same bits."""
    scene = make_scene(gravity=(0, -9.81, 0), floor=0.0)
    scene.mpm("/a", wsim.Sphere(0.12), at=(0, 0.13, 0), cell=0.04, velocity=(0, -3, 0), material=Snow(young=1e6))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64", worlds=2)
    energy, method = [], find_method(simulation)
    for _ in range(12):
        simulation.step()
        energy.append(method.indicators(None, None)["mpm_energy"])
        assert method.indicators(None, None)["mpm_penetration"] == 0.0
    assert np.diff(energy).max() <= 1e-3 * abs(energy[0])
    assert np.array_equal(simulation.samples(0)[1].positions, simulation.samples(1)[1].positions)
    assert method.part.arrays["q"].numpy().min() < -0.01


@pytest.mark.parametrize("young, integrator", [(1e6, "explicit"), (1e13, "implicit"), (1e22, "implicit")])
def test_stiffness_that_no_explicit_step_can_hold_goes_implicit(young, integrator):
    from wsim.physics.mpm.implicit.choice import chosen_integrator
    scene = wsim.Scene(fps=60)
    scene.mpm("/a", wsim.Sphere(0.1), material=Jelly(young))
    assert chosen_integrator(scene.things("MaterialPoints"), 60) == integrator
    wsim.Simulation(scene, device="cpu")
