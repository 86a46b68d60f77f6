"""The solve of the pressure by itself: what divergence a random velocity is left with, and after how many iterations."""

import numpy as np
import pytest

from tests.physics.fluid.flows import box, method
from wsim.physics.fluid.measure import fluid_cell_divergence
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation

SIDES = {"closed": ("closed",) * 6, "open": ("open",) * 6, "periodic": ("periodic",) * 6,
         "mixed": ("closed", "open", "periodic", "periodic", "closed", "closed")}


def solved(n, sides: str, pressure: str, *, ball: bool = False, precision: str = "float32", tolerance: float = 1e-6):
    """(divergence left over that before, iterations of the device)."""
    scene = box(n, size=1.0, sides=SIDES[sides], pressure=pressure, tolerance=tolerance)
    if ball:
        scene.collider("/ball", Sphere(0.19), at=(0.47, 0.5, 0.5))
    sim = Simulation(scene, device="cpu", precision=precision)
    sim.load()
    m = method(sim)
    m.before_frame(0.0, sim.plan.clock)
    domain, layout, rng = m.domains[0], m.layouts[0], np.random.default_rng(1)
    for a in range(layout.dim):
        u = rng.standard_normal(layout.faces(a))
        if not layout.periodic[a]:
            ends = np.moveaxis(u, a, 0)
            ends[0] *= layout.low[a] > 0.0
            ends[-1] *= layout.high[a] > 0.0
        m.field(0, "uvw"[a]).assign(u.ravel().astype(sim.model.dtype))
    before = fluid_cell_divergence(domain.fluid, layout, m.arrays(0), domain.obstacles)
    domain.pressure.solve(domain.u)
    domain.pressure.project(domain.u, domain.u)
    after = fluid_cell_divergence(domain.fluid, layout, m.arrays(0), domain.obstacles)
    assert domain.words["missed"].numpy()[0] == 0
    return np.linalg.norm(after) / np.linalg.norm(before), int(domain.words["solves"].numpy()[1])


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("n", [(64, 64), (128, 128), (32, 32, 32), (36, 20, 28)])
@pytest.mark.parametrize("sides", SIDES)
def test_a_multigrid_cycle_takes_seven_iterations_to_1e_6(n, sides, ball):
    if sides in ("periodic", "mixed") and 36 in n:
        n = (36, 20, 24) if sides == "periodic" else (36, 32, 28)
    left, iterations = solved(n, sides, "multigrid", ball=ball)
    assert iterations <= 7
    assert left < 4e-6              # float32 subtracts the gradient of a pressure as large as the velocity


def test_a_finer_box_takes_no_more():
    counts = [solved((n, n), "closed", "multigrid")[1] for n in (32, 64, 128, 256)]
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("n", [(50, 34), (20, 32, 26)])
def test_a_direct_solve_ends_at_once(n, sides):
    left, iterations = solved(n, sides, "direct")
    assert iterations <= 2
    assert left < 4e-6


def test_float64_goes_as_far_as_it_is_asked_to():
    for how in ("multigrid", "direct"):
        left, iterations = solved((24, 24, 24), "open", how, precision="float64", tolerance=1e-12)
        assert left < 1e-12 and iterations <= (10 if how == "multigrid" else 2)
