"""How a cluster of blocks shares a net: every spring finds its other end in its own block's memory."""

import numpy as np
import pytest

from tools.bench.nets import reference
from wsim.physics.motion.fast_paths.cluster import PUSHES, ROOM, SpringCluster, cluster_for, exchange_halo


def ends(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each spring from both ends."""
    return np.concatenate([edges[:, 0], edges[:, 1]]), np.concatenate([edges[:, 1], edges[:, 0]])


def memory(cluster: SpringCluster, push: np.ndarray, n: int) -> np.ndarray:
    """Which point stands in each slot of each block, (size, slots), -1 for none, after all have written."""
    room = np.full((cluster.size, cluster.slots), -1)
    for i, places in enumerate(push.reshape(n, -1)):
        room[i // cluster.points, i % cluster.points] = i
        for place in places[places >= 0]:
            assert room[place >> 16, place & 0xffff] == -1            # no two points in one place
            room[place >> 16, place & 0xffff] = i
    return room


@pytest.mark.parametrize("n", [5, 32, 45, 64])
@pytest.mark.parametrize("size", [8, 16])
def test_every_spring_finds_its_other_end_at_home(n, size):
    edges = reference.spring_cloth(n).springs[0].edges
    point, other = ends(edges)
    plan = cluster_for(n * n, int(np.bincount(point).max()), size)
    cluster, held = exchange_halo(plan, n * n, point, other, 4)
    room = memory(cluster, held.push, n * n)
    assert np.array_equal(room[point // cluster.points, held.slot], other)
    assert 3 * 16 * cluster.slots <= ROOM and cluster.threads % 32 == 0
    assert np.array_equal(held.guests, (room[:, cluster.points:] >= 0).sum(1))


def test_a_net_within_one_block_writes_nowhere_else():
    point, other = ends(np.array([[0, 1], [1, 2]]))
    cluster, held = exchange_halo(SpringCluster(8, 1, 64, 8), 3, point, other, 8)
    assert cluster.slots == cluster.points and np.all(held.push == -1) and np.array_equal(held.slot, other)


@pytest.mark.parametrize("bytes_of_real", [4, 8])
def test_a_net_that_hangs_together_everywhere_is_left_to_launches(bytes_of_real):
    """500 springs of chance across 4096 points of 16 blocks fit; 12 a point need more memory than a block has."""
    edges = np.random.default_rng(1).integers(0, 4096, (24_000, 2))
    assert exchange_halo(SpringCluster(2, 8, 256, 16), 4096, *ends(edges[:500]), bytes_of_real) is not None
    assert exchange_halo(SpringCluster(2, 8, 256, 16), 4096, *ends(edges), bytes_of_real) is None


def test_a_point_that_all_blocks_hang_on_needs_more_writes_than_a_lane_has():
    star = np.column_stack([np.zeros(4095, int), np.arange(1, 4096)])
    assert PUSHES * 2 < 15 and exchange_halo(SpringCluster(2, 8, 256, 16), 4096, *ends(star), 4) is None
