"""Surfaces never end a substep with an intersection, keep momentum, and pay nothing for flying together."""

import numpy as np
import pytest

from tests.physics.selfcontact.rig import crossed, crumple, layers, run, said
from tools.draws.scenes import drawn
from wsim.physics.selfcontact import method


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


def test_sheets_that_are_thrown_have_no_intersection_in_any_substep_by_the_midpoint():
    """Which steps to the end, and gains no energy."""
    scene, energy = drawn(8, "newton midpoint"), []
    for sim in by_substep(scene, 5):
        assert crossed(sim) == 0, sim.frame
        energy.append(sum(sim.indicators()[name] for name in ("kinetic_energy", "elastic_energy")))
    told = said(sim)
    assert sim.plan.integrator == "implicit_midpoint" and told["cut"] == told["held"] == 0 < told["near_pairs"]
    assert max(energy) < 1.05 * energy[0]


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


def test_energy_that_cuts_take_is_counted(monkeypatch):
    """Two sheets that fly at each other, with neither contacts nor projections: cuts alone stop them, and take what is lost; of
    one substep more and more of the motion, several running."""
    for name, value in (("SWEEPS", 0), ("LAST", 0), ("LONGER", 0), ("ROUNDS", 0), ("LOSS", 1000)):
        monkeypatch.setattr(method, name, value)
    scene = layers(2, 3, 0.0125, substeps=1, iterations=1)
    scene.fps *= 10.0
    for cloth, sign in zip(scene.cloths, (1.0, -1.0), strict=True):
        cloth.velocities = np.broadcast_to((0.0, 3.0 * sign, 0.0), cloth.points.shape).copy()
    sim = run(scene)
    masses, h = sim.model.stack("masses"), 1.0 / scene.fps
    kinetic = [0.5 * 9.0 * masses.sum()]
    for _ in range(5):
        sim.step()
        kinetic.append(sim.indicators()["kinetic_energy"])
    told, lost = said(sim), -np.diff(kinetic)
    assert crossed(sim) == 0 and told["cut"] > 0 and kinetic[-1] < 0.01 * kinetic[0]
    wanted = np.sum(kinetic[:-1]) * h                                    # motions of a substep are those of the one before
    assert told["cut_energy"] == pytest.approx(lost.sum() / wanted, rel=1e-3)
    assert told["cut_run"] == (lost > 0.1 * np.array(kinetic[:-1])).sum() > 1
