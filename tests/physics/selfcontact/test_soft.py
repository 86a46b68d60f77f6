"""Soft bodies that meet: no triangle of their surfaces intersects, by the exact test, at any frame."""

import numpy as np
import pytest

from tests.physics.selfcontact.rig import run
from wsim.geometry.tetra.tets import surface
from wsim.physics.selfcontact.crossings import crossings
from wsim.scene import Plane, Scene, shapes


@pytest.mark.parametrize("solver", ["explicit", "implicit"])
def test_a_block_of_jelly_that_falls_on_another_does_not_enter_it(solver):
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=24.0, substeps=8, iterations=4, solver=solver)
    for k in (0, 1):
        points, tets = shapes.block((0.2, 0.2, 0.2), (3, 3, 3))
        scene.soft(f"/block{k}", np.array(points) + (0.03 * k, 0.15 + 0.26 * k, 0.02 * k), tets, self_collision=True)
    scene.collider("/floor", Plane("Y"))
    sim = run(scene)
    n = len(scene.softs[0].points)
    triangles = np.concatenate([surface(soft.tets) + n * k for k, soft in enumerate(scene.softs)])
    gap = np.inf
    for _ in range(12):
        sim.step()
        written = np.concatenate([sim.positions(soft.path) for soft in scene.softs]).astype(np.float32)
        assert not len(crossings(written, triangles))
        gap = min(gap, written[n:, 1].min() - written[:n, 1].max())
    assert gap < 0.02                                                           # they have met
