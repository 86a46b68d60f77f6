"""Conjugate gradients by a cluster of blocks: what a CPU and one block find, and the same to the bit from run to run. Skipped
where there is no CUDA device."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.physics.soft.soft_bar import bar
from wsim import Bulk
from wsim.physics.motion.fused import conjugate
from wsim.scene import Plane, shapes
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
SOFT = Bulk(1e5, 0.3, 1e3, "neo_hookean")


def held():
    return bar((8, 4, 4), (0.8, 0.4, 0.4), bulk=SOFT, iterations=4)


def dropped():
    scene = bar((4, 4, 4), (0.4, 0.4, 0.4), bulk=replace(SOFT, damping=1e-3), held=False, iterations=4)
    scene.collider("/floor", Plane(), at=(0.0, -0.21, 0.0))
    return scene


def two():
    """Two bodies, each a system of its own."""
    scene = held()
    points, tets = shapes.block((0.2, 0.2, 0.2), 3, at=(0.0, 2.0, 0.0))
    scene.soft("/cube", points, tets)
    return scene


def end(make, device: str, precision: str, frames: int = 12):
    sim = Simulation(make(), device=device, precision=precision)
    sim.run(frames)
    return sim.state.x.numpy(), sim.plan.ports.newton_assembly.system


@pytest.mark.parametrize("make", [held, dropped, two])
@pytest.mark.parametrize("precision, apart", [("float64", 1e-6), ("float32", 1e-4)])
def test_a_cluster_finds_what_a_cpu_and_one_block_find(make, precision, apart, monkeypatch):
    x, system = end(make, "cuda:0", precision)
    assert system.cluster is not None
    assert np.array_equal(x, end(make, "cuda:0", precision)[0])
    assert np.abs(x - end(make, "cpu", precision)[0]).max() < apart
    monkeypatch.setattr(conjugate, "ROOM", 0)
    one, system = end(make, "cuda:0", precision)
    assert system.cluster is None and np.abs(x - one).max() < apart


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_one_solve_is_that_of_numpy(precision):
    sim = Simulation(two(), device="cuda:0", precision=precision)
    sim.run(2)
    own, n = sim.plan.ports.newton_assembly, sim.model.points
    own.linearise(120.0)
    own.solve(own.f, 1e-6, 1000)
    first, column = own.rows.pair.numpy(), own.rows.column.numpy()
    block, free = own.A.block.numpy().astype(np.float64), own.rows.w.numpy() > 0.0
    A = np.zeros((n, 3, n, 3))
    for i in np.flatnonzero(free):
        A[i, :, i] += own.A.own.numpy()[i] * np.eye(3)
        for b in range(first[i], first[i + 1]):
            A[i, :, column[b]] += block[b]
            A[i, :, i] -= block[b]
    A = A[free][:, :, free].reshape(3 * free.sum(), -1)
    want = np.linalg.solve(A, own.f.numpy()[free].astype(np.float64).ravel())
    found = own.v.y.numpy()
    assert not found[~free].any()
    assert np.abs(found[free].ravel() - want).max() < (1e-5 if precision == "float64" else 1e-3) * np.abs(want).max()
