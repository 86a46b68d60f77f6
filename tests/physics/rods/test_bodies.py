"""Rods against rigid bodies, both ways: momentum, friction, ropes under a weight."""

import numpy as np
import pytest

from tests.make.physics.rods.bodies import THICK, G, at, box, line, lying, masses, thrown
from tests.physics.rods.rig import simulated
from wsim.physics.rods import bodies, coupled_newton
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene
from wsim.scene.check.scene import check_scene


@pytest.mark.parametrize("mass, on", [(1e-3, False), (0.2, True), (20.0, False)])
def test_a_box_and_a_rope_that_collide_keep_their_momentum(mass, on):
    """To 1e-6 of the box's, whatever it weighs beside 0.25 kg of rope."""
    simulation, method = simulated(thrown(mass, on))
    rigid = simulation.plan.method("rigid")
    m, M = masses(method, rigid)
    first = m @ method.points(0)[1] + M @ rigid.velocities()
    for _ in range(10):
        simulation.step()
        assert np.abs(m @ method.points(0)[1] + M @ rigid.velocities() - first).max() < 1e-6 * 10.0 * mass
    assert (method.points(0)[1] @ (0.0, -1.0, 0.0)).max() > 0.005 and rigid.velocities()[0, 1] > -9.9        # they met


def test_a_rod_is_carried_by_what_it_lies_on():
    """Friction mu m g between a rod and a box that glides: m/s^2 as Coulomb has them, then M v / (M + m) for both."""
    M, v, mu = 1.0, 0.4, 0.15
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=4)
    across = np.stack([np.zeros(9), np.full(9, 0.1 + 0.5 * THICK), np.linspace(-0.1, 0.1, 9)], axis=1)
    scene.add(Rods("/rod", across, [9], THICK, young=1e8, static_friction=mu, dynamic_friction=mu))
    box(scene, "/box", (0.5, 0.05, 0.2), (0.0, 0.05, 0.0), mu, mass=M, velocity=np.array([v, 0.0, 0.0]),
               inertia=np.full(3, 1e6))
    simulation, method = simulated(scene)
    rigid = simulation.plan.method("rigid")
    m = masses(method, rigid)[0]
    simulation.set("/box", "force", (0.0, (M + m.sum()) * G, 0.0))
    seen = []
    for _ in range(24):
        simulation.step()
        seen.append([(m @ method.points(0)[1])[0] / m.sum(), rigid.velocities()[0, 0]])
    seen = np.array(seen)
    assert (seen[8, 0] - seen[4, 0]) * 15.0 == pytest.approx(mu * G, rel=0.01)
    assert (seen[8, 1] - seen[4, 1]) * 15.0 == pytest.approx(-mu * G * m.sum() / M, rel=0.01)
    assert seen[-1] == pytest.approx(M * v / (M + m.sum()), rel=1e-4)


def test_a_box_on_rods_sticks_and_slips_at_the_critical_angle():
    critical = np.degrees(np.arctan(0.5))
    assert abs(lying(critical - 1.0, 30)) < 1e-5
    a = np.radians(critical + 1.0)
    gain = lying(critical + 1.0, 24) - lying(critical + 1.0, 9)
    assert gain == pytest.approx(0.25 * G * (np.sin(a) - 0.5 * np.cos(a)), rel=0.05)


def sag(M: float, stretch: float, reach: float, under: float) -> float:
    """How far [m] a weight of breadth 2 `under` sinks on two light ropes over 2 `reach`, without friction: 4 T sin = M g."""
    low, high = 0.0, reach
    for _ in range(60):
        s = 0.5 * (low + high)
        side = np.hypot(reach - under, s)
        T = stretch * ((side + under) / reach - 1.0)
        low, high = (s, high) if 4.0 * T * s / side < M * G else (low, s)
    return s


def test_ropes_bear_a_weight():
    """50 kg on two ropes of 32 g: where statics have them, and their ends bear both. The air that slows them down bears nothing
    of what is at rest: it bore 2.5 % of it, half of the drag times a substep."""
    half, n, M = 0.5, 81, 50.0
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=4)
    rods = scene.add(Rods("/ropes", np.concatenate([line(n, half, 0.0, z) for z in (0.08, -0.08)]), [n, n], 0.01,
                          stretch=2e4, bend=1e-3, twist=1e-3, density=400.0, static_friction=0.0, dynamic_friction=0.0))
    rods.pin("/ends", [0, n - 1, n, 2 * n - 1])
    box(scene, "/box", (0.1, 0.05, 0.15), (0.0, 0.056, 0.0), 0.0, mass=M, drag=12.0, spin_drag=12.0)
    simulation, method = simulated(scene)
    simulation.run(150)
    x, rigid = method.points(0)[0], simulation.plan.method("rigid")
    assert np.abs(rigid.velocities()).max() < 2e-3
    end = np.array([[0, 1], [n - 1, n - 2], [n, n + 1], [2 * n - 1, 2 * n - 2]])
    e = x[end[:, 1]] - x[end[:, 0]]
    size = np.linalg.norm(e, axis=1)
    rest = 2.0 * half / (n - 1)
    borne = -(2e4 * (size / rest - 1.0) * e[:, 1] / size).sum()
    m = masses(method, rigid)[0].sum()
    assert borne == pytest.approx((M + m) * G, rel=0.005)
    bottom = -(rigid.poses()[0, 1, 3] - 0.05 - 0.005)
    assert bottom == pytest.approx(sag(M, 2e4, half, 0.1), rel=0.02)


def test_results_are_the_same_from_run_to_run_and_in_worlds():
    found = []
    for worlds in (1, 1, 2):
        simulation, method = simulated(thrown(0.2, False), worlds=worlds)
        simulation.run(6)
        found += [(method.points(k)[0], simulation.plan.method("rigid").poses()[k]) for k in range(worlds)]
    assert all(np.array_equal(a, b) for each in found[1:] for a, b in zip(found[0], each, strict=True))


def test_a_point_that_more_bodies_touch_than_there_is_room_for(monkeypatch):
    """Three boxes press one point: the frame is repeated with room, and momentum kept."""
    monkeypatch.setattr(bodies, "ROOM", 2)
    monkeypatch.setattr(bodies, "WIDE", 2)
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=4)
    scene.add(Rods("/rope", line(5, 0.2), [5], THICK, young=1e7))
    for k, way in enumerate(([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0])):
        d = np.array(way)
        box(scene, f"/box{k}", (0.02, 0.008, 0.008), (0.008 + 0.5 * THICK + 2e-4) * d, mass=0.1, velocity=-0.5 * d)
    simulation, method = simulated(scene)
    simulation.prepare()
    rigid = simulation.plan.method("rigid")
    m, M = masses(method, rigid)
    first = M @ rigid.velocities()
    simulation.run(3)
    assert method.touching.bodies.depth > 2
    assert np.abs(m @ method.points(0)[1] + M @ rigid.velocities() - first).max() < 1e-6 * 0.05


def test_a_rope_that_begins_in_a_body_is_told():
    scene = thrown(0.2, False)
    scene.things("Body")[0].motion = at((0.0, 0.01, 0.0))
    said = [p for p in check_scene(scene) if p.path == "/rope"]
    assert len(said) == 1 and "3 points begin inside of /box/shape, the deepest, 10, by 0.04 m" in said[0].text


def test_nothing_of_it_is_built_without_bodies():
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    scene.add(Rods("/rope", line(5, 0.2), [5], THICK))
    simulation, method = simulated(scene)
    assert method.touching is None and "cling" not in method.part.arrays


@pytest.mark.slow
@pytest.mark.parametrize("on", [False, True])
def test_a_block_of_threads_finds_what_a_thread_a_strand_does_with_bodies(on, monkeypatch):
    """A box that is thrown at a rope: iterations end at 1e-6 of an edge of 4 cm, in each of 16 substeps."""
    def places(team: bool) -> tuple[np.ndarray, np.ndarray, bool]:
        monkeypatch.setattr(coupled_newton, "TEAM", team)
        simulation, method = simulated(thrown(0.2, on))
        simulation.run(4)
        rigid = simulation.plan.method("rigid")
        return method.points(0)[0], rigid.velocities(), bool(rigid.velocities()[0, 1] > -9.9)
    one, other = places(True), places(False)
    assert one[2] and other[2]                                                        # they met
    assert np.abs(one[0] - other[0]).max() < 16 * 1e-6 * 0.04
    assert np.abs(one[1] - other[1]).max() < 16 * 1e-6 * 0.04 * 240.0
