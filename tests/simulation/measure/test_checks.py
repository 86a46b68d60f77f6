"""A run checks its own figures: energy that comes from nowhere is seen, work that something does is not taken for it."""

import numpy as np
import pytest

from wsim.physics.rigid.joints.joint import Drive, Joint, locked_limits_except, revolute_joint
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Capsule, Collider, Load, Plane, Scene, Sphere, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

CPU = {"device": "cpu"}


def body(path, at, shape=None, **more) -> Body:
    return Body(path, [Collider(f"{path}/s", shape or Box((0.1, 0.1, 0.1)))], Motion.at_place(at), **{"mass": 1.0} | more)


def moving(path, shape, way, **more) -> Collider:
    """way(t): place [m], or (4, 4)."""
    times = np.linspace(0.0, 2.0, 241)
    return Collider(path, shape, motion=Motion(times, np.array([placed(way(t)) for t in times])), **more)


def placed(where) -> np.ndarray:
    where, M = np.asarray(where, float), np.eye(4)
    if where.shape == (4, 4):
        return where
    M[:3, 3] = where
    return M


def scene(*things, **more) -> Scene:
    made = Scene(**{"up": "Z", "fps": 60.0, "substeps": 10} | more)
    for thing in things:
        made.colliders.append(thing) if isinstance(thing, Collider) else made.add(thing)
    return made


def works(sim: Simulation, frames: int) -> float:
    """Work of all frames [J] as the balance has it."""
    balance, total = sim.plan.ports.balance, 0.0
    for _ in sim.frames(frames):
        total += balance.found()["work"]
    return total


def kicked(sim: Simulation, factor: float, world: int = 0) -> None:
    """Makes everything faster after each frame, which nothing explains."""
    def kick(sim) -> None:
        for part, names in (("bodies", "pL"), ("points", "v")):
            for name in names if part in sim.state.parts else ():
                array = sim.state.parts[part].arrays[name]
                values, n = array.numpy(), len(array) // sim.worlds
                values[world * n:(world + 1) * n] *= factor
                array.assign(values)
    sim.watchers.append(kick)


def gained(sim: Simulation) -> list[str]:
    return [w for w in sim.warnings if "gained energy" in w]


def test_a_lift_gives_a_box_the_work_of_its_weight():
    """0.5 m up at a smooth speed: half way m v^2 / 2 is left of the work of both, and at the top nothing. The lift's own counts
    a hundredth more."""
    lift = moving("/lift", Box((1.0, 1.0, 0.1)), lambda t: (0.0, 0.0, 0.25 * (1.0 - np.cos(np.pi * min(t, 1.0)))))
    sim = Simulation(scene(lift, body("/box", (0.2, 0.1, 0.2))), **CPU)
    kinetic, weight = 0.5 * (0.25 * np.pi)**2, 9.81 * 0.25
    assert works(sim, 30) == pytest.approx(kinetic + 0.01 * (kinetic + weight), abs=0.03 * kinetic)
    assert works(sim, 40) == pytest.approx(-kinetic + 0.01 * (weight - kinetic), abs=0.06 * kinetic) and not sim.warnings


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_turntable_and_a_belt_drag_what_lies_on_them_without_a_warning(precision):
    def turn(t: float) -> np.ndarray:
        M, a = np.eye(4), 1.5 * t
        M[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
        return M
    table = moving("/table", Box((1.0, 1.0, 0.1)), turn)
    belt = moving("/belt", Box((3.0, 0.5, 0.1)), lambda t: (2.0 * t, 3.0, 0.0))
    sim = Simulation(scene(table, belt, body("/box", (0.4, 0.0, 0.2)), body("/other", (0.0, 3.0, 0.2))), precision=precision,
                     **CPU)
    sim.run(60)
    assert np.linalg.norm(sim.plan.ports.bodies.velocities()[1]) == pytest.approx(2.0, rel=1e-2)
    assert sim.plan.ports.balance.ledger.most.numpy()[0] > 2.0 and not sim.warnings


def test_a_box_that_a_paddle_hits_has_the_energy_of_the_blow():
    """An inelastic blow of a wall at 3 m/s: m u^2 of work, half of it kept."""
    wall = moving("/wall", Box((0.1, 1.0, 1.0)), lambda t: (-1.0 + 3.0 * t, 0.0, 0.0))
    sim = Simulation(scene(wall, body("/box", (0.0, 0.0, 0.0)), gravity=(0.0, 0.0, 0.0), fps=120.0), **CPU)
    total = works(sim, 60)
    assert sim.plan.ports.bodies.velocities()[0, 0] == pytest.approx(3.0, rel=1e-3)
    assert total == pytest.approx(1.01 * 9.0, rel=1e-2) and not sim.warnings          # a hundredth more: it is a bound


def motor(**drive) -> Scene:
    """A wheel on an axle, without gravity."""
    wheel = Body("/wheel", [], Motion.still(), mass=2.0, center=(0, 0, 0), inertia=(0.1, 0.1, 0.1))
    hinge = revolute_joint("/axle", None, wheel, at=(0, 0, 0), axis=(0, 0, 1))
    made = Joint(**vars(hinge) | {"drives": {"rotX": Drive(**drive)}})
    return scene(wheel, made, gravity=(0.0, 0.0, 0.0))


def test_a_motor_gives_what_its_torque_does():
    """c (w - w') from rest to w = 5 rad/s: the work is torque times w, I w^2 in all, half of which is kept."""
    sim = Simulation(motor(damping=1.0, speed=5.0), **CPU)
    assert works(sim, 90) == pytest.approx(1.01 * 0.1 * 25.0, rel=1e-2)
    assert np.linalg.norm(sim.plan.ports.bodies.spins()[0]) == pytest.approx(5.0, rel=1e-3) and not sim.warnings


def test_a_spring_drive_that_swings_is_balanced():
    """Its energy is stored in the spring and comes back: no warning, and the rise is far below what turns over."""
    sim = Simulation(motor(stiffness=4.0, target=1.0), **CPU)
    sim.run(90)
    assert sim.plan.ports.balance.ledger.most.numpy()[0] == pytest.approx(2.0, rel=0.05)          # k / 2 of 1 rad
    assert sim.report(profile=False)["balance"]["rise"] < 0.01 and not sim.warnings


def test_a_spring_that_starts_stretched_stores_energy_from_the_start():
    """1 kg, 0.1 m from the rest of a spring of 1e4 N/m: half k y^2 = 50 J goes to and fro."""
    box = body("/box", (0.1, 0.0, 0.0))
    slide = Joint("/slide", body1="/box", limits=locked_limits_except("transX"), drives={"transX": Drive(stiffness=1e4)})
    sim = Simulation(scene(box, slide, gravity=(0.0, 0.0, 0.0)), **CPU)
    sim.run(5)
    assert sim.plan.ports.balance.report()["rise"] < 1e-4 and not sim.warnings


@pytest.mark.parametrize("make", ["bodies", "cloth", "implicit"])
def test_energy_that_comes_from_nowhere_is_warned_of(make):
    """2 % more speed after each frame: 4 % of the energy."""
    if make == "bodies":
        made = scene(body("/fast", (0, 0, 0), velocity=(3.0, 0.0, 0.0)), body("/slow", (5, 0, 0)), gravity=(0.0, 0.0, 0.0))
    else:
        made = Scene(substeps=12, solver="implicit" if make == "implicit" else "explicit", gravity=(0.0, 0.0, 0.0))
        points, counts, indices = shapes.sheet(0.5, 0.5, 4, 4)
        made.cloth("/fast", points, counts, indices, material=Fabric(stretch=50.0),
                   velocities=np.tile((1.0, 0.0, 0.0), (len(points), 1)))
    right, wrong = Simulation(made, **CPU), Simulation(made, **CPU)
    kicked(wrong, 1.02)
    for sim in (right, wrong):
        sim.run(6)
    (said,) = gained(wrong)
    assert not right.warnings and "/fast" in said and "substeps" in said and said.startswith("frame 2 and 4 later")


def test_each_world_has_a_balance_of_its_own():
    sim = Simulation(scene(body("/box", (0, 0, 0), velocity=(3.0, 0.0, 0.0)), gravity=(0.0, 0.0, 0.0)), worlds=3, **CPU)
    kicked(sim, 1.02, world=1)
    sim.run(4)
    assert "/box (world 1)" in gained(sim)[0] and (sim.plan.ports.balance.ledger.rise.numpy()[[0, 2], 0] <= 1e-6).all()


def test_bodies_asleep_are_balanced():
    sim = Simulation(scene(Collider("/floor", Plane()), body("/box", (0, 0, 0.1)), sleep_speed=0.05), **CPU)
    sim.run(60)
    assert sim.plan.ports.bodies.part.arrays["asleep"].numpy().all() and not sim.warnings


def ball_under(**more) -> Scene:
    """A cloth that a ball lifts and throws."""
    made = Scene(fps=60.0, **{"substeps": 20, "iterations": 6} | more)
    made.cloth("/cloth", *shapes.sheet(0.5, 0.5, 6, 6, horizontal=True, at=(0, 0.13, 0)), material=Fabric(stretch=100.0))
    made.colliders.append(moving("/ball", Sphere(0.12), lambda t: (0.0, 0.3 * (1.0 - np.cos(4.0 * t)), 0.0)))
    return made


@pytest.mark.parametrize("solver", ["explicit", "implicit", "xpbd"])
def test_colliders_that_move_points_give_what_the_points_have(solver):
    """No frame is left open, and nothing is warned of but where the ball's work is not counted."""
    sim = Simulation(ball_under(solver=solver, **({"substeps": 60} if solver == "explicit" else {})), **CPU)
    sim.run(45)
    said = sim.report(profile=False)["balance"]
    assert said["left_open"] == {} and said["rise"] < 0.01 and not sim.warnings and said["strained"] == (solver == "xpbd")
    wrong = Simulation(ball_under(solver=solver, **({"substeps": 60} if solver == "explicit" else {})), **CPU)
    wrong.plan.ports.balance.terms.each[-1] = lambda rows: rows.zero_()              # the ball's work is not counted
    wrong.run(45)
    assert gained(wrong)


@pytest.mark.parametrize("solver", ["explicit", "implicit"])
def test_wind_and_loads_give_what_the_cloth_has(solver):
    """A flag that is blown from rest, and one that a force pulls: both gain energy, and neither is warned of."""
    made = Scene(fps=60.0, solver=solver, substeps=40, gravity=(0.0, 0.0, 0.0), wind=(6.0, 0.0, 1.0))
    for k in (0, 1):
        made.cloth(f"/c{k}", *shapes.sheet(0.4, 0.4, 4, 4, at=(0, 2.0 * k, 0)), material=Fabric(stretch=100.0),
                   drag=0.5 * (k == 0), lift=0.5 * (k == 0))
    made.loads.append(Load("/pull", "/c1", Curve(np.zeros(1), np.array([[0.3, 0.0, 0.0]])), points=np.arange(25)))
    sim = Simulation(made, **CPU)
    sim.run(20)
    said = sim.report(profile=False)["balance"]
    assert said["left_open"] == {} and not sim.warnings and sim.indicators()["kinetic_energy"] > 0.01


def test_a_pin_that_moves_leaves_its_frames_open_and_a_blow_up_is_seen_there():
    made = Scene(fps=60.0, substeps=20, solver="implicit", gravity=(0.0, 0.0, 0.0))
    cloth = made.cloth("/cloth", *shapes.sheet(0.4, 0.4, 4, 4), material=Fabric(stretch=100.0))
    made.pin("/pin", cloth, [0, 4], motion=moving("/x", Plane(), lambda t: (0.1 * np.sin(6.0 * t), 0.0, 0.0)).motion)
    right, wrong = Simulation(made, **CPU), Simulation(made, **CPU)
    kicked(wrong, 8.0)
    right.run(10)
    wrong.run(10)
    assert right.report(profile=False)["balance"]["left_open"] == {"/pin moves": 10} and not right.warnings
    assert any("faster than what moves it" in w for w in wrong.warnings)


def sunk(depth: float = 0.009, **more) -> Scene:
    """A box of 20 cm that begins in the floor: pushed out, it gains the work of its weight. Up to 1 cm is no overlap."""
    return scene(Collider("/floor", Plane()), body("/box", (0.0, 0.0, 0.1 - depth)), **more)


def unnamed(**more) -> Scene:
    made = sunk(**more)
    made.substeps = Scene().substeps
    return made


def test_substeps_that_nobody_named_are_raised_twice_at_most_and_stay():
    named, free = Simulation(sunk(), **CPU), Simulation(unnamed(), **CPU)
    before = free.plan.clock.substeps
    named.run(4)
    free.run(4)
    assert named.plan.clock.substeps == 10 and not named.repeats and any("move them apart" in w for w in named.warnings)
    assert free.plan.clock.substeps == 4 * before and len(free.repeats) == 2 and free.warnings
    assert free.repeats[0] == f"frame 1: energy gained; repeated with {2 * before} substeps in place of {before}, which stay"


def test_what_overlaps_at_the_start_raises_no_substeps():
    """It is pushed apart whatever these are: a box, and a cloth, that begin in a collider."""
    made = Scene()
    made.cloth("/sheet", *shapes.sheet(0.5, 0.5, 8, 8, horizontal=True, at=(0, 0.05, 0)))
    made.collider("/ball", Sphere(0.15))
    for start in (unnamed(depth=0.04), made):
        sim = Simulation(start, **CPU)
        before = sim.plan.clock.substeps
        sim.run(2)
        assert sim.plan.clock.substeps == before and not sim.repeats and gained(sim)[0].endswith("starts, move them apart")


def test_worlds_rise_together_to_the_bits_of_one_or_not_at_all():
    """Apart, as sweeps run them, none changes its steps: the run warns."""
    worlds, one, apart = (Simulation(unnamed(), worlds=n, **CPU) for n in (2, 1, 2))
    apart.plan.clock.apart, before = True, apart.plan.clock.substeps
    for sim in (worlds, one, apart):
        sim.run(3)
    x, alone = (sim.state.parts["bodies"].arrays["x"].numpy() for sim in (worlds, one))
    assert worlds.plan.clock.substeps == one.plan.clock.substeps == 4 * before
    assert np.array_equal(x, np.repeat(alone, 2, axis=0))
    assert apart.plan.clock.substeps == before and not apart.repeats and gained(apart)


def test_points_that_start_in_a_collider_are_to_be_moved_apart():
    made = Scene(solver="xpbd")
    made.cloth("/sheet", *shapes.sheet(0.5, 0.5, 8, 8, horizontal=True, at=(0, 0.05, 0)))
    made.collider("/ball", Sphere(0.15))
    sim = Simulation(made, **CPU)
    sim.run(2)
    (said,) = gained(sim)
    assert "/sheet gained energy" in said and said.endswith("if shapes overlap where the run starts, move them apart")
    assert 'or solver "implicit"' in said


def test_a_restart_goes_on_with_the_raised_substeps_to_the_bit():
    through = Simulation(unnamed(), **CPU)
    through.run(3)
    fields = {path: through.fields(path) for path in through.state.paths()}
    through.run(3)
    again = Simulation(unnamed(), **CPU)
    again.restart(3, fields)
    again.run(3)
    assert again.plan.clock.substeps == through.plan.clock.substeps > Simulation(unnamed(), **CPU).plan.clock.substeps
    for name in "xeqopL":
        assert np.array_equal(*(s.state.parts["bodies"].arrays[name].numpy() for s in (again, through)))
    assert again.plan.ports.balance.rises == 2 and not again.repeats


def test_joints_that_gape_and_shapes_that_overlap_are_told_by_prim():
    """A joint is torn by hand, in maximal coordinates; a box of 1 kg under 1000 kg is crushed at 2 substeps."""
    a, b = body("/a", (0, 0, 1.0)), body("/b", (0.3, 0, 1.0))
    sim = Simulation(scene(a, b, revolute_joint("/hinge", a, b, at=(0.15, 0, 1.0), axis=(0, 1, 0)), gravity=(0.0, 0.0, 0.0),
                           coordinates="maximal"), **CPU)
    part = sim.state.parts["bodies"]
    x = part.arrays["x"].numpy()
    x[1, 2] += 0.5
    part.arrays["x"].assign(x)
    sim.step()
    assert any("/hinge gapes by" in w for w in sim.warnings)
    crushed = Simulation(scene(Collider("/floor", Plane()), body("/light", (0, 0, 0.1)), body("/heavy", (0, 0, 0.3), mass=1e4),
                               substeps=2), **CPU)
    crushed.run(20)
    (said,) = [w for w in crushed.warnings if "overlap" in w]
    assert "/light" in said and "more substeps" in said


@pytest.mark.parametrize("solver, shape, told", [
    ("implicit", Capsule(0.06, 0.04), True), ("implicit", Capsule(0.02, 0.08), False),
    ("implicit", Box((0.06, 0.06, 0.1)), True), ("xpbd", Box((0.06, 0.06, 0.1)), False)])
def test_a_collider_that_stands_out_of_a_cloth_between_its_points_is_told(solver, shape, told):
    """A post under the middle of a cell of 15 cm: 6 cm of it are in the cloth, or 2, where a quarter of an edge is allowed. A
    box of 6 cm meets the cloth's edges in sweeps, and points alone in Newton steps."""
    made = Scene(solver=solver, substeps=8)
    made.cloth("/cloth", *shapes.sheet(0.6, 0.6, 4, 4, horizontal=True, at=(0.0, 0.12, 0.0)), material=Fabric(stretch=100.0))
    upright = np.array([[1, 0, 0, 0.075], [0, 0, 1, 0], [0, -1, 0, 0.075], [0, 0, 0, 1.0]])
    made.collider("/post", shape, motion=Motion.still(upright), thickness=0.0)
    sim = Simulation(made, **CPU)
    sim.run(3)
    found = [w for w in sim.report(profile=False)["warnings"] if "/cloth lets a collider stand out" in w]
    assert len(found) == told and all("wsim:thickness" in w for w in found)


@pytest.mark.parametrize("worlds", [1, 3])
def test_the_balance_counts_what_pressed_contacts_hold(worlds):
    """A box at rest presses its springs by d under its weight: they hold m g d / 2 in each world, which they may give back."""
    scene = Scene(fps=60, substeps=4, iterations=8)
    scene.collider("/floor", Plane())
    scene.body("/box", Box((0.1, 0.1, 0.1)), at=(0.0, 0.1, 0.0), mass=8.0)
    simulation = Simulation(scene, device="cpu", precision="float64", worlds=worlds)
    simulation.run(60)
    terms = simulation.plan.method("balance").terms
    rows = terms.own[terms.each.index(terms.sum_contacts)].numpy().reshape(worlds, -1, 4)
    for world, held in enumerate(rows[:, :, 2].sum(axis=1)):
        depth = 0.1 - simulation.poses(world=world)["/box"][1, 3]
        assert depth > 1e-6 and held == pytest.approx(0.5 * 8.0 * 9.81 * depth, rel=1e-3)
