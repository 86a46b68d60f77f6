"""Coordinates, rows and the elimination of joints, each by itself; loops and heavy ends."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.joints.islands import chain
from tests.physics.joints.make import errors, places, rod, start
from wsim.geometry import rotation
from wsim.kernels.rigid.joint import coordinates
from wsim.physics.rigid.joints.islands import elimination_order
from wsim.physics.rigid.joints.joint import revolute_joint


@wp.kernel(module="unique", enable_backward=False)
def joint_places(Q_a: wp.array(dtype=wp.quatd), Q_b: wp.array(dtype=wp.quatd), p: wp.array(dtype=wp.vec3d), form: int,
                 cone: wp.vec2d, turned: wp.array(dtype=wp.vec3d), shift: wp.array(dtype=wp.vec3d),
                 rows: wp.array(dtype=wp.mat33d)):
    i = wp.tid()
    e = coordinates.JointFrames()
    e.Q_a = Q_a[i]
    e.Q_b = Q_b[i]
    e.p_b = p[i]
    found = coordinates.joint_coordinates(e, form, cone)
    turned[i] = found.turned
    shift[i] = found.shift
    rows[i] = found.turn


def places_of(Q_a, Q_b, p, form=0, cone=(0.0, 0.0)):
    n = len(Q_a)
    out = [wp.zeros(n, dtype=t, device="cpu") for t in (wp.vec3d, wp.vec3d, wp.mat33d)]
    arrays = [wp.array(v, dtype=t, device="cpu") for v, t in ((Q_a, wp.quatd), (Q_b, wp.quatd), (p, wp.vec3d))]
    wp.launch(joint_places, n, [*arrays, form, wp.vec2d(*cone)], out, device="cpu")
    return [a.numpy() for a in out]


def random_turns(n: int, seed: int) -> np.ndarray:
    return rotation.unit_quat(np.random.default_rng(seed).normal(size=(n, 4)))


def test_swing_and_twist_make_up_the_turn():
    A, B = random_turns(50, 1), random_turns(50, 2)
    p = np.random.default_rng(3).normal(size=(50, 3))
    turned, shift, _ = places_of(A, B, p)
    swing = rotation.quaternion_exponential(turned * (0.0, 1.0, 1.0))
    twist = rotation.quaternion_exponential(turned * (1.0, 0.0, 0.0))
    again = rotation.quat_product(A, rotation.quat_product(swing, twist))
    assert np.abs(np.abs((again * B).sum(1)) - 1.0).max() < 1e-14
    assert np.abs(rotation.quat_rotate(A, shift) - p).max() < 1e-14


@pytest.mark.parametrize("form, cone", [(0, (0.0, 0.0)), (2, (1.0, 1.0 / 0.6))])
def test_rows_of_turns_are_the_rates_of_their_coordinates(form, cone):
    """Central differences of turns about the world's axes, also of swings of two radians."""
    A, B, p = random_turns(60, 4), random_turns(60, 5), np.zeros((60, 3))
    turned, _, rows = places_of(A, B, p, form, cone)
    near = np.linalg.norm(places_of(A, B, p)[0][:, 1:], axis=1) < 2.5
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        more, less = (places_of(A, rotation.quat_product(rotation.quaternion_exponential(s * step)[None], B), p, form, cone)[0]
                      for s in (1, -1))
        rate = (more - less) / 2e-6
        keep = near & (np.abs(rate).max(1) < 1e3)
        assert keep.sum() > 30 and np.abs(rate - rows[:, :, k])[keep].max() < 1e-7


def filled_in(pairs) -> int:
    order = elimination_order(np.array(pairs), 1 + max(max(p) for p in pairs))
    return len(order.near)


def test_a_tree_of_chains_fills_nothing_in():
    chain = [(k, k + 1) for k in range(20)]
    assert filled_in(chain) == 19
    arms = [(0, 1), (1, 2), (0, 3), (3, 4), (0, 5), (5, 6)]
    assert filled_in(arms) == 3 + 3                              # those at body 0 are near each other, an arm is a chain


def test_a_ring_fills_in_once_for_each_joint():
    assert filled_in([(k, (k + 1) % 10) for k in range(10)]) == 10 + 7


def test_a_factor_is_that_of_the_whole_matrix():
    """The order's program, run in NumPy with blocks of one, against a dense Cholesky factor."""
    rng = np.random.default_rng(0)
    pairs = np.array([(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 2), (1, 4), (-1, 0)])
    J = np.zeros((8, 5))
    for j, (a, b) in enumerate(pairs):
        J[j, [k for k in (a, b) if k >= 0]] = rng.normal(size=sum(k >= 0 for k in (a, b)))
    order = elimination_order(pairs, 5)
    A = (J @ J.T + np.eye(8))[np.ix_(order.joint, order.joint)]
    n = 8
    block = np.zeros(order.blocks)
    block[:n] = np.diag(A)
    for i in range(n):
        for e in range(order.first_near[i], order.first_near[i + 1]):
            block[n + e] = A[order.near[e], i]
    for i in range(n):
        block[i] = np.sqrt(block[i])
        mine = range(order.first_near[i], order.first_near[i + 1])
        t = order.first_target[i]
        for e in mine:
            block[n + e] /= block[i]
            for f in range(order.first_near[i], e + 1):
                block[order.target[t]] -= block[n + e] * block[n + f]
                t += 1
    L = np.linalg.cholesky(A)
    assert np.abs(np.diag(L) - block[:n]).max() < 1e-13
    assert all(abs(L[order.near[e], i] - block[n + e]) < 1e-13 for i in range(n)
               for e in range(order.first_near[i], order.first_near[i + 1]))


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_chain_with_a_hundred_times_its_weight_at_the_end_stays_closed_and_loses_nothing(precision):
    sim = chain(100.0, precision=precision)
    m = sim.plan.method("rigid")
    worst = 0.0
    for _ in range(100):
        sim.step()
        worst = max(worst, errors(sim)[0])
    energy = m.indicators(None, None)["rigid_energy"]
    assert worst < (1e-9 if precision == "float64" else 1e-6) and abs(energy) < (1.0 if precision == "float64" else 2.0)
    assert 0.5 * 100.0 * (m.velocities()[-1] ** 2).sum() > 1000.0          # of the joules that it has turned over


def test_a_four_bar_loop_stays_closed_though_it_says_too_much():
    """Four hinges lock 20 of 18 coordinates and leave one: it swings, and goes back through where it came from."""
    points = [(0.0, 0.0, 0.0), (0.3, 1.0, 0.0), (1.8, 1.5, 0.0), (1.5, 0.0, 0.0)]
    bars = [rod(f"/b{k}", 0.5 * np.add(points[k], points[k + 1])) for k in range(3)]
    sides = [None, *bars, None]
    hinges = [revolute_joint(f"/j{k}", sides[k], sides[k + 1], at=points[k], axis=(0.0, 0.0, 1.0)) for k in range(4)]
    sim = start(*bars, *hinges)
    m = sim.plan.method("rigid")
    energy = m.indicators(None, None)["rigid_energy"]
    worst, moved = 0.0, 0.0
    first = places(sim)
    for _ in range(240):
        sim.step()
        worst, moved = max(worst, *errors(sim)), max(moved, np.abs(places(sim) - first).max())
    assert worst < 1e-9 and moved > 0.5
    assert abs(m.indicators(None, None)["rigid_energy"] / energy - 1.0) < 1e-3
