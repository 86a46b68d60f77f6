"""What the air carries: shapes that turn, smoke that stays, what sources give."""

import numpy as np
import pytest

from tests.physics.fluid.flows import box, method, put
from wsim.physics.fluid.objects import Source
from wsim.scene import Motion
from wsim.scene.curve import Curve
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation


def turned(n: int, start: np.ndarray, scheme: str, courant: float = 0.25) -> np.ndarray:
    """A scalar after one turn of the air about the middle of a box of 1 m, on cells (n, n); the rim crosses `courant` cells a
    step."""
    scene = box((n, n), size=1.0, sides=("closed",) * 6, smoke=start[..., None], scalar_advection=scheme)
    sim = Simulation(scene, device="cpu")
    put(sim, lambda axis, x, y, z: 2.0 * np.pi * ((0.5 - y) if axis == 0 else (x - 0.5)))
    sim.load()
    m = method(sim)
    m.before_frame(0.0, sim.plan.clock)
    domain, steps = m.domains[0], round(np.pi * n / courant)
    domain.clock.assign(np.array([1.0 / steps, 0.0, steps, 1.0], np.float32))
    if domain.tiles:
        domain.tiles.mark()
    for _ in range(steps):
        domain._carry_scalars(domain.u)
    return m.arrays(0)["smoke"][..., 0]


def middles(n: int) -> np.ndarray:
    x = (np.arange(n) + 0.5) / n
    return np.stack(np.meshgrid(x, x, indexing="ij"))


def zalesak(n: int) -> np.ndarray:
    """The slotted disk (Zalesak 1979): radius 0.15 about (0.5, 0.75), a slot 0.05 wide and 0.25 deep."""
    x, y = middles(n)
    disk = (x - 0.5) ** 2 + (y - 0.75) ** 2 < 0.15 ** 2
    return (disk & ~((np.abs(x - 0.5) < 0.025) & (y < 0.85))).astype(float)


def blob(n: int) -> np.ndarray:
    x, y = middles(n)
    return np.exp(-((x - 0.5) ** 2 + (y - 0.7) ** 2) / (2 * 0.07 ** 2))


@pytest.mark.parametrize(("scheme", "courant", "most"), [
    ("cubic", 1.5, 0.296), *(pytest.param(*row, marks=pytest.mark.slow) for row in (
        ("cubic", 0.25, 0.385), ("maccormack", 1.5, 0.54), ("bfecc", 0.25, 0.57), ("maccormack", 0.25, 0.67)))])
def test_the_slotted_disk_after_a_turn(scheme, courant, most):
    """Sum of what is wrong over the sum of the disk, after 268 steps, or 1608, which interpolate as often; `linear` has 1.11.
    Cubics through four rows kept within the four around, along circles that are exact, end 0.382 off in NumPy after 1608, so
    that no way back costs any of it."""
    start = zalesak(128)
    end = turned(128, start, scheme, courant)
    assert np.abs(end - start).sum() / start.sum() <= most
    assert end.min() >= -1e-6 and end.max() <= 1.0 + 1e-6


@pytest.mark.parametrize(("scheme", "most"), [("cubic", 0.0436), ("bfecc", 0.145), ("maccormack", 0.19)])
def test_a_smooth_blob_after_a_turn(scheme, most):
    """The same in NumPy: 0.0432."""
    start = blob(64)
    end = turned(64, start, scheme)
    assert np.abs(end - start).sum() / start.sum() <= most


def test_a_source_gives_what_it_says():
    """Smoke of 2 /s and 30 K/s in a ball for half of a second, then less and less for as long; heat that does not lift."""
    scene = box((32, 32, 32), size=1.0, sides=("closed",) * 6, seconds=1.0, frames=4, lift=0.0, steps=2)
    strength = Curve(np.array([0.0, 0.5, 1.0]), np.array([1.0, 1.0, 0.0]))
    scene.add(Source("/ball", Sphere(0.2), smoke=2.0, temperature=30.0, strength=strength, motion=Motion.at_place((0.5,) * 3)))
    sim = Simulation(scene, device="cpu")
    sim.run()
    now, volume = method(sim).arrays(0), 4.0 / 3.0 * np.pi * 0.2 ** 3
    assert now["smoke"].max() == pytest.approx(1.5, rel=1e-5)
    assert now["heat"].max() == pytest.approx(22.5, rel=1e-5)
    assert sim.indicators()["fluid_smoke"] == pytest.approx(1.5 * volume, rel=0.01)


def test_decay_is_exact():
    start = np.ones((16, 16, 1))
    scene = box((16, 16), size=1.0, sides=("closed",) * 6, seconds=0.5, smoke=start, temperature=40.0 * start, smoke_decay=2.0,
                cooling=3.0, lift=0.0, steps=3)
    sim = Simulation(scene, device="cpu")
    sim.step()
    now = method(sim).arrays(0)
    assert now["smoke"] == pytest.approx(np.exp(-1.0), rel=1e-5) and now["heat"] == pytest.approx(40.0 * np.exp(-1.5), rel=1e-5)


def plume(n: int, *, precision: str = "float32", **more) -> Simulation:
    """A ball of warm smoke that rises for 2 s in a closed box of 1 m."""
    x, y = middles(n)
    ball = 1.0 / (1.0 + np.exp((np.hypot(x - 0.5, y - 0.3) - 0.12) / 0.02))[..., None]
    scene = box((n, n), size=1.0, sides=("closed",) * 6, seconds=2.0, frames=8, gravity=(0.0, -9.81, 0.0), smoke=ball,
                temperature=15.0 * ball, **more)
    return Simulation(scene, device="cpu", precision=precision)


@pytest.mark.parametrize(("n", "most"), [(64, 0.015), pytest.param(128, 0.01, marks=pytest.mark.slow)])
def test_smoke_stays(n, most):
    """What a closed box holds of it after a ball of it has rolled up; clamped cubic conserves nothing by itself."""
    sim = plume(n)
    before = sim.indicators()["fluid_smoke"]
    sim.run()
    assert sim.indicators()["fluid_speed"] > 0.2
    assert sim.indicators()["fluid_smoke"] == pytest.approx(before, rel=most)


@pytest.mark.parametrize(("precision", "most"), [("float32", 1e-6), ("float64", 1e-13)])
def test_what_is_conserved_stays_to_rounding(precision, most):
    """Smoke and heat of the same ball, and no more of either anywhere than there was: without, smoke is 1 % off."""
    sim = plume(64, conserve=True, precision=precision)
    before = {name: method(sim).arrays(0)[name] for name in ("smoke", "heat")}
    sim.run()
    assert sim.indicators()["fluid_speed"] > 0.2
    for name, was in before.items():
        now = method(sim).arrays(0)[name]
        assert now.sum() == pytest.approx(was.sum(), rel=most)
        assert now.max() <= was.max() * (1.0 + 1e-3) and now.min() >= -1e-3 * was.max()


def test_a_plume_is_its_own_mirror_image():
    """To what rounding grows to in 2 s: clamps turn it into choices."""
    sim = plume(64)
    sim.run()
    now = method(sim).arrays(0)
    assert np.abs(now["smoke"] - now["smoke"][::-1]).max() < 2e-3
    assert np.abs(now["u"] + now["u"][::-1]).max() < 2e-3 * np.abs(now["u"]).max()


def test_runs_are_the_same_to_the_bit():
    ends = []
    for _ in range(2):
        sim = plume(32, vorticity=0.5, viscosity=1e-4)
        sim.run(3)
        ends.append(method(sim).arrays(0))
    assert all(np.array_equal(ends[0][name], ends[1][name]) for name in ends[0])


def test_a_run_goes_on_from_its_fields_to_the_bit():
    whole, first, second = plume(32), plume(32), plume(32)
    whole.run(4)
    first.run(2)
    second.restart(2, {"/fluid": first.fields("/fluid")})
    second.run(2)
    ends = [method(sim).arrays(0) for sim in (whole, second)]
    assert all(np.array_equal(ends[0][name], ends[1][name]) for name in ends[0])


def test_layers_of_warm_air_at_rest_stay_at_rest():
    """Hydrostatic: heat that grows with height is held by the pressure alone."""
    y = middles(32)[1][..., None]
    scene = box((32, 32), size=1.0, sides=("closed",) * 6, seconds=1.0, frames=4, gravity=(0.0, -9.81, 0.0),
                temperature=30.0 * y, steps=4, tolerance=1e-6)
    sim = Simulation(scene, device="cpu")
    sim.run()
    assert sim.indicators()["fluid_speed"] < 1e-5
