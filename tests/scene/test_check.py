"""Each mistake that a scene can hold is found by its prim path, and a sound scene holds none."""

import re
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from tests.conftest import grid
from wsim.scene import Box, Capsule, Plane, Scene, Sphere, Surface, shapes
from wsim.scene.check import objects
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric


def scaled(x: float, y: float = 1.0, z: float = 1.0) -> Motion:
    return Motion.still(np.diag([x, y, z, 1.0]))


def test_a_sound_scene_has_no_problem(scene):
    scene.collider("/floor", Plane(), at=(0, -2, 0))
    scene.collider("/pill", Capsule(0.2, 0.0))
    scene.net("/net", [[0, 0, 0.5], [0, 0, 1]], [[0, 1]], [10.0], [1.0])
    assert check_scene(scene) == []


def test_seams_of_a_collider_are_no_fault(scene):
    """Faces with corners of their own: a cloth comes apart there, a collider does not, and has no weld that could be set."""
    points, counts, indices = grid()
    apart = np.asarray(points)[indices], counts, np.arange(len(indices))
    scene.collider("/wall", Surface(*apart))
    assert check_scene(scene) == []
    scene.cloth("/torn", *apart)
    assert {p.path for p in check_scene(scene)} == {"/torn"}


MISTAKES = {
    # what: (how the scene is spoilt, path that is named, words of the message)
    "fps": (lambda s: setattr(s, "fps", 0.0), "/", "fps is 0"),
    "substeps": (lambda s: setattr(s, "substeps", 0), "/", "substeps is 0"),
    "iterations": (lambda s: setattr(s, "iterations", -1), "/", "iterations is -1"),
    "frames": (lambda s: setattr(s, "frames", -5), "/", "frames is -5"),
    "integrator": (lambda s: setattr(s, "integrator", "rk5"), "/", "integrator is 'rk5'"),
    "up": (lambda s: setattr(s, "up", "X"), "/", "up axis is 'X'"),
    "gravity": (lambda s: setattr(s, "gravity", (0.0, nan, 0.0)), "/", "gravity"),
    "nothing": (lambda s: s.cloths.clear(), "/", "nothing here can move"),
    "duplicate": (lambda s: s.collider("/cloth", Plane()), "/cloth", "2 objects"),
    "path": (lambda s: s.collider("floor", Plane()), "floor", "no prim path"),
    "model": (lambda s: setattr(s.cloths[0], "model", "jelly"), "/cloth", "model is 'jelly'"),
    "nan point": (lambda s: s.cloths[0].points.__setitem__((5, 1), nan), "/cloth", "finite"),
    "index": (lambda s: s.cloths[0].indices.__setitem__(3, 99), "/cloth", "99"),
    "counts": (lambda s: s.cloths[0].counts.__setitem__(0, 5), "/cloth", "37"),
    "velocities": (lambda s: setattr(s.cloths[0], "velocities", np.zeros((3, 3))), "/cloth", "3 velocities"),
    "nan velocity": (lambda s: setattr(s.cloths[0], "velocities", np.full((16, 3), inf)), "/cloth", "16 velocities"),
    "zero mass": (lambda s: setattr(s.cloths[0], "masses", np.zeros(16, np.float32)), "/cloth", "16 of 16 masses"),
    "negative mass": (lambda s: setattr(s.cloths[0], "mass", -1.0), "/cloth", "mass is -1"),
    "thickness": (lambda s: setattr(s.cloths[0], "thicknesses", -np.ones(16, np.float32)), "/cloth", "thicknesses"),
    "weld": (lambda s: setattr(s.cloths[0], "weld", -1.0), "/cloth", "weld is -1"),
    "flat transform": (lambda s: setattr(s.cloths[0], "motion", scaled(0.0)), "/cloth", "flattens"),
    "nan transform": (lambda s: setattr(s.cloths[0], "motion", scaled(nan)), "/cloth", "transform holds NaN"),
    "huge": (lambda s: setattr(s.cloths[0], "motion", scaled(1e6)), "/cloth", "1e+06 m from the prim's own origin"),
    "all pinned": (lambda s: s.pin("/more", "/cloth", range(16)), "/cloth", "all 16 points are pinned"),
    "pin body": (lambda s: s.pin("/more", "/clot", [0]), "/more", "'/clot', which is no cloth"),
    "pin index": (lambda s: s.pin("/more", "/cloth", [2, 16]), "/more", "point 16 of /cloth; allowed: 0 to 15"),
    "pin places": (lambda s: setattr(s.pins[0], "places", np.zeros((5, 3))), "/pin", "5 places"),
    "pin stiffness": (lambda s: setattr(s.pins[0], "stiffness", -1.0), "/pin", "stiffness is -1"),
    "pin stiffness nan": (lambda s: setattr(s.pins[0], "stiffness", nan), "/pin", "stiffness is nan"),
    "rows": (lambda s: s.collider("/ball", Sphere(1.0), motion=Motion.still(Motion.at_place((1.0, 2.0, 3.0)).at(0.0).T)),
             "/ball", "the last row of its matrix at t = 0 s is (1.0, 2.0, 3.0, 1.0)"),
    "pin motion": (lambda s: setattr(s.pins[0], "motion", scaled(1.0, 2.0)), "/pin", "scales, shears or mirrors"),
    "mirrored collider": (lambda s: s.collider("/b", Sphere(1.0), motion=scaled(-1.0)), "/b", "mirrors"),
    "radius": (lambda s: s.collider("/b", Sphere(0.0)), "/b", "radius is 0"),
    "half": (lambda s: s.collider("/b", Box((1.0, -1.0, 1.0))), "/b", "half is -1"),
    "friction": (lambda s: s.collider("/b", Plane(), static_friction=-0.1), "/b", "static_friction is -0.1"),
    "collider mesh": (lambda s: s.collider("/b", Surface([[0, 0, 0]], [3], [0, 1, 2])), "/b", "1"),
    "poses": (lambda s: s.collider("/b", Surface(*grid(), poses=Curve([0.0], np.zeros((1, 3, 3))))), "/b", "(1, 3, 3)"),
    "spring index": (lambda s: s.net("/n", [[0, 0, 0], [1, 0, 0]], [[0, 2]], [1.0], [1.0]), "/n", "points [0, 2]"),
    "spring length": (lambda s: s.net("/n", [[0, 0, 0], [0, 0, 0]], [[0, 1]], [1.0], [1.0]), "/n", "length 0"),
    "rest length": (lambda s: s.net("/n", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [1.0], [1.0], lengths=[-1.0]), "/n",
                    "rest lengths"),
    "spring stiffness": (lambda s: s.net("/n", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [-1.0], [1.0]), "/n", "stiffnesses"),
    "net mass": (lambda s: s.net("/n", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [1.0], [0.0]), "/n", "masses"),
    "empty pin": (lambda s: s.pin("/p", "/cloth", []), "/p", "no points"),
    "no springs": (lambda s: s.net("/n", [[0, 0, 0]], np.zeros((0, 2)), [1.0], [1.0]), "/n", "without springs"),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_is_an_error_at_its_path(scene, what):
    spoil, path, words = MISTAKES[what]
    spoil(scene)
    found = [p for p in check_scene(scene) if p.fatal]
    assert any(p.path == path and words in p.text for p in found), found


ODD = {
    "too large": (lambda s: setattr(s.cloths[0], "motion", scaled(70.0, 70.0, 70.0)), "/cloth", "metersPerUnit"),
    "too small": (lambda s: setattr(s.cloths[0], "motion", scaled(1e-4, 1e-4, 1e-4)), "/cloth", "metersPerUnit"),
    "strong gravity": (lambda s: setattr(s, "gravity", (0.0, -981.0, 0.0)), "/", "metersPerUnit"),
    "falls": (lambda s: s.pins.clear(), "/cloth", "falls for ever"),
    "far": (lambda s: s.cloths[0].points.__iadd__(np.float32(9e3)), "/cloth", "rounded"),
}


@pytest.mark.parametrize("what", ODD)
def test_what_is_odd_is_a_warning_at_its_path(scene, what):
    spoil, path, words = ODD[what]
    spoil(scene)
    found = check_scene(scene)
    assert not any(p.fatal for p in found), found
    assert any(p.path == path and words in p.text for p in found), found


def two_sheets(gap: float) -> tuple:
    """Two sheets side by side, `gap` [m] between their facing edges: points, counts, indices."""
    points, counts, indices = grid()
    beside = points + np.float32([1.0 + gap, 0, 0])
    return np.concatenate([points, beside]), np.tile(counts, 2), np.concatenate([indices, indices + len(points)])


def test_a_piece_without_a_pin_is_named(scene):
    scene.cloths.clear()
    scene.cloth("/cloth", *two_sheets(0.2))
    assert any("1 of its 2 separate pieces" in p.text for p in check_scene(scene))
    scene.pin("/other", "/cloth", [20])
    assert check_scene(scene) == []


def test_a_welded_seam_joins_the_pieces(scene):
    scene.cloths.clear()
    cloth = scene.cloth("/cloth", *two_sheets(1e-4))
    assert any("separate pieces" in p.text for p in check_scene(scene))
    cloth.weld = 1e-3
    assert check_scene(scene) == []


def test_soft_pins_leave_the_points_free(scene):
    scene.pin("/soft", "/cloth", range(16), stiffness=100.0)
    assert check_scene(scene) == []


def test_several_mistakes_are_reported_together_and_errors_come_first():
    scene = Scene(substeps=0, gravity=(0.0, -981.0, 0.0))
    scene.cloth("/a", *grid(), model="jelly")
    scene.pin("/p", "/b", [0])
    found = check_scene(scene)
    assert {p.path for p in found if p.fatal} == {"/", "/a", "/p"}
    assert [p.fatal for p in found] == sorted((p.fatal for p in found), reverse=True)


def test_the_far_limit_is_where_float32_steps_by_eight_millimetres():
    assert np.spacing(np.float32(objects.FAR)) == pytest.approx(0.0078125)


@pytest.mark.parametrize("field", ["velocities", "masses", "thicknesses", "rest_points"])
def test_a_list_of_length_0_is_a_wrong_length_and_no_crash(field):
    scene = Scene()
    sheet = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 3, 3))
    setattr(sheet, field, np.zeros((0, 3) if field in ("velocities", "rest_points") else 0, np.float32))
    assert any(p.fatal and p.text.startswith("0 ") and "allowed: 16" in p.text for p in check_scene(scene))


def test_damping_far_longer_than_a_substep_is_warned_of(scene):
    scene.cloths[0].material = replace(scene.cloths[0].material, damping=1.0)
    (found,) = [p for p in check_scene(scene) if "damping is 1 s" in p.text]
    assert not found.fatal and "less damping" in found.text


@pytest.mark.parametrize(("change", "words"), [
    (lambda scene: setattr(scene, "gravity", -9.81), r"/: gravity is -9.81; allowed: three numbers .*; fix: give gravity="),
    (lambda scene: setattr(scene, "wind", (1.0, 2.0)), r"/: wind is \(1.0, 2.0\); allowed: three numbers .*; fix: give"),
    (lambda scene: setattr(scene.cloths[0], "path", "/a b"), "/a b: this is no prim path; allowed: an absolute path"),
    (lambda scene: setattr(scene.cloths[0], "path", "/1st"), "/1st: this is no prim path"),
    (lambda scene: setattr(scene.cloths[0], "material", Fabric(stretch=1e30)),
     r"/cloth: its stretch is 1e\+30 N/m; expected: 0.001 to 1e\+09 N/m; fix: author it in stage units")])
def test_numbers_and_names_that_cannot_be_meant(scene, change, words):
    change(scene)
    scene.pins.clear()
    assert re.match(words, str(check_scene(scene)[0]).removeprefix("error: ").removeprefix("warning: "))
