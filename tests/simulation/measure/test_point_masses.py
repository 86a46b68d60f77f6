"""Masses of points pair with their velocities in the author's order, whatever the order in the arrays is."""

import numpy as np
import pytest

import wsim
from wsim.scene import Scene, shapes
from wsim.simulation.simulation import Simulation

RNG = np.random.default_rng(4)


def start(points) -> np.ndarray:
    """Velocities [m/s] that tell each point from any other."""
    return np.cumsum(np.ones_like(points), axis=0) * (0.01, 0.02, -0.01)


def cloth(scene: Scene, weld: float = 0.0) -> np.ndarray:
    """A sheet whose points come in no order; with weld two halves whose seam has each point twice."""
    points, counts, indices = shapes.sheet(0.4, 0.2, 8, 4)
    if weld:
        half = points[:, 0] < 1e-6
        one = np.flatnonzero(half)
        points = np.concatenate([points, points[one]])
        swap = {int(p): len(points) - len(one) + k for k, p in enumerate(one)}
        right = points[indices.reshape(-1, 4)][:, :, 0].mean(axis=1) > 0
        faces = indices.reshape(-1, 4).copy()
        faces[right] = np.vectorize(lambda p: swap.get(int(p), int(p)))(faces[right])
        indices = faces.ravel()
    order = RNG.permutation(len(points))
    v = start(points[order])
    if weld:                                                           # points at one place move as one
        _, same = np.unique(points[order].round(6), axis=0, return_inverse=True)
        v = v[np.array([np.flatnonzero(same.ravel() == s)[0] for s in same.ravel()])]
    scene.cloth("/thing", points[order], counts, np.argsort(order)[indices], velocities=v, weld=weld)
    return v


def springs(scene: Scene) -> np.ndarray:
    points = RNG.uniform(size=(7, 3))
    v = start(points)
    scene.net("/thing", points, [[0, 4], [4, 2], [2, 6], [6, 1], [1, 5], [5, 3]], np.full(6, 50.0), np.arange(1.0, 8.0),
              velocities=v)
    return v


def soft(scene: Scene, **more) -> np.ndarray:
    points, tets = shapes.block((0.3, 0.2, 0.1), (3, 2, 1))
    order = RNG.permutation(len(points))
    v = start(points)
    scene.soft("/thing", points[order], np.argsort(order)[tets], velocities=v, **more)
    return v


@pytest.mark.parametrize("add", [cloth, lambda s: cloth(s, 1e-4), springs, soft], ids=["cloth", "welded", "springs", "soft"])
def test_momentum_is_the_sum_of_masses_times_velocities(add):
    """Against the sum over the arrays, in their own order; and the velocities are those that were given."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), frames=2)
    v = add(scene)
    sim = Simulation(scene, device="cpu", precision="float64")
    (body,) = sim.model.bodies
    m = body.point_masses
    assert np.abs(sim.velocities("/thing") - v).max() < 1e-6 and m.shape == (len(v),)
    assert m.sum() == pytest.approx(body.masses.sum(), rel=1e-12)
    assert m @ sim.velocities("/thing") == pytest.approx(body.masses @ sim.state.v.numpy()[:body.count], rel=1e-9)


def test_masses_of_a_net_are_those_that_were_given():
    scene = Scene()
    springs(scene)
    (body,) = Simulation(scene, device="cpu").model.bodies
    assert body.point_masses.tolist() == list(np.arange(1.0, 8.0))


def test_of_quadratic_tets_the_nodes_amid_edges_have_the_rest():
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    v = soft(scene, quadratic=True)
    sim = Simulation(scene, device="cpu")
    (body,) = sim.model.bodies
    assert len(body.point_masses) == len(v) == len(sim.velocities("/thing"))
    amid = np.asarray(body.middles) - body.first
    assert body.point_masses.sum() + body.masses[amid].sum() == pytest.approx(body.masses.sum(), rel=1e-6)


def test_masses_of_tied_bodies_add_up():
    scene = Scene()
    points, tets = shapes.block((0.2, 0.2, 0.2), (2, 2, 2))
    jelly = scene.soft("/jelly", points, tets)
    top = np.flatnonzero(points[:, 1] > 0.099)
    x, counts, indices = shapes.sheet(0.2, 0.2, 2, 2, horizontal=True, at=(0.0, 0.1, 0.0))
    sheet = scene.cloth("/sheet", x, counts, indices)
    near = [int(np.argmin(np.linalg.norm(points[top] - p, axis=1))) for p in x]
    scene.tie("/tie", sheet, range(len(x)), jelly, top[near])
    sim = Simulation(scene, device="cpu")
    total = sum(body.point_masses.sum() for body in sim.model.bodies)
    assert total == pytest.approx(sum(body.masses.sum() for body in sim.model.bodies), rel=1e-6)


@pytest.mark.parametrize("kind", ["rods", "mpm"])
def test_rods_and_material_points_keep_the_order_that_they_are_given_in(kind):
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    if kind == "rods":
        points = np.stack([np.linspace(0.0, 1.0, 6), np.zeros(6), np.zeros(6)], axis=1)
        scene.rods("/thing", points, [6], velocities=start(points))
        assert np.abs(Simulation(scene, device="cpu").velocities("/thing") - start(points)).max() < 1e-6
        return
    points = RNG.uniform(0.0, 0.2, (20, 3))
    scene.mpm("/thing", points=points, volumes=np.full(20, 1e-6), cell=0.05, velocity=start(points))
    (sample,) = wsim.Simulation(scene, device="cpu").samples()
    assert np.abs(sample.positions - points).max() < 1e-6 and np.abs(sample.velocities - start(points)).max() < 1e-6
