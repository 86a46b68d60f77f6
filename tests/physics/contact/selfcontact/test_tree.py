"""The tree of moving boxes: pairs of boxes that meet are found, each once."""

import numpy as np
import pytest
import warp as wp

from tests.physics.contact.selfcontact.rig import crumple, run
from wsim.kernels.contact.selfcontact import search

STEPS = 64             # places in time where boxes are looked at


def boxes(near, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the boxes of triangles or edges all along their tubes, (STEPS, n, 3) each, in float64."""
    f = near.frames
    start, way, beta, lead = (getattr(f, name).numpy().astype(float) for name in ("start", "way", "beta", "lead"))
    at = start + np.linspace(0.0, lead[0], STEPS)[:, None, None] * way
    return (at - beta[:, None])[:, ids].min(axis=2), (at + beta[:, None])[:, ids].max(axis=2)


def meeting(near, a: np.ndarray, b: np.ndarray) -> set[tuple[int, int]]:
    """Pairs (i of a, j of b) without a common point that come within the thickness along an axis each, at one time."""
    (low, high), (low_b, high_b) = boxes(near, a), boxes(near, b)
    room, found = near.surfaces.thickness, np.zeros((len(a), len(b)), bool)
    for k in range(STEPS):
        gap = np.maximum(low[k][:, None] - high_b[k][None], low_b[k][None] - high[k][:, None])
        found |= (gap <= room).all(axis=-1)
    found &= ~(a[:, None, :, None] == b[None, :, None, :]).any(axis=(-1, -2))
    return set(zip(*map(np.ndarray.tolist, np.nonzero(found)), strict=True))


def candidates(near) -> tuple[list, list]:
    """(point, triangle) and (edge, edge) that were found."""
    count = int(near.found_at.struct.count.numpy()[0])
    assert count <= near.found_at.struct.capacity
    pair = near.found_at.struct.pair.numpy()[:count]
    edges = pair[pair[:, 1] < 0]
    return ([tuple(p) for p in pair[pair[:, 1] >= 0].tolist()],
            [tuple(sorted((i, -1 - k))) for i, k in edges.tolist()])


@pytest.mark.parametrize("side", [9, 12])
def test_boxes_that_meet_are_found_once(side):
    sim = run(crumple(0, side, 8.0))
    sim.run(8)
    near = sim.plan.method("selfcontact").near
    s = near.surfaces
    tip, edge = candidates(near)
    assert len(set(tip)) == len(tip) and len(set(edge)) == len(edge) and edge
    wanted = meeting(near, s.points[:, None], s.triangles)
    assert {(s.points[i], k) for i, k in wanted} <= set(tip)
    assert {p for p in meeting(near, s.edges, s.edges) if p[0] < p[1]} <= set(edge)
    assert len(tip) + len(edge) < 4 * (len(wanted) + len(edge)) and len(tip) < 0.7 * len(s.points) * len(s.triangles)


def test_threads_that_share_a_walk_find_what_one_finds():
    """Walks of a GPU, beside those of a CPU that go level by level."""
    sim = run(crumple(0, 9, 8.0))
    sim.run(8)
    near, walk = sim.plan.method("selfcontact").near, search.box_candidate_kernel(wp.float32, "walks")
    s, found_at = near.surfaces, near.found_at
    first = [sorted(each) for each in candidates(near)]
    for shares in (1, 4, 32):
        found_at.struct.count.zero_()
        seekers, looks = near.forest._walk_launch_rows([(kind, order, k, shares) for kind, order, k in near._tree_searches()])
        wp.launch(walk, seekers, [s.data, near.frames, looks, s.thickness], [found_at.at], device="cpu")
        assert [sorted(each) for each in candidates(near)] == first


def test_trees_are_sorted_by_where_triangles_are():
    """Leaves next to each other are near; none is lost, where triangles are fewer than leaves, too."""
    sim = run(crumple(0, 12, 8.0))
    near = sim.plan.method("selfcontact").near
    for tree, table in zip(near.trees, (near.surfaces.triangles, near.surfaces.edges), strict=True):
        before = tree.order.item.numpy()
        near.build()
        item = tree.order.item.numpy()
        assert sorted(item) == sorted(before) and (item[len(table):] == -1).all() and sorted(item[:len(table)]) == [
            *range(len(table))]
        middle = near.frames.start.numpy()[table].mean(axis=1)
        step = np.linalg.norm(np.diff(middle[item[:len(table)]], axis=0), axis=1)
        assert np.median(step) < 1.5 * near.surfaces.edge


def test_boxes_of_nodes_are_about_those_below_them():
    """Trees of triangles and of edges, in two worlds."""
    sim = run(crumple(0, 10), worlds=2)
    trees = sim.plan.method("selfcontact").near.forest
    for tree in trees.each:
        leaf = np.arange(4 * tree.leaves) % (2 * tree.leaves) >= tree.leaves
        box = np.where(leaf[:, None, None], tree.tree.box.numpy(), 0.0)
        tree.tree.box.assign(box)
        box = box.reshape(2, 2 * tree.leaves, 4, 3)
        for k in range(tree.leaves - 1, 0, -1):
            both = box[:, 2 * k:2 * k + 2]
            box[:, k] = np.where(np.arange(4)[:, None] % 2 == 0, both.min(axis=1), both.max(axis=1))
        trees.join_boxes()
        assert tree.leaves > 64 and np.array_equal(tree.tree.box.numpy().reshape(box.shape)[:, 1:], box[:, 1:])
