"""Clusters and other bodies push each other: momentum goes from one to the other, and the sum stays."""

from math import inf

import numpy as np
import pytest

from tests.physics.soft.clusters.lattice import cube_points
from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.scene import Scene, SceneError, shapes
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

POINTS, TETS = shapes.block((0.2, 0.2, 0.2), (3, 3, 3))
POINTS = POINTS - POINTS.mean(axis=0)
SURFACE = tet_surface_triangles(TETS)


def thrown(stiffness: float) -> Scene:
    """A cluster of half a kilogram that moves down at 2 m/s."""
    scene = Scene(fps=60, substeps=10, iterations=6, gravity=(0, 0, 0))
    scene.clusters("/c", POINTS + [0.01, 0.16, 0.02], counts=np.full(len(SURFACE), 3), indices=SURFACE.ravel(), mass=0.5,
                   stiffness=stiffness, radius=0.002, self_collision=True, velocities=np.tile([0, -2.0, 0], (len(POINTS), 1)))
    return scene


@pytest.mark.parametrize("stiffness", [inf, 4e3])
@pytest.mark.parametrize("what", ["cloth", "soft", "clusters"])
def test_a_blow_keeps_the_momentum_of_both(what, stiffness):
    scene = thrown(stiffness)
    if what == "cloth":
        scene.cloth("/b", *shapes.sheet(0.6, 0.6, 8, 8, horizontal=True), self_collision=True,
                    material=Fabric(stretch=500.0, density=300.0, thickness=0.004))
    elif what == "soft":
        scene.soft("/b", POINTS, TETS, material=Bulk(young=3e4, density=60.0, poisson=0.3), self_collision=True)
    else:
        scene.clusters("/b", POINTS, counts=np.full(len(SURFACE), 3), indices=SURFACE.ravel(), mass=0.3, stiffness=inf,
                       radius=0.002, self_collision=True)
    sim = Simulation(scene, device="cpu")
    sim.run(6)
    given = sim.model.body("/b").point_masses @ sim.velocities("/b").astype(float)
    kept = 0.5 * sim.velocities("/c").astype(float).mean(axis=0)
    assert given[1] < -0.1 and np.abs(given + kept - [0, -1.0, 0]).max() < 1e-5


def test_a_cluster_that_hangs_on_a_net_stretches_it_by_its_weight():
    """A spring that is tied to a point of it: (m + m') g / k."""
    p = cube_points(3, 0.1)
    top = int(np.flatnonzero((np.abs(p[:, [0, 2]]).sum(axis=1) == 0.0) & (p[:, 1] > 0.05))[0])
    scene = Scene(fps=60, substeps=16, iterations=8, solver="xpbd", air_drag=6.0)
    net = scene.net("/rope", [[0, 0.55, 0], [0, 0.1, 0]], [[0, 1]], [300.0], [0.01])
    scene.pin("/pin", net, [0])
    scene.tie("/tie", net, [1], scene.clusters("/c", p, mass=2.0, stiffness=inf), [top])
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(240)
    x = sim.positions("/rope")
    assert np.array_equal(x[1], sim.positions("/c")[top])
    assert abs(0.1 - x[1, 1] - 2.01 * 9.81 / 300.0) < 1e-3 * 2.01 * 9.81 / 300.0


def test_a_tie_goes_through_usd(tmp_path):
    scene = Scene(frames=4)
    sheet = shapes.sheet(0.2, 0.2, 2, 2, at=(0.0, -0.2, 0.1))
    cloth = scene.cloth("/cloth", np.asarray(sheet[0], np.float32), *sheet[1:])
    at = int(np.argmin(np.linalg.norm(np.asarray(sheet[0]) - np.asarray(sheet[0])[0], axis=1)))
    body = scene.clusters("/c", (cube_points(3, 0.1) + np.asarray(sheet[0])[at] - [0.1, 0.1, 0.1]).astype(np.float32), mass=1.0)
    scene.tie("/tie", cloth, [at], body, [26])
    save(scene, tmp_path / "a.usda")
    assert load(tmp_path / "a.usda").ties == scene.ties


def test_two_points_on_one_are_refused():
    scene = Scene()
    body = scene.clusters("/c", cube_points(3, 0.1), mass=1.0)
    net = scene.net("/n", [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [1, 0, 0]], [[0, 2], [1, 2]], [10.0], [1.0])
    scene.tie("/tie", net, [0, 1], body, [26, 26])
    with pytest.raises(SceneError, match="/tie: two points are tied to one point of /c"):
        Simulation(scene, device="cpu")
