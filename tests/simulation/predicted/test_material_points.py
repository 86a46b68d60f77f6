"""The forecast of material points counts steps by the wave of the material, and particles by the shape."""

from math import ceil, sqrt

import pytest

from wsim import Box, Scene
from wsim.physics.mpm.objects import Granular, Jelly
from wsim.simulation.predicted.scene_counts import count_material_points


def heap(material, cell=0.05, **more) -> Scene:
    scene = Scene(fps=60.0, frames=2)
    scene.mpm("/heap", Box((0.2, 0.2, 0.2)), cell=cell, material=material, **more)
    return scene


@pytest.mark.parametrize("cell", [0.1, 0.05])
def test_explicit_steps_are_half_a_cell_of_the_wave(cell):
    """A cube of 0.4 m has (0.4 / cell)^3 cells of eight particles; the wave speed is sqrt((lambda + 2 mu) / density)."""
    found = count_material_points(heap(Jelly(young=1e5, poisson=0.25, density=1000.0), cell), 10, False)
    speed = sqrt(1.2 * 1e5 / 1000.0)                              # lambda = mu = 0.4 young
    assert found["transfer"] == ceil(speed / (0.5 * cell * 60.0))
    assert found["particle"] == pytest.approx(found["transfer"] * 8 * (0.4 / cell)**3, rel=0.05)


def test_implicit_steps_are_those_of_the_speed():
    stiff = Granular(young=2e8)
    assert count_material_points(heap(stiff), 10, False)["long"] == 1
    assert count_material_points(heap(stiff, velocity=(18.5, 0.0, 0.0)), 10, False)["long"] == 4       # 0.308 m by two cells
