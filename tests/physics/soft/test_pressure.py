"""Pressure in soft bodies: its potential, a block, Lame's hollow ball, momentum and energy."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.soft.soft_bar import bar, ran, settled, spin
from wsim import Bulk, Scene, Simulation
from wsim.geometry.primitives import sphere_outline
from wsim.kernels.math.real import types
from wsim.kernels.soft.material import lame_parameters
from wsim.kernels.solver import line_search
from wsim.scene import shapes

E, NU, RHO, P = 1e5, 0.3, 1e3, 5e3


def shell(inner: float, outer: float, layers: int, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """A hollow ball: triangles of a ball as prisms between radii, each three tets (split by the order of its points)."""
    unit, triangles = sphere_outline(1.0, sides)
    n, radii = len(unit), np.geomspace(inner, outer, layers + 1)
    points = (radii[:, None, None] * unit).reshape(-1, 3)
    a, b, c = np.sort(triangles, axis=1).T
    cells = [np.stack(t, axis=1) for t in ((a, b, c, c + n), (a, b, b + n, c + n), (a, a + n, b + n, c + n))]
    tets = np.concatenate([cell + k * n for k in range(layers) for cell in cells])
    x = points[tets]
    turned = np.linalg.det(x[:, 1:] - x[:, :1]) < 0.0
    tets[turned] = tets[turned][:, [0, 1, 3, 2]]
    return points, tets


def free(points, tets, pressure=P, bulk=None, **more) -> Scene:
    scene = Scene(**{"solver": "implicit", "integrator": "backward_euler", "substeps": 2, "iterations": 2, "fps": 60.0,
                     "gravity": (0.0, 0.0, 0.0)} | more)
    scene.soft("/body", points, tets, material=bulk or Bulk(E, NU, RHO)).pressure = pressure
    return scene


def enclosed(x: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (x[triangles[:, k]] for k in range(3))
    return float(np.einsum("mi,mi->", a, np.cross(b, c))) / 6.0


def table_of(scene: Scene):
    sim = Simulation(scene, device="cpu", precision="float64")
    return sim, sim.plan.solids[-1]


def test_forces_are_minus_the_gradient_of_the_potential_and_the_line_search_knows_it():
    """-p V of random places, 1 km from the origin; V is a cubic, so central differences of 1e-3 m are good to their square."""
    scene = free(*shapes.block((0.3, 0.2, 0.2), (3, 2, 2)))
    sim, table = table_of(scene)
    rng, model, t, n = np.random.default_rng(1), sim.model, types(wp.float64), sim.model.points
    x, d, y = (rng.normal(size=(n, 3)) for _ in range(3))
    triangles, away = model.bodies[0].triangles, np.array([1000.0, 0.0, 0.0])

    def array(values):
        return wp.array(values, dtype=t.vec3, device="cpu")
    parts = wp.zeros(3 * table.size, dtype=t.vec3, device="cpu")
    table.place(0, 0)
    table.need_forces()
    table.forces(array(x + away), array(d), None, parts)
    force = np.zeros((n, 3))
    np.add.at(force, table.ids.ravel(), parts.numpy())
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()
    assert np.abs(np.cross(x + d, force).sum(axis=0)).max() < 1e-12 * np.abs(force).sum()

    h = 1e-5
    slope = P * (enclosed(x + d + h * y, triangles) - enclosed(x + d - h * y, triangles)) / (2.0 * h)
    assert np.sum(force * y) == pytest.approx(slope, rel=1e-7)

    trial = line_search.LineSearchTrial()
    trial.first, trial.lanes, trial.begin, trial.end = table.first, 1, 1, 4
    trial.step = wp.array([-1.0], dtype=wp.float64, device="cpu")
    trial.change = wp.zeros((1, 9), dtype=wp.float64, device="cpu")
    wp.launch(table.kernels()[1], 1, [trial, table.data, array(x + away), array(d), array(d), array(y), None, 0.0], [],
              device="cpu")
    wanted = [-P * (enclosed(x + d + s * y, triangles) - enclosed(x + d, triangles)) for s in (0.5, 0.25, 0.125)]
    np.testing.assert_allclose(trial.change.numpy()[0], [0.0, *wanted, 0.0, 0.0, 0.0, 0.0, 0.0], rtol=1e-9)


@pytest.mark.parametrize("quadratic", [False, True])
def test_a_block_swells_as_its_bulk_modulus_says(quadratic):
    """Corotational: (2 mu + 3 lam) e = p (1 + e)^2, the pressure following the surface; small: 3 e = 3 (1 - 2 nu) p / E."""
    points, tets = shapes.block((0.2, 0.2, 0.2), (2, 2, 2))
    scene = free(points, tets)
    scene.softs[0].quadratic = quadratic
    sim = settled(scene, precision="float64")
    mu, lam = lame_parameters(E, NU)
    roots = np.roots([P, 2.0 * P - (2.0 * mu + 3.0 * lam), P])
    e = roots[np.abs(roots).argmin()].real
    assert e == pytest.approx((1.0 - 2.0 * NU) * P / E, rel=0.05)
    np.testing.assert_allclose(sim.positions(), (1.0 + e) * points.astype(np.float64), atol=1e-7)


def test_a_hollow_ball_is_pressed_from_within_as_lame_says():
    """Thick-walled, a = 0.1 m, b = 0.2 m, small strain (Timoshenko, Goodier 1970, article 136):
    u(r) = p a^3 ((1 - 2 nu) r + (1 + nu) b^3 / 2 r^2) / E (b^3 - a^3). Coarse meshes are too stiff, finer ones less."""
    a, b, errors, p = 0.1, 0.2, [], 100.0
    for layers, sides in ((2, 8), (4, 16)):
        points, tets = shell(a, b, layers, sides)
        sim = settled(free(points, tets, p), precision="float64")
        r = np.linalg.norm(points, axis=1)
        u = np.einsum("ni,ni->n", sim.positions() - points, points) / r
        wanted = p * a**3 * ((1.0 - 2.0 * NU) * r + (1.0 + NU) * b**3 / (2.0 * r**2)) / (E * (b**3 - a**3))
        errors.append(float(np.sqrt(np.mean((u - wanted)**2) / np.mean(wanted**2))))
    assert errors[1] < 0.1 and errors[1] < 0.4 * errors[0]


def test_a_free_body_under_sudden_pressure_keeps_its_energy_and_stays_where_it_is():
    """Leapfrog in float32: half a second, twenty swings and more."""
    scene = free(*shapes.block((0.2, 0.2, 0.2), (2, 2, 2)), solver="explicit", integrator="leapfrog", substeps=40, iterations=1)
    sim = Simulation(scene, device="cpu")
    sim.run(1)
    before = sim.indicators()
    assert before["kinetic_energy"] > 1e-3
    swing = 0.0
    for _ in range(29):
        sim.step()
        now = sim.indicators()
        swing = max(swing, abs(now["kinetic_energy"] - before["kinetic_energy"]))
        assert now["energy"] == pytest.approx(0.0, abs=0.02 * swing + 1e-5)
    body = sim.model.bodies[0]
    m, v = body.masses[body.index - body.first][:, None], sim.velocities()
    assert np.abs((m * v).sum(axis=0)).max() < 1e-6 * np.abs(m * v).sum() and np.abs(spin(sim)[0]).max() < 1e-6


def test_pressure_is_live_where_there_is_some():
    weak, strong = free(*shapes.block((0.2, 0.2, 0.2), (2, 2, 2)), 1.0), free(*shapes.block((0.2, 0.2, 0.2), (2, 2, 2)))
    sim = Simulation(weak, device="cpu", precision="float64")
    sim.set("/body", "pressure", P)
    sim.run(3)
    np.testing.assert_allclose(sim.positions(), ran(strong, 3, precision="float64").positions(), atol=0)


def test_a_pressure_of_nothing_is_not_there():
    sim = Simulation(bar(), device="cpu")
    assert [t.name for t in sim.plan.solids] == ["corotational"]
