"""Gradients through contacts with friction: exact for the scheme that ran, away from kinks. Differences take steps of 1e-8 m,
so short that no list and no branch changes; they are right to about 1e-7 then."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.gradient.gradients import Run
from tests.make.physics.contact.project_adjoint import SHAPES, SOLVERS, Slid, dropped
from wsim.physics.contact.barrier import contact_energy_scale
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("shape, solver", [*((shape, "leapfrog") for shape in SHAPES), ("sphere", "xpbd"), ("box", "xpbd")])
def test_a_sheet_that_falls_on_a_turning_collider_and_slides(shape, solver):
    run = Slid(dropped(shape, spin=3.0, **SOLVERS[solver]), frames=4)
    plain = run.plain()
    plain.run(4)
    assert plain.indicators()["contacts"] >= 1
    assert any("contacts of edges have no derivative" in w for w in run.sim.warnings) == (shape in ("box", "cylinder", "cone"))
    assert np.abs(plain.positions() - run.recording.positions(4)).max() < 1e-11
    within = 5e-5 if (shape, solver) == ("box", "leapfrog") else 3e-7     # at its edges sweeps end after so many steps, or one
    run.by("positions", 1e-8, within)                                     # more: a ragged function, right to 1e-4 of the way
    run.by("velocities", 1e-6, within)
    g, way = np.asarray(run.scene.gravity), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.gravity() @ way, lambda s: ("/", "gravity", g + s * way), 1e-5, within)


def test_a_sheet_that_starts_in_an_overlap():
    """It is carried out, without velocity, by what is left at most of the overlap."""
    run = Slid(dropped(gap=-0.0031, **SOLVERS["xpbd"]), frames=2)
    run.by("positions", 1e-8)
    run.by("velocities", 1e-6)


@pytest.mark.parametrize("more", [{"spin": 3.0}, {"gap": -0.0031}])
def test_bdf2_forgets_what_was_before_a_contact(more):
    """Along the normals of contacts; of points that are carried out of an overlap altogether."""
    run = Slid(dropped(**more, solver="xpbd", integrator="bdf2", substeps=8, iterations=12), frames=3)
    plain = run.plain()
    plain.run(3)
    assert plain.plan.integrator == "bdf2" and plain.indicators()["contacts"] >= 1
    assert np.abs(plain.positions() - run.recording.positions(3)).max() < 1e-11
    run.by("positions", 1e-8)
    run.by("velocities", 1e-6)


def test_checkpoints_find_the_same_contacts_again():
    kept, again = (Run(dropped(spin=3.0, **SOLVERS["leapfrog"]), frames=4, keep=keep) for keep in ("all", "checkpoints"))
    assert again.recording.bytes < 0.5 * kept.recording.bytes
    for name in ("positions", "velocities", "masses"):
        a, b = (getattr(run.gradient, name)() for run in (kept, again))
        assert np.abs(a - b).max() < 1e-12 * np.abs(a).max()


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_smoothed_contact_has_no_kink_where_it_begins(solver):
    """Differences may take steps that are ten times as long, across the place where a hard contact begins."""
    scene = dropped("sphere", spin=3.0, friction=(0.0, 0.0), **SOLVERS[solver])
    scene.contact_width = 1e-3
    run = Slid(scene, frames=3)
    run.by("positions", 1e-7)
    run.by("velocities", 1e-5)


def test_a_sheet_rests_where_the_potential_bears_it():
    """So far in that 3 E s^2 / w^3 = g, whatever the substep."""
    scene = dropped(friction=(0.0, 0.0), gap=-0.0005, **SOLVERS["xpbd"] | {"iterations": 40})
    scene.colliders[0].motion = Motion.at_place((0.0, 0.0, -0.0005))
    scene.gravity, scene.contact_width, scene.cloths[0].points[:, 2] = (0.0, 0.0, -9.8), 2e-4, 0.0
    scene.cloths[0].rest_points = scene.cloths[0].points.copy()
    for substeps in (2, 6):
        sim = Simulation(replace(scene, substeps=substeps), device="cpu", precision="float64")
        sim.run(60)
        gap = sim.positions()[:, 2] - (-0.0005) - scene.cloths[0].material.thickness / 2
        assert gap == pytest.approx(-2e-4 * np.sqrt(9.8 * 2e-4 / (3.0 * contact_energy_scale(scene))), rel=1e-3)
