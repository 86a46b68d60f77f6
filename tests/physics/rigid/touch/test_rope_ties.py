"""Ropes tied to rigid bodies, both ways: momentum, weights of any mass, a pendulum, a bridge, restart, worlds, USD."""

import numpy as np
import pytest

from tools.bench.rigid.answers.tied import momenta, whirling
from wsim.physics.rods import coupled_newton
from wsim.scene import Box, Motion, Scene, SceneError, Sphere
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

G = 9.81


def simulated(scene: Scene):
    simulation = Simulation(scene, device="cpu", precision="float64")
    return simulation, simulation.plan.method("rods")


def hung(weight: float, size: float = 1.0, at=(0.0, 0.0, 0.0), asleep: bool = False, **more) -> Scene:
    """A box of some weight [kg] on a straight rope of 8 edges, `size` [m] long and size / 100 thick, pinned at its top."""
    scene = Scene(fps=60, substeps=4, gravity=(0.0, -G * size, 0.0))
    x = np.stack([np.zeros(9), -np.linspace(0.0, size, 9), np.zeros(9)], axis=1) + at
    rope = scene.rods("/rope", x, [9], diameters=0.01 * size, **({"young": 1e9, "damping": 0.05} | more))
    scene.pin("/pin", rope, [0])
    box = scene.body("/weight", Box((0.05 * size,) * 3), at=x[-1] - (0.0, 0.05 * size, 0.0), mass=weight, asleep=asleep)
    scene.tie("/tie", rope, [8], box)
    return scene


@pytest.mark.parametrize("team", [False, True])
@pytest.mark.parametrize("mass", [8e-5, 1.0, 80.0])
def test_a_body_and_a_rope_in_flight_keep_their_momentum(mass, team, monkeypatch):
    """A body of a 1000th, 12 times and 1000 times the rope's mass: linear momentum to 1e-9 of what they have."""
    monkeypatch.setattr(coupled_newton, "TEAM", team)
    simulation, _ = simulated(whirling(mass, 4))
    first, _ = momenta(simulation)
    simulation.run(20)
    assert np.abs(momenta(simulation)[0] - first).max() < 1e-9 * np.linalg.norm(first)
    assert simulation.indicators()["rod_tie_gap"] < 1e-8


def test_the_angular_momentum_that_is_lost_is_of_first_order():
    """Backward Euler: half of the step, half of the loss."""
    lost = []
    for substeps in (4, 8, 16):
        simulation, _ = simulated(whirling(1.0, substeps))
        first = momenta(simulation)[1]
        simulation.run(20)
        lost.append(np.linalg.norm(momenta(simulation)[1] - first) / np.linalg.norm(first))
    assert lost[0] < 0.01 and lost[1:] == pytest.approx([lost[0] / 2, lost[0] / 4], rel=0.05)


def flail_energy(substeps: int) -> float:
    """Part of its energy that a flail loses in half a second: handle, rope and ball, which turn at 6 rad/s."""
    scene = Scene(fps=60, substeps=substeps, gravity=(0.0, 0.0, 0.0))
    x, spin = np.stack([np.linspace(0.25, 0.75, 9), np.zeros(9), np.zeros(9)], axis=1), np.array([0.0, 0.0, 6.0])
    rope = scene.rods("/rope", x, [9], diameters=0.01, young=1e8, bend=1e-4, twist=1e-4, velocities=np.cross(spin, x))
    handle = scene.body("/handle", Box((0.25, 0.02, 0.02)), mass=0.6, spin=spin)
    ball = scene.body("/ball", Sphere(0.05), at=(0.8, 0, 0), mass=1.0, velocity=np.cross(spin, (0.8, 0, 0)), spin=spin)
    scene.tie("/grip", rope, [0], handle)
    scene.tie("/knot", rope, [8], ball)
    simulation, rods = simulated(scene)
    m = rods.table.values["m"].reshape(-1)[rods.table.place[0]]

    def kinetic():
        return 0.5 * m @ (rods.points(0)[1]**2).sum(1) + simulation.indicators()["rigid_energy"]
    first = kinetic()
    simulation.run(30)
    return 1.0 - kinetic() / first


def test_a_flail_loses_energy_at_first_order_and_gains_none():
    lost = [flail_energy(n) for n in (4, 8, 16)]
    assert 0.0 < lost[0] < 0.06 and lost[1] == pytest.approx(0.5 * lost[0], rel=0.15)
    assert lost[2] == pytest.approx(0.5 * lost[1], rel=0.1)


@pytest.mark.parametrize("size", [1e-3, 1.0, 100.0])
@pytest.mark.parametrize("heavy", [1e-3, 1.0, 1e3])
def test_a_weight_at_rest_stretches_its_rope_by_its_tension(size, heavy):
    """A weight of `heavy` times the rope's mass, frames of 1 mm to 100 m: M g and the rope's below each edge, over E A."""
    rope = 1000.0 * 0.25 * np.pi * (0.01 * size) ** 2 * size
    young = 1e4 * (heavy + 1.0) * rope * G * size / (0.25 * np.pi * (0.01 * size) ** 2)          # a strain of 1e-4
    simulation, method = simulated(hung(heavy * rope, size, at=(30.0 * size, 0.0, 0.0), young=young))
    simulation.run(90)
    below = heavy * rope + rope * (np.arange(7, -1, -1) + 0.5) / 8
    strain = below * G * size / (young * 0.25 * np.pi * (0.01 * size) ** 2)
    length = np.linalg.norm(np.diff(method.points(0)[0], axis=0), axis=1) / (size / 8.0)
    assert length - 1.0 == pytest.approx(strain, rel=1e-3)
    assert simulation.plan.method("rigid").velocities() == pytest.approx(0.0, abs=1e-5 * size)


def test_the_reaction_of_the_pin_bears_rope_and_weight():
    simulation, method = simulated(hung(2.0))
    simulation.run(90)
    rope = method.table.values["m"].sum()
    assert simulation.reactions("/pin").sum(0) == pytest.approx((0.0, (2.0 + rope) * G, 0.0), abs=0.01)
    assert simulation.reactions("/tie") == pytest.approx(np.array([[0.0, -2.0 * G, 0.0]]), abs=0.01)         # on the rope


def pendulum_period(substeps: int) -> float:
    """Half a period [s], twice, of a small heavy ball on a stiff rope of 1 m without a mass to speak of, from 0.3 rad."""
    scene = Scene(fps=60, substeps=substeps)
    x = np.linspace(0.0, 1.0, 5)[:, None] * np.array([np.sin(0.3), -np.cos(0.3), 0.0])
    rope = scene.rods("/rope", x, [5], diameters=0.002, young=1e11, bend=0.0, twist=0.0, density=100.0)
    scene.pin("/pin", rope, [0])
    scene.tie("/tie", rope, [4], scene.body("/ball", Sphere(0.02), at=x[-1], mass=1.0, inertia=(1e-7,) * 3))
    simulation, _ = simulated(scene)
    seen = []
    for _ in range(120):
        simulation.step()
        place = simulation.poses("/ball")["/ball"][:3, 3]
        seen.append(np.arctan2(place[0], -place[1]))
    CubicSpline = pytest.importorskip("scipy.interpolate").CubicSpline
    return 2.0 * np.diff(CubicSpline(np.arange(1, 121) / 60.0, seen).roots(extrapolate=False))[0]


def test_the_period_of_a_weight_on_a_rope_converges_to_the_closed_form():
    """4 sqrt(l / g) K(sin(a / 2)): the error falls with the substep (backward Euler loses swing)."""
    exact = 4.0 * np.sqrt(1.0 / G) * pytest.importorskip("scipy.special").ellipk(np.sin(0.15) ** 2)
    error = [abs(pendulum_period(n) / exact - 1.0) for n in (4, 8, 16)]
    assert error[0] < 3e-4 and error[1] < 0.65 * error[0] and error[2] < 0.65 * error[1]


def bridge(planks: int = 6, load: float = 15.0) -> Scene:
    """Planks on two ropes, with a ball that lies on them."""
    scene, n, span = Scene(fps=60, substeps=4), 2 * planks + 1, planks * 0.25
    x = np.linspace(-0.5 * span, 0.5 * span, n)
    y = -0.06 * span * (1.0 - (2.0 * x / span) ** 2)
    ropes = scene.rods("/ropes", np.concatenate([np.stack([x, y, np.full(n, z)], axis=1) for z in (-0.4, 0.4)]), [n, n],
                       diameters=0.02, young=2e8, density=600.0, bend=0.01, twist=0.01, damping=0.02)
    scene.pin("/posts", ropes, [0, n - 1, n, 2 * n - 1])
    for k in range(planks):
        a = 2 * k + 1
        plank = scene.body(f"/plank{k}", Box((0.09, 0.015, 0.45)), at=(x[a], y[a] - 0.03, 0.0), density=500.0)
        scene.tie(f"/tie{k}", ropes, [a, n + a], plank)
    scene.body("/ball", Sphere(0.15), at=(0.0, y.min() + 0.16, 0.0), mass=load)
    return scene


def test_a_bridge_stands_under_a_load():
    """What its posts bear, in the mean over the last half second, is the weight of ropes, planks and ball."""
    simulation = Simulation(bridge(), device="cpu", precision="float64")
    simulation.run(90)
    rods, rigid, borne = simulation.plan.method("rods"), simulation.plan.method("rigid"), []
    for _ in range(30):
        simulation.step()
        borne.append(simulation.reactions("/posts").sum(0))
    weight = G * (rods.table.values["m"].sum() + sum(m.mass for m in rigid.masses))
    assert np.mean(borne, axis=0) == pytest.approx((0.0, weight, 0.0), abs=0.05 * weight)
    ball = simulation.poses("/ball")["/ball"][:3, 3]
    assert -0.4 < ball[1] < 0.1 and abs(ball[2]) < 1e-3
    assert simulation.indicators()["rod_tie_gap"] < 1e-6


def test_a_run_goes_on_to_the_bit_and_worlds_are_alike():
    whole, _ = simulated(bridge(3))
    whole.run(12)
    first, _ = simulated(bridge(3))
    first.run(6)
    paths = [path for path in first.state.paths() if not path.startswith("/ball/")]
    second, _ = simulated(bridge(3))
    second.restart(6, {path: first.fields(path) for path in paths})
    second.run(6)
    assert np.array_equal(whole.positions("/ropes"), second.positions("/ropes"))
    assert np.array_equal(whole.poses("/plank1")["/plank1"], second.poses("/plank1")["/plank1"])
    many = Simulation(bridge(3), device="cpu", precision="float64", worlds=2)
    many.run(12)
    assert np.array_equal(many.positions("/ropes", world=0), many.positions("/ropes", world=1))
    assert np.array_equal(many.positions("/ropes", world=0), whole.positions("/ropes"))


def test_a_body_that_begins_asleep_hangs_on_its_rope_and_moves():
    scene = hung(1.0, asleep=True, young=1e6)
    simulation, _ = simulated(scene)
    simulation.run(20)
    assert simulation.poses("/weight")["/weight"][1, 3] < -1.06


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
def test_a_link_of_a_tree_hangs_on_a_rope_in_both_coordinates(coordinates):
    scene = hung(1.0)
    scene.coordinates = coordinates
    scene.joint("revolute", "/hinge", scene.body("/arm", Box((0.05, 0.02, 0.02)), at=(0.1, -1.05, 0.0), mass=0.1), "/weight",
                at=(0.05, -1.05, 0.0), axis=(0, 0, 1))
    simulation, _ = simulated(scene)
    simulation.run(10)
    assert simulation.indicators()["joint_error"] < 1e-3
    assert ("reduced" in simulation.plan.method("rigid").joints.what) == (coordinates == "auto")


def test_a_tie_stands_in_a_file_and_is_read_again(tmp_path):
    scene = bridge(3)
    scene.ties[0].places = np.array([[0.01, 0.03, -0.4], [0.01, 0.03, 0.4]])
    save(scene, tmp_path / "bridge.usda")
    again = load(tmp_path / "bridge.usda")
    assert [(t.path, t.body, t.other, t.points.tolist()) for t in again.ties] == [
        (t.path, t.body, t.other, t.points.tolist()) for t in scene.ties]
    assert again.ties[0].places == pytest.approx(scene.ties[0].places, abs=1e-6) and again.ties[1].places is None
    assert not [p for p in check_scene(again) if p.fatal]


@pytest.mark.parametrize(("change", "said"), [
    (lambda s: s.tie("/more", "/rope", [3], "/nothing"), "which is no rigid body"),
    (lambda s: s.tie("/more", "/rope", [9], "/weight"), "it names point 9"),
    (lambda s: s.tie("/more", "/rope", [], "/weight"), "it names no point"),
    (lambda s: s.tie("/more", "/rope", [8], "/weight"), "tied or pinned 2 times"),
    (lambda s: s.tie("/more", "/rope", [0], "/weight"), "tied or pinned 2 times"),
    (lambda s: s.tie("/more", "/rope", [3], "/weight", places=[(0, 0, np.nan)]), "a finite place"),
    (lambda s: s.tie("/more", "/ropes", [3], "/weight"), "is no cloth, spring net, soft body, rods"),
])
def test_bad_ties_are_told_in_a_line(change, said):
    scene = hung(1.0)
    change(scene)
    with pytest.raises(SceneError, match=said):
        Simulation(scene, device="cpu")


def test_what_is_tied_begins_without_a_gap_or_is_drawn_there():
    """Places 1 cm off: the first substep closes the gap."""
    scene = hung(1.0)
    scene.ties[0].places = np.array([[0.0, 0.06, 0.0]])
    simulation, _ = simulated(scene)
    simulation.run(1)
    assert simulation.indicators()["rod_tie_gap"] < 1e-8


def test_turned_bodies_hold_points_in_their_own_frames():
    scene = Scene(fps=60, substeps=4, gravity=(0, 0, 0))
    rope = scene.rods("/rope", [(0.1 * k, 0.0, 0.0) for k in range(4)], [4], diameters=0.01)
    turned = Motion.still([[0, -1, 0, 0.3], [1, 0, 0, 0.0], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    body = scene.body("/body", Box((0.02, 0.05, 0.08)), motion=turned, center=(0.0, 0.01, 0.0), mass=1.0, inertia=(1e-3,) * 3)
    scene.tie("/tie", rope, [3], body)
    simulation, _ = simulated(scene)
    simulation.run(4)
    assert simulation.positions("/rope")[3] == pytest.approx((0.3, 0.0, 0.0), abs=1e-12)
