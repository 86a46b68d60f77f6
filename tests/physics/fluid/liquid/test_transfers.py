"""Transfers between particles and grid: what they keep, and what they lose."""

import numpy as np
import pytest

from tests.physics.fluid.liquid.tanks import method, momenta, particles, put, ready, tank, to_grid, to_particles
from wsim.physics.fluid.liquid.objects import LiquidSource
from wsim.scene import Motion
from wsim.scene.solids import Sphere

CELL = 1.0 / 32.0
MIDDLE = np.array([0.5, 0.5])


def blob(transfer: str, precision: str = "float32", turning: bool = True, **more):
    """A disk of liquid of 6 cells about the middle of a box, that turns by 1 rad/s."""
    scene = tank((32, 32), [(0, 0), (0.01, 0.01)], transfer=transfer, **more)
    scene.objects["LiquidSource"] = [LiquidSource("/blob", Sphere(6 * CELL), Motion.at_place((0.5, 0.5, 0.5 * CELL)))]
    sim = ready(scene, precision=precision)
    x = particles(sim)["x"][:, :2] - MIDDLE
    put(sim, np.stack([-x[:, 1], x[:, 0]], 1) if turning else np.random.default_rng(1).standard_normal(x.shape))
    return sim


def turned(sim) -> float:
    """Angular momentum about the middle of the box."""
    p, turn, _ = momenta(sim)
    return turn - (MIDDLE[0] * p[1] - MIDDLE[1] * p[0]) / CELL


def kept(transfer: str, precision: str = "float32", times: int = 200, **more) -> float:
    """Part of the angular momentum on the grid that is there after so many transfers and back."""
    sim = blob(transfer, precision, **more)
    to_grid(sim)
    first = turned(sim)
    for _ in range(times):
        to_particles(sim)
        to_grid(sim)
    return turned(sim) / first


@pytest.mark.parametrize("precision, bound", [("float32", 1e-6), ("float64", 1e-13)])
def test_apic_keeps_angular_momentum(precision, bound):
    assert abs(kept("apic", precision) - 1.0) < bound


@pytest.mark.slow
def test_pic_loses_it_and_flip_a_part():
    """After 200 transfers pic has a tenth left."""
    pic, flip = kept("pic"), kept("flip", flip=0.99)
    assert pic < 0.2 and pic < flip < 0.999


@pytest.mark.parametrize("transfer", ["apic", "flip", "pic"])
def test_momentum_on_the_grid_is_that_of_the_particles(transfer):
    """Of velocities at random, to rounding; so is their number."""
    sim = blob(transfer, "float64", turning=False)
    to_grid(sim)
    for _ in range(5):
        to_particles(sim)
        to_grid(sim)
    p, _, _ = momenta(sim)
    v = particles(sim)["v"]
    assert np.abs(p - v.sum(0)[:2]).max() < 1e-12 * np.abs(v).sum()
    assert all(abs(m.numpy().sum() - len(v)) < 1e-9 * len(v) for m in method(sim).domains[0].mass)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_linear_velocity_comes_back_as_it_was(dim):
    """Exact of apic, to rounding: hats carry linear functions, and C is their gradient."""
    n, low = (12, 10, 8)[:dim], 0.1
    high = [c * CELL - low for c in n]
    sim = ready(tank(n, [(low,) * dim, high], transfer="apic"), precision="float64")
    A = np.random.default_rng(3).standard_normal((dim, dim))
    x = particles(sim)["x"][:, :dim]
    put(sim, x @ A.T)
    part = method(sim).parts[0]
    C = np.zeros((part.capacity, 3, 3))
    C[:, :dim, :dim] = A
    part.arrays["C"].assign(C)
    to_grid(sim)
    to_particles(sim)
    assert np.abs(particles(sim)["v"][:, :dim] - x @ A.T).max() < 1e-12
    assert np.abs(part.arrays["C"].numpy() - C).max() < 1e-11


def test_particles_of_a_cell_are_its_own_in_ascending_order():
    """Counting sort: every particle once, those of a cell in their order."""
    sim = ready(tank((16, 12, 8), [(0, 0, 0), (0.3, 0.2, 0.2)]))
    d, part = method(sim).domains[0], method(sim).parts[0]
    rng = np.random.default_rng(5)
    x = rng.uniform(0, 1, (part.capacity, 3)) * np.array([16, 12, 8]) * CELL
    part.arrays["x"].assign(x.astype(np.float32))
    d.order.sort(d.particles)
    first, order = d.order.first.numpy(), d.order.order.numpy()
    i = np.minimum((part.arrays["x"].numpy() / np.float32(CELL)).astype(int), [15, 11, 7])
    cell = (i[:, 0] * 12 + i[:, 1]) * 8 + i[:, 2]
    assert np.array_equal(order, np.argsort(cell, kind="stable"))
    assert np.array_equal(np.diff(first), np.bincount(cell, minlength=16 * 12 * 8))
