"""Heaps of grains, tanks and drops of fluid by constraints; python -m tools.bench.soft.particles heap|pour|tank|basin|drop ...

    heap RADIUS_OF_COLUMN FRAMES SUBSTEPS ITERATIONS [ROLLING]    a column twice as high as wide collapses; mu = 0.5, grains of
                                                                  8 mm, which turn where ROLLING says their rolling friction
    pour FRICTION ROLLING                                 1033 grains of 8 mm fall on a spot in 3.6 s; ROLLING may be inf
    tank PARTICLES_ACROSS FRAMES SUBSTEPS ITERATIONS      water at rest between walls of no friction, as deep as wide
    basin PARTICLES_ACROSS LAYERS SUBSTEPS ITERATIONS     a lattice between such walls, that sloshes: frames 27 to 46, of which
                                                          the columns are wall time and CPU time (median) and density error
    drop RADIUS_OVER_DISTANCE SURFACE_TENSION SUBSTEPS ITERATIONS     without gravity, particles of 1 cm

Columns: CPU time a frame, greatest speed, greatest overlap, steepest part of the slope; or mean height over that at the start,
virial pressure over hydrostatic pressure, density error; or virial pressure over 2 sigma / R, damping ratio, and frequency of a
drop that was drawn out by 12 %, over Rayleigh's: omega^2 = 8 sigma / (rho R^3).
"""

import sys
import time

import numpy as np

import wsim
from wsim.kernels.position_based import density, tension
from wsim.model.compiler.core_team import count_cores
from wsim.physics.position_based.objects import ConstraintFluid, Grains, Pour


def heap(radius: float, frames: int, substeps: int, iterations: int, rolling: float = np.inf) -> None:
    """Prints a line every half second. It begins on a cubic lattice, whose towers do not fall by themselves."""
    scene = wsim.Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", wsim.Plane())
    across, up = np.arange(-20, 21) * 0.0088, np.arange(int((4 * radius - 0.0088) / 0.0088) + 1) * 0.0088 + 0.0094
    x = np.stack(np.meshgrid(across, up, across, indexing="ij"), -1).reshape(-1, 3)
    x = x[np.hypot(x[:, 0], x[:, 2]) < radius - 0.0044]
    scene.particles("/grains", points=x + 0.0004 * np.random.default_rng(0).uniform(-1.0, 1.0, x.shape), radius=0.004,
                    material=Grains(rolling_friction=rolling))
    simulation = wsim.Simulation(scene, device="cpu")
    print(f"{len(simulation.positions())} grains, {substeps} x {iterations}")
    spent, before = 0.0, simulation.positions().copy()
    for frame in range(1, frames + 1):
        start = time.process_time()
        simulation.step()
        spent += time.process_time() - start
        if frame % 30 == 0:
            x, v = simulation.positions(), np.linalg.norm(simulation.velocities(), axis=1)
            out = np.hypot(x[:, 0], x[:, 2])
            rings = np.linspace(0.2, 0.95, 9) * np.quantile(out, 0.98)
            crest = [x[(out >= a) & (out < b), 1].max(initial=0.0) for a, b in zip(rings[:-1], rings[1:], strict=True)]
            slope = -np.polyfit(0.5 * (rings[1:] + rings[:-1]), crest, 1)[0]
            overlap = simulation.report(profile=False)["error"].get("grain_overlap", 0.0)
            print(f"{frame / 60:6.1f} s  {1e3 * spent / 30:6.1f} ms  v {v.max():.1e} m/s  overlap {overlap:.1e}  slope "
                  f"{slope:.2f}  moved {np.abs(x - before).max():.1e} m", flush=True)
            spent, before = 0.0, x.copy()


def pour(mu: float, rolling: float) -> None:
    """Prints a line after 5 s: the slope of a cone of the same mean height and mean distance from its axis."""
    scene, r = wsim.Scene(fps=60, frames=300, substeps=8, iterations=4), 0.004
    scene.collider("/floor", wsim.Plane(), static_friction=1.0, dynamic_friction=1.0)
    down = wsim.Motion.still([[1, 0, 0, 0], [0, 0, 1, 0.12], [0, -1, 0, 0], [0, 0, 0, 1]])
    grains = Grains(static_friction=mu, dynamic_friction=mu, rolling_friction=rolling)
    scene.particles("/grains", wsim.Cylinder(0.02, 0.006), motion=down, radius=r, velocity=(0, 0, -0.4), material=grains,
                    pour=Pour(0.0, 3.6, 0.2))
    simulation, start = wsim.Simulation(scene, device="cpu"), time.process_time()
    simulation.run()
    x, v = simulation.positions("/grains"), simulation.velocities("/grains")
    slope = 4.0 * (x[:, 1].mean() - r) / (2.0 * np.hypot(x[:, 0], x[:, 2]).mean())
    spent = 1e3 * (time.process_time() - start) / 300
    print(f"{len(x)} grains, mu {mu}, rolling {rolling}  {spent:.1f} ms  slope {slope:.2f}  v {np.abs(v).max():.1e} m/s")


def tank(across: int, frames: int, substeps: int, iterations: int) -> None:
    """Prints a line every second."""
    r, half = 0.01, 0.01 * across
    scene = walled_scene(half, substeps, iterations)
    scene.particles("/water", wsim.Box((half, half, half)), at=(0, half, 0), radius=r, material="fluid")
    simulation = wsim.Simulation(scene, device="cpu")
    method = next(m for m in simulation.plan.methods if m.name == "density")
    height, spent = simulation.positions()[:, 1].mean(), 0.0
    print(f"{len(simulation.positions())} particles, {substeps} x {iterations}")
    for frame in range(1, frames + 1):
        start = time.process_time()
        simulation.step()
        spent += time.process_time() - start
        if frame % 60 == 0:
            x, found = simulation.positions(), method.indicators(None, None)
            inner = (np.abs(x[:, [0, 2]]) < half - 4 * r).all(axis=1) & (x[:, 1] > 4 * r) & (x[:, 1] < 2 * half - 6 * r)
            slope = -np.polyfit(x[inner, 1], virial_pressures(method, x)[inner], 1)[0]
            print(f"{frame / 60:5.1f} s  {1e3 * spent / 60:6.1f} ms  height {x[:, 1].mean() / height:.4f}  pressure "
                  f"{slope / 9810:.3f}  density error "
                  f"{found['density_error']:.1e}, most {found['most_density_error']:.1e}", flush=True)
            spent = 0.0


def walled_scene(half: float, substeps: int, iterations: int) -> wsim.Scene:
    """A floor and four walls without friction, `half` from the middle [m]."""
    scene = wsim.Scene(fps=60, substeps=substeps, iterations=iterations)
    slip = {"static_friction": 0.0, "dynamic_friction": 0.0}
    scene.collider("/floor", wsim.Plane(), **slip)
    for k, n in enumerate(([1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1])):
        M = np.eye(4)
        x = np.cross([0, 1, 0], n)
        M[:3, :3], M[:3, 3] = np.stack([x, np.cross(n, x), n], axis=1), -half * np.array(n)
        scene.collider(f"/wall_{k}", wsim.Plane(), motion=wsim.Motion.still(M), **slip)
    return scene


def basin(across: int, layers: int, substeps: int, iterations: int) -> None:
    """Prints a line."""
    r = 0.005
    scene = walled_scene(r * across, substeps, iterations)
    i = np.stack(np.meshgrid(np.arange(across), np.arange(layers), np.arange(across), indexing="ij"), -1).reshape(-1, 3)
    scene.particles("/water", points=(2 * i + 1) * r - [across * r, 0, across * r], radius=r, material="fluid")
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(26)
    rows = []
    for _ in range(20):
        wall, start = time.perf_counter(), time.process_time()
        simulation.step()
        taken = time.perf_counter() - wall, time.process_time() - start
        found = simulation.indicators()
        rows.append([*taken, found["density_error"], found["most_density_error"]])
    (wall, spent, error, _), most = np.median(rows, axis=0), max(row[3] for row in rows)
    height = simulation.positions()[:, 1].mean() / (layers * r)
    print(f"{len(i)} particles, {substeps} x {iterations}, {count_cores()} threads: {1e3 * wall:.1f} ms, CPU {1e3 * spent:.1f} "
          f"ms, density error {error:.1e}, most {most:.1e}, height {height:.3f}")


def drop(size: float, sigma: float, substeps: int, iterations: int) -> None:
    """Prints a line: 60 frames a period of the oscillation."""
    d, start = 0.01, time.process_time()
    x = np.stack(np.meshgrid(*[np.arange(-int(size) - 1, int(size) + 2) + 0.5] * 3, indexing="ij"), -1).reshape(-1, 3)
    x = d * x[(x**2).sum(axis=1) < size**2]
    R = d * (3.0 * len(x) / (4.0 * np.pi)) ** (1.0 / 3.0)
    fps = 60.0 * np.sqrt(8.0 * sigma / (1000.0 * R**3)) / (2.0 * np.pi)

    def make(places: np.ndarray, smoothing: float) -> wsim.Simulation:
        scene = wsim.Scene(fps=fps, substeps=substeps, iterations=iterations, gravity=(0, 0, 0))
        material = ConstraintFluid(viscosity=0.0, smoothing=smoothing, surface_tension=sigma)
        scene.particles("/water", points=places, radius=0.5 * d, material=material)
        return wsim.Simulation(scene, device="cpu")
    simulation, found = make(x + np.random.default_rng(1).normal(0.0, 0.05 * d, x.shape), 0.1), []
    simulation.run(80)
    for _ in range(8):
        simulation.run(4)
        now = simulation.positions().astype(float)
        method = next(m for m in simulation.plan.methods if m.name == "density")
        inner = np.linalg.norm(now - now.mean(axis=0), axis=1) < R - 2.5 * d
        found.append(virial_pressures(method, now, sigma)[inner].mean())
    simulation = make(x, 0.1)
    simulation.run(60)
    rest = simulation.positions().astype(float)
    simulation, drawn = make((rest - rest.mean(axis=0)) * 1.12 ** np.array([1.0, -0.5, -0.5]), 0.0), []
    for _ in range(72):
        drawn.append(np.var(simulation.positions().astype(float), axis=0) @ [1.0, -0.5, -0.5])
        simulation.step()
    omega, damping = fit_oscillation(np.array(drawn) / drawn[0])
    print(f"{len(x)} particles, {substeps} x {iterations}  pressure {np.mean(found) * R / (2.0 * sigma):.3f}  frequency "
          f"{omega:.3f}  damping {damping:.2f}  {time.process_time() - start:.0f} s", flush=True)


def fit_oscillation(values: np.ndarray) -> tuple[float, float]:
    """(omega over one that has 60 values a period, damping ratio) of a damped oscillation from rest."""
    from scipy.optimize import curve_fit

    def damped(t: np.ndarray, A: float, g: float, w: float, c: float) -> np.ndarray:
        return A * np.exp(-g * t) * (np.cos(w * t) + g / w * np.sin(w * t)) + c
    (_, g, w, _), _ = curve_fit(damped, np.arange(len(values)) / 60.0, values, p0=(values[0], 1.0, 2.0 * np.pi, 0.0))
    return float(np.hypot(g, w)) / (2.0 * np.pi), float(g / np.hypot(g, w))


def virial_pressures(method, x: np.ndarray, sigma: float = 0.0) -> np.ndarray:
    """Pressure at each particle [Pa], from the forces of its pairs; sigma: surface tension [N/m]."""
    from scipy.spatial import cKDTree
    d, n = method.distance, len(x)
    p, H = method.part.arrays["p"].numpy()[method.part.rows["/water", 0]].astype(float), density.REACHED * d
    i, j = cKDTree(x).query_pairs(H, output_type="ndarray").T
    way = x[i] - x[j]
    r = np.linalg.norm(way, axis=1)
    slope = -45.0 / (8.0 * np.pi * density.LATTICE) * (1.0 - r / H) ** 2 / H
    virial = -(p[i] + p[j]) * slope * r
    if sigma:
        normal = H * np.stack([np.bincount(i, s, n) - np.bincount(j, s, n) for s in (way * (slope / r)[:, None]).T], axis=1)
        a = 64.0 * (r / H * (1.0 - r / H)) ** 3
        pulled = tension.COHESION * np.where(r > 0.5 * H, a, 2.0 * a - 1.0) * r
        virial -= sigma / d**2 * (pulled + tension.EVEN * (way * (normal[i] - normal[j])).sum(axis=1))
    return (np.bincount(i, virial, n) + np.bincount(j, virial, n)) / 6.0


if __name__ == "__main__":
    name, *given = sys.argv[1:]
    run, kinds = {"heap": (heap, (float, int, int, int, float)[:len(given)]), "tank": (tank, (int, int, int, int)),
                  "basin": (basin, (int, int, int, int)), "pour": (pour, (float, float)),
                  "drop": (drop, (float, float, int, int))}[name]
    run(*(kind(each) for kind, each in zip(kinds, given, strict=True)))
