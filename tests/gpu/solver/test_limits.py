"""Strain limits of sheets in one launch of a cluster or a grid of blocks: the motion of launch by launch within rounding, and
twice the same bits. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.gpu.solver.sheets import end, moves_alike
from tests.make.physics.motion.fused.kernel_fusion import CLOTH, moved
from wsim.physics.motion.fused import domain_decomposition
from wsim.scene import Motion, Plane, Scene, Sphere, shapes
from wsim.scene.curve import Curve
from wsim.scene.fabric import Fabric

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
ROUNDING = 5e-6        # [m], after four frames
LIMIT = 0.01


def hung(damping: float = 0.0, tethers: bool = False) -> Scene:
    """A sheet, a fifth of whose edges are at their limits, on two corners of which one moves."""
    scene = Scene(solver="explicit")
    points, counts, indices = shapes.sheet(0.6, 0.4, 20, 14, horizontal=True)
    soft = Fabric(**{**CLOTH.__dict__, "damping": damping, "strain_limit": LIMIT})
    cloth = scene.cloth("/cloth", points, counts, indices, material=soft, tethers=tethers)
    scene.pin("/a", cloth, [0])
    scene.pin("/b", cloth, [20], motion=Motion([0.0, 1.0], [np.eye(4), moved(-0.1, 0.3, 0.0)]))
    return scene


def met() -> Scene:
    """The same with a soft pin, tethers, a load, a ball that rises into it and a floor."""
    scene = hung(1e-4, tethers=True)
    scene.pin("/soft", "/cloth", [300], stiffness=50.0, damping=0.1)
    scene.collider("/ball", Sphere(0.1), motion=Motion([0.0, 1.0], [moved(0.0, -0.12, 0.0), moved(0.0, 0.2, 0.0)]))
    scene.force("/push", "/cloth", range(200, 260), Curve([0.0, 0.2], [[0.0, 0.0, 0.0], [0.0, 0.02, 0.01]]))
    scene.collider("/floor", Plane(), at=(0.0, -0.2, 0.0))
    return scene


def thrice() -> Scene:
    """Three sweeps a substep."""
    scene = hung(1e-4)
    scene.integrator, scene.substeps, scene.iterations = "leapfrog", 120, 3
    return scene


SCENES = {"hung": hung, "thrice": thrice, "met": met}
BLOCKS = {"cluster of 8": 8, "cluster": 16, "grid": 64}


@pytest.mark.parametrize("blocks", BLOCKS)
@pytest.mark.parametrize("name", SCENES)
def test_limits_in_one_launch_hold_as_launch_by_launch(name, blocks, monkeypatch):
    moves_alike(SCENES[name], BLOCKS[blocks], ROUNDING, monkeypatch)


@pytest.mark.parametrize("blocks", BLOCKS)
def test_edges_stay_within_what_a_sweep_leaves_of_their_limit(blocks, monkeypatch):
    """Without limits they are stretched by more than twice as much, and a live limit is that of the next frame."""
    monkeypatch.setattr(domain_decomposition, "blocks_of", lambda *given: [BLOCKS[blocks]])
    _, _, pull = end(hung())
    model, rest, stretched = pull.model, pull.model.stack("rest"), []
    edges = model.bodies[0].edges
    for limit in (LIMIT, 10.0):
        sim = wsim.Simulation(hung(), device="cuda:0")
        assert sim.plan.method("explicit").taken == {"xpbd"}
        sim.set("/cloth", "strain_limit", limit)
        for _ in range(6):
            sim.step()
        x = sim.state.x.numpy()
        stretched.append(max(np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
                             / np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)) - 1.0)
    assert 0.9 * LIMIT < stretched[0] < 0.5 * stretched[1]
