"""Momentum and angular momentum of material points, in double precision and over a thousand steps in single precision."""

import numpy as np

import wsim
from wsim.physics.mpm.objects import Jelly

from .test_method import find_method, make_scene, total_momentum


def test_momentum_and_angular_momentum_stay():
    """Two jellies that collide off centre while they spin. Float64 loses a rounding a step."""
    scene = make_scene(gravity=(0, 0, 0))
    scene.mpm("/a", wsim.Box((0.1, 0.1, 0.1)), cell=0.05, velocity=(1, 0.2, 0), spin=(0, 3, 5), material=Jelly(2e4))
    scene.mpm("/b", wsim.Sphere(0.12), at=(0.24, 0.06, 0.01), cell=0.05, velocity=(-1, 0, 0.3), material=Jelly(1e4))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    p, spin = total_momentum(simulation)
    simulation.run(10)
    p_end, spin_end = total_momentum(simulation)
    assert np.abs(p_end - p).max() < 1e-11 and np.abs(spin_end - spin).max() < 1e-12
    assert find_method(simulation).elastic_energy().sum() > 1e-3


def test_single_precision_keeps_momentum_over_a_thousand_steps():
    """The same jellies: 1e-6 of the sum of m |v|, and 1e-5 of the angular momentum, which a rounding of each place and velocity
    in each step would exceed if roundings added up to one side."""
    scene = make_scene(gravity=(0, 0, 0))
    scene.mpm("/a", wsim.Box((0.1, 0.1, 0.1)), cell=0.05, velocity=(1, 0.2, 0), spin=(0, 3, 5), material=Jelly(2e4))
    scene.mpm("/b", wsim.Sphere(0.12), at=(0.24, 0.06, 0.01), cell=0.05, velocity=(-1, 0, 0.3), material=Jelly(1e4))
    simulation = wsim.Simulation(scene, device="cpu")
    m, steps = find_method(simulation), 0
    size = sum((now["m"] * np.linalg.norm(now["v"], axis=1)).sum() for now in map(m.read_particles, (0, 1)))
    p, spin = total_momentum(simulation)
    while steps < 1000:
        simulation.step()
        steps += int(m.status.said("mpm: grid")[3])
    p_end, spin_end = total_momentum(simulation)
    assert np.abs(p_end - p).max() < 1e-6 * size and np.abs(spin_end - spin).max() < 1e-5 * np.linalg.norm(spin)
