"""Momentum of sheets that meet, by every solver: linear, and angular where the integrator keeps it; no bounce."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.contact.selfcontact.momentum import meeting, moments
from tests.physics.contact.selfcontact.rig import THIN, crossed, layers, run, solvers
from tests.physics.rigid.touch.touching import Mixed
from wsim.kernels.contact.selfcontact.newton.law import BACK, DEPTH
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Motion, Scene, shapes
from wsim.scene.solid import Bulk


@pytest.mark.parametrize("solver", solvers())
def test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce(solver):
    """At every frame to 1e-6 of what there is. Kinetic energy that is left: that of motion along the sheets, of what turns and
    trembles, a third of what was; BDF2 without more would leave three quarters."""
    sim = run(meeting(0.5, **solver))
    before, _, size, _ = moments(sim)
    kinetic = []
    for _ in range(6):
        sim.step()
        now = moments(sim)
        assert np.abs(now[0] - before).max() < 1e-6 * size
        kinetic.append(sim.indicators()["kinetic_energy"])
    assert crossed(sim) == 0 and max(kinetic[1:]) < 0.4 * sim.model.stack("masses").sum() * 0.5 * (9.0 + 0.25)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("solver", solvers("leapfrog", "newton midpoint"))
def test_angular_momentum_is_kept(solver, friction):
    """To 1e-6 behind the blow, by leapfrog to the way of half a substep while it is read within one; friction has no moment."""
    sim = run(meeting(friction, **solver))
    _, before, _, size = moments(sim)
    for frame in range(6):
        sim.step()
        read = frame == 0 and solver["solver"] == "explicit"
        assert np.abs(moments(sim)[1] - before).max() < (5e-6 if read else 1e-6) * size
    assert sim.plan.integrator == solver["integrator"]


@pytest.mark.parametrize("solver", first_and_slow(solvers("newton", "newton bdf2", "xpbd", "leapfrog")))
def test_a_rigid_body_far_away_changes_nothing_of_what_two_sheets_do(solver):
    """Newton's method balanced the momentum of each sheet with what bodies push it by, and took back what the other sheet had:
    half of the momentum of one sheet came from nowhere, and edges were strained by 14 %. Newton steps end where a row is wrong
    by less than DEPTH of the 2 mm that it keeps, and it takes BACK of that in a substep of 1/600 s: 7e-4 m/s of 8."""
    def met(body: bool):
        scene = layers(2, 8, 0.02, **solver)
        for cloth, speed in zip(scene.cloths, (4.0, -4.0), strict=True):
            cloth.velocities[:, 1] = speed
        if body:
            scene.add(Body("/box", [Collider("/box/shape", Box((0.1, 0.1, 0.1)))], Motion.at_place((50.0, 0.0, 0.0))))
        sim = run(scene)
        before, _, size, _ = moments(sim)
        for _ in range(3):
            sim.step()
            assert np.abs(moments(sim)[0] - before).max() < 1e-6 * size
        return np.stack([sim.velocities(cloth.path) for cloth in scene.cloths])
    left = DEPTH * BACK * 2e-3 * 600.0 if solver["solver"] == "implicit" else 1e-3
    assert np.abs(met(True) - met(False)).max() < left


def struck(**solver) -> Scene:
    """Two sheets without gravity, the upper of which a box strikes from above."""
    scene = layers(2, 8, 0.02, **solver)
    scene.add(Body("/box", [Collider("/box/shape", Box((0.05, 0.05, 0.05)))], Motion.at_place((0.0, 0.09, 0.0)),
                   velocity=(0.0, -4.0, 0.0), spin=(3.0, 1.0, 5.0), mass=0.3))
    return scene


def tied(**solver) -> Scene:
    """A sheet that shares points with the edge of a soft body, beside another that shares none, one that is pinned far away,
    and a box that strikes them."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, **solver)
    points, tets = shapes.block((0.2, 0.1, 0.2), (4, 2, 4))
    points -= points.mean(axis=0)
    scene.soft("/jelly", points, tets, material=Bulk(young=2e4, density=300.0), self_collision=True)
    for k, (name, side, at) in enumerate((("sheet", 4, (-0.2, 0.05, 0.0)), ("above", 7, (-0.17, 0.08, 0.01)),
                                          ("held", 4, (5.0, 0.0, 0.0)))):
        own, counts, indices = shapes.sheet(0.2, 0.2, side, side, horizontal=True)
        own = own - own.mean(axis=0) + at
        scene.cloth(f"/{name}", own, counts, indices, material=THIN, self_collision=k < 2)
    sheet = scene.cloths[0].points
    away = np.linalg.norm(sheet[:, None] - points[None], axis=2)
    shared = np.flatnonzero(away.min(axis=1) < 1e-6)
    scene.tie("/tie", "/sheet", shared, "/jelly", away[shared].argmin(axis=1))
    scene.pin("/pin", "/held", [0])
    scene.add(Body("/box", [Collider("/box/shape", Box((0.05, 0.05, 0.05)))], Motion.at_place((-0.16, 0.17, 0.02)),
                   velocity=(0.0, -4.0, 0.0), spin=(3.0, 1.0, 5.0), mass=0.3))
    return scene


def kept(scene: Scene, frames: int):
    """The run; momentum of points and bodies together stays, at every frame to 1e-6 of what moves. By BDF2, whose velocities
    are sums of two before, and by explicit steps, of which there are more, float32 rounds by 2e-6: float64 is held to
    what sums of pushes round by."""
    bound, precision = (1e-6, "float32") if scene.integrator == "backward_euler" else (1e-10, "float64")
    sim = run(scene, precision=precision)
    before, size = Mixed(sim).momentum, 0.0
    for _ in range(frames):
        sim.step()
        now = Mixed(sim)
        size = max(size, now.moved)
        assert np.abs(now.momentum - before).max() < bound * size
    return sim


@pytest.mark.parametrize("solver", first_and_slow(solvers("newton bdf2", "newton", "xpbd bdf2", "xpbd", "leapfrog", "rk4")))
def test_sheets_and_the_body_that_strikes_them_keep_their_momentum(solver):
    """By BDF2 behind Newton steps a memory had been told of what the body pushed points by before surfaces pushed both: a third
    of what came on top was given once more, 7e-3 of all momentum in three frames."""
    sim = kept(struck(**solver), 4)
    assert crossed(sim) == 0 and sim.velocities("/layer0")[:, 1].min() < -1.0


@pytest.mark.parametrize("solver", first_and_slow(solvers("newton", "newton bdf2", "leapfrog", "rk4")))
def test_what_is_tied_keeps_its_momentum_beside_what_strikes_it(solver):
    """All bodies of a world with a tie counted as held, as points that another stands for have no mass: 1.2e-2 of momentum came
    from steps that were not solved to the end. A cloth that is pinned, and shares nothing, holds none of them."""
    sim = kept(tied(**solver), 6)
    assert not [w for w in sim.warnings if "intersect" in w] and sim.velocities("/above")[:, 1].min() < -1.0


@pytest.mark.parametrize("solver", first_and_slow(solvers("xpbd", "newton")))
def test_a_world_of_sheets_and_the_body_that_strikes_them_ends_as_one_alone(solver):
    """To the bit: the bodies of other worlds, which it never meets, had counted among those that a body meets, and gave it more
    rounds."""
    alone, many = run(struck(**solver)), run(struck(**solver), worlds=2)
    for sim in (alone, many):
        sim.run(3)
    for cloth in alone.model.scene.cloths:
        for world in (0, 1):
            assert np.array_equal(alone.positions(cloth.path), many.positions(cloth.path, world))
    assert alone.velocities("/layer0")[:, 1].min() < -1.0
