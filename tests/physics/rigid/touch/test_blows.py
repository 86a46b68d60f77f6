"""Bodies against points of cloth: momentum, closed forms of blows and friction, rest, speed, the same bits."""

import numpy as np
import pytest

from tests.make.physics.rigid.contact import ball, box
from tests.make.physics.rigid.touch.blows import FREE, WAYS, by
from tests.physics.rigid.touch.touching import Mixed, run, scene


def read(sim) -> np.ndarray:
    """Momentum of points and bodies near them by velocities as they are read."""
    seen = Mixed(sim)
    return seen.m @ sim.plan.state.v.numpy().astype(np.float64) + (seen.mass[:, None] * seen.speeds)[seen.near].sum(0)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_velocities_that_are_read_have_all_momentum_in_each_frame(way, rest):
    """Points of leapfrog are read behind a last half kick, without what their bodies take back of it."""
    sim = run(scene(ball("/ball", (0.03, 0.16, 0.02), 0.15, velocity=(0.0, -2.0, 0.3), mass=0.2, rest=rest), gravity=FREE,
                    **by(way)))
    before = read(sim)
    for _ in range(5):
        sim.step()
        assert np.abs(read(sim) - before).max() < 1e-6 * Mixed(sim).moved


def energy(sim) -> float:
    """Kinetic energy [J] of points and bodies near them, as they are read, and what the sheet stores where that is said."""
    seen, v = Mixed(sim), sim.plan.state.v.numpy().astype(np.float64)
    indicators = sim.indicators()
    method = sim.plan.method("rigid")
    bodies = 0.5 * seen.mass * (seen.speeds**2).sum(1) + 0.5 * (method.read("L") * seen.spins).sum(1)
    return float(0.5 * seen.m @ (v * v).sum(1) + bodies[seen.near].sum() + indicators.get("elastic_energy", 0.0))


@pytest.mark.parametrize("way", WAYS)
def test_a_ball_without_restitution_and_friction_gives_a_sheet_no_more_energy_than_it_has(way):
    one = ball("/ball", (0.03, 0.16, 0.02), 0.15, velocity=(0.0, -2.0, 0.3), mass=0.2, rub=0.0)
    sim = run(scene(one, gravity=FREE, rub=0.0, **by(way)))
    first = energy(sim)
    for _ in range(8):
        sim.step()
        assert energy(sim) < first * (1.0 + 1e-5)
    assert energy(sim) > 0.2 * first


@pytest.mark.parametrize("way", ["xpbd", "xpbd bdf2", "leapfrog"])
def test_an_elastic_blow_keeps_energy(way):
    """A flat box on a plate of points, restitution 1: to 1 %."""
    sim = run(scene(box("/box", (0.0, 0.23, 0.0), (0.6, 0.2, 0.6), rest=1.0, velocity=(0.0, -1.5, 0.0), mass=0.6, rub=0.0),
                    gravity=FREE, rub=0.0, **by(way)))
    sim.run(4)
    seen = Mixed(sim)
    assert seen.speeds[seen.near][0, 1] == pytest.approx(-1.5 * (0.6 - 0.2) / (0.6 + 0.2), rel=1e-3)
    assert energy(sim) == pytest.approx(0.5 * 0.6 * 1.5**2, rel=1e-2)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("ratio", [0.01, 1.0, 100.0])
def test_what_a_ball_gives_a_sheet_it_has_lost(way, ratio):
    """To 1e-6 of all momentum in float32, whatever integrates the points; the sheet weighs 0.2 kg."""
    sim = run(scene(ball("/ball", (0.03, 0.16, 0.02), 0.15, velocity=(0.0, -2.0, 0.3), mass=0.2 * ratio), gravity=FREE,
                    **by(way)))
    before = Mixed(sim)
    sim.run(8)
    after = Mixed(sim)
    given = np.abs(after.p - before.p)[after.near].max()
    assert given > 1e-2 * min(1.0, ratio) * 0.2 and np.abs(after.momentum - before.momentum).max() < 1e-6 * after.moved
    assert np.abs(after.p - before.p)[~after.near].max() == 0.0


def test_a_blow_without_rebound_leaves_one_velocity():
    """A plate of points as heavy as the box that falls on it, flat: m v / (m + M) for both."""
    sim = run(scene(box("/box", (0.0, 0.23, 0.0), (0.6, 0.2, 0.6), velocity=(0.0, -1.5, 0.0), mass=0.6), gravity=FREE))
    sim.run(4)
    seen, total = Mixed(sim), 0.2 + 0.6
    assert np.abs(seen.v[:, 1] + 1.5 * 0.6 / total).max() < 2e-6
    assert np.abs(seen.speeds[seen.near][0] - (0.0, -1.5 * 0.6 / total, 0.0)).max() < 2e-6


@pytest.mark.parametrize("way", ["xpbd", "xpbd bdf2", "leapfrog"])
def test_a_blow_that_rebounds_keeps_a_part_of_the_speed(way):
    """Newton's law: relative speed e = 0.6 of what it was, and momentum."""
    sim = run(scene(box("/box", (0.0, 0.23, 0.0), (0.6, 0.2, 0.6), rest=0.6, velocity=(0.0, -1.5, 0.0), mass=0.6), gravity=FREE,
                    **by(way)))
    sim.run(4)
    seen = Mixed(sim)
    away = seen.speeds[seen.near][0, 1] - seen.m @ seen.v[:, 1] / seen.m.sum()
    assert away == pytest.approx(0.6 * 1.5, rel=1e-4)
    assert seen.momentum[1] == pytest.approx(-1.5 * 0.6, rel=1e-6)


@pytest.mark.parametrize("v", [0.3, 0.35])
def test_friction_slows_a_box_by_mu_of_what_presses(v):
    """Over a plate of points a million times as heavy: v - mu F t / m, until it rests after v^2 m / (2 mu F). Rounding decides
    which of them bear it: a star that got stuck there threw the box up, at 1.1 m/s where it began with 0.35."""
    mu, mass, force = 0.3, 2.0, 8.0
    one = box("/box", (0.0, 0.1005, 0.0), (0.6, 0.1, 0.6), rub=mu, velocity=(v, 0.0, 0.0), mass=mass, force=(0.0, -force, 0.0))
    sim = run(scene(one, gravity=FREE, rub=mu, density=1e9))
    for _ in range(9):
        sim.step()
        assert np.abs(Mixed(sim).speeds[0, 1:]).max() < 1e-4
    assert Mixed(sim).speeds[0, 0] == pytest.approx(v - mu * force / mass * 9 / 60, rel=5e-3)
    sim.run(18)
    seen = Mixed(sim)
    assert np.abs(seen.speeds[0]).max() < 1e-4
    assert seen.x[0, 0] == pytest.approx(v * v * mass / (2.0 * mu * force), rel=1e-2)


@pytest.mark.parametrize("way", ["xpbd", "leapfrog"])
def test_nothing_passes_at_twenty_metres_a_second(way):
    """A ball of 10 cm, a frame's way 33 cm, into a pinned sheet whose points are 6 cm apart."""
    more = {} if way == "xpbd" else {"substeps": 60}
    sim = run(scene(ball("/ball", (0.01, 0.3, 0.02), 0.1, velocity=(0.0, -20.0, 0.0), mass=0.1), pinned=True, n=17,
                    stretch=1e4 if way == "xpbd" else 3e3, **by(way) | more))
    lowest = 0.0
    for _ in range(12):
        sim.step()
        seen = Mixed(sim)
        lowest = min(lowest, seen.x[0, 1])
        assert seen.fastest < 30.0
    assert lowest < -0.05 and seen.speeds[0, 1] > 1.0


@pytest.mark.parametrize("ratio", [0.01, 1.0, 100.0])
def test_a_ball_in_a_sheet_comes_to_rest(ratio):
    """Of 1/100 to 100 times its weight; still to 1 mm/s, and energy is never gained."""
    one = ball("/ball", (0.013, 0.2, 0.008), 0.15, mass=0.2 * ratio, drag=3.0, spin_drag=3.0)
    sim = run(scene(one, pinned=True, stretch=2e4 if ratio > 1.0 else 1e3, damping=2e-3, n=17, air_drag=2.0))
    rises = []
    for _ in range(360):
        sim.step()
        rises.append(Mixed(sim).x[0, 1])
    for _ in range(20):
        sim.step()
        assert Mixed(sim).fastest < 1e-3
    assert max(rises[100:]) < 0.2 and abs(rises[-1] - rises[-40]) < 1e-4


def test_runs_are_the_same_to_the_bit():
    def end():
        sim = run(scene(ball("/ball", (0.03, 0.16, 0.02), 0.15, velocity=(0.0, -2.0, 0.0), mass=1.0), pinned=True))
        sim.run(6)
        return b"".join(a.numpy().tobytes() for part in sim.plan.state.parts.values() for a in part.arrays.values())
    assert end() == end()
