"""What is light between what is heavy: sweeps go on until it is not run through, and nothing has to be cut.

Flat sheets that meet without a bounce go on with the velocity of their centre of mass: v = sum m_k v_k / sum m_k.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.physics.contact.selfcontact.rig import SOLVERS, THIN, crossed, layers, run, said, solvers
from tests.physics.contact.selfcontact.test_momentum import moments

HEAVY, GAP = 2000.0, 8e-3                # times as heavy as the sheet between; [m]
LEAPFROG = pytest.param(SOLVERS["leapfrog"] | {"substeps": 80, "times": 3.0}, id="leapfrog")   # faster: short steps cut less


def squeezed(times: float = 1.0, **solver):
    """Three flat sheets, of which the first and the last come from either side, at 10 and 6 m/s, times a number; the middle one
    is finer."""
    scene = layers(3, 4, GAP, size=0.12, **solver)
    fine = layers(1, 13, GAP, size=0.11).cloths[0]
    scene.cloths[1] = replace(fine, path="/layer1", points=fine.points + (0.0, GAP, 0.0))
    for k, (cloth, v) in enumerate(zip(scene.cloths, (10.0, 0.0, -6.0), strict=True)):
        cloth.velocities = np.broadcast_to((0.0, times * v, 0.0), cloth.points.shape).copy()
        cloth.points[:] += (4e-3 * k, 0.0, 3e-3 * k)
        cloth.material = replace(THIN, stretch=100.0, shear=30.0, density=100.0 if k == 1 else 100.0 * HEAVY)
    return scene


@pytest.mark.parametrize("solver", first_and_slow([
    *solvers("newton", "xpbd", "xpbd bdf2", "newton bdf2", "newton midpoint"), LEAPFROG]))
def test_a_light_sheet_between_heavy_ones_takes_the_velocity_of_all(solver):
    """Along the blow within 2 % of the 16 m/s, or times 3, behind three frames, and as little across it, of which the formula
    says nothing (points lie beside points, so sheets are bent by the blow, and tremble: by BDF2 at 0.22 and 0.25 m/s);
    momentum to 1e-6; nothing cut, held or projected, but that tight steps of the midpoint may leave a pair to a projection (2;
    none with half as many steps, or twice)."""
    sim = run(squeezed(**solver))
    before, _, size, _ = moments(sim)
    mean = before / sim.model.stack("masses").sum()
    for _ in range(3):
        sim.step()
        assert crossed(sim) == 0
    told, few = said(sim), 4 * (solver.get("integrator") == "implicit_midpoint")
    assert told["cut"] == told["held"] == 0 and told["projected"] <= few, told
    assert np.abs(moments(sim)[0] - before).max() < 1e-6 * size
    for b in sim.model.bodies:
        off = sim.velocities(b.path).mean(axis=0) - mean
        assert max(abs(off[1]), np.hypot(off[0], off[2])) < 0.02 * 16.0 * solver.get("times", 1.0)
