"""Draws: grids, Latin hypercubes, lists and files; what is refused."""

import numpy as np
import pytest

from wsim.scene import SceneError
from wsim.sweep.vary.draws import grid_draws, latin_hypercube, parse_sweep_axes


def test_a_logarithmic_grid_has_equal_ratios_and_both_ends():
    values = [d["stretch"] for d in grid_draws(parse_sweep_axes(["stretch=log(100,10000,5)"]))]
    assert (values[0], values[-1]) == (100.0, 10000.0)
    np.testing.assert_allclose(np.divide(values[1:], values[:-1]), 10.0**0.5, rtol=1e-12)


def test_a_grid_is_the_product_with_the_last_axis_fastest():
    draws = grid_draws(parse_sweep_axes(["a=lin(0,1,2)", "/p:b=list(x,y,z)"]))
    assert [(d["a"], d["/p:b"]) for d in draws] == [(0.0, "x"), (0.0, "y"), (0.0, "z"), (1.0, "x"), (1.0, "y"), (1.0, "z")]


def test_a_hypercube_has_one_draw_in_each_part_of_every_axis():
    draws = latin_hypercube(parse_sweep_axes(["a=lin(-1,1)", "b=log(1,1e6)", "c=list(u,v)"]), 40, seed=3)
    for name, part in (("a", lambda v: (v + 1.0) / 2.0), ("b", lambda v: np.log(v) / np.log(1e6))):
        assert sorted(int(40 * part(d[name])) for d in draws) == list(range(40))
    assert sum(d["c"] == "u" for d in draws) == 20
    assert draws == latin_hypercube(parse_sweep_axes(["a=lin(-1,1)", "b=log(1,1e6)", "c=list(u,v)"]), 40, seed=3)
    assert draws != latin_hypercube(parse_sweep_axes(["a=lin(-1,1)", "b=log(1,1e6)", "c=list(u,v)"]), 40, seed=4)


def test_files_hold_numbers_vectors_and_joint_draws(tmp_path):
    for name, text in {"one.csv": "stretch\n1\n2.5\n", "wind.csv": "1,0,0\n0,0,2\n", "both.csv": "a,/p:b\n1,x\n2,y\n"}.items():
        (tmp_path / name).write_text(text)
    draws = grid_draws(parse_sweep_axes([f"stretch={tmp_path / 'one.csv'}", f"wind={tmp_path / 'wind.csv'}"]))
    winds = ((1.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    assert [(d["stretch"], d["wind"]) for d in draws] == [(a, w) for a in (1.0, 2.5) for w in winds]
    assert grid_draws(parse_sweep_axes([str(tmp_path / "both.csv")])) == [{"a": 1.0, "/p:b": "x"}, {"a": 2.0, "/p:b": "y"}]


def test_a_list_holds_vectors():
    assert grid_draws(parse_sweep_axes(["gravity=list(0 -9.81 0, 0 0 -3.7)"])) == [{"gravity": (0.0, -9.81, 0.0)},
                                                                                   {"gravity": (0.0, 0.0, -3.7)}]


@pytest.mark.parametrize(("texts", "words"), [
    (["a=lin(2,1,3)"], "its range 2 to 1 is empty"), (["a=log(0,1,3)"], "must begin above 0"),
    (["a=lin(0,1,0)"], "0 values of a range"), (["a=lin(0,inf,3)"], "finite numbers"), (["a=list()"], "its list is empty"),
    (["a"], "write it as TARGET="), (["a=3"], "allowed are lin"), (["a=nothere.csv"], "cannot be read: No such file"),
    (["a=lin(0,1,2)", "a=list(3)"], "is varied twice"), ([], "nothing varies"), (["a=lin(0,1)"], "no number of values"),
    (["a=lin(0,1,2000)", "b=lin(0,1,2000)"], "4000000 runs; allowed are 1 to 1000000"),
])
def test_what_is_no_draw_is_refused(texts, words):
    with pytest.raises(SceneError, match=words):
        grid_draws(parse_sweep_axes(texts))


def test_a_file_with_rows_of_two_columns_is_refused(tmp_path):
    (tmp_path / "two.csv").write_text("1,2\n")
    with pytest.raises(SceneError, match="row 1 has 2 columns; draws of wind have one, or three"):
        parse_sweep_axes([f"wind={tmp_path / 'two.csv'}"])
