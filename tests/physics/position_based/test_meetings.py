"""Particles and what they meet: momentum of both, the distance that they keep, loads of light cloth, and what is fast."""

from math import inf

import numpy as np
import pytest

import wsim
from wsim import Bulk, Fabric, shapes
from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.position_based.objects import Grains, Pour
from wsim.scene import Scene

R = 0.01
POINTS, TETS = shapes.block((0.15, 0.1, 0.15), (3, 2, 3))
POINTS = POINTS - POINTS.mean(axis=0)
SURFACE = tet_surface_triangles(TETS)


def add_partner(scene, partner):
    """Something free, whose top is 5 cm up or less."""
    if partner == "soft":
        scene.soft("/other", POINTS, TETS, material=Bulk(young=3e4, density=300.0))
    elif partner == "clusters":
        scene.clusters("/other", POINTS, counts=np.full(len(SURFACE), 3), indices=SURFACE.ravel(), mass=0.7, stiffness=4e3)
    elif partner == "cloud":
        scene.clusters("/other", POINTS, mass=0.7, stiffness=inf, radius=0.03, self_collision=True,
                       static_friction=0.0, dynamic_friction=0.0)
    elif partner == "cloth":
        scene.cloth("/other", *shapes.sheet(0.2, 0.2, 8, 8, horizontal=True),
                    material=Fabric(500.0, thickness=0.002, density=500.0))
    else:
        t, rows = np.linspace(-0.15, 0.15, 13), np.linspace(-0.04, 0.04, 5)
        points = np.concatenate([np.stack([t, 0 * t, 0 * t + z], axis=1) for z in rows])
        scene.rods("/other", points, [13] * 5, diameters=[0.01], young=1e7, density=1100.0, self_collision=True,
                   static_friction=0.0, dynamic_friction=0.0)


def throw(partner, material, speed=1.0, number=2, **more):
    """A simulation of particles that fly down at what is free, without gravity."""
    scene = Scene(**{"fps": 60, "substeps": 8, "iterations": 4, "gravity": (0, 0, 0)} | more)
    k = np.stack(np.meshgrid(*[np.arange(number)] * 3, indexing="ij"), -1).reshape(-1, 3)
    x = 2.05 * R * (k - 0.5 * (number - 1)) + [0.003, 0.1, 0.002]
    scene.particles("/p", points=x, radius=R, velocities=np.tile([0.05, -speed, 0.1], (len(x), 1)), material=material)
    add_partner(scene, partner)
    return wsim.Simulation(scene, device="cpu")


def momenta(simulation):
    """Sums of m v and of x cross m v."""
    P, L = np.zeros(3), np.zeros(3)
    parts = [(b.point_masses, simulation.positions(b.path).astype(float), simulation.velocities(b.path).astype(float))
             for b in simulation.model.bodies]
    if rods := simulation.plan.method("rods") if simulation.scene.things("Rods") else None:
        parts.append((rods.table.values["m"].T.ravel(), *rods.points(0)))
    for m, x, v in parts:
        P, L = P + m @ v, L + np.cross(x, m[:, None] * v).sum(axis=0)
    return P, L


@pytest.mark.parametrize("material", [Grains(static_friction=0.0, dynamic_friction=0.0), "fluid"])
@pytest.mark.parametrize("partner", ["cloth", "soft", "clusters", "cloud", "rods"])
def test_what_particles_lose_the_other_gains(partner, material):
    """Momentum to 2e-6 of all of it, the moment to 2 % of it at 0.1 m: normals are those of the start of a substep."""
    simulation = throw(partner, material)
    before, moment = momenta(simulation)
    simulation.run(8)
    after, now = momenta(simulation)
    size = np.linalg.norm(before)
    assert simulation.velocities("/p")[:, 1].max() > -0.97                            # they met
    assert np.abs(after - before).max() < 2e-6 * size
    assert np.abs(now - moment).max() < 0.02 * 0.1 * size


def distance_to_triangles(p, corners):
    """Least distance of points (n, 3) to triangles (t, 3, 3), by a fine sample of each."""
    k = np.stack(np.meshgrid(*[np.arange(21)] * 2, indexing="ij"), -1).reshape(-1, 2) / 20.0
    k = k[k.sum(axis=1) <= 1.0]
    weights = np.column_stack([1.0 - k.sum(axis=1), k])
    places = (weights @ corners).reshape(-1, 3)
    return np.linalg.norm(p[:, None] - places[None], axis=-1).min()


@pytest.mark.parametrize("collides", [False, True])
def test_a_grain_lies_on_a_cloth_and_not_above_it(collides):
    """At its radius and half of the thickness, whether the cloth collides with itself or not."""
    scene = Scene(fps=60, substeps=8, iterations=4)
    cloth = scene.cloth("/cloth", *shapes.sheet(0.1, 0.1, 5, 5, horizontal=True), self_collision=collides,
                        material=Fabric(2000.0, thickness=0.002, density=1000.0, damping=0.002))
    edge = np.flatnonzero(np.abs(np.asarray(cloth.points)[:, [0, 2]]).max(axis=1) > 0.049)
    scene.pin("/pin", cloth, edge)
    scene.particles("/p", points=[[0.003, 0.013, 0.002]], radius=R)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(60)
    corners = simulation.positions("/cloth").astype(float)[triangulate_polygons(cloth.points, cloth.counts, cloth.indices)[0]]
    away = distance_to_triangles(simulation.positions("/p").astype(float), corners)
    assert abs(away / (R + 0.001) - 1.0) < 0.02
    assert np.abs(simulation.velocities("/p")).max() < 0.02


def test_a_light_cloth_bears_a_heavy_grain_by_newton_steps():
    """A grain 40 and 4000 times as heavy as a point of the cloth hangs as deep, to a tenth: the load is its own alone."""
    depth = []
    for density in (500.0, 5.0):
        scene = Scene(fps=60, substeps=8, iterations=2, solver="auto" if density < 10.0 else "implicit")
        cloth = scene.cloth("/cloth", *shapes.sheet(0.1, 0.1, 5, 5, horizontal=True),
                            material=Fabric(2000.0, thickness=0.002, density=density, damping=0.004))
        scene.pin("/pin", cloth, np.flatnonzero(np.abs(np.asarray(cloth.points)[:, [0, 2]]).max(axis=1) > 0.049))
        scene.particles("/p", points=[[0.003, 0.012, 0.002]], radius=R)
        simulation = wsim.Simulation(scene, device="cpu")
        assert simulation.plan.choice.solver == "implicit"
        simulation.run(24)
        depth.append(float(simulation.positions("/cloth")[:, 1].min()))
    assert abs(depth[1] / depth[0] - 1.0) < 0.1 and -0.01 < depth[1] < -0.002


@pytest.mark.parametrize("partner", ["cloth", pytest.param("soft", marks=pytest.mark.slow), "clusters"])
def test_no_grain_of_a_hundred_diameters_a_substep_passes_a_surface(partner):
    simulation = throw(partner, "grains", 100 * 2 * R * 480, 1)
    simulation.step()
    x, v = simulation.positions("/p"), simulation.velocities("/p")
    assert np.isfinite(x).all() and np.isfinite(simulation.positions("/other")).all()
    assert v[0, 1] > -0.9 * 960.0                                                   # it was stopped, or carries the other along
    assert x[0, 1] > simulation.positions("/other")[:, 1].min()
    assert any("came nearer by more than an edge" in str(w) for w in simulation.warnings)


def test_two_clouds_of_points_meet():
    """Clusters without a surface that collide keep the distance of their balls, and their momentum."""
    scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, 0))
    cube = 0.02 * (np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3) - 1.0)
    for k, v in enumerate((-1.0, 1.0)):
        scene.clusters(f"/{'ab'[k]}", cube + [0.003 * k, -0.04 * v, 0.0], mass=0.5 + k, stiffness=inf, radius=R,
                       self_collision=True, velocities=np.tile([0.0, v, 0.0], (27, 1)))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(12)
    a, b = simulation.positions("/a"), simulation.positions("/b")
    v = [simulation.velocities(path).astype(float).mean(axis=0) for path in ("/a", "/b")]
    assert np.linalg.norm(a[:, None] - b[None], axis=-1).min() > 0.9 * 2 * R
    assert np.abs(0.5 * v[0] + 1.5 * v[1] - [0.0, 1.0, 0.0]).max() < 1e-5 and v[1][1] < 0.9


@pytest.mark.parametrize("partner", ["soft", "rods"])
def test_two_runs_and_a_reset_have_the_same_bits(partner):
    first, second = (throw(partner, "grains") for _ in range(2))
    first.run(6)
    second.run(6)
    assert np.array_equal(first.positions("/p"), second.positions("/p"))
    second.reset()
    second.run(6)
    assert np.array_equal(first.positions("/p"), second.positions("/p"))


def test_a_cloth_flies_through_where_grains_have_not_come_yet_and_meets_those_that_have():
    def run(start):
        scene = Scene(fps=60, frames=24, substeps=4, iterations=4, gravity=(0, 0, 0))
        points, counts, indices = shapes.sheet(0.1, 0.1, 4, 4, horizontal=True)
        scene.cloth("/cloth", points + [0, -0.1, 0], counts, indices, material=Fabric(500.0, thickness=0.002, density=500.0),
                    velocities=np.tile([0.0, 1.0, 0.0], (25, 1)))
        scene.particles("/spout", wsim.Sphere(0.02), radius=0.005, velocity=(0, 0.2, 0), pour=Pour(start, start + 0.1))
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(20)
        return simulation
    late, early = run(0.35), run(0.0)
    assert np.allclose(late.velocities("/cloth"), [0.0, 1.0, 0.0], atol=1e-5)
    assert early.velocities("/cloth")[:, 1].min() < 0.9 and early.velocities("/spout")[:, 1].max() > 0.1


@pytest.mark.parametrize("partner, material, words", [
    ("cloth", "grains", "grains overlap"), ("rods", "grains", "grains overlap"), ("cloth", "fluid", "pressed together")])
def test_a_hundred_in_one_place_beside_others_go_on_from_a_file_to_the_bit(partner, material, words):
    """They touch a hundred others each, for which there is no room at first; all stay finite, and are told of. The fluid goes
    on from its second frame: from the first one, in which it bursts against the cloth, other bits follow."""
    def crowd():
        scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, 0))
        scene.particles("/p", points=np.tile([0.003, 0.03, 0.002], (100, 1)), radius=R,
                        velocities=np.tile([0.05, -1.0, 0.1], (100, 1)), material=material)
        add_partner(scene, partner)
        return wsim.Simulation(scene, device="cpu")
    first, second, third = crowd(), crowd(), crowd()
    frames = 4 if material == "fluid" else 6
    first.run(frames)
    second.run(frames - 2)
    third.restart(frames - 2, {path: second.fields(path) for path in second.state.paths()})
    third.run(2)
    assert np.isfinite(first.positions("/p")).all()
    for path in first.state.paths():
        for name in {"x", "e", "v", "p", "surfaces_wait", "surfaces_tried"} & first.fields(path).keys():
            assert np.array_equal(first.fields(path)[name], third.fields(path)[name]), f"{path}, {name}"
    assert any(words in str(w) for w in first.warnings)


@pytest.mark.parametrize("ratio", [29, 490])
def test_a_pile_lies_on_a_cloth_by_newtons_method(ratio):
    """27 grains, each `ratio` times as heavy as a point of the cloth, are no nearer to it than they keep, but for 2 %."""
    scene, k = Scene(fps=60, substeps=8, iterations=6, solver="implicit"), np.indices((3, 3, 3)).reshape(3, -1).T
    points, counts, indices = shapes.sheet(0.2, 0.2, 12, 12, horizontal=True)
    cloth = scene.cloth("/cloth", points, counts, indices, material=Fabric(2000.0, density=500.0, thickness=2e-3, damping=2e-3))
    scene.pin("/pin", cloth, np.flatnonzero(np.abs(points[:, [0, 2]]).max(axis=1) > 0.099))
    density = ratio * 0.04 * 500.0 * 2e-3 / 169 / (4 / 3 * np.pi * R**3)
    scene.particles("/p", points=2.05 * R * (k - [1, 0, 1]) + [0.003, R + 0.002, 0.002], radius=R,
                    material=Grains(density=density))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(20)
    corners = simulation.positions("/cloth").astype(float)[triangulate_polygons(points, counts, indices)[0]]
    assert 0.98 < distance_to_triangles(simulation.positions("/p").astype(float), corners) / (R + 1e-3) < 1.05


def loaded(kind, ratio, **more):
    """Sixteen grains on a cloth or a net of 8 x 8 cells that is held at its edge; ratio: of their mass to that of a point."""
    scene, n = Scene(fps=60, substeps=8, iterations=4, **more), 9
    k = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2)
    held = np.flatnonzero((k % (n - 1) == 0).any(axis=1))
    if kind == "cloth":
        points, counts, indices = shapes.sheet(0.16, 0.16, 8, 8, horizontal=True)
        other = scene.cloth("/other", points, counts, indices, masses=np.full(n * n, 2e-3), material=Fabric(2e4, damping=0.0))
        held = np.flatnonzero(np.abs(points[:, [0, 2]]).max(axis=1) > 0.079)
    else:
        edges = [(i, j) for i in range(n * n) for j in range(i) if np.abs(k[i] - k[j]).sum() == 1]
        places = np.stack([0.02 * (k[:, 0] - 4), 0.0 * k[:, 0] - 0.004, 0.02 * (k[:, 1] - 4)], axis=1)
        other = scene.net("/other", places, edges, [1e5] * len(edges), [2e-3] * (n * n), radius=0.004)
    scene.pin("/pin", other, held)
    q = np.stack(np.meshgrid(np.arange(4), [0], np.arange(4), indexing="ij"), -1).reshape(-1, 3)
    scene.particles("/p", points=2.1 * R * (q - [1.5, 0, 1.5]) + [0.003, 0.0115, 0.002], radius=R,
                    material=Grains(density=ratio * 2e-3 / (4 / 3 * np.pi * R**3), rolling_friction=np.inf))
    return scene


@pytest.mark.parametrize(("kind", "ratio", "said"), [("cloth", 5, ""), ("cloth", 300, "implicit"), ("net", 10, ""),
                                                     ("net", 100, "give 32 substeps")])
def test_sweeps_that_a_load_is_too_heavy_for_are_warned_of(kind, ratio, said):
    """Where a net lets its grains through, a warning has said so; with the substeps that it asks for they stay on it."""
    scene = loaded(kind, ratio, solver="xpbd" if kind == "cloth" else "auto")
    found = [w for w in wsim.Simulation(scene, device="cpu").warnings if "leave it strained" in w]
    assert len(found) == bool(said) and all(said in w and "fix: give" in w and len(w) < 300 for w in found)
    if kind == "net":
        scene.substeps = 32 if said else 8
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(45)
        assert simulation.positions("/p")[:, 1].min() > -0.02 and not simulation.warnings
