"""A cloth that is folded in three comes to rest on a floor: calm, touching where it does all the time, and as thick as it is.

Of sheets that lie flat on each other many more pairs are as near than it takes to bear them: which of these push changes with
the last digits, and says nothing. So points are counted, and what is borne by pairs that come and go.
"""

import numpy as np
import pytest

from tests.physics.contact.selfcontact.rig import SOLVERS, crossed, run, said, solvers
from wsim.scene import Pin, Plane, Scene, shapes
from wsim.scene.fabric import Fabric

CALM = 1e-3                              # [m/s]
STEADY = 1e-3                            # of all that pairs push with, by those that push in one of two substeps
CLOTH = Fabric(stretch=60.0, shear=20.0, bend=1e-6, thickness=4e-3, density=100.0)


def folded(**more) -> Scene:
    """A strip that is laid in three, over arcs of a radius of 8 mm, a millimetre above a floor; air that slows it down."""
    length, width, r = 0.21, 0.05, 8e-3
    points, counts, indices = shapes.sheet(length, width, 21, 4, horizontal=True)
    points = np.array(points, np.float64)
    points -= points.min(axis=0)
    arc = np.pi * r
    flat = (length - 2.0 * arc) / 3.0
    u = points[:, 0]
    a, b = (u - flat) / r, (u - 2.0 * flat - arc) / r
    parts = [u < flat, u < flat + arc, u < 2.0 * flat + arc, u < 2.0 * flat + 2.0 * arc]
    points[:, 0] = np.select(parts, [u, flat + r * np.sin(a), 2.0 * flat + arc - u, -r * np.sin(b)], u - 2.0 * (flat + arc))
    points[:, 1] = np.select(parts, [0.0, r - r * np.cos(a), 2.0 * r, 3.0 * r - r * np.cos(b)], 4.0 * r)
    points[:, 1] += 0.5 * CLOTH.thickness + 1e-3
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, air_drag=10.0, **more)
    scene.cloth("/cloth", points, counts, indices, material=CLOTH, self_collision=True)
    scene.collider("/floor", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    return scene


@pytest.mark.parametrize("solver", solvers("xpbd", "xpbd bdf2", "newton", "newton bdf2", "newton midpoint", "leapfrog", "rk4"))
def test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is(solver):
    sim = run(folded(**solver))
    flicker = []
    for _ in range(60):
        sim.step()
        flicker.append(said(sim).get("flicker", 0.0))
    assert max(flicker[:20]) > 0.05                       # while it settles, pairs come and go
    speed, touching, thin, least = [], [], [], []
    for _ in range(6):
        sim.step()
        told = said(sim)
        assert told["flicker"] < STEADY
        speed.append(np.linalg.norm(sim.velocities(), axis=1).max())
        touching.append(told["touching"])
        thin.append(told["thin"])
        least.append(told["least_gap"])
    assert crossed(sim) == 0 and told["cut"] == told["held"] == told["projected"] == 0
    assert max(speed) < CALM, speed
    assert min(touching) > 90 and np.ptp(touching) <= 1, touching                                        # no flicker
    assert max(thin) <= 0.05, thin
    assert 0.5 * CLOTH.thickness < min(least) <= CLOTH.thickness, least


def test_a_folded_cloth_at_rest_on_a_cloth_is_calm_by_the_midpoint():
    """It has no colliders: on a cloth that pins hold. Nothing but friction and air takes what trembles."""
    scene = folded(**SOLVERS["newton midpoint"])
    scene.colliders.clear()
    points, counts, indices = shapes.sheet(0.16, 0.1, 16, 10, horizontal=True)
    own = scene.cloths[0].points
    middle = 0.5 * (own.min(axis=0) + own.max(axis=0)) - np.mean(points, axis=0)
    scene.cloth("/under", points + (middle[0], -0.5 * CLOTH.thickness, middle[2]), counts, indices, material=CLOTH,
                self_collision=True)
    scene.pins.append(Pin("/pin", "/under", range(len(points) - 1)))
    sim = run(scene)
    sim.run(75)
    touching = []
    for _ in range(6):
        before = sim.positions("/cloth")
        sim.step()
        v, told = sim.velocities("/cloth"), said(sim)
        assert told["flicker"] < STEADY
        touching.append(told["touching"])
        assert np.linalg.norm(v, axis=1).max() < CALM
        assert np.linalg.norm(v - 60.0 * (sim.positions("/cloth") - before), axis=1).max() < 0.5 * CALM
        assert told["thin"] <= 0.05 and 0.5 * CLOTH.thickness < told["least_gap"] <= CLOTH.thickness
    assert crossed(sim) == 0 and told["cut"] == told["held"] == told["projected"] == 0
    assert min(touching) > 90 and np.ptp(touching) <= 1                                                  # no flicker
    assert sim.plan.integrator == "implicit_midpoint"


def test_a_folded_cloth_at_rest_is_not_read_as_falling_by_rk4():
    """Contacts give half of a lasting force's velocity: without the other half its centre is read at g h / 2, 2 mm/s."""
    solver = SOLVERS["rk4"]
    sim = run(folded(**solver))
    sim.run(60)
    fall = 9.81 / 60.0 / solver["substeps"] / 2.0
    for _ in range(6):
        before = sim.positions().copy()
        sim.step()
        v = sim.velocities()
        assert np.linalg.norm(60.0 * (sim.positions() - before), axis=1).max() < CALM
        assert np.abs(v.mean(axis=0)[1]) < 0.02 * fall and np.abs(v[:, 1]).max() < CALM
    assert crossed(sim) == 0
