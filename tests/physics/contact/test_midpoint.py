"""Colliders by the implicit midpoint: blows, friction, what surfaces carry, and the work that contacts do.

A mass is one end of a spring of 1e-9 N/m whose other end is far away: it moves as a free point."""

import numpy as np
import pytest

from tests.make.physics.contact.midpoint import G, draped, fallen, mass
from tests.make.physics.contact.restitution import ball, bounced, run
from tests.physics.contact.selfcontact.rig import THIN, crossed, said
from wsim.scene import Box, Plane, SceneError, Sphere
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("solver", ["implicit", "xpbd"])
def test_three_bounces_follow_the_parabolas_to_rounding(solver):
    sim, found = run(ball(v=(0.3, 0.25, 0.0), solver=solver, integrator="implicit_midpoint", iterations=2), 118)
    exact = np.array([bounced((k + 1) / 60, 1.0, 0.25, 0.8) for k in range(118)])
    assert exact[-1, 2] == 3 and sim.plan.integrator == "implicit_midpoint"
    np.testing.assert_allclose(found, exact[:, :2], atol=1e-12)


@pytest.mark.parametrize("solver", ["implicit", "xpbd"])
def test_a_blow_without_restitution_leaves_no_speed_at_once(solver):
    _, found = run(ball(e=0.0, v=(0.3, 0.25, 0.0), solver=solver, integrator="implicit_midpoint", iterations=2), 60)
    hit = int(np.argmax(found[:, 0] < 1e-12))
    assert 25 < hit < 35 and found[hit - 1, 1] < -4.0
    np.testing.assert_allclose(found[hit:], 0.0, atol=1e-12)


def test_what_rides_on_an_accelerating_lift_has_its_velocity_and_slips_at_the_critical_force():
    """Of what rides the floor bears g + a; were the mean velocity of a step that at its end, g + 2 a."""
    a, friction, keys = 5.0, 0.5, np.linspace(0.0, 2.0, 201)
    places = np.zeros((201, 3))
    places[:, 1] = 0.5 * a * keys**2 - 1.0
    lift, found = Motion.through(keys, places, np.tile([0.0, 0.0, 0.0, 1.0], (201, 1))), {}
    for part in (0.99, 1.01):
        scene = mass((0.0, 0.0, 0.0), shape=Box((2.0, 1.0, 2.0)), motion=lift, friction=friction)
        scene.gravity = (part * friction * (G + a), -G, 0.0)
        sim = Simulation(scene, device="cpu", precision="float64")
        sim.run(60)
        x, v = sim.positions()[0], sim.velocities()[0]
        assert x[1] == pytest.approx(0.5 * a, abs=1e-12) and v[1] == pytest.approx(a, abs=1e-10)
        found[part] = x[0], v[0]
    assert found[0.99][0] < 5e-4 and abs(found[0.99][1]) < 1e-12             # the first substeps know no acceleration yet
    assert found[1.01][1] == pytest.approx(0.01 * friction * (G + a), rel=0.12)


def test_what_lies_on_a_turntable_slips_where_friction_no_longer_turns_it():
    """Spun up with alpha: (w^2 r)^2 + (alpha r)^2 = (mu g)^2. Half of that w^2 would be the force of a doubled velocity."""
    alpha, r, friction, keys = 2.0, 0.5, 0.3, np.linspace(0.0, 3.0, 301)
    half = 0.25 * alpha * keys**2
    turns = np.stack([0.0 * half, np.sin(half), 0.0 * half, np.cos(half)], axis=1)
    scene = mass((r, 0.0, 0.0), shape=Box((2.0, 1.0, 2.0)), friction=friction,
                 motion=Motion.through(keys, np.tile([0.0, -1.0, 0.0], (301, 1)), turns))
    sim, slips = Simulation(scene, device="cpu", precision="float64"), []
    while not slips:
        sim.step()
        x = sim.positions()[0]
        if abs(np.hypot(x[0], x[2]) - r) > 1e-4:
            slips.append(sim.time)
    assert slips[0] == pytest.approx(((friction * G)**2 - (alpha * r)**2)**0.25 / (r**0.5 * alpha), rel=0.05)


def test_what_slides_on_a_ball_keeps_its_energy_to_first_order():
    errors = []
    for substeps in (10, 20, 40):
        sim = Simulation(mass((np.sin(0.2), np.cos(0.2), 0.0), shape=Sphere(1.0), motion=Motion.still(), substeps=substeps),
                         device="cpu", precision="float64")
        sim.run(30)
        x, v = sim.positions()[0], sim.velocities()[0]
        assert np.linalg.norm(x) == pytest.approx(1.0, abs=2e-4 / substeps)
        errors.append(0.5 * v @ v + G * (x[1] - np.cos(0.2)))
    assert -2e-3 < errors[0] < errors[1] < errors[2] < 0.0                   # of 1 J/kg; lost, not gained
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, atol=0.05)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_contacts_do_no_work_and_what_they_throw_back_is_taken(friction):
    """In every substep of a steep sheet that falls on a floor: J . (d - e) is not positive, nor what impulses do to the kinetic
    energy. With friction, of which they give a part back, both together; but what stuck by a push of which half is taken back
    slides off before the sheet has moved, so that one substep gains a thousandth of what contacts take in 12 frames."""
    scene = draped(Plane("Y"), 12, friction)
    cloth, angle = scene.cloths[0], 0.9
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    cloth.points[:] = cloth.points @ turn.T
    cloth.points[:, 1] += -cloth.points[:, 1].min() - 0.11
    cloth.velocities = np.tile([0.5, -2.0, 0.0], (len(cloth.points), 1))
    sim = Simulation(scene, device="cpu", precision="float64")
    contact, mass_of, found = sim.plan.method("contact"), np.concatenate([b.masses for b in sim.model.bodies]), []
    own, contacts, n = contact.prolonged, contact.contacts, sim.model.points
    even = own.even

    def kinetic(v) -> float:
        return float(0.5 * (mass_of * (v.numpy()**2).sum(axis=1)).sum())

    def looked(v) -> None:
        J = (own.rest.numpy() + contacts.push.numpy() / sim.plan.clock.h).reshape(-1, n, 3)
        J[np.arange(len(J))[:, None] >= contacts.slots.count.numpy()] = 0.0
        way, before = sim.state.d.numpy() - sim.state.e.numpy(), kinetic(v)
        even(v)
        found.append((float((mass_of * (J.sum(axis=0) * way).sum(axis=1)).sum()), kinetic(v) - before))
    own.even = looked
    for _ in range(12):                                                      # launch by launch
        sim.plan.clock.free = False
        sim.plan.before_frame(sim.time)
        sim.plan.frame()
        sim.plan.clock.starting = False
        sim.frame += 1
    work, taken = np.array(found).T
    assert work.min() < -1e-9 and taken.min() < -1e-6
    assert work.max() < 1e-9 * -work.sum() and (work + taken).max() < (1e-3 if friction else 1e-9) * -taken.sum()
    assert friction or taken.max() < 1e-9 * -taken.sum()


@pytest.mark.parametrize("iterations", [3, 6])
def test_a_sheet_falls_on_a_ball_and_slides_down_without_giving_way(iterations):
    """By 20 substeps: where folds spring open, 10 add to its energy what the run rightly warns of."""
    sim = Simulation(draped(Sphere(0.1), iterations=iterations, substeps=20), device="cpu")
    sim.run(30)
    assert sim.plan.integrator == "implicit_midpoint" and not sim.warnings
    assert sim.plan.method("contact").indicators(None, None)["penetration"] < 1e-6


def test_layers_fall_on_a_floor_and_never_intersect():
    """By 12 iterations: with 6, frame 5 misses the residual that the midpoint needs, and says so."""
    sim = Simulation(fallen(iterations=12), device="cpu")
    for _ in range(15):
        sim.step()
        told = said(sim)
        assert crossed(sim) == told["cut"] == told["held"] == 0
    assert sim.plan.integrator == "implicit_midpoint" and told["touching"] > 150 and told["thin"] == 0.0
    assert told["least_gap"] > 0.9 * THIN.thickness
    low = sim.positions("/layer0")
    assert np.abs(low[:, 1] - 0.5 * THIN.thickness).max() < 1e-6 and np.abs(sim.velocities("/layer0")).max() < 1e-6


def test_a_smoothed_contact_is_refused_with_its_mend():
    scene = draped(Sphere(0.1), solver="xpbd", contact_width=1e-3)
    with pytest.raises(SceneError, match="contact_width is 0.001 m, and integrator implicit_midpoint has hard contacts"):
        Simulation(scene, device="cpu")
