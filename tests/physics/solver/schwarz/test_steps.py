"""Newton steps of membranes solved by domains: an independent solution of the same equations, and orders on stiff cloth."""

import numpy as np
import pytest

from tests.make.physics.solver.schwarz.schwarz import sheet
from wsim.physics.solver import newton
from wsim.physics.solver.schwarz import solver
from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

STRETCH, SHEAR, POISSON = 3e3, 8e2, 0.2


@pytest.fixture(autouse=True)
def always(monkeypatch):
    """Small and soft sheets too."""
    monkeypatch.setitem(solver.PAYS, "cpu", (0, 0.0))


def slope(d, start, triangles, rest, masses, goal, h, free):
    """Gradient of Phi by complex steps: inertia and strains U - 1 of all triangles, U^2 = F^T F, by the closed form of a root
    of 2 x 2."""
    Dm = (rest[triangles[:, 1:]] - rest[triangles[:, :1]])[:, :, :2].transpose(0, 2, 1)
    B, area = np.linalg.inv(Dm), 0.5 * np.abs(np.linalg.det(Dm))
    many = np.eye(len(d))[:, None] if d.ndim == 1 else 0.0
    X = start.astype(complex) + np.zeros((len(d), *start.shape))
    X[:, free] += (d + 1e-30j * many[:, 0]).reshape(len(d), -1, 3)
    F = np.einsum("ntkc,tkj->ntcj", X[:, triangles[:, 1:]] - X[:, triangles[:, :1]], B)
    M = np.einsum("ntci,ntcj->ntij", F, F)
    det = np.sqrt(M[..., 0, 0] * M[..., 1, 1] - M[..., 0, 1]**2)
    trace = np.sqrt(M[..., 0, 0] + M[..., 1, 1] + 2.0 * det)
    e, f, g = (M[..., 0, 0] + det) / trace - 1.0, (M[..., 1, 1] + det) / trace - 1.0, 2.0 * M[..., 0, 1] / trace
    stored = (STRETCH / (1.0 - POISSON**2) * (e * e + f * f + 2.0 * POISSON * e * f) + SHEAR * g * g) @ area
    inertia = (masses[:, None] / h**2 * (X - goal)**2).sum(axis=(1, 2))
    return 0.5e30 * (stored + inertia).imag


def test_a_converged_step_is_the_solution_of_scipy(monkeypatch):
    optimize = pytest.importorskip("scipy.optimize")
    monkeypatch.setattr(newton, "TOLERANCE", 1e-10)
    scene = Scene(solver="implicit", integrator="backward_euler", fps=60.0, substeps=1, iterations=40)
    points, counts, indices = shapes.sheet(1.0, 1.0, 3, 3)
    cloth = scene.cloth("/cloth", points, counts, indices, model="membrane",
                        velocities=3.0 * np.random.default_rng(7).normal(size=points.shape),
                        material=Fabric(stretch=STRETCH, shear=SHEAR, bend=0.0, poisson=POISSON))
    scene.pin("/pin", cloth, [0, 3])
    sim = Simulation(scene, device="cpu", precision="float64")
    body, h = sim.model.bodies[0], 1.0 / 60.0
    place = body.places + body.origin
    free = np.flatnonzero(sim.plan.ports.newton_assembly.rows.w.numpy() > 0.0)
    goal = place + h * np.where(np.isin(np.arange(body.count), free)[:, None], body.velocities, 0.0) + h * h * np.array(
        scene.gravity)
    where = (place, body.triangles - body.first, body.rest, body.masses, goal, h, free)
    found = optimize.root(slope, (goal - place)[free].ravel(), args=where, tol=1e-12)
    assert np.abs(found.fun).max() < 1e-6
    sim.step()
    assert sim.indicators()["residual"] < 1e-7
    d = (sim.state.x.numpy() + sim.state.e.numpy() - body.places)[free].ravel()
    np.testing.assert_allclose(d, found.x, atol=1e-8)
    assert np.abs(d.reshape(-1, 3) - (goal - place)[free]).max() > 1e-3           # forces matter


@pytest.mark.parametrize("integrator, order", [("backward_euler", 1.0), ("bdf2", 2.0), ("sdirk3", 1.6)])
def test_orders_on_stiff_cloth(integrator, order):
    """A sheet of 1e5 N/m swings on its upper edge: a wave passes it many times in the longest of the steps, and motion is as on
    a constraint, where the stages of sdirk3, of order 1, leave less than order 3 (Hairer, Wanner 1996, VI.3)."""
    ends = []
    for substeps in (4, 8, 16, 64):
        scene = sheet(6, 1e5, integrator=integrator, fps=20.0, substeps=substeps, iterations=8, gravity=(0.0, -4.0, 9.0))
        scene.pin("/edge", "/cloth", [1, 2, 3, 4, 5])
        sim = Simulation(scene, device="cpu", precision="float64")
        sim.run(5)
        assert sim.plan.integrator == integrator and not sim.warnings and sim.indicators()["residual"] < 1e-6
        ends.append(sim.positions())
    errors = [np.sqrt(((x - ends[-1])**2).sum(axis=1).mean()) for x in ends[:-1]]
    assert errors[0] < 0.02 and -np.polyfit(np.log([1, 2, 4]), np.log(errors), 1)[0] > order - 0.2, errors
