"""On a GPU: poses of many colliders and their broad phase, captured, are those of the CPU; lists of faces of meshes.
Skipped where there is no device."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.candidate_lists import Pair, apart
from tests.make.physics.contact.collider.poses import crowd, met, mixed, table, tried
from wsim.physics.contact import contacts

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def test_poses_of_many_colliders_are_those_of_the_cpu():
    """To 1e-14, but for the ball and the stride of the mesh that deforms, the last row: its points of up to 0.15 m are float32.
    A blend of keys and a distance take four roundings of 2^-24 on each device, and a GPU rounds a product with its sum once."""
    found = []
    for device in ("cpu", "cuda:0"):
        c = tried(mixed(np.random.default_rng(4)), device=device)
        for time in (0.1, 0.6):
            c.prepare(time)
        found.append(table(c))
    for cpu, gpu in zip(*found, strict=True):
        np.testing.assert_allclose(cpu[:, :-1], gpu[:, :-1], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(cpu[:, -1], gpu[:, -1], rtol=0.0, atol=2 * 4 * 0.15 * 2.0**-24)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_broad_phase_changes_no_bit(monkeypatch, precision):
    """A tree that a graph builds anew and refits, of two worlds."""
    found = []
    for many in (contacts.MANY, 10**9):
        monkeypatch.setattr(contacts, "MANY", many)
        result, c = met(crowd(0), device="cuda:0", precision=precision, worlds=2)
        assert (c.tree is None) == (many == 10**9)
        found.append(result)
    assert all(np.array_equal(tree, each) for tree, each in zip(*found, strict=True))


@pytest.mark.parametrize("shape, how", [("blob", "moves"), ("blob", "deforms"), ("slab", "moves"), ("fine", "stands")])
def test_lists_find_what_a_search_of_the_whole_mesh_finds(shape, how):
    pair = Pair(np.random.default_rng(3), shape, how, device="cuda:0")
    met, differ = np.sum([apart(*found) for found in pair.substeps()], axis=0)
    assert met > 150 and differ == 0
