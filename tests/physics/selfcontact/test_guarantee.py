"""Surfaces never end a substep with an intersection, keep momentum, and pay nothing for flying together."""

import numpy as np
import pytest

from tests.physics.selfcontact.rig import crossed, crumple, layers, run, said


def by_substep(scene, frames: int):
    """The simulation, with frames of one substep each, after so many of its own frames."""
    scene.fps, scene.substeps, steps = scene.fps * scene.substeps, 1, frames * scene.substeps
    sim = run(scene)
    for _ in range(steps):
        sim.step()
        yield sim


@pytest.mark.parametrize("seed", range(2))
def test_a_crumpled_sheet_has_no_intersection_in_any_substep(seed):
    for sim in by_substep(crumple(seed), 4):
        assert crossed(sim) == 0, sim.frame
    assert said(sim)["held"] == 0


def test_the_same_sheet_passes_through_itself_without():
    scene = crumple(0)
    scene.cloths[0].self_collision = False
    sim = run(scene)
    sim.run(4)
    assert crossed(sim) > 0


def test_layers_that_fly_and_turn_together_are_not_touched():
    """Twelve layers 3 mm apart, 2 mm thick, at 20 m/s: nothing is pushed, projected or cut, and they go as without."""
    places = []
    for on in (True, False):
        sim = run(layers(12, 8, 3e-3, velocity=(20.0, 0.0, 0.0), spin=5.0, on=on))
        sim.run(8)
        places.append(np.concatenate([sim.positions(b.path) for b in sim.model.bodies]))
        if on:
            told = said(sim)
    assert told["projected"] == told["cut"] == told["held"] == 0 and told["near_pairs"] > 0
    assert np.abs(places[0] - places[1]).max() == 0.0
    assert told["searches"] <= 3


def test_results_are_the_same_from_run_to_run():
    found = []
    for _ in range(2):
        sim = run(crumple(1))
        sim.run(3)
        found.append(sim.positions("/sheet"))
    assert np.array_equal(*found)
