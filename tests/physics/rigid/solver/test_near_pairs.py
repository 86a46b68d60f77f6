"""Pairs of shapes that are near each other, by a table of a world's pairs and by trees of boxes."""

import numpy as np
import pytest

import wsim
from wsim.physics.rigid import meetings
from wsim.physics.rigid.contacts import pair_list


def heap() -> wsim.Scene:
    """Boxes and balls in a heap, a hinge between two, on a plane and beside a step."""
    scene = wsim.Scene(fps=60, substeps=4)
    scene.collider("/ground", wsim.Plane())
    scene.collider("/step", wsim.Box((0.3, 0.2, 0.3)), at=(0.6, 0.2, 0.0))
    bodies = [scene.body(f"/b{k}", wsim.Box((0.1, 0.1, 0.1)) if k % 2 else wsim.Sphere(0.1),
                         at=(0.19 * (k % 3), 0.12 + 0.21 * (k // 3), 0.02 * k)) for k in range(8)]
    scene.joint("revolute", "/hinge", bodies[0], bodies[1], at=(0.1, 0.12, 0.0))
    return scene


def listed_pairs(monkeypatch, few: int, worlds: int):
    """(shapes of the pairs (2, rows), places) behind 12 frames; few: shapes up to which a table lists them."""
    for module in (meetings, pair_list):
        monkeypatch.setattr(module, "FEW", few)
    simulation = wsim.Simulation(heap(), device="cpu", precision="float64", worlds=worlds)
    for _ in range(12):
        simulation.step()
    contacts = simulation.plan.method("rigid").contacts
    assert (contacts.broad.near is None) == (few == 0)
    count = int(contacts.broad.first.numpy()[0, -1])
    return np.stack([contacts.list.a.numpy(), contacts.list.b.numpy()])[:, :count], simulation.plan.method("rigid").get("x")


@pytest.mark.parametrize("worlds", [1, 3])
def test_a_table_lists_the_pairs_of_trees(monkeypatch, worlds):
    (trees, x), (table, same) = (listed_pairs(monkeypatch, few, worlds) for few in (0, 64))
    assert trees.shape[1] >= 8 * worlds and np.array_equal(trees, table)
    assert np.array_equal(x, same)
    hinged = (np.sort(table % 8, axis=0) == [[0], [1]]).all(axis=0) & (table < 8 * worlds).all(axis=0)
    assert not hinged.any()                                    # bodies of a joint do not touch
