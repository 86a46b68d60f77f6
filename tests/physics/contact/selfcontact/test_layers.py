"""Layers that fly: fifty a millimetre apart go as if nothing were near them; two that meet push, and are said to;
surfaces of soft bodies that meet do not intersect, by the exact test, at any frame."""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.contact.selfcontact.momentum import moments
from tests.physics.contact.selfcontact.rig import THIN, crossed, layers, run, said, solvers
from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.scene import Plane, Scene, shapes

COUNT, SIDE, GAP, SPEED, SPIN, FRAMES = 50, 3, 1e-3, 20.0, 20.0, 10


@pytest.mark.parametrize("solver", solvers("leapfrog", "newton midpoint"))
def test_fifty_layers_that_are_thrown_and_turn_keep_their_path_and_their_turn(solver):
    """2.7 m of flight and half a turn: the path to 1e-6 of its length, angular momentum about the centre to 1e-4,
    nothing pushed, projected or cut; one search in five frames at most, behind the first."""
    scene = layers(COUNT, SIDE, GAP, size=0.06, velocity=(SPEED, 0.0, 0.0), spin=SPIN, **solver)
    for cloth in scene.cloths:
        cloth.material = replace(THIN, thickness=0.6 * GAP, stretch=100.0, shear=30.0)
    sim = run(scene)
    m = np.concatenate([b.masses[b.index - b.first] for b in sim.model.bodies])[:, None]

    def state() -> tuple[np.ndarray, np.ndarray]:
        """Centre of all points, and moment of momentum about it."""
        p, L = moments(sim)[:2]
        x = np.concatenate([sim.positions(b.path) for b in sim.model.bodies])
        centre = (m * x).sum(axis=0) / m.sum()
        return centre, L - np.cross(centre, p)
    (start, turn), searches = state(), []
    for frame in range(1, FRAMES + 1):
        sim.step()
        centre, now = state()
        way = SPEED * frame / scene.fps
        assert np.abs(centre - start - (way, 0.0, 0.0)).max() < 1e-6 * way
        assert np.abs(now - turn).max() < 1e-4 * np.linalg.norm(turn)
        searches.append(said(sim)["searches"])
    told = said(sim)
    assert sim.plan.integrator == solver["integrator"]
    assert told["near_pairs"] > 1000 and told["surface_contacts"] == told["projected"] == told["cut"] == told["held"] == 0
    assert searches[-1] - searches[0] <= (FRAMES - 1) / 5 and crossed(sim) == 0


@pytest.mark.parametrize("solver", first_and_slow(solvers("xpbd", "newton bdf2", "newton")))
def test_layers_that_change_their_momentum_are_said_to_touch(solver):
    """Two layers meet by 1.3 edges in a substep, one a frame: what moves the centre of one is the other. The list is made anew
    behind the sweeps that stop them, and the new one has no push."""
    scene = layers(2, 8, 0.02, **(solver | dict(fps=600.0, substeps=1)))
    for cloth, speed in zip(scene.cloths, (8.0, -8.0), strict=True):
        cloth.velocities[:, 1] = speed
    sim = run(scene)
    v, anew, searches = sim.velocities("/layer0").mean(axis=0), 0, 0.0
    for _ in range(4):
        sim.step()
        now, told = sim.velocities("/layer0").mean(axis=0), said(sim)
        if np.linalg.norm(now - v) > 0.1:
            assert told["surface_contacts"] >= 64 and told["touching"] == 128
            anew += told["searches"] - searches > 1
        v, searches = now, told["searches"]
    assert abs(v[1]) < 0.5 and told["surface_contacts"] == told["touching"] == 0 < anew


@pytest.mark.parametrize("solver", ["explicit", "implicit"])
def test_a_block_of_jelly_that_falls_on_another_does_not_enter_it(solver):
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=24.0, substeps=8, iterations=4, solver=solver)
    for k in (0, 1):
        points, tets = shapes.block((0.2, 0.2, 0.2), (3, 3, 3))
        scene.soft(f"/block{k}", np.array(points) + (0.03 * k, 0.15 + 0.26 * k, 0.02 * k), tets, self_collision=True)
    scene.collider("/floor", Plane("Y"))
    sim = run(scene)
    n = len(scene.softs[0].points)
    triangles = np.concatenate([tet_surface_triangles(soft.tets) + n * k for k, soft in enumerate(scene.softs)])
    gap = np.inf
    for _ in range(12):
        sim.step()
        written = np.concatenate([sim.positions(soft.path) for soft in scene.softs]).astype(np.float32)
        assert not len(crossed_triangles(written, triangles))
        gap = min(gap, written[n:, 1].min() - written[:n, 1].max())
    assert gap < 0.02                                                           # they have met
