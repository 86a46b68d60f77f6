"""Clusters that solve for a body: every point and every block of a row has a thread, as registers allow."""

import pytest

from wsim.physics.motion.fast_paths.cluster import THREADS
from wsim.physics.motion.fused.conjugate import ROOM, plan_pcg_cluster


@pytest.mark.parametrize("n, most, size, real",
                         [(825, 18, 16, 4), (425, 14, 8, 8), (8, 7, 16, 4), (2000, 20, 16, 4), (1, 0, 8, 4)])
def test_every_point_and_block_has_a_thread(n, most, size, real):
    found = plan_pcg_cluster(n, most, size, real)
    assert found.points * size >= n and found.lanes * found.entries >= most and found.threads <= THREADS
    assert found.threads % 32 == 0 and found.threads >= 2 * size                # threads that send sums
    assert 9 * real * found.entries <= ROOM


def test_what_registers_do_not_hold_has_no_cluster():
    assert plan_pcg_cluster(3000, 20, 16, 4) is None and plan_pcg_cluster(2000, 26, 16, 8) is None
