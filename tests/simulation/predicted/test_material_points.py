"""The forecast of material points counts steps by the wave of the material, and particles by the shape."""

from math import ceil, exp, sqrt

import pytest

from wsim import Box, Plane, Scene
from wsim.physics.mpm.objects import Granular, Jelly, Snow
from wsim.simulation.predicted.scene_counts import count_material_points, impact_speed


def heap(material, cell=0.05, **more) -> Scene:
    scene = Scene(fps=60.0, frames=2)
    scene.mpm("/heap", Box((0.2, 0.2, 0.2)), cell=cell, material=material, **more)
    return scene


@pytest.mark.parametrize("cell", [0.1, 0.05])
def test_explicit_steps_are_half_a_cell_of_the_wave(cell):
    """A cube of 0.4 m has (0.4 / cell)^3 cells of eight particles; the wave speed is sqrt((lambda + 2 mu) / density)."""
    found = count_material_points(heap(Jelly(young=1e5, poisson=0.25, density=1000.0), cell), 10, True)
    speed = sqrt(1.2 * 1e5 / 1000.0)                              # lambda = mu = 0.4 young
    assert found["transfer"] == ceil(speed / (0.5 * cell * 60.0))
    assert found["particle"] == pytest.approx(found["transfer"] * 8 * (0.4 / cell)**3, rel=0.05)


def test_implicit_steps_are_those_of_the_speed():
    stiff = Granular(young=2e8)
    assert count_material_points(heap(stiff), 10, False)["long"] == 1
    assert count_material_points(heap(stiff, velocity=(18.5, 0.0, 0.0)), 10, False)["long"] == 4       # 0.308 m by two cells


def test_steps_are_those_of_the_way_where_particles_outrun_the_wave():
    """Half a cell a step, either way."""
    soft = Jelly(young=1e3, poisson=0.25, density=1000.0)                                              # a wave of 1.1 m/s
    assert count_material_points(heap(soft, velocity=(0.0, 0.0, 9.0)), 10, False)["transfer"] == ceil(9.0 / (0.5 * 0.05 * 60.0))


@pytest.mark.parametrize(("height", "packed"), [(0.3, False), (8.0, True)])
def test_snow_that_falls_far_gets_as_stiff_as_it_can(height, packed):
    """density 2 g H against compression_limit (lambda + 2 mu); then waves go e^2 times as fast."""
    snow = Snow()
    scene = heap(snow, at=(0.0, height, 0.0))
    scene.collider("/floor", Plane())
    (thing,) = scene.things("MaterialPoints")
    speed = sqrt(2.0 * 9.81 * (height - 0.2))
    assert impact_speed(thing, scene) == pytest.approx(speed, rel=1e-12)
    assert (snow.density * speed**2 > snow.compression_limit * snow.young / 0.9) == packed               # nu = 0.2
    wave = sqrt(snow.young / 0.9 / snow.density) * (exp(2.0) if packed else 1.0)
    assert count_material_points(scene, 10, False)["transfer"] == ceil(max(wave, speed) / (0.5 * 0.05 * 60.0))
