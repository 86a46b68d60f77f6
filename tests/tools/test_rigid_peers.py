"""The arithmetic of the comparison of rigid bodies with other engines: judges on motions that are known."""

import numpy as np
import pytest

from tools.bench.rigid import judges
from tools.bench.rigid.overlap import overlaps
from tools.bench.rigid.problems import PROBLEMS, scene
from tools.bench.rigid.problems import body as solid
from tools.bench.rigid.settings import ENGINES, settings, words
from tools.bench.rigid.table import slower, table

STILL = (0.0, 0.0, 0.0, 1.0)


def states(x, q=STILL, v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0)) -> dict:
    """Of one body over frames."""
    x = np.array(x, float).reshape(-1, 1, 3)
    return {"x": x, **{name: np.broadcast_to(value, (len(x), 1, len(value))) for name, value in (("q", q), ("v", v), ("w", w))}}


def test_boxes_overlap_by_the_least_of_all_axes():
    half, level = np.full((2, 3), 0.5), np.array([STILL, STILL])
    assert np.allclose(overlaps(np.array([[0, 0, 5.0], [0.9, 0.2, 5.0]]), level, half), [0.1])
    turned = np.array([STILL, (0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8))])
    depth = 0.5 + 0.5 * np.sqrt(2.0) - 1.1                              # an edge in a face
    assert np.allclose(overlaps(np.array([[0, 0, 5.0], [1.1, 0.0, 5.0]]), turned, half), [depth])
    assert len(overlaps(np.array([[0, 0, 5.0], [1.25, 0.0, 5.0]]), turned, half)) == 0
    assert np.allclose(overlaps(np.array([[0, 0, 0.4], [9.0, 0.0, 5.0]]), level, half), [0.1])      # in the floor


def test_edges_that_cross_are_apart_where_no_face_says_so():
    lean = np.array([(0.0, np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8)), (np.sin(np.pi / 8), 0.0, 0.0, np.cos(np.pi / 8))])
    top = np.sqrt(0.5)
    for gap in (-0.01, 0.01):
        found = overlaps(np.array([[0, 0, 5.0], [0, 0, 5.0 + 2.0 * top + gap]]), lean, np.full((2, 3), 0.5))
        assert np.allclose(found, [0.01] if gap < 0.0 else [])


def test_a_motion_by_the_closed_form_has_no_error():
    slide = PROBLEMS["sliding box"].make()
    assert judges.sliding(slide, states([(25.0 / 9.81, 0.0, 0.25)]))["distance"] < 1e-12
    assert judges.sliding(slide, states([(1.1 * 25.0 / 9.81, 0.0, 0.25)]))["distance"] == pytest.approx(10.0)
    t, heights, start, v = np.arange(1, 217) / 60.0, [], np.sqrt(2.0 / 9.81), 0.8 * np.sqrt(2.0 * 9.81)
    for s in t:
        a, u = s - start, v
        while a > 2.0 * u / 9.81:
            a, u = a - 2.0 * u / 9.81, 0.8 * u
        heights.append(0.5 + (1.0 - 0.5 * 9.81 * s * s if s < start else u * a - 0.5 * 9.81 * a * a))
    ball = PROBLEMS["three bounces"].make()
    assert judges.bounces(ball, states([(0.0, 0.0, h) for h in heights]))["height"] < 1e-9
    assert judges.bounces(ball, states([(0.0, 0.0, 0.5)] * 216))["height"] == 100.0


def test_a_free_turn_about_a_principal_axis_is_a_steady_one():
    q = judges.turned((1.0, 2.0, 3.0), (0.0, 0.0, 2.0), 1.0, 200)
    assert np.allclose(q, (0.0, 0.0, np.sin(1.0), np.cos(1.0)), atol=1e-8)
    top = scene([solid(None, [0.1], (0, 0, 0), 1.0, (1.0, 2.0, 3.0), spin=[0.0, 0.0, 2.0])], 1.0)
    found = judges.racket(top, states([(0, 0, 0)], q, w=(0.0, 0.0, 2.02)))
    assert found["energy"] == pytest.approx(1.01**2 - 1.0) and found["momentum"] == pytest.approx(0.01)
    assert found["angle"] < 1e-4


def test_a_rod_swings_with_the_energy_that_it_falls_by():
    one = {"gravity": [0, 0, -9.81], "bodies": [{"mass": 1.0, "moments": [0.0, 1.0 / 12.0, 1.0 / 12.0]}]}
    quarter = judges.swung(one, 0.1)[0]
    h = 1e-4
    w = (judges.swung(one, 0.1 + h)[0] - judges.swung(one, 0.1 - h)[0]) / (2.0 * h)
    assert 0.5 / 3.0 * w * w == pytest.approx(9.81 * 0.5 * np.sin(quarter), rel=1e-6)


def row(engine: str, ms: float, sag: float, setting=None, **more) -> dict:
    return {"problem": "column of ten", "engine": engine, "setting": setting or {"substeps": 8, "iterations": 2}, "ms": ms,
            "cpu_ms": 1.0 / ms, "errors": {"sag": sag, "speed": 0.0, "fallen": False} | more}


def test_where_wsim_is_behind_is_said():
    rows = [row("wsim", 2.0, 1.0), row("wsim", 1.0, 3.0), row("mujoco", 1.0, 2.0, {"steps": 4}),
            row("mujoco", 4.0, 0.5, {"steps": 9}), row("mujoco", 0.1, 0.1, {"steps": 1}, fallen=True)]
    said = slower(rows)
    assert len(said) == 2                                              # what has fallen is no row to be beaten
    assert "2 times as long" in said[0] and said[0].endswith("slower")
    assert said[1].endswith("its least is 1 -- less accurate")
    assert "| column of ten | wsim 8 x 2 | 2 | 0.5 | sag 1 mm, speed 0 |" in table(rows)
    assert "0.5 times as long" in slower(rows, "cpu_ms")[0] and not slower(rows, "cpu_ms")[0].endswith("slower")


def test_every_engine_has_a_setting_for_every_scene_and_words_for_it():
    for engine in ENGINES:
        for problem in PROBLEMS:
            said = [words(engine, setting) for setting in settings(engine, problem)]
            assert len(set(said)) == len(said) > 0
