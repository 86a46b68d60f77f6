"""Sealed regions that are found on the device: those of the host, and air that a piston moves in a box without outlet."""

import numpy as np
import pytest

from tests.make.physics.fluid.pressure.islands import piston, stretched
from tests.physics.fluid.flows import method
from tests.physics.fluid.liquid import tanks
from wsim.physics.fluid.grid.pressure import label_sealed_regions
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("n", [(32, 16), (32, 8, 8)])
@pytest.mark.parametrize("right", ["closed", "open"])
def test_air_on_both_sides_of_a_piston_stretches_evenly(n, right):
    assert stretched(n, right, "cpu") < 2e-4


@pytest.mark.parametrize(("n", "sides"), [((24, 37), ("closed",) * 6), ((12, 9, 8), ("closed", "open", *("closed",) * 4)),
                                          ((12, 9, 8), ("periodic", "periodic", *("closed",) * 4))])
def test_regions_are_those_of_the_host(n, sides):
    """Openings at random, of which most are shut; what a right-hand side sums to in each is nothing then."""
    sim = piston(n, sides)
    sim.load()
    method(sim).before_frame(0.0, sim.plan.clock)
    domain = method(sim).domains[0]
    pressure, rng = domain.pressure, np.random.default_rng(3)
    openings = [(rng.random(size) > 0.6).astype(np.float32) for size in domain.sizes]
    for name, values in zip("xyz", openings, strict=False):
        getattr(pressure.open, name).assign(values)
    pressure.multigrid.refresh()
    pressure.find_region()
    found = pressure.islands.forest.label.numpy()
    vented = pressure.islands.forest.vented.numpy()
    shut = np.where((found >= 0) & (vented[np.maximum(found, 0)] == 0), found, -1)
    expected, count = label_sealed_regions(domain.layout, openings)
    roots = np.unique(shut[shut >= 0])
    assert len(roots) == count > 2
    assert np.array_equal(np.where(shut >= 0, np.searchsorted(roots, shut), -1), expected)
    b = rng.normal(size=domain.layout.cells).astype(np.float32)
    pressure.r.assign(b)
    pressure.solver.sum(pressure.r, pressure.r)
    pressure.islands.level(pressure.r, pressure.solver.part)
    now = pressure.r.numpy().astype(np.float64)
    for k in range(count):
        inside = expected == k
        assert now[inside] == pytest.approx(b[inside] - b[inside].astype(np.float64).mean(), abs=2e-7)
    assert np.array_equal(now[expected < 0], b[expected < 0])


def test_liquid_that_walls_part_from_all_air_has_a_pressure():
    """Two cells with one open face between them and no other: 1 comes out of one and 2 out of the other. No pressure answers
    the sum of both, which is taken off, 1.5 each; then 2 p - 2 p' = 1 - 2."""
    scene = tanks.tank((8, 8), ((0.0, 0.0), (0.25, 0.125)))
    scene.collider("/post", Box((0.02, 0.02, 1.0)), at=(0.2, 0.2, 0.0))
    sim = Simulation(scene, device="cpu")
    sim.step()
    surface = tanks.method(sim).domains[0].surface
    phi, right = -np.ones((8, 8), np.float32), np.zeros((8, 8), np.float32)
    phi[:3] = 1.0                                              # air elsewhere, so that the box is not full
    x, y = np.ones((9, 8), np.float32), np.ones((8, 9), np.float32)
    x[5:7, 5:7] = y[5, 5:8] = 0.0
    y[5, 6], right[5, 5:7] = 1.0, (1.0, 2.0)
    for array, values in ((surface.phi, phi), (surface.open.x, x), (surface.open.y, y)):
        array.assign(values.ravel())
    surface.refresh()
    surface.r.assign(right.ravel())
    surface._solve_pressure(1e-4)
    p = surface.p.numpy().reshape(8, 8)
    assert np.isfinite(p).all() and np.abs(p).max() < 10.0
    assert p[5, 6] - p[5, 5] == pytest.approx(0.5, abs=1e-3)
