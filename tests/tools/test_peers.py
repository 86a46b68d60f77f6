"""The arithmetic of the comparison with other engines, on made-up rows."""

import pytest

from tools.bench.verdict import fastest, front, sharpest, usable, verdicts


def row(ms, error, **more):
    return {"ms": ms, "error": error, "finite": True} | more


def test_the_front_drops_what_is_slower_and_no_better():
    a, b, c = row(1.0, 0.1), row(2.0, 0.05), row(4.0, 0.01)
    assert front([c, row(3.0, 0.05), a, b, row(4.0, 0.02), row(1.0, 0.2)], "error") == [a, b, c]


def test_equal_rows_stand_once_on_the_front():
    assert front([row(1.0, 0.1), row(1.0, 0.1)], "error") == [row(1.0, 0.1)]


def test_failed_rows_and_rows_worse_than_standing_still_are_left_out():
    good = row(1.0, 0.1)
    bad = [row(1.0, 0.1, finite=False), {"finite": False, "failed": "x"}, row(0.1, 0.3), row(0.1, 5.0), row(1.0, None),
           row(1.0, float("nan"))]
    assert usable([*bad, good], "error", 0.3) == [good]


def test_the_fastest_may_reach_the_limit_and_no_more():
    rows = [row(1.0, 0.1), row(2.0, 0.05), row(3.0, 0.01)]
    assert fastest(rows, "error", 0.05) == rows[1]
    assert fastest(rows, "error", 0.005) is None


def test_the_sharpest_takes_at_most_the_time():
    rows = [row(1.0, 0.1), row(2.0, 0.05), row(3.0, 0.01)]
    assert sharpest(rows, "error", 2.0) == rows[1]
    assert sharpest(rows, "error", 0.5) is None


@pytest.fixture
def found():
    """Ours: 1 ms for 0.02, 2 ms for 0.001. Implicit front: 4 ms for 0.04, 30 ms for 0.001; explicit: 3 ms for 0.01."""
    own = [row(1.0, 0.02), row(2.0, 0.001)]
    implicit = [row(4.0, 0.04), row(30.0, 0.001), row(50.0, 0.002)]
    return verdicts(own, implicit, [row(3.0, 0.01)], "error", 1.0)


def test_speedup_is_its_time_over_ours_at_its_error(found):
    assert [p["ratio"] for p in found["speedup"]["pairs"]] == [4.0, 15.0]
    assert found["speedup"]["verdict"]["ratio"] == 4.0
    assert found["speedup"]["best"]["peer"] == row(30.0, 0.001)


def test_tenth_is_our_time_at_a_tenth_of_its_error_over_its(found):
    assert found["tenth"]["verdict"]["ratio"] == 2.0 / 3.0


def test_accuracy_is_its_error_over_ours_in_its_time(found):
    assert [p["ratio"] for p in found["accuracy"]["pairs"]] == pytest.approx([40.0, 1.0])
    assert found["accuracy"]["verdict"]["peer"]["ms"] == 30.0


def test_a_row_that_we_do_not_reach_decides():
    lost = verdicts([row(1.0, 0.02)], [row(4.0, 0.04), row(0.5, 0.05), row(9.0, 0.01)], [row(3.0, 0.01)], "error", 1.0)
    assert lost["speedup"]["verdict"]["ratio"] is None and lost["speedup"]["verdict"]["peer"]["ms"] == 9.0
    assert lost["accuracy"]["verdict"]["ratio"] is None and lost["accuracy"]["verdict"]["peer"]["ms"] == 0.5
    assert lost["tenth"]["verdict"]["ratio"] is None and lost["tenth"]["verdict"]["ours"] is None


def test_without_rows_of_the_peer_there_is_no_verdict():
    assert all(v["verdict"] is None and v["pairs"] == [] for v in verdicts([row(1.0, 0.1)], [], [], "error", 1.0).values())
