"""Corners and edges of colliders against surfaces: no triangle of a cloth intersects one of a collider, by the exact test on
what a file would hold, where triangles of the cloth are larger than the collider."""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.contact.selfcontact.colliders import SPIKE, crossed, cube, dropped, spike, turning
from tests.physics.contact.selfcontact.rig import THIN, layers, run, said, solvers
from wsim.scene import Box, Motion, Plane, Scene, SceneError
from wsim.scene.curve import Curve


def checked(scene: Scene, frames: int):
    sim = run(scene)
    for _ in range(frames):
        sim.step()
        assert crossed(sim) == 0, (sim.frame, said(sim))
    return sim


def goes(start, end, seconds: float) -> Motion:
    M = np.tile(np.eye(4), (2, 1, 1))
    M[:, :3, 3] = start, end
    return Motion([0.0, seconds], M)


def test_a_spike_pokes_through_without():
    sim = run(dropped(spike(), on=False))
    sim.run(8)                                  # it lands in the seventh
    assert crossed(sim) > 0


@pytest.mark.parametrize("solver", ["xpbd", "explicit", "implicit"])
def test_a_coarse_cloth_lies_on_a_spike(solver):
    sim = checked(dropped(spike(), solver=solver), 10)
    told = said(sim)
    assert told["held"] == told["pinched"] == 0 and told["near_pairs"] > 0
    assert sim.positions("/cloth")[:, 1].max() > 0.1                            # the tip bears it


@pytest.mark.parametrize("shape", [cube(0.05), Box((0.05, 0.05, 0.05))], ids=["mesh", "box"])
def test_an_edge_of_a_cube_stays_below_triangles_larger_than_the_cube(shape):
    sim = checked(dropped(shape, turning(0, 0.0, tilt=np.pi / 4), above=0.12), 10)
    told = said(sim)
    assert told["cut"] == told["pinched"] == 0
    assert sim.positions("/cloth")[:, 1].max() > 0.05


def test_a_spike_that_sweeps_takes_the_cloth_along():
    """Tip at 0.6 m/s, and the far corners at more: it comes from beside and under the cloth."""
    sim = checked(dropped(spike(), turning(2, 4.0, tilt=-1.0)), 16)
    assert said(sim)["held"] == 0


def test_a_mesh_that_grows_lifts_the_cloth():
    times = np.linspace(0.0, 1.0, 9)
    poses = Curve(times, np.array([SPIKE * np.array([1.0, 1.0 + t, 1.0], np.float32) for t in times]))
    sim = checked(dropped(spike(SPIKE, poses)), 24)
    assert sim.positions("/cloth")[:, 1].max() > 0.25 and said(sim)["held"] == 0


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_friction_at_a_tip_is_coulombs(mu):
    """Two triangles fly onto a tip under their middle: all impulse comes from there, mu times as much across as along."""
    scene = dropped(spike(), side=2, above=0.155)
    scene.gravity = (0.0, 0.0, 0.0)
    (cloth,), (collider,) = scene.cloths, scene.colliders
    cloth.points = cloth.points - cloth.points.mean(axis=0) + np.array([0.0, 0.155, 0.0], np.float32)
    cloth.material = replace(THIN, static_friction=mu, dynamic_friction=mu)
    collider.static_friction = collider.dynamic_friction = mu
    cloth.velocities = np.broadcast_to((2.0, -0.5, 0.0), cloth.points.shape).copy()
    sim = run(scene)
    sim.run(1)
    b = sim.model.body("/cloth")
    v = b.masses[b.index - b.first] @ sim.velocities("/cloth") / b.masses.sum()
    assert v[1] > -0.4 and crossed(sim) == 0                                    # has met the tip
    assert abs(v[0] - 2.0 + mu * (v[1] + 0.5)) < 0.02 * (v[1] + 0.5)


@pytest.mark.parametrize("solver", ["xpbd", "explicit", "implicit"])
def test_a_cloth_between_colliders_that_meet_stops_and_goes_on_once_they_part(solver):
    """The upper one comes at 0.8 m/s and meets the lower within 8 frames."""
    scene = dropped(cube(0.1), goes((0.0, -0.11, 0.0), (0.0, -0.11, 0.0), 1.0), above=0.0, solver=solver)
    scene.gravity = (0.0, 0.0, 0.0)
    scene.collider("/over", cube(0.08), motion=goes((0.0, 0.2, 0.0), (0.0, 0.0, 0.0), 0.25))
    sim = run(scene)
    with pytest.raises(SceneError, match=r"/cloth: point \d+ at \(.*\) m is pinched: /under and /over .* frame \d was"):
        sim.run(8)
    begun, before = sim.frame, sim.positions("/cloth")
    assert 2 <= begun < 8 and said(sim)["pinched"] > 0 and crossed(sim) == 0
    with pytest.raises(SceneError, match="pinched"):                            # the same again
        sim.step()
    assert sim.frame == begun and np.array_equal(sim.positions("/cloth"), before)
    sim.set("/over", "motion", scene.colliders[1].motion.at(sim.time))          # it stays where it is
    sim.run(3)
    assert sim.frame == begun + 3 and crossed(sim) == 0


def test_a_spike_through_the_start_is_told_with_its_place():
    sim = run(dropped(spike(), above=0.1))
    sim.run(1)
    (text,) = [w for w in sim.warnings if "intersect where surfaces start" in w]
    assert "/cloth and /under at (" in text


def test_colliders_do_not_meet_each_other():
    scene = dropped(cube(0.05), goes((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), 1.0), above=2.0)
    scene.collider("/too", cube(0.06))
    sim = run(scene)
    sim.run(2)
    assert said(sim)["near_pairs"] == 0 and not sim.warnings


def test_a_cloth_that_falls_far_above_has_frames_without_contacts():
    sim = run(dropped(cube(0.05), above=3.0))
    sim.run(3)
    assert sim.plan.clock.free and said(sim)["near_pairs"] == 0


def test_worlds_meet_a_collider_each_and_alike():
    one, two = run(dropped(spike())), run(dropped(spike()), worlds=2)
    for sim in (one, two):
        sim.run(6)
    assert np.array_equal(two.positions("/cloth", 0), two.positions("/cloth", 1))
    assert np.abs(two.positions("/cloth", 0) - one.positions("/cloth")).max() < 1e-4


def test_what_a_file_holds_of_a_turned_and_far_prim_does_not_intersect():
    """100 m from the origin of its prim, where float32 tells 8 micrometres apart."""
    scene = dropped(spike(), turning(1, 0.0, (-60.0, 0.0, 80.0), tilt=0.4))
    (cloth,) = scene.cloths
    M = turning(1, 0.0, tilt=0.4).at(0.0)
    cloth.points = ((cloth.points + (-60.0, 0.0, 80.0)) @ M[:3, :3]).astype(np.float32)
    cloth.motion = Motion.still(M)
    checked(scene, 10)


@pytest.mark.parametrize("solver", first_and_slow(solvers("newton", "leapfrog", "xpbd bdf2", "newton bdf2", "xpbd", "rk4")))
def test_a_ball_is_thrown_back_as_far_beside_surfaces_that_are_near_each_other(solver):
    """Without weight, by 0.8 of 2 m/s. Sheets that hover elsewhere have their sweeps, before each of which contacts are
    projected again: 0.14, 0.58, 1.28 and 0 m/s were left of 1.6, by Newton's method, leapfrog, XPBD's BDF2 and Newton's."""
    scene = layers(2, 6, 2.2e-3, **solver)
    for cloth in scene.cloths:
        cloth.points[:, 1] += 3.0
    height, speed, e = 0.0503, 2.0, 0.8
    scene.net("/ball", [[1.0, height, 0.0], [2.0, height, 0.0]], [[0, 1]], [100.0], [0.25], static_friction=0.0,
              dynamic_friction=0.0, velocities=[(0.0, -speed, 0.0)] * 2)
    scene.collider("/floor", Plane("Y"), restitution=e, thickness=0.0)
    sim = run(scene, precision="float64")
    sim.run(3)
    assert said(sim)["near_pairs"] > 0 and not sim.plan.clock.free
    np.testing.assert_allclose(sim.velocities("/ball")[:, 1], e * speed, rtol=1e-9)
    np.testing.assert_allclose(sim.positions("/ball")[:, 1], e * (speed * sim.time - height), rtol=1e-9)


@pytest.mark.parametrize("solver", solvers("newton bdf2"))
def test_a_sheet_that_collides_with_itself_is_thrown_back_as_one_that_does_not(solver):
    """By BDF2, whose velocities are settled once more behind the proof: 0.39 m/s were left of 1.6."""
    scene = layers(1, 6, 0.0, **solver)
    scene.cloths[0].points[:, 1] += 0.0503
    scene.cloths[0].velocities[:, 1] = -2.0
    scene.collider("/floor", Plane("Y"), restitution=0.8)
    sim = run(scene, precision="float64")
    sim.run(3)
    np.testing.assert_allclose(sim.velocities()[:, 1], 1.6, rtol=1e-6)
