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
