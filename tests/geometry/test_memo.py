"""What is kept is what would be computed again, by content, and belongs to whoever asked for it."""

import numpy as np
import pytest

from wsim.geometry.memo import KEPT, digest_of_arguments, keep_latest_results
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Scene, shapes
from wsim.scene.check.scene import check_scene


@pytest.fixture
def counted():
    """A function that is kept, and the list of its calls."""
    calls = []

    @keep_latest_results
    def double(values, factor):
        calls.append(factor)
        return [values * 2.0, (values * factor,)]

    return double, calls


def test_equal_arrays_are_computed_once_whatever_their_identity(counted):
    double, calls = counted
    first, again = double(np.arange(4.0), 3), double(np.arange(4.0), 3)
    assert calls == [3] and again[0].tolist() == first[0].tolist() and again[1][0].tolist() == [0.0, 3.0, 6.0, 9.0]


def test_an_array_changed_in_place_is_another_one(counted):
    double, calls = counted
    values = np.arange(4.0)
    double(values, 3)
    values[2] = 7.0
    assert double(values, 3)[0].tolist() == [0.0, 2.0, 14.0, 6.0] and calls == [3, 3]


def test_a_result_changed_by_its_owner_is_not_what_the_next_one_gets(counted):
    double, _ = counted
    for _ in range(3):
        result = double(np.arange(4.0), 3)
        assert result[0].tolist() == [0.0, 2.0, 4.0, 6.0] and result[1][0].tolist() == [0.0, 3.0, 6.0, 9.0]
        result[0][:] = result[1][0][:] = -1.0


def test_only_the_latest_are_kept(counted):
    double, calls = counted
    for factor in (*range(KEPT + 1), KEPT, 0):
        double(np.ones(2), factor)
    assert calls == [*range(KEPT + 1), 0]


def test_type_and_shape_are_content():
    zeros = np.zeros(12, np.float32)
    assert len({digest_of_arguments(a) for a in (zeros, zeros.reshape(4, 3), zeros.reshape(3, 4), zeros.view(np.int32),
                                                 zeros[:0], None, (zeros[:0], "x")[1])}) == 7
    assert digest_of_arguments(np.arange(6).reshape(2,
                                                3).T) == digest_of_arguments(np.ascontiguousarray(np.arange(6).reshape(2, 3).T))


def test_a_mesh_is_cut_once_for_check_and_model(monkeypatch):
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    sheet = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 23, 29))
    cuts = []
    cut = triangulate_polygons.__globals__["_cut_polygons"]
    monkeypatch.setitem(triangulate_polygons.__globals__, "_cut_polygons", lambda *mesh: cuts.append(1) or cut(*mesh))
    for _ in range(2):
        assert check_scene(scene) == []
        triangulate_polygons(sheet.points.astype(np.float64), sheet.counts, sheet.indices)
    assert len(cuts) == 1                                     # quadrangles alone: one call of _cut_polygons for the whole mesh
