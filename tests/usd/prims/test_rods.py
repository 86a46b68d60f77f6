"""Curves that make no sense: each mistake is an error with its path, its place and the name that its author wrote."""

import numpy as np
import pytest

from tests.make.usda import Reader, errors
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene
from wsim.scene.check.scene import check

APIS = '"PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "WsimRodsAPI"'
STRAIGHT = [[0.1 * k, 0.0, 0.0] for k in range(4)]


def curve(values: str) -> str:
    places = ", ".join(map(str, map(tuple, STRAIGHT)))
    return (f'def BasisCurves "rope" (prepend apiSchemas = [{APIS}]) {{\nuniform token type = "linear"\n'
            f"int[] curveVertexCounts = [4]\npoint3f[] points = [{places}]\n{values}\n}}\n")


@pytest.mark.parametrize("values, said", [
    ("normal3f[] normals = [(0, 0, 1), (nan, 0, 0), (0, 0, 1), (0, 0, 1)]", "directors (of curves: normals)[1] is [nan,"),
    ("normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 0), (0, 0, 1)]",
     "directors (of curves: normals)[2] is [0.0, 0.0, 0.0], the edge behind point 2"),
    ("normal3f[] normals = [(0, 0, 1), (1, 0, 0), (1, 0, 0), (0, 0, 1)]",
     "directors (of curves: normals)[1] is [1.0, 0.0, 0.0], the edge behind point 1 goes along [0.1"),
    ("normal3f[] physics:restNormals = [(0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)]",
     "rest_directors (of curves: physics:restNormals)[0] is [0.0, 0.0, 0.0]"),
    ("point3f[] physics:restShapePoints = [(0, 0, 0), (1, 0, 0), (inf, 0, 0), (3, 0, 0)]",
     "rest_points (of curves: physics:restShapePoints)[2] is [inf,"),
    ("float[] physics:thicknesses = [0]", "physics:thicknesses holds 0"),
    ("float[] physics:thicknesses = [0.01, 0.01, -0.2, 0.01]", "physics:thicknesses holds -0.2")])
def test_what_a_curve_says_wrongly_is_named_as_its_author_wrote_it(tmp_path, values, said):
    assert f"/rope: {said}" in errors(Reader(tmp_path), curve(values))


def test_the_normal_of_a_last_point_which_no_edge_has_may_be_anything(tmp_path):
    read = Reader(tmp_path)(curve("normal3f[] normals = [(0, 0, 1), (0, 1, 1), (1, 0, 1), (0, 0, 0)]"))
    assert len(read.things("Rods")) == 1


def test_directors_are_seen_beside_the_edges_of_each_strand():
    """Two strands that are not one: the edge between them is none, and none behind the last point."""
    x = np.array(STRAIGHT + [[0.5, 0.125, 0.0], [0.5, 0.25, 0.0], [0.5, 0.375, 0.0]])
    d = np.tile([0.0, 0.0, 1.0], (7, 1))
    d[[3, 6]] = 0.0
    scene = Scene()
    rods = scene.add(Rods("/two", x, [4, 3], directors=d))
    assert not [p for p in check(scene) if p.fatal]
    rods.directors[5] = 0.0, 3.0, 0.0
    assert [p.text for p in check(scene) if p.fatal] == [
        "directors (of curves: normals)[5] is [0.0, 3.0, 0.0], the edge behind point 5 goes along [0.0, 0.125, 0.0] "
        "(1 such edges); allowed: directions across their edges, not 0; mend: author it again, or leave it out: no twist then"]
