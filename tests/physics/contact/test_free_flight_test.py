"""Frames without contacts: the bits of a scene without colliders, or of contacts that find nothing; and none is missed.

A sheet is a net of 6 x 6 points, or a cloth, 1 m wide; z is up. `held` steps the same scene with contacts in every frame.
"""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.free_flight_test import CPU, FORMS, LEAPS, MARCH, WHOLE, G, rising, sheet, state, swelling
from wsim.geometry.rotation import axis_rotation_matrix, unit_quat
from wsim.model.launches import KernelLaunches
from wsim.model.stage import FREE
from wsim.physics.contact import free_flight_test
from wsim.scene import Box, Capsule, Plane, Scene, Sphere, Surface, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation.report import report_text
from wsim.simulation.simulation import Simulation

forms = pytest.mark.parametrize("form", FORMS)


@pytest.fixture
def held(monkeypatch):
    """Builds a simulation of which every frame has contacts."""
    def build(scene: Scene, **more) -> Simulation:
        with monkeypatch.context() as m:
            m.setattr(free_flight_test, "allows_free_flight", lambda *_: False)
            return Simulation(scene, **(CPU | more))
    return build


# nothing near

@pytest.mark.parametrize(("form", "shape", "precision"), [
    ("march", Sphere(0.5), "float32"), ("march", Surface(*shapes.sphere(0.5, 8)), "float64"), ("march", Plane(), "float64"),
    ("leaps", Sphere(0.5), "float32"), ("leaps", Plane(), "float64"), ("stages", Plane(), "float64")])
def test_a_far_collider_leaves_explicit_steps_their_bits(form, shape, precision):
    alone, far = (Simulation(sheet(s, **FORMS[form]), device="cpu", precision=precision) for s in (None, shape))
    for sim in (alone, far):
        sim.run(12)
    assert far.forms == {"free": 12, "met": 0, "repeated": 0} and np.array_equal(state(alone), state(far))
    assert np.abs(far.positions()[:, 2]).max() > 0.1                           # it has moved


@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
@pytest.mark.parametrize("form", ["xpbd", "newton"])
def test_implicit_steps_have_the_bits_of_contacts_that_find_nothing(form, integrator, held):
    scene = sheet(Sphere(0.5), integrator=integrator, **FORMS[form] | {"iterations": 8})
    free, met = Simulation(scene, **CPU), held(scene)
    for sim in (free, met):
        sim.run(6)
    assert free.forms["free"] == 6 and met.forms["free"] == 0 and np.array_equal(state(free), state(met))
    names = {r["name"] for r in free.plan.table(FREE)}
    assert "stray" in names and not {"contacts", "find contacts"} & names


def test_wind_within_substeps_leaves_them_their_form_without_contacts(held, monkeypatch):
    """Launch by launch; a CPU that takes them in one launch has the form with contacts alone."""
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    scene = sheet(Sphere(0.5), **LEAPS)
    scene.cloths[0] = replace(scene.cloths[0], drag=1.0, lift=0.5)
    free, met = Simulation(scene, **CPU), held(scene)
    for sim in (free, met):
        sim.run(6)
    assert free.forms["free"] == 6 and np.array_equal(state(free), state(met))
    assert any(s.name == "correct" for s in free.plan.stages("finish", "substep"))


def test_a_scene_without_colliders_knows_nothing_of_it():
    sim = Simulation(sheet(**MARCH), **CPU)
    assert free_flight_test.REACHED not in sim.plan.status.places and not sim.plan.parted and "forms" not in sim.report()


def test_what_cannot_be_without_contacts_has_them_in_every_frame():
    always = [sheet(Sphere(0.5), **MARCH) for _ in range(2)]
    always[0].colliders[0] = replace(always[0].colliders[0], restitution=0.5)
    for k in range(64):
        always[1].collider(f"/c{k}", Sphere(0.01), at=(0.1 * k, 0.0, -20.0))
    for scene in always:
        assert not Simulation(scene, **CPU).plan.parted
    assert not Simulation(sheet(Sphere(0.5), **MARCH), gradients=True, **CPU).plan.parted


# one that is met

@forms
def test_a_sheet_falls_on_a_floor_as_with_contacts_throughout(form, held):
    """Explicit steps differ by rounding (float64), others not at all."""
    scene = sheet(Plane(), at=(0.0, 0.0, 0.0), height=0.3, pinned=False, **FORMS[form])
    free, met = Simulation(scene, **CPU), held(scene)
    for sim in (free, met):
        sim.run(24)
    assert free.forms["repeated"] <= 1 and free.forms["free"] >= 5 and free.forms["met"] >= 5      # it is seen to come
    assert free.forms["repeated"] <= 3                                        # it stays with contacts once it has met
    assert np.abs(free.positions() - met.positions()).max() <= (1e-9 if form in WHOLE else 0.0)
    assert free.positions()[:, 2].min() >= 0.0 and free.indicators()["penetration"] == 0.0


@forms
def test_a_floor_is_met_from_where_the_fall_of_a_frame_reaches(form):
    """A sheet falls freely by g dt^2 / 2 in a frame of explicit steps, implicit ones of n substeps add 1 / n of that; and look
    ahead by another predicted displacement, g dt^2 / n, as rk4 does by all of the fall. Two skins and what the floor and the
    sheet keep stand between; rounding is given 1e-5 of a meter."""
    fall = 0.5 * G / 3600.0

    def free(height: float) -> bool:
        sim = Simulation(sheet(Plane(), at=(0.0, 0.0, 0.0), height=height, pinned=False, **FORMS[form]), **CPU)
        sim.step()
        return sim.forms["free"] == 1
    probe = Simulation(sheet(Plane(), at=(0.0, 0.0, 0.0), height=1.0, **FORMS[form]), **CPU)
    probe.step()
    room = probe.plan.method("contact").clearance.room.numpy()
    kept = 1.0 - room[room < 1e3].min()
    assert 4e-3 <= kept < 8e-3
    n = probe.plan.clock.substeps
    least, most = {"march": (1.0, 1.0), "leaps": (1.0, 1.0), "stages": (2.0, 2.0)}.get(form, (1.0 + 1.0 / n, 1.0 + 4.0 / n))
    assert free(kept + 1.01 * most * fall) and not free(kept + 0.95 * least * fall)


@forms
def test_what_is_through_a_thin_wall_within_a_frame_is_caught(form, held):
    """100 m/s: 1.7 m a frame, through a wall of 2 mm; more than a substep, whose positions are all far from it."""
    scene = sheet(Box((5.0, 5.0, 1e-3)), at=(0.0, 0.0, -0.9), velocity=(0.0, 0.0, -100.0), pinned=False, **FORMS[form])
    sim, met = Simulation(scene, **CPU), held(scene)
    assert abs(-0.9 % (100.0 / 60.0 / sim.plan.clock.substeps)) > 2e-3
    for s in (sim, met):
        s.step()
    assert sim.forms == {"free": 0, "met": 1, "repeated": 1} and sim.positions()[:, 2].min() > -0.9
    assert np.array_equal(state(sim), state(met))


@pytest.mark.parametrize(("form", "down", "repeated"), [("march", 0.0, 0), ("march", 0.1, 1), ("xpbd", 0.1, 0)])
def test_a_ball_that_comes_steadily_is_met_without_repeating_a_frame(form, down, repeated, held):
    """At 1.2 m/s, 2 cm a frame, it lifts a sheet that was at rest by 5 cm, and goes; as with contacts throughout."""
    way = Motion.through([0.0, 0.5, 1.0], [(0.0, 0.0, -0.75), (0.0, 0.0, -0.15), (0.0, 0.0, -0.75)], kind="linear")
    scene = sheet(Sphere(0.2), motion=way, velocity=(0.0, 0.0, -down), **FORMS[form] | {"gravity": (0.0, 0.0, 0.0)})
    sim, met = Simulation(scene, **CPU), held(scene)
    for each in (sim, met):
        each.run(60)
    assert sim.forms["repeated"] <= repeated and sim.forms["free"] >= 20 and sim.forms["met"] >= 5
    assert np.abs(sim.positions() - met.positions()).max() < 1e-9


@pytest.mark.parametrize("form", ["march", "leaps", "stages"])
def test_what_is_in_and_out_of_reach_within_a_frame_is_caught(form):
    """A mass on a spring passes a wall, and is back above it where the frame of 1 s ends."""
    k, mass = (2.0 * np.pi)**2, 0.5

    def run(shape):
        named = {name: value for name, value in FORMS[form].items() if name != "cloth"}
        scene = Scene(fps=1.0, substeps=256, gravity=(0.0, 0.0, 0.0), up="Z", **named)
        if form == "leaps":                        # a cloth with bending far away: elements, and so launches of their own
            scene.cloth("/far", *shapes.sheet(1.0, 1.0, 2, 2, up="Z"), motion=Motion.at_place((50.0, 0.0, 0.0)),
                        material=Fabric(stretch=1.0))
        net = scene.net("/mass", [[0, 0, 0], [0, 0, 2]], [[0, 1]], [k], [mass], lengths=[1.5])
        scene.pin("/pin", net, [0])
        if shape:
            scene.collider("/wall", shape, at=(0.0, 0.0, 1.5))
        sim = Simulation(scene, **CPU)
        sim.step()
        return sim
    period = 2.0 * np.pi * (mass / k)**0.5
    assert 1.0 / period == pytest.approx(2.0**0.5)                         # it is at 1.5 + 0.5 cos(2 pi t / period)
    alone, wall = run(None), run(Box((1.0, 1.0, 0.01)))
    assert alone.positions("/mass")[1, 2] == pytest.approx(1.5 + 0.5 * np.cos(2.0 * np.pi / period), abs=1e-3)
    assert wall.forms["repeated"] == 1
    assert abs(wall.positions("/mass")[1, 2] - alone.positions("/mass")[1, 2]) > 0.05


def passing(shape, there, middle, turn=0.0) -> tuple:
    """A collider that is at `there` [m] and comes by `middle` within a frame of 0.1 s, back by its end."""
    keys = np.tile(np.eye(4), (3, 1, 1))
    keys[:, :3, 3] = there, middle, there
    keys[1, :3, :3] = axis_rotation_matrix(np.array([1.0, 0.0, 0.0]), turn)
    return shape, Motion(np.array([0.2, 0.25, 0.3]), keys)


BALL = passing(Sphere(0.3), (0.0, 0.0, -3.0), (0.0, 0.0, -0.1))
MESH = passing(Surface(*shapes.sphere(0.3, 8)), (0.0, 0.0, -3.0), (0.0, 0.0, -0.1))
SWING = passing(Capsule(0.05, 3.0), (0.0, 2.0, -2.0), (0.0, 2.0, -2.0), np.pi / 4)
FLOOR = passing(Plane(), (0.0, 0.0, -0.5), (0.0, 0.0, 0.2))
TILT = passing(Plane(), (0.0, 3.0, -1.0), (0.0, 3.0, -1.0), -0.4)


@pytest.mark.parametrize(("form", "by"), [("march", BALL), ("march", MESH), ("march", SWING), ("march", FLOOR), ("march", TILT),
                                          ("leaps", FLOOR), ("stages", BALL), ("xpbd", SWING), ("newton", BALL)])
def test_a_collider_that_comes_by_within_a_frame_is_met(form, by, held):
    scene = sheet(by[0], motion=by[1], fps=10.0, gravity=(0.0, 0.0, 0.0), **FORMS[form] | {"substeps": 50})
    sim, met, seen = Simulation(scene, **CPU), held(scene), []
    for _ in range(4):
        sim.step()
        met.step()
        seen.append(sim.plan.clock.free)
    assert seen[:3] == [True, True, False]
    assert np.abs(met.velocities()).max() > 0.1 and np.abs(sim.positions() - met.positions()).max() < 1e-9


# what a clearance promises

def turning(rng, kind="linear", slower=1.0, **how) -> Motion:
    turns = rng.normal(size=(4, 4)) * 0.01 + np.array([0.0, 0.0, 0.0, 1.0])
    return Motion.through(slower * np.array(KEYS), rng.uniform(-0.5, 0.5, (4, 3)), unit_quat(turns), kind, **how)


KEYS = [0.0, 0.004, 0.01, 0.02]
OFF = (shapes.sphere(0.3, 8)[0] + np.float32([0.2, 0.0, 0.1]), *shapes.sphere(0.3, 8)[1:])      # its origin is aside
FOUND = [(Sphere(0.4), {}), (Box((0.2, 0.5, 0.3)), {}), (Capsule(0.1, 0.6), {}), (Surface(*OFF), {}),
         (swelling(0.3, 0.1, KEYS), {}), (Box((0.2, 0.5, 0.3)), {"kind": "catmull_rom", "slower": 4.0}),
         (Capsule(0.1, 0.6), {"kind": "eased", "easing": "elastic-out"})]


@pytest.mark.parametrize("seed", range(len(FOUND)))
def test_no_search_finds_a_contact_of_points_within_their_clearance(seed):
    """Of many points and steps about colliders that turn and wander, where |x - x0| + 2 |d| is all of the clearance."""
    rng, (shape, how) = np.random.default_rng(seed), FOUND[seed]
    scene = Scene(fps=60.0, substeps=5, solver="xpbd", gravity=(0.0, 0.0, 0.0), up="Z")
    n = 4000
    scene.net("/points", rng.uniform(-8.0, 8.0, (n, 3)), np.arange(n).reshape(-1, 2), [1.0], [1.0], radius=1e-3)
    scene.collider("/c0", shape, motion=turning(rng, **how))
    scene.collider("/c1", Plane(), motion=rising(-3.0, -2.8))
    sim = Simulation(scene, **CPU)
    sim.load()
    contact = sim.plan.method("contact")
    sim.plan.before_frame(0.0)
    contact.clearance.begin(sim.plan.clock)
    room, x0 = contact.clearance.room.numpy(), sim.state.x.numpy().copy()
    assert 0.2 < (room > 0.0).mean() < 0.99
    unit = (u := rng.normal(size=(2, n, 3))) / np.linalg.norm(u, axis=-1, keepdims=True)
    some = np.maximum(room, 0.0)[:, None]
    near = 0
    for k in range(5):
        for part in (0.0, 0.3, 1.0):
            sim.state.x.assign(x0 + (1.0 - part) * some * unit[0])
            sim.state.d.assign(0.5 * part * some * unit[1])
            contact.contacts.search(k, sim.state.x, sim.state.d, sim.state.a)
            count = contact.contacts.slots.count.numpy()
            assert not count[room > 0.0].any()
            near += int(count[room <= 0.0].sum())
    assert near > 0                                                        # and others are found


# runs

def test_three_worlds_meet_together_and_are_the_same():
    scene = sheet(Plane(), at=(0.0, 0.0, 0.0), height=0.2, pinned=False, **MARCH)
    one, three = Simulation(scene, **CPU), Simulation(scene, worlds=3, **CPU)
    for sim in (one, three):
        sim.run(20)
    assert one.forms == three.forms and one.forms["met"] > 0
    for world in range(3):
        assert np.array_equal(three.positions(world=world), one.positions())


def test_one_world_that_meets_gives_all_of_them_contacts(held):
    far = sheet(Plane(), at=(0.0, 0.0, 0.0), height=5.0, pinned=False, **MARCH)
    sim, met = Simulation(far, worlds=2, **CPU), held(far, worlds=2)
    for s in (sim, met):
        s.set("/sheet", "positions", s.positions(world=1) - (0.0, 0.0, 4.999), world=1)
        s.run(3)
    assert sim.forms["met"] == 3 and np.abs(sim.positions(world=0) - met.positions(world=0)).max() < 1e-12
    assert np.abs(sim.positions(world=1) - met.positions(world=1)).max() < 1e-12


@pytest.mark.parametrize(("form", "precision"), [("march", "float32"), *((form, "float64") for form in FORMS)])
def test_a_restart_goes_on_to_the_bit_from_every_frame(form, precision):
    """Through frames without contacts, the first that has some, and later ones."""
    scene = sheet(Plane(), at=(0.0, 0.0, 0.0), height=0.1, pinned=False, **FORMS[form])
    whole, kept, forms = Simulation(scene, device="cpu", precision=precision), [], []
    for _ in range(14):
        whole.step()
        kept.append({"/sheet": whole.fields("/sheet")})
        forms.append(whole.plan.clock.free)
    assert set(forms) == {True, False}
    for frame in range(1, 14, 2):
        again = Simulation(scene, device="cpu", precision=precision)
        again.restart(frame, kept[frame - 1])
        again.run(14 - frame)
        assert np.array_equal(state(again), state(whole)), frame
        assert again.forms["free"] == sum(forms[frame:])


def test_a_thickness_that_is_set_counts():
    sim = Simulation(sheet(Plane(), at=(0.0, 0.0, 0.0), height=1.0, pinned=False, gravity=(0.0, 0.0, 0.0), **MARCH), **CPU)
    sim.step()
    sim.set("/wall", "thickness", 1.5)
    sim.step()
    assert sim.forms == {"free": 1, "met": 1, "repeated": 1}


def test_a_collider_that_is_set_to_move_is_seen():
    sim = Simulation(sheet(Sphere(0.2), gravity=(0.0, 0.0, 0.0), **MARCH), **CPU)
    sim.run(2)
    by = passing(Sphere(0.2), (0.0, 0.0, -9.0), (0.0, 0.0, -0.1))[1]
    sim.set("/wall", "motion", Motion(by.times - 0.2 + sim.time - 0.045, by.values))
    sim.step()
    assert sim.forms == {"free": 2, "met": 1, "repeated": 1}


def test_plan_and_report_tell_of_both_forms():
    sim = Simulation(sheet(Plane(), at=(0.0, 0.0, 0.0), height=0.05, pinned=False, **MARCH), **CPU)
    sim.run(8)
    said = sim.report()
    assert said["forms"] == sim.forms and sum(said["forms"][f] for f in ("free", "met")) == 8
    assert f"{said['forms']['free']} without contacts" in report_text(said)
    assert "a frame in which nothing can touch" in sim.plan.describe()
    assert {r["name"] for r in sim.plan.table()} >= {"find contacts", "contacts", "near"}


def test_a_frame_takes_as_few_launches_as_without_a_collider():
    """And one, for the clearance."""
    alone, far = (Simulation(sheet(shape, **MARCH), **CPU) for shape in (None, Sphere(0.5)))
    for sim in (alone, far):
        sim.run(2)

    def launched(sim: Simulation) -> int:
        count, launch = [], wp.launch
        sim.plan.clock.free = sim is far
        try:
            wp.launch = lambda *given, **more: (count.append(1), launch(*given, **more))
            sim.plan.frame()
        finally:
            wp.launch = launch
        return len(count)
    assert launched(far) == launched(alone) + 1
