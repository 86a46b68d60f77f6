"""Each mistake that a soft body can hold is found by its path and element, and a sound one holds none."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from wsim.scene import Plane, Scene, Skin, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion
from wsim.scene.solid import Bulk

N, T = 125, 320                    # points and tets of a block of 4 x 4 x 4 cells
FACE = ([3], [0, 1, 2])
FLOOR = np.array([[1.0, 0, 0, 0], [0, 0, 1, -1], [0, -1, 0, 0], [0, 0, 0, 1]])      # a plane's z is +y, at y = -1


@pytest.fixture
def scene() -> Scene:
    """A block 1 m wide, 4 cells across, over a floor, with a skin."""
    scene = Scene()
    scene.soft("/body/sim", *shapes.block((1, 1, 1), 4), skins=[Skin("/body/skin", np.eye(3) / 2, *FACE)])
    scene.collider("/floor", Plane(), motion=Motion.still(FLOOR))
    return scene


def scaled(x: float, y: float = 1.0, z: float = 1.0) -> Motion:
    return Motion.still(np.diag([x, y, z, 1.0]))


def spoil(**fields):
    """Sets fields of the soft body."""
    def do(scene: Scene) -> None:
        for name, value in fields.items():
            setattr(scene.softs[0], name, value)
    return do


def made_of(**values):
    return spoil(material=replace(Bulk(), **values))


def row(tet: int, corners):
    return lambda scene: scene.softs[0].tets.__setitem__(tet, corners)


def at(name: str, index, value):
    """One value of an array of the soft body."""
    def do(scene: Scene) -> None:
        soft = scene.softs[0]
        given = {"points": soft.points, "rest_points": soft.points.copy(), "masses": np.ones(N, np.float32),
                 "which": np.zeros(T, np.int32), "filled": np.ones(T, np.float32)}[name]
        given[index] = value
        setattr(soft, name, given)
    return do


def test_a_sound_body_has_no_problem(scene):
    soft = scene.softs[0]
    soft.others, soft.which, soft.filled = [Bulk(young=1e4)], np.arange(T) % 2, np.full(T, 0.0, np.float32)
    soft.masses, soft.mass = np.ones(N, np.float32), 3.0
    assert check_scene(scene) == []


def test_a_mirrored_body_is_sound_when_its_tets_are_turned(scene):
    soft = scene.softs[0]
    soft.motion = scaled(-1.0)
    assert any("320 of its 320 tets are turned inside out" in p.text for p in check_scene(scene))
    soft.tets = soft.tets[:, [0, 1, 3, 2]]
    assert check_scene(scene) == []


MISTAKES = {
    # what: (how the scene is spoilt, path that is named, words of the message)
    "nan point": (at("points", (7, 1), nan), "/body/sim", "1 of 125 points are NaN or infinite, first at index 7"),
    "index": (row(9, [0, 1, 2, N]), "/body/sim", "tet 9 is naming points that there are not; allowed are 0 to 124"),
    "twice": (row(9, [0, 1, 2, 2]), "/body/sim", "tet 9 is naming a point twice"),
    "copy": (lambda s: row(9, s.softs[0].tets[4][[1, 2, 0, 3]])(s), "/body/sim", "tet 9 is given before (the first as tet 4)"),
    "no tet": (spoil(tets=np.zeros((0, 4), np.int32)), "/body/sim", "there is no tet"),
    "inverted": (lambda s: row(9, s.softs[0].tets[9][[0, 1, 3, 2]])(s), "/body/sim",
                 "1 of its 320 tets are turned inside out at rest, first tet 9"),
    "flat": (spoil(motion=scaled(1.0, 1e-8)), "/body/sim", "320 tets (first: 0) are flat"),
    "flat at rest": (at("rest_points", (slice(None), 1), 0.0), "/body/sim", "320 tets (first: 0) are flat"),
    "flat transform": (spoil(motion=scaled(0.0)), "/body/sim", "flattens"),
    "nan transform": (spoil(motion=scaled(nan)), "/body/sim", "transform holds NaN"),
    "rest count": (spoil(rest_points=np.zeros((3, 3), np.float32)), "/body/sim", "3 rest points; allowed: 125"),
    "nan rest": (at("rest_points", 3, nan), "/body/sim", "rest points are NaN or infinite, first at index 3"),
    "velocities": (spoil(velocities=np.zeros((0, 3), np.float32)), "/body/sim", "0 velocities"),
    "zero mass": (at("masses", 5, 0.0), "/body/sim", "1 of 125 masses are too small, first 0 at index 5"),
    "negative mass": (spoil(mass=-1.0), "/body/sim", "mass is -1"),
    "filled": (at("filled", 6, -0.5), "/body/sim", "1 of 320 filled are too small, first -0.5 at index 6"),
    "overfull": (at("filled", 6, 1.5), "/body/sim", "filled[6] is 1.5; allowed: 0 to 1"),
    "which": (at("which", slice(8, 12), 1), "/body/sim", "which[8] is 1: tet 8 has a material that there is not"),
    "which count": (spoil(which=np.zeros(3, np.int32)), "/body/sim", "3 values of which"),
    "pressure": (spoil(pressure=nan), "/body/sim", "pressure is nan"),
    "plastic": (lambda s: (made_of(yield_strain=0.1)(s), spoil(quadratic=True)(s)), "/body/sim", "quadratic tets do not flow"),
    "solver": (lambda s: setattr(s, "solver", "xpbd"), "/", "allowed: auto, implicit, explicit"),
    "all pinned": (lambda s: s.pin("/pin", "/body/sim", range(N)), "/body/sim", "all 125 points are pinned"),
    "pin index": (lambda s: s.pin("/pin", "/body/sim", [N]), "/pin", "point 125 of /body/sim; allowed: 0 to 124"),
    "twin path": (lambda s: s.collider("/body/skin", Plane()), "/body/skin", "2 objects have this path"),
    "skin point": (lambda s: s.softs[0].skins[0].points.__setitem__((2, 0), inf), "/body/skin", "first at index 2"),
    "skin away": (lambda s: s.softs[0].skins[0].points.__setitem__((2, 0), 9.0), "/body/skin", "point 2 lies 8.5 m outside"),
    "skin index": (lambda s: s.softs[0].skins[0].indices.__setitem__(1, 3), "/body/skin", "corner 1 names point 3; allowed: 0"),
    "skin face": (lambda s: s.softs[0].skins[0].counts.__setitem__(0, 2), "/body/skin", "face 0 has 2 corners"),
    "skin corners": (lambda s: s.softs[0].skins[0].counts.__setitem__(0, 4), "/body/skin", "4 corners, and 3 are given"),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_is_an_error_at_its_path(scene, what):
    change, path, words = MISTAKES[what]
    change(scene)
    found = [p for p in check_scene(scene) if p.fatal]
    assert any(p.path == path and words in p.text for p in found), found


def with_a_point(place):
    """One more point, of no tet."""
    def do(scene: Scene) -> None:
        scene.softs[0].points = np.concatenate([scene.softs[0].points, np.float32([place])])
    return do


ODD = {
    "idle point": (with_a_point((0.1, 0.1, 0.1)), "point 125 is in no tet"),
    "twin point": (with_a_point((0.5, 0.5, 0.5)), "point 125 is where another one is (the first at point 124)"),
    "too large": (spoil(motion=scaled(70.0, 70.0, 70.0)), "metersPerUnit"),
    "too small": (spoil(motion=scaled(1e-4, 1e-4, 1e-4)), "metersPerUnit"),
    "far": (lambda s: (s.softs[0].skins.clear(), s.softs[0].points.__iadd__(np.float32(2000.0))), "rounded"),
    "coarse": (lambda s: (s.softs.clear(), s.soft("/body/sim", *shapes.block((1, 1, 1), 2))), "give 4 cells or more across"),
    "soft E": (made_of(young=0.1), "its material has E = 0.1 Pa; expected: 10 to 1e+12 Pa"),
    "stiff E": (made_of(young=2e13), "E = 2e+13 Pa"),
    "light": (made_of(density=1e-3), "density = 0.001 kg/m^3; expected: 1 to 30000"),
    "heavy": (spoil(others=[Bulk(density=1e6)], which=np.arange(T, dtype=np.int32) % 2), "material 1 has density = 1e+06"),
    "unused": (spoil(others=[Bulk()]), "material 1 of 2 (counted from 0) is that of no tet"),
    "falls": (lambda s: s.colliders.clear(), "falls for ever"),
}


@pytest.mark.parametrize("what", ODD)
def test_what_is_odd_is_a_warning_at_its_path(scene, what):
    change, words = ODD[what]
    change(scene)
    found = check_scene(scene)
    assert not any(p.fatal for p in found), found
    assert any(p.path == "/body/sim" and words in p.text for p in found), found


def test_points_of_no_tet_do_not_count_as_free(scene):
    with_a_point((0.1, 0.1, 0.1))(scene)
    scene.pin("/pin", "/body/sim", range(N))
    assert any("all 125 points are pinned" in p.text for p in check_scene(scene) if p.fatal)


def test_a_start_that_is_inverted_is_no_mistake(scene):
    """Only the rest shape must have volumes: the start may be pressed flat, or turned inside out."""
    soft = scene.softs[0]
    soft.rest_points, soft.points = soft.points.copy(), soft.points * np.float32([1, -1, 1])
    assert check_scene(scene) == []
    soft.points = soft.points * np.float32([1, 0, 1])
    assert check_scene(scene) == []


def test_a_piece_without_a_pin_is_named(scene):
    points, tets = shapes.block((1, 1, 1), 4)
    scene.softs.clear()
    scene.soft("/two", np.concatenate([points, points + (2, 0, 0)]), np.concatenate([tets, tets + len(points)]))
    scene.pin("/pin", "/two", [0])
    (found,) = check_scene(scene)
    assert not found.fatal and "1 of its 2 separate pieces are held by no pin" in found.text


def test_a_body_without_points_is_an_error():
    """It was a ValueError of NumPy."""
    scene = Scene()
    scene.soft("/jelly", np.zeros((0, 3)), np.zeros((0, 4), int))
    (problem,) = check_scene(scene)
    assert str(problem).startswith("error: /jelly: it has no points; allowed: a tet and its four points")
