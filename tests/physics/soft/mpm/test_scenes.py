"""The example scenes of material points."""

from pathlib import Path

import numpy as np
import pytest

from tests.make.tools.scenes import GRAINS
from wsim.physics.mpm.seeding import place_particles
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation
from wsim.usd import load

FOLDER = Path(__file__).resolve().parents[4] / "scenes"


@pytest.mark.parametrize("name", GRAINS)
def test_scenes_of_grains_hold_what_they_say(name):
    """Particles as they say; nothing to warn of."""
    scene = load(FOLDER / f"{name}.usda")
    assert not scene.notes and not check_scene(scene)
    assert sum(len(place_particles(thing).x) for thing in scene.things("MaterialPoints")) == GRAINS[name]


def test_sand_runs_through_the_neck_of_the_hourglass_and_stays_in_it():
    """After a third of a second some has come through; all is within the glass, a polygon of 40 sides."""
    sim = Simulation(load(FOLDER / "hourglass.usda"), device="cpu")
    sim.run(8)
    x = sim.samples()[0].positions
    r, y = np.hypot(x[:, 0], x[:, 2]), x[:, 1]
    glass = np.interp(y, [0.02, 0.18, 0.5, 0.54, 0.86, 0.98], [0.2, 0.2, 0.07, 0.07, 0.2, 0.2])
    assert len(x) == GRAINS["hourglass"] and (r < glass).all() and (y > 0.0).all()
    assert 0.02 < (y < 0.5).mean() < 0.8 and not sim.warnings


def places_above(x, points, corners):
    """Of places (n, 3) [m] above or below a sheet: heights [m] over the nearest triangle, which it is, and parts (n, 3) of its
    corners."""
    height, face, part = np.full(len(x), np.inf), np.zeros(len(x), int), np.zeros((len(x), 3))
    for k, (a, b, c) in enumerate(points[corners]):
        uv = np.linalg.solve(np.array([b - a, c - a])[:, [0, 2]].T, (x - a)[:, [0, 2]].T).T
        up = (x - a - uv @ np.array([b - a, c - a]))[:, 1]
        on = (uv >= 0).all(axis=1) & (uv.sum(axis=1) <= 1) & (abs(up) < abs(height))
        height[on], face[on], part[on] = up[on], k, np.column_stack([1.0 - uv.sum(axis=1), uv])[on]
    return height, face, part


@pytest.mark.parametrize("frames", [24, pytest.param(180, marks=pytest.mark.slow)])
def test_sand_lies_on_a_cloth_that_sags_as_under_a_static_load(frames):
    """No grain passes. Over the last two swings the cloth sags, on the mean, as one that bears the grains' weights as forces:
    within 8 %, since a heap stiffens what it lies on. Its pins bear the weight of both."""
    from wsim.geometry.triangulate import triangulate_polygons
    scene = load(FOLDER / "sand_on_cloth.usda")
    sim, cloth = Simulation(scene, device="cpu"), scene.things("Cloth")[0]
    corners = triangulate_polygons(cloth.points, cloth.counts, cloth.indices)[0]
    hung, borne = [], []
    for _ in range(frames):
        sim.step()
        hung.append(sim.positions(cloth.path))
        borne.append(np.reshape(sim.reactions("/World/Corners"), (-1, 3)).sum(axis=0)[1])
    x = sim.samples()[0].positions
    height, face, part = places_above(x, hung[-1], corners)
    assert height.min() > 0.004 and not sim.warnings
    if frames > 100:
        mass = 464 * 0.025**3 * 1600.0
        weights = np.zeros(len(cloth.points))
        np.add.at(weights, corners[face], mass / len(x) * part)
        alone = scene.with_objects("MaterialPoints", [])
        alone.force("/World/Weights", cloth, np.arange(len(weights)), (0.0, -9.81, 0.0), weights)
        rest, still = Simulation(alone, device="cpu"), []
        for _ in range(240):
            rest.step()
            still.append(rest.positions(cloth.path)[:, 1])
        still = np.mean(still[-72:], axis=0)
        off = np.mean(hung[-72:], axis=0)[:, 1] - still
        sags = 0.62 - np.mean(hung[-72:], axis=0)[:, 1].min(), 0.62 - still.min()
        assert abs(sags[0] / sags[1] - 1) < 0.08 and np.sqrt(np.mean(off**2)) < 0.05 * sags[1]
        assert abs(np.mean(borne[-72:]) / (9.81 * (mass + sim.plan.model.bodies[0].masses.sum())) - 1) < 0.05
