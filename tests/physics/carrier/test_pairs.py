"""The list of pairs: keys, order, colours, room. float64, CPU."""

import numpy as np
import pytest
import warp as wp

from tests.physics.carrier.rig import REAL, H, Points, Rig, Walls, feature
from wsim.kernels.carrier.pairs import key
from wsim.model.state import Field, Part, State
from wsim.physics.carrier.carriers import EDGE, POINT, TRIANGLE


def pile(n: int = 30, contacts: int = 80, seed: int = 0) -> tuple[Points, Points, Walls, list[dict]]:
    """Points and a triangle net that meet in many pairs with friction, some of them with a wall."""
    rng = np.random.default_rng(seed)
    a = Points(rng.uniform(0.5, 2.0, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), "bdf2")
    b = Points(rng.uniform(0.5, 2.0, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
    wall = Walls([np.zeros(3)], [(0.0, 0.0, 0.1)])
    rows = []
    for k in range(contacts):
        normal = rng.normal(size=3)
        row = {"a": feature(rng.integers(n)), "n": normal / np.linalg.norm(normal), "gap": -0.003, "friction": (0.4, 0.3)}
        if k % 5 == 0:
            rows.append(row | {"kind": 1, "b": feature(0, np.zeros(3)), "keys": (k, 7)})
        else:
            rows.append(row | {"b": feature(rng.permutation(n)[:3], (0.3, 0.3)), "keys": (k // 2, k)})
    return a, b, wall, rows


def test_a_key_says_kind_object_and_feature_and_nothing_else():
    """63 bits, apart for any two features, in the order of kind, object, feature."""
    cases = [(POINT, 0, 0), (POINT, 0, 2**31 - 1), (POINT, 1, 0), (POINT, 2**24 - 1, 5), (EDGE, 0, 0), (TRIANGLE, 3, 9),
             (127, 2**24 - 1, 2**31 - 1)]
    out = wp.zeros(len(cases), dtype=wp.int64, device="cpu")
    kind, object, feature = (wp.array([c[k] for c in cases], dtype=int, device="cpu") for k in range(3))

    def pack(kind: wp.array(dtype=int), object: wp.array(dtype=int), feature: wp.array(dtype=int),
             out: wp.array(dtype=wp.int64)):
        i = wp.tid()
        out[i] = key(kind[i], object[i], feature[i])
    wp.launch(wp.kernel(pack, name="pack_keys", module="unique", enable_backward=False), len(cases), [kind, object, feature],
              [out], device="cpu")
    expected = [(k << 56) | (o << 32) | f for k, o, f in cases]
    assert out.numpy().tolist() == expected and sorted(set(expected)) == expected and expected[-1] < 2**63 - 1


def ran(order: np.ndarray | None = None, colours: int = 24):
    a, b, wall, rows = pile()
    rig = Rig((a, b), (a, wall), capacity=128, colours=colours)
    for _ in range(2):
        rig.substep(rows if order is None else [rows[k] for k in order], sweeps=3)
    return rig, a, b


@pytest.mark.parametrize("colours", [3, 24])
def test_bits_do_not_depend_on_the_order_in_which_pairs_were_found(colours):
    """With a remainder (3 colours) and without."""
    rng = np.random.default_rng(5)
    rig, a, b = ran(colours=colours)
    left = rig.pairs.coloring.colour.numpy()[:80]
    assert (left == colours).any() == (colours == 3) and left.min() >= 0
    for _ in range(3):
        other, c, d = ran(rng.permutation(80), colours)
        assert np.array_equal(rig.push(), other.push()) and np.array_equal(rig.total(), other.total())
        assert np.array_equal(a.velocity(), c.velocity()) and np.array_equal(b.velocity(), d.velocity())
        assert np.array_equal(rig.pairs.list.key_a.numpy()[:80], other.pairs.list.key_a.numpy()[:80])
    assert np.abs(rig.push()).max() > 0.01


def test_no_two_pairs_of_a_colour_move_one_thing_and_every_pair_is_in_one_group():
    """But in the remainder. Groups hold pairs of one colour and one combination."""
    rig, _, _ = ran(colours=3)
    pairs, c = rig.pairs.list, rig.pairs.coloring
    first, order = pairs.first.numpy(), pairs.order.numpy()
    a, b, colour, kind = (array.numpy()[:80] for array in (c.a, c.b, c.colour, pairs.kind))
    assert sorted(order[:first[-1]]) == list(range(80))
    for group in range(len(first) - 1):
        rows = order[first[group]:first[group + 1]]
        assert (colour[rows] == group // 2).all() and (kind[rows] == group % 2).all()
    for number in range(3):
        moved = np.concatenate([a[colour == number].ravel(), b[colour == number].ravel()])
        moved = moved[moved >= 0]
        assert len(moved) > 20 and len(set(moved)) == len(moved)


def test_pairs_stand_by_their_keys():
    rig, _, _ = ran(np.random.default_rng(2).permutation(80))
    keys = list(zip(rig.pairs.list.key_a.numpy()[:80], rig.pairs.list.key_b.numpy()[:80], strict=True))
    assert keys == sorted(keys) and len(set(keys)) == 80


def test_sweeps_converge_to_where_nothing_penetrates_and_impulses_only_press():
    """Complementarity of the normal impulses without friction: gaps >= 0, lam >= 0, lam C = 0, each to rounding."""
    a, b, wall, rows = pile(contacts=20)
    rig = Rig((a, b), (a, wall), capacity=32)
    for row in rows:
        row["friction"] = (0.0, 0.0)
    places = [a.place(), b.place()]
    rig.substep(rows, sweeps=400)
    order = sorted(rows, key=lambda row: row["keys"])
    lam = np.einsum("ij,ij->i", rig.push(), [row["n"] for row in order])
    gaps = []
    for row in order:
        ids, at = row["b"]
        weights = np.array([1.0 - at.sum(), *at])
        moved = (a.place() - places[0])[row["a"][0][0]]
        other = (0.0, 0.0, 0.1 * H) if row.get("kind") else weights @ (b.place() - places[1])[ids]
        gaps.append(row["gap"] + row["n"] @ (moved - other))
    assert min(gaps) > -1e-12 and lam.min() >= 0.0 and np.abs(lam * gaps).max() < 1e-13 and (lam > 0.0).sum() > 5
    said = rig.pairs.indicators()
    assert said["pairs"] == 20 and said["pair_residual"] < 1e-12


def test_what_few_sweeps_leave_is_said():
    """Points in a row run into each other: the residual is the deepest gap after a sweep, to rounding."""
    points = Points(np.ones(5), np.zeros((5, 3)), [(1.0 - 0.5 * k, 0.0, 0.0) for k in range(5)])
    rig = Rig((points, points))
    rig.substep([{"a": feature(k + 1), "b": feature(k), "n": (1.0, 0.0, 0.0), "gap": 0.0, "keys": (k, 0)} for k in range(4)])
    deepest = np.diff(points.place()[:, 0]).min()
    assert deepest < -1e-4 and abs(rig.pairs.indicators()["pair_residual"] + deepest) < 1e-17


def test_sweeps_converge_as_gauss_seidel_does_on_a_chain():
    """n pairs between n + 1 equal masses that are pressed together: the error falls by cos^2(pi / (n + 1)) a sweep."""
    n, errors = 9, []
    for sweeps in (60, 61, 2000):
        x = np.zeros((n + 1, 3))
        points = Points(np.ones(n + 1), x, [(1.0 - 0.2 * k, 0.0, 0.0) for k in range(n + 1)])
        rig = Rig((points, points))
        rig.substep([{"a": feature(k + 1), "b": feature(k), "n": (1.0, 0.0, 0.0), "gap": 0.0, "keys": (k, 0)}
                     for k in range(n)], sweeps=sweeps)
        errors.append(rig.push()[:, 0])
    first, second = (np.abs(found - errors[2]).max() for found in errors[:2])
    assert first > 1e-6 and errors[2].min() > 0.1
    assert abs(second / first - np.cos(np.pi / (n + 1))**2) < 1e-4


def test_a_list_that_is_too_short_says_what_it_wanted_and_grows():
    a, b, wall, rows = pile()
    rig = Rig((a, b), (a, wall), capacity=16)
    rig.substep(rows)
    rig.status.fetch()
    assert int(rig.pairs.list.count.numpy()[0]) == 16
    (remedy,) = rig.pairs.retry(rig.status)
    assert remedy.kind == "grow" and remedy.act() == "80 pairs were in contact, and there was room for 16"
    rig.substep(rows)
    rig.status.fetch()
    assert rig.pairs.retry(rig.status) == [] and int(rig.pairs.list.count.numpy()[0]) == 80


def test_an_overlap_is_left_at_a_bounded_speed_that_stays_no_motion():
    """0.5 m/s, half a substep's worth of it each for equal masses; velocities stay 0."""
    a, b = (Points([1.0], [[x, 0.0, 0.0]], [0.0, 0.0, 0.0], i) for x, i in ((-0.05, "bdf2"), (0.05, "backward_euler")))
    rig = Rig((a, b))
    rig.substep([{"a": feature(0), "b": feature(0), "n": (1.0, 0.0, 0.0), "gap": -0.1}], sweeps=20)
    apart = a.place()[0, 0] - b.place()[0, 0]
    assert abs(apart + 0.1 - 0.5 * H) < 1e-15
    assert np.abs(a.velocity()).max() < 1e-15 and np.abs(b.velocity()).max() < 1e-15
    rig.substep([])
    assert abs(a.place()[0, 0] - b.place()[0, 0] - apart) < 1e-15, "the way out of an overlap is no part of BDF2's history"


def column(warm: bool) -> tuple[float, float]:
    """A column of six points of 1 kg at rest under 10 m/s^2, solved to rounding once and then with a sweep a substep: errors of
    the impulses [N s] and the places [m] after 20."""
    n, points_at = 6, 0.1 * np.arange(6)
    points = Points(np.ones(n), [(0.0, 0.0, z) for z in points_at], np.zeros((n, 3)), gravity=(0.0, 0.0, -10.0))
    ground = Walls([np.zeros(3)], [np.zeros(3)])
    rig = Rig((points, points), (points, ground), warm=State() if warm else None)
    for k in range(20):
        z = points.place()[:, 2]
        rows = [{"a": feature(i + 1), "b": feature(i), "n": (0.0, 0.0, 1.0), "gap": z[i + 1] - z[i] - 0.1, "keys": (i + 1, 0)}
                for i in range(n - 1)]
        rows.append({"kind": 1, "a": feature(0), "b": feature(0, np.zeros(3)), "n": (0.0, 0.0, 1.0), "gap": z[0],
                     "keys": (0, 0)})
        rig.substep(rows, sweeps=1 if k else 400)
    weights = 10.0 * H * np.arange(6, 0, -1)
    return np.abs(rig.push()[:, 2] - weights).max(), np.abs(points.place()[:, 2] - points_at).max()


def test_a_column_that_was_solved_stays_so_with_one_sweep_once_it_begins_with_the_last_impulses():
    """Each bears the weight above it. Without, a sweep carries an impulse one point further, and the column sinks."""
    assert max(column(True)) < 1e-11
    assert min(column(False)) > 0.01


def test_an_impulse_is_found_by_its_keys_and_dropped_where_the_normal_has_turned():
    n, turned = np.array((0.0, 0.0, 1.0)), np.array((0.0, 0.9, 0.436))
    points = Points([1.0] * 3, np.zeros((3, 3)), [(0.0, 0.0, -1.0)] * 3)
    wall = Walls([np.zeros(3)], [np.zeros(3)])
    rig = Rig((points, wall), warm=State())

    def row(k: int, normal, gap: float) -> dict:
        return {"a": feature(k), "b": feature(0, np.zeros(3)), "n": normal, "gap": gap, "keys": (k, 5)}
    rig.substep([row(k, n, 0.0) for k in range(3)])
    assert np.abs(rig.push() - n).max() < 1e-14                 # 1 kg from 1 m/s to rest
    rig.put([row(2, n, 1.0), row(0, turned / np.linalg.norm(turned), 1.0)])
    rig.pairs.order(rig.clock)
    assert np.array_equal(rig.push(), [(0.0, 0.0, 0.0), n])


def test_a_part_that_grows_keeps_its_rows_and_those_of_its_snapshot():
    fields = (Field("p", "m", True, "first"), Field("k", "", True, "of 64 bits", "long"), Field("q", "m", True, "third"),
              Field("r", "m", False, "of a substep"))
    part, state, rng = Part.allocate("list", fields, 0, REAL, "cpu", 3), State(), np.random.default_rng(0)
    state.add(part)
    values = {"p": rng.normal(size=(3, 3)), "q": rng.normal(size=(3, 3)), "k": rng.integers(2**60, size=3)}
    for name, value in values.items():
        part.arrays[name].assign(value)
    state.snapshot()
    for name in values:
        part.arrays[name].zero_()
    part.enlarge(7, REAL, "cpu")
    assert all(not part.arrays[name].numpy().any() and len(part.arrays[name]) == 7 for name in values)
    state.restore()
    for name, value in values.items():
        found = part.arrays[name].numpy()
        assert np.array_equal(found[:3], value) and not found[3:].any()
