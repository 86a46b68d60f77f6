"""A liquid against theory: at rest, in free fall, behind a dam; what it keeps."""

import numpy as np
import pytest

from tests.physics.fluid.liquid.tanks import GRAVITY, method, particles, tank
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation

G = 9.81


def run(scene, frames: int, **more) -> Simulation:
    sim = Simulation(scene, device="cpu", **more)
    for _ in range(frames):
        sim.step()
    return sim


@pytest.mark.parametrize("n, top, bound", [((32, 32), 0.5, 1e-5), ((32, 32), 15.0 / 64.0, 1e-5),
                                           ((8, 16, 8), 0.3125, 1e-5)])
def test_a_column_at_rest_stays_at_rest(n, top, bound):
    """Speed over that of a fall through its height, to the tolerance; the surface is at faces or between."""
    edge = [c / 32.0 for c in n]
    sim = run(tank(n, [(0,) * len(n), (edge[0], top, *edge[2:])], tolerance=1e-6), 12)
    said = sim.indicators()
    assert said["liquid_speed"] < bound * np.sqrt(2 * G * top) and said["liquid_iterations"] <= 8
    thick = edge[2] if len(n) == 3 else 1.0 / 32.0
    assert said["liquid_volume"] == pytest.approx(edge[0] * top * thick, rel=1e-3)


def test_the_pressure_is_that_of_the_weight_above():
    """rho g depth in the cells' centres, linear to the tolerance; p is pressure times h / (rho dx)."""
    sim = run(tank((16, 16), [(0, 0), (0.5, 0.375)], tolerance=1e-6, volume=False), 2, precision="float64")
    domain = method(sim).domains[0]
    p = domain.surface.p.numpy().reshape(16, 16) / domain.clock.numpy()[0] / 32
    depth = 0.375 - (np.arange(16) + 0.5) / 32
    assert np.abs(p - G * np.maximum(depth, 0.0)).max() < 1e-4 * G * 0.375


@pytest.mark.parametrize("transfer", ["apic", "flip", "pic"])
def test_free_fall_is_exact(transfer):
    """A drop that moves and falls keeps its shape to rounding, and falls as steps of u += h g, x += h u say."""
    drop = tank((32, 64), [(0.25, 1.5), (0.5, 1.75)], velocity=(0.5, 0.0, 0.0), transfer=transfer, steps=2)
    sim = Simulation(drop, device="cpu", precision="float64")
    x0, frames = particles(sim)["x"], 8
    for _ in range(frames):
        sim.step()
    found, k, h = particles(sim), 2 * frames, 1.0 / 48.0
    way = np.array([0.5 * k * h, -G * h * h * k * (k + 1) / 2])
    assert np.abs(found["x"][:, :2] - x0[:, :2] - way).max() < 1e-10
    assert np.abs(found["v"][:, :2] - np.array([0.5, -G * k * h])).max() < 1e-10


@pytest.mark.slow
def test_the_front_of_a_dam_is_that_of_ritter():
    """Ritter 1892: behind a long reservoir of depth H the front runs at 2 sqrt(g H), once what falls has turned, and through
    the dam pass 8/27 sqrt(g) H^1.5 a second."""
    m, long, times = 12, 5, 36
    scene = tank((13 * m, 16), [(0, 0), (long, 1)], cell=1.0 / m, frames=times, fps=np.sqrt(G) / 0.1)
    sim = Simulation(scene, device="cpu")
    front, beyond = [], []
    for _ in range(times):
        sim.step()
        x = particles(sim)["x"][:, 0]
        front.append(x.max() - long)
        beyond.append(np.count_nonzero(x > long) / (2 * m) ** 2)
    assert (front[-1] - front[24]) / 1.1 == pytest.approx(2.0, rel=0.05)
    assert (beyond[-1] - beyond[14]) / 2.1 == pytest.approx(8.0 / 27.0, rel=0.05)


MARTIN_MOYCE = np.array([(0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33), (2.20, 2.56),
                         (2.32, 2.78), (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.98, 3.67), (3.11, 3.89), (3.33, 4.11)])


@pytest.mark.slow
def test_a_column_that_collapses_spreads_as_in_the_experiment():
    """Martin and Moyce 1952, table 2 (n^2 = 2): x / a over t sqrt(2 g / a). Their membrane takes 0.28 of that time to go, which
    nothing here does; but for this one number the fronts agree within 5 %."""
    a, m, frames, span, late = 0.05715, 16, 62, 3.1, 0.28
    scene = tank((5 * m, 40), [(0, 0), (a, 2 * a)], cell=a / m, frames=frames, fps=frames / span * np.sqrt(2 * G / a))
    sim = Simulation(scene, device="cpu")
    front = [1.0]
    for _ in range(frames):
        sim.step()
        front.append(particles(sim)["x"][:, 0].max() / a)
    found = np.interp(MARTIN_MOYCE[:, 0] - late, np.linspace(0.0, span, frames + 1), front)
    assert np.abs(found / MARTIN_MOYCE[:, 1] - 1.0).max() < 0.05


def slosh(volume: bool) -> list[float]:
    """Volumes, over that at the start, of half a tank that falls into the other half, 4 s long."""
    scene = tank((32, 24), [(0, 0), (0.3, 0.5)], volume=volume, cell=1.0 / 32.0, frames=96)
    sim = Simulation(scene, device="cpu")
    found = []
    for _ in range(96):
        sim.step()
        found.append(sim.indicators()["liquid_volume"])
    whole = sim.indicators()["liquid_particles"] / (4 * 32 ** 3)
    return [v / whole for v in found]


@pytest.mark.slow
def test_the_volume_is_kept_and_is_lost_where_it_is_not_asked_for():
    kept, lost = slosh(True), slosh(False)
    assert np.mean(kept[-24:]) == pytest.approx(1.0, abs=0.02)
    assert np.mean(lost[-24:]) < 0.9


@pytest.mark.slow
def test_no_particle_is_lost_and_energy_is_not_won():
    sim = Simulation(tank((24, 16, 8), [(0, 0, 0), (0.25, 0.4, 0.25)]), device="cpu")
    first = sim.indicators()
    for _ in range(16):
        sim.step()
        now = sim.indicators()
        assert now["liquid_energy"] < first["liquid_energy"] * (1 + 1e-3)
    assert now["liquid_particles"] == first["liquid_particles"] and not sim.warnings
    x = particles(sim)["x"]
    assert np.isfinite(x).all() and (x >= 0).all() and (x <= np.array([24, 16, 8]) / 32.0).all()
    assert np.array_equal(particles(sim)["id"], np.arange(len(x)))


@pytest.mark.slow
def test_a_full_box_without_air_stays_as_it_is():
    sim = run(tank((16, 16), [(0, 0), (0.5, 0.5)]), 6)
    assert sim.indicators()["liquid_speed"] < 1e-3 and not sim.warnings


@pytest.mark.slow
def test_a_ball_in_a_pool_is_neither_wetted_nor_does_it_stir():
    scene = tank((32, 32), [(0, 0), (1, 0.5)])
    scene.collider("/ball", Sphere(0.12), at=(0.5, 0.25, 1 / 64))
    sim = run(scene, 24)
    away = np.linalg.norm(particles(sim)["x"] - np.array([0.5, 0.25, 1 / 64]), axis=1)
    assert away.min() > 0.12 - 1.0 / 32 / 16 and sim.indicators()["liquid_speed"] < 1e-2


def test_runs_are_the_same_to_the_bit_and_worlds_do_not_mix():
    scene = tank((24, 24), [(0, 0), (0.3, 0.6)])
    ends = [run(scene, 8) for _ in range(2)] + [run(scene, 8, worlds=2)]
    one = method(ends[0]).parts[0].arrays["x"].numpy()
    assert np.array_equal(one, method(ends[1]).parts[0].arrays["x"].numpy())
    assert all(np.array_equal(one, part.arrays["x"].numpy()) for part in method(ends[2]).parts)


def test_gravity_is_set_while_it_runs():
    sim = Simulation(tank((16, 16), [(0.1, 0.2), (0.3, 0.4)]), device="cpu")
    sim.set("/", "gravity", (0.0, 0.0, 0.0))
    sim.step()
    assert sim.indicators()["liquid_speed"] == 0.0
    sim.set("/", "gravity", GRAVITY)
    sim.step()
    assert sim.indicators()["liquid_speed"] == pytest.approx(G / 24, rel=1e-6)


def test_lengths_and_speeds_far_from_the_origin_are_as_near_it():
    """Places are from the domain's corner: a kilometre away it moves to the same bits."""
    near, far = (tank((16, 16), [(0, 0), (0.25, 0.375)]) for _ in range(2))
    for thing in far.things("Liquid"):
        thing.low, thing.high = thing.low + 1024.0, thing.high + 1024.0
    for thing in far.things("LiquidSource"):
        thing.motion.values[:, :3, 3] += 1024.0
    ends = [method(run(scene, 6)).parts[0].arrays["x"].numpy() for scene in (near, far)]
    assert np.array_equal(*ends)
