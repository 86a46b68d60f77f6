"""Surface tension of fluids by constraints: Laplace pressure, a cube that becomes round, momentum, USD. Bits: test_fluid.py."""

import numpy as np
import pytest

import wsim
from wsim.kernels.position_based import density, tension
from wsim.physics.position_based.objects import ConstraintFluid
from wsim.scene import Scene

D = 0.01


def drop(x, sigma, velocities=None, smoothing=0.1, precision="float32", fps=200, substeps=8):
    """A drop without gravity."""
    scene = Scene(fps=fps, substeps=substeps, iterations=4, gravity=(0, 0, 0))
    material = ConstraintFluid(viscosity=0.0, smoothing=smoothing, surface_tension=sigma)
    scene.particles("/drop", points=x, radius=D / 2, velocities=velocities, material=material)
    return wsim.Simulation(scene, device="cpu", precision=precision)


def cube(n):
    return (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3) - 0.5 * (n - 1)) * D


def ball(n):
    x = cube(2 * n)
    x = x[(x**2).sum(axis=1) < (n * D) ** 2]
    return x + np.random.default_rng(1).normal(0, 0.05 * D, x.shape)


def method(simulation):
    return next(m for m in simulation.plan.methods if m.name == "density")


def virial_pressure(simulation, sigma):
    """Pressure at each particle [Pa], from the forces of its pairs: sum of r . F / (6 V)."""
    of, x = method(simulation), simulation.positions().astype(float)
    lam = of.part.arrays["p"].numpy()[of.part.rows["/drop", 0]].astype(float)
    way = x[:, None] - x[None]
    r, H = np.linalg.norm(way, axis=-1), density.REACHED * D
    q, near = r / H, (r < H) & (r > 0.0)
    e = way / np.where(near, r, 1.0)[..., None]
    slope = np.where(near, -45 / (8 * np.pi * density.LATTICE) * (1 - q) ** 2 / H, 0.0)
    a = 64 * (q * (1 - q)) ** 3
    s = np.where(near, np.where(q > 0.5, a, 2 * a - 1), 0.0)
    n = H * (slope[..., None] * e).sum(axis=1)
    even = (way * (n[:, None] - n[None])).sum(axis=-1) * near
    pulled = -sigma * D * (tension.COHESION * s * r + tension.EVEN * even) / D**3
    return (-(lam[:, None] + lam[None]) * slope * r + pulled).sum(axis=1) / 6.0


@pytest.mark.parametrize("n, sigma", [(5, 0.1), (6, 0.5), pytest.param(5, 0.5, marks=pytest.mark.slow)])
def test_pressure_in_a_drop_is_that_of_laplace(n, sigma):
    """2 sigma / R, at two radii and two sigmas."""
    x = ball(n)
    R = D * (3 * len(x) / (4 * np.pi)) ** (1 / 3)
    simulation = drop(x, sigma, fps=60 * np.sqrt(8 * sigma / (1000 * R**3)) / (2 * np.pi))
    simulation.run(60)
    found = []
    for _ in range(4):
        simulation.run(4)
        now = simulation.positions().astype(float)
        inner = np.linalg.norm(now - now.mean(axis=0), axis=1) < R - 2.5 * D
        found.append(virial_pressure(simulation, sigma)[inner].mean())
    assert abs(np.mean(found) * R / (2 * sigma) - 1) < 0.1


def test_a_cube_becomes_round():
    """Farthest over nearest place of the surface: 1.73 of a cube, 1 of a ball; and moments of inertia are equal."""
    simulation = drop(cube(8), 0.5, fps=60)

    def unevenness():
        x = simulation.positions().astype(float)
        x -= x.mean(axis=0)
        rays = np.random.default_rng(0).normal(size=(200, 3))
        far = (x @ (rays / np.linalg.norm(rays, axis=1)[:, None]).T).max(axis=0)
        return far.max() / far.min()
    before = unevenness()
    simulation.run(80)
    assert not simulation.warnings, simulation.warnings                       # of energy that surfaces give
    assert before > 1.5 and unevenness() < 1.12
    x = simulation.positions().astype(float)
    spread = np.linalg.eigvalsh(np.cov(x.T))
    assert spread[2] / spread[0] < 1.1
    R = D * (3 * len(x) / (4 * np.pi)) ** (1 / 3)
    assert abs(np.sqrt(5 / 3 * np.trace(np.cov(x.T))) / R - 1) < 0.03                 # it keeps its volume


def test_momentum_stays():
    """Linear to rounding; angular within what the term of normals adds. Smoothing, which is off here, takes more."""
    x = cube(6)
    v = np.cross([0.0, 0.0, 2.0], x) + np.random.default_rng(0).normal(0, 0.02, x.shape) + [0.1, 0.0, 0.0]
    simulation = drop(x, 0.5, v, 0.0, precision="float64", fps=120)
    simulation.run(20)
    at, now = simulation.positions(), simulation.velocities()
    assert np.abs(now.sum(axis=0) - v.sum(axis=0)).max() < 1e-6 * np.abs(v).sum()

    def spin(x, v):
        return np.cross(x - x.mean(axis=0), v - v.mean(axis=0)).sum(axis=0)
    assert np.abs(spin(at, now) - spin(x, v)).max() < 0.05 * np.abs(spin(x, v)).max()


def test_a_fluid_without_it_has_no_kernel_of_it():
    assert "tension" not in method(drop(cube(2), 0.0)).kernels
    assert "tension" in method(drop(cube(2), 0.1)).kernels


def test_more_than_substeps_carry_is_said_and_cut():
    scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, 0))
    scene.particles("/drop", points=cube(5) * 0.1, radius=D / 20, material=ConstraintFluid(surface_tension=0.072))
    simulation = wsim.Simulation(scene, device="cpu")
    assert any("/drop: surface_tension is 0.072 N/m, and acts as 0.0046" in w and "give 32 substeps" in w
               for w in simulation.warnings), simulation.warnings
    simulation.run(20)
    assert np.abs(simulation.positions()).max() < 0.004


def test_it_is_written_and_read(tmp_path):
    scene = Scene(fps=60, frames=2)
    scene.particles("/drop", points=cube(2), radius=D / 2, material=ConstraintFluid(surface_tension=0.072))
    wsim.save(scene, tmp_path / "drop.usda")
    assert wsim.load(tmp_path / "drop.usda").things("Particles")[0].material.surface_tension == pytest.approx(0.072)
