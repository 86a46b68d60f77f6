"""Sealed regions that are found on the device: those of the host, and air that a piston moves in a box without outlet."""

import numpy as np
import pytest

from tests.physics.fluid.flows import box, method
from wsim.physics.fluid.grid.pressure import label
from wsim.scene import Motion
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation


def piston(n: tuple[int, ...], sides, frames: int = 2, device: str = "cpu") -> Simulation:
    """A wall of 12 cells across a box of 1 m, ends in the middle of cells, goes by a cell a frame, at 1 m/s."""
    scene = box(n, size=1.0, seconds=frames / n[0], frames=frames, sides=sides, steps=1)
    M = np.tile(np.eye(4), (2, 1, 1))
    M[:, :3, 3] = np.array([0.5 + np.array([0.5, 0.5 + frames]) / n[0], [0.5] * 2, [0.5] * 2]).T
    scene.collider("/piston", Box((6.0 / n[0], 2.0, 2.0)), motion=Motion(np.array([0.0, frames / n[0]]), M))
    return Simulation(scene, device=device)


def stretched(n: tuple[int, ...], right: str, device: str) -> float:
    """How far u is from x / L between wall and piston, which alone has that divergence; as one to an open side."""
    sim = piston(n, ("closed", right, *("closed",) * 4), device=device)
    sim.run()
    u, face = method(sim).arrays(0)["u"], np.arange(n[0] + 1)
    left, beyond = n[0] // 2 - 6 + 3, n[0] // 2 + 6 + 2               # first and last face that it shuts
    beside = (n[0] - face) / (n[0] - beyond) if right == "closed" else np.ones(n[0] + 1)
    expected = np.where(face <= left, face / left, np.where(face >= beyond, beside, 1.0))
    return float(np.abs(u - expected[:, None, None]).max())


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
    expected, count = label(domain.layout, openings)
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
