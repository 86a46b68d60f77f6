"""A cloth that is folded in three comes to rest on a floor: calm, touching where it does all the time, and as thick as it is.

Of sheets that lie flat on each other many more pairs are as near than it takes to bear them: which of these push changes with
the last digits, and says nothing. So points are counted, and what is borne by pairs that come and go.
"""

import numpy as np
import pytest

from tests.make.physics.contact.selfcontact.rest import CLOTH, folded
from tests.physics.contact.selfcontact.rig import SOLVERS, crossed, run, said, solvers
from wsim.scene import Pin, shapes

CALM = 1e-3                              # [m/s]
STEADY = 1e-3                            # of all that pairs push with, by those that push in one of two substeps




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
