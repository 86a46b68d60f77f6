"""Faces of colliders that hold matter, where several solids meet: walls that stand on a floor, and floors of several boxes."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly

SMOOTH = {"static_friction": 0.0, "dynamic_friction": 0.0}


def test_sand_in_a_tank_of_smooth_walls_on_a_floor_stands_still():
    """Corners below the floor are outside of the walls that stand on it: sand sank along them, by 7 mm in 20 frames."""
    scene = wsim.Scene(fps=60)
    scene.collider("/floor", wsim.Box((2, 0.5, 2)), at=(0, -0.5, 0), **SMOOTH)
    half = np.array([0.2, 0.15, 0.2])
    for k, (x, z) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        box = wsim.Box((0.25 if x else 0.7, 0.5, 0.25 if z else 0.7))
        scene.collider(f"/wall{k}", box, at=(0.45 * x, 0.5, 0.45 * z), **SMOOTH)
    scene.mpm("/sand", wsim.Box(half - 1e-4), at=(0, 0.15, 0), cell=0.05, material=Granular(), integrator="implicit")
    simulation = wsim.Simulation(scene, device="cpu")
    start = simulation.samples()[0].positions
    simulation.run(20)
    assert np.abs(simulation.samples()[0].positions - start).max() < 1e-4


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_block_slides_over_the_seam_of_a_floor_and_along_a_wall_with_its_speed(integrator):
    """Nothing rubs, so that no force acts along x. A third of the speed was lost at the seam, at a plane of nodes."""
    scene = wsim.Scene(fps=60)
    for k, x in enumerate((-2, 2)):
        scene.collider(f"/floor{k}", wsim.Box((2, 0.5, 2)), at=(x, -0.5, 0), **SMOOTH)
    scene.collider("/wall", wsim.Box((4, 1, 0.5)), at=(0, 1, -0.6), **SMOOTH)
    scene.mpm("/block", wsim.Box((0.0999, 0.0999, 0.0999)), at=(-0.15, 0.1, 0), cell=0.05, velocity=(1.0, 0, -0.01),
              material=Jelly(1e5, viscosity=50.0), integrator=integrator)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(18)
    assert simulation.samples()[0].velocities[:, 0].mean() == pytest.approx(1.0, abs=1e-4)
