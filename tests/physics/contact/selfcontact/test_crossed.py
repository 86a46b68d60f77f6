"""Starts that intersect: surfaces go on as they are, crossed, finite and without energy of their own, by every solver."""

import numpy as np
import pytest

from tests.physics.contact.selfcontact.rig import THIN, crossed, run, said, solvers
from wsim.scene import Scene, Surface, shapes


def energy(sim) -> float:
    """Kinetic energy [J]."""
    return sum(0.5 * float(b.masses[b.index - b.first] @ (sim.velocities(b.path) ** 2).sum(axis=1)) for b in sim.model.bodies)


def folded_through(found: Scene) -> None:
    """A square, one half of which is folded back through the other."""
    points, counts, indices = shapes.sheet(0.4, 0.4, 16, 16, horizontal=True)
    x, points = points[:, 0].copy(), np.array(points)
    flat = points.copy()
    points[:, 0], points[:, 1] = np.where(x > 0.0, -0.9 * x, x), np.where(x > 0.0, 0.02 - 0.2 * x, 0.0)
    found.cloth("/fold", points, counts, indices, material=THIN, self_collision=True, rest_points=flat)


def crossing(found: Scene) -> None:
    """Two squares; rows of one lie in the plane of the other."""
    for k, (horizontal, at) in enumerate(((True, (0.0, 0.0, 0.0)), (False, (0.01, 0.0, 0.013)))):
        points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8, horizontal=horizontal, at=at)
        found.cloth(f"/cloth{k}", points, counts, indices, material=THIN, self_collision=True)


def around(found: Scene) -> None:
    """A square through a mesh collider that stands still."""
    points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8, horizontal=True, at=(0.01, 0.013, 0.01))
    found.cloth("/cloth", points, counts, indices, material=THIN, self_collision=True)
    ball, counts, indices = shapes.sphere(0.08, 8)
    found.collider("/ball", Surface(np.array(ball, np.float32), counts, indices))


def through_jelly(found: Scene) -> None:
    points, tets = shapes.block((0.2, 0.2, 0.2), (3, 3, 3))
    found.soft("/jelly", points, tets, self_collision=True)
    points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8, horizontal=True, at=(0.01, 0.013, 0.01))
    found.cloth("/cloth", points, counts, indices, material=THIN, self_collision=True)


@pytest.mark.parametrize("solver", solvers())
def test_surfaces_that_start_crossed_fall_freely_and_gain_no_energy(solver):
    """Nothing else acts: their middle falls as all bodies do, and what they move beside it is a thousandth of what it takes to
    lift them by their thickness."""
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, **solver)
    crossing(scene)
    sim = run(scene)
    sim.run(8)
    masses = np.concatenate([b.masses[b.index - b.first] for b in sim.model.bodies])
    v = np.concatenate([sim.velocities(b.path) for b in sim.model.bodies])
    mean = masses @ v / masses.sum()
    assert abs(mean[1] + 9.81 * 8 / 60) < 0.02 and np.abs(mean[[0, 2]]).max() < 1e-3
    beside = 0.5 * float(masses @ ((v - mean) ** 2).sum(axis=1))
    assert beside < 1e-3 * (9.81 * masses.sum() * THIN.thickness), beside
    assert said(sim)["held"] == 0


@pytest.mark.parametrize("solver", solvers("xpbd", "newton"))
def test_a_cloth_folded_through_itself_goes_on_calmly(solver):
    """What its shape at rest and its bends store moves it, at well under the 0.5 m/s at which thicknesses part; millijoules."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, **solver)
    folded_through(scene)
    sim = run(scene)
    for _ in range(8):
        sim.step()
        assert energy(sim) < 1e-3
    assert said(sim)["held"] == 0 and energy(sim) > 0.0


@pytest.mark.parametrize("solver", solvers("newton", "leapfrog"))
def test_a_cloth_through_a_soft_body_stays_calm(solver):
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, **solver)
    through_jelly(scene)
    sim = run(scene)
    sim.run(6)
    assert energy(sim) < 1e-5 and [w for w in sim.warnings if "/cloth and /jelly at (" in w]


def test_leapfrog_holds_a_cloth_that_a_collider_starts_inside_of():
    """It stays stretched over the ball, which it cannot leave, and passes through itself in no frame; nothing grows."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, solver="explicit", integrator="leapfrog", substeps=40)
    around(scene)
    sim = run(scene)
    for _ in range(8):
        sim.step()
        assert crossed(sim) == 0 and np.linalg.norm(sim.velocities(), axis=1).max() < 20.0
    told = said(sim)
    assert told["projected"] > 0 == told["cut"] == told["held"] == told["pinched"]
    assert [w for w in sim.warnings if "/cloth and /ball at (" in w]


@pytest.mark.parametrize("solver", solvers("xpbd", "newton"))
def test_a_collider_that_starts_inside_a_cloth_throws_nothing(solver):
    """Points are pushed out at 0.5 m/s, and their neighbours are taken along."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, **solver)
    around(scene)
    sim = run(scene)
    speed = 0.0
    for _ in range(8):
        sim.step()
        speed = max(speed, np.linalg.norm(sim.velocities(), axis=1).max())
    assert speed < 4.0 and [w for w in sim.warnings if "/cloth and /ball at (" in w]
