"""Flows with a known answer: how far from it grids of each size end, and how fast that falls."""

import numpy as np
import pytest

from tests.physics.fluid.flows import CAVITY, TURN, abc, box, error, method, put, run, taylor_green
from wsim.simulation.simulation import Simulation


def test_vortices_of_taylor_and_green_stay_by_reflection():
    assert error(run((64, 64), taylor_green()), taylor_green()) <= 2e-4


@pytest.mark.parametrize(("scheme", "found"), [("linear", 5.12e-2), ("cubic", 3.41e-2), ("maccormack", 3.40e-2),
                                               ("bfecc", 3.42e-2)])
def test_other_schemes_lose_to_the_projection_what_reflection_keeps(scheme, found):
    assert error(run((64, 64), taylor_green(), advection=scheme), taylor_green()) == pytest.approx(found, rel=0.01)


def test_a_flow_that_changes_is_followed_to_order_two():
    errors = [error(run((n, n), taylor_green(0.7)), taylor_green(0.7, 2.0)) for n in (32, 64)]
    assert np.log2(errors[0] / errors[1]) > 1.9
    assert errors[1] < 2e-3


def test_a_beltrami_flow_stays_in_three_dimensions():
    assert error(run((32, 32, 32), abc, seconds=1.0, fastest=2.0), abc) <= 1.2e-3


def test_a_flat_fluid_is_the_same_in_every_plane():
    def turned(axes):
        return lambda axis, x, y, z: taylor_green()(axis, x, y, z)
    flat = [method(run(n, turned(n))).arrays(0) for n in ((16, 16, 1), (16, 1, 16))]
    assert np.array_equal(flat[0]["u"], flat[1]["u"]) and np.array_equal(flat[0]["v"], flat[1]["v"])


def pair(axis, x, y, z, n=64):
    """Two Gaussian vortices of radius 0.12 m and opposite sign in a closed box of 1 m, from a stream function."""
    def psi(x, y):
        two = sum(s * np.exp(-((x - 0.5 - s * 0.12) ** 2 + (y - 0.3) ** 2) / 0.015) for s in (1.0, -1.0))
        return 0.06 * two * np.sin(np.pi * x) * np.sin(np.pi * y)
    e = 0.5 / n
    return (psi(x, y + e) - psi(x, y - e)) / (2 * e) if axis == 0 else -(psi(x + e, y) - psi(x - e, y)) / (2 * e)


@pytest.mark.parametrize(("scheme", "least", "most"), [("reflection", 0.97, 1.0), ("cubic", 0.3, 0.5)])
def test_a_pair_of_vortices_keeps_its_energy_in_long_steps(scheme, least, most):
    """Air of 0.6 m/s crosses four cells in each of 19 steps."""
    sim = Simulation(box((64, 64), size=1.0, sides=("closed",) * 6, tolerance=1e-6, steps=19, advection=scheme), device="cpu")
    put(sim, pair)
    before = sim.indicators()["fluid_energy"]
    sim.step()
    assert least <= sim.indicators()["fluid_energy"] / before <= most


@pytest.mark.parametrize("nu", [0.05, 0.01])
def test_viscosity_slows_vortices_at_the_rate_of_theory(nu):
    """Energy of Taylor and Green's vortices falls as exp(-4 nu t)."""
    sim = run((64, 64), taylor_green(), viscosity=nu)
    before = 0.5 * 1.2 * (TURN / 64) ** 3 * 64 * 64 * 0.5
    assert -np.log(sim.indicators()["fluid_energy"] / before) / 2.0 == pytest.approx(4.0 * nu, rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize(("Re", "n", "seconds", "layers"), [(100, 64, 15, False), (400, 128, 30, True), (1000, 128, 60, True)])
def test_a_lid_drives_air_round_a_cavity(Re, n, seconds, layers):
    """When nothing changes any more; the extremum of a parabola through three faces."""
    lid = np.zeros((6, 3))
    lid[3, 0] = 1.0
    sim = Simulation(box((n, n), size=1.0, seconds=seconds, frames=seconds, sides=("closed",) * 6, side_velocities=lid,
                         slip=False, layers=layers, viscosity=1.0 / Re, steps=n // 2), device="cpu")
    sim.run()
    now = method(sim).arrays(0)
    u, v = now["u"][n // 2, :, 0], now["v"][:, n // 2, 0]

    def least(a):
        k = int(np.argmin(a))
        low, middle, high = a[k - 1:k + 2]
        return middle - (low - high) ** 2 / (8.0 * (low - 2.0 * middle + high))
    assert (least(u), -least(-v), least(v)) == pytest.approx(CAVITY[Re], rel=0.01)
