"""Loads in USD: what is saved is loaded, units and samples, and what is refused."""

import numpy as np
import pytest

from tests.make.physics.motion.loads import pushed
from tests.make.usda import Reader, cloth, errors, notes
from wsim import load
from wsim.cli.run import delay_scene_curves
from wsim.scene import shapes
from wsim.scene.nodal.loads import surface_triangles_among
from wsim.usd import save


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def of(values: str, body: str = "/cloth") -> str:
    push = f'def Scope "push" (prepend apiSchemas = ["WsimLoadAPI"]) {{\nrel wsim:load:body = <{body}>\n{values}\n}}\n'
    return cloth() + push


def test_loads_come_back_as_they_were_saved(tmp_path):
    scene = pushed()
    bar = scene.soft("/bar", *shapes.block((0.4, 0.2, 0.2), (2, 1, 1)))
    scene.traction("/bar/pull", bar, surface_triangles_among(bar)[:3], (1.5, 0.1, 0.0))
    save(scene, tmp_path / "scene.usda")
    assert load(tmp_path / "scene.usda") == scene


def test_units_samples_and_triangles_are_read(read):
    """In centimetres and grams: 1 g cm / s^2 = 1e-5 N, 1 g / (cm s^2) = 0.1 Pa. A preroll moves the keys."""
    header = 'metersPerUnit = 0.01\nkilogramsPerUnit = 0.001\nupAxis = "Y"\ntimeCodesPerSecond = 10\nstartTimeCode = 5'
    samples = "vector3d wsim:load:force.timeSamples = { 5: (0, 0, 0), 15: (1e5, 0, 2e5) }"
    scene = read(of(samples + "\nint[] wsim:load:points = [1, 3]"), header)
    (force,) = scene.loads
    np.testing.assert_allclose(force.curve.times, [0.0, 1.0])
    np.testing.assert_allclose(force.curve.values, [[0, 0, 0], [1, 0, 2]])
    assert force.points.tolist() == [1, 3] and "wsim:load" not in notes(scene)
    assert delay_scene_curves(scene, 2.0).loads[0].curve.times.tolist() == [2.0, 3.0]
    (whole,) = read(of("vector3d wsim:load:traction = (10, 0, 0)"), header).loads
    np.testing.assert_allclose(whole.curve.values, [[1, 0, 0]])
    assert sorted(map(sorted, whole.triangles.tolist())) == [[0, 1, 2], [0, 2, 3]]
    (part,) = read(of("vector3d wsim:load:traction = (10, 0, 0)\nint[] wsim:load:points = [0, 1, 2]"), header).loads
    assert part.triangles.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("values, body, words", [
    ("int[] wsim:load:points = [0]", "/cloth", "author one of wsim:load:force"),
    ("vector3d wsim:load:force = (1, 0, 0)", "/cloth", "has a force and no points"),
    ("vector3d wsim:load:force = (1, 0, 0)\nint[] wsim:load:points = [4]", "/cloth", "loads point 4"),
    ("vector3d wsim:load:force = (1, 0, 0)\nint[] wsim:load:points = [0]", "/other", "names /other; allowed is one cloth"),
    ("vector3d wsim:load:traction = (1, 0, 0)\nint[] wsim:load:points = [0, 1]", "/cloth", "has no triangle"),
    ("vector3d wsim:load:traction = (1, nan, 0)", "/cloth", "not finite"),
    ("double wsim:load:traction = 1", "/cloth", "allowed is vector3d"),
    ("vector3d wsim:load:traction = (1, 0, 0)\nint3[] wsim:load:triangles = [(0, 1, 3)]", "/cloth", "in one face of the mesh"),
])
def test_broken_loads_are_refused(read, values, body, words):
    assert words in errors(read, of(values, body))


def test_a_misspelt_name_of_a_load_is_said(read):
    scene = read(of("vector3d wsim:load:force = (1, 0, 0)\nint[] wsim:load:points = [0]\nint[] wsim:load:point = [0]"))
    assert "did you mean wsim:load:points" in notes(scene)
