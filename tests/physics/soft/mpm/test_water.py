"""Weakly compressible water of material points: pressure in a tank, and what floats."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Water

from .test_method import find_method


def make_tank(half, depth, cut=None):
    """A tank whose walls stand on its floor, without friction, full of water; cut: a box that is left out, (centre, half)."""
    scene = wsim.Scene(fps=60)
    smooth = {"static_friction": 0.0, "dynamic_friction": 0.0}
    scene.collider("/floor", wsim.Box((3, 0.5, 3)), at=(0, -0.5, 0), **smooth)
    for k, (x, z) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        scene.collider(f"/wall{k}", wsim.Box((0.5 if x else 1.3, 1.0, 0.5 if z else 1.3)),
                       at=((half + 0.5) * x, 1.0, (half + 0.5) * z), **smooth)
    step = 0.025
    axes = [np.arange(-half, half, step) + 0.5 * step, np.arange(0, depth, step) + 0.5 * step]
    points = np.stack(np.meshgrid(axes[0], axes[1], axes[0], indexing="ij"), -1).reshape(-1, 3)
    if cut:
        points = points[(np.abs(points - cut[0]) > cut[1] - 1e-9).any(axis=1)]
    scene.mpm("/water", points=points, volumes=step**3, cell=0.05, material=Water(bulk=1e5, viscosity=1.0))
    return scene


def test_pressure_in_a_tank_stays_hydrostatic():
    """Above the lowest cell, whose splines lack what is beyond the floor, the pressure grows by rho g a metre. It is a mean
    over 60 frames: sound goes up and down. Nothing flows out through the edges where walls stand on the floor."""
    simulation = wsim.Simulation(make_tank(0.2, 0.3), device="cpu")
    part, found = find_method(simulation).part, []
    for frame in range(180):
        simulation.step()
        if frame >= 60:
            rows = part.rows["/water", 0]
            y = find_method(simulation).read_particles(0)["x"][:, 1]
            pressure = -part.arrays["T"].numpy()[rows].mean(axis=1) / (1.0 + part.arrays["q"].numpy()[rows])
            found.append(np.stack([y, pressure], 1)[(y > 0.05) & (y < 0.25)])
    for third in (found[:60], found[60:]):
        slope, bottom = np.polyfit(*np.concatenate(third).T, 1)
        assert abs(-slope / 9810 - 1) < 0.03 and abs(bottom / (9810 * 0.3) - 1) < 0.03
    assert np.abs(find_method(simulation).read_particles(0)["v"]).max() < 0.3


@pytest.mark.parametrize("frames", [90, pytest.param(600, marks=pytest.mark.slow)])
def test_a_box_of_half_the_density_floats_with_half_its_volume_in_water(frames):
    """4 cells across, within a cell of where it floats; the slow case takes ten seconds of its time."""
    at = np.array([0.0, 0.3, 0.0])
    scene = make_tank(0.3, 0.3, (at, 0.1))
    scene.body("/box", wsim.Box((0.1,) * 3), at=at, density=500.0, static_friction=0.0, dynamic_friction=0.0)
    simulation = wsim.Simulation(scene, device="cpu")
    for frame in range(frames):
        simulation.step()
        if frame >= 30:
            assert np.abs(centre(simulation) - at).max() < 0.03


def centre(simulation):
    """Centre of mass of the first body [m]."""
    rigid = simulation.plan.method("rigid")
    return (rigid.origin + rigid.get("x") + rigid.get("e"))[0]
