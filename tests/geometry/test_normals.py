"""Normals that follow: against the exact normals of shapes that are known, and in a result layer."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.conftest import grid
from tests.make.usd.result.recorder import CLOTH, author, record, world
from wsim.geometry.normals import AuthoredNormals, polygon_fans
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.usd.result.recorder import Recorder

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])      # outward
OUT = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)
TURN = axis_rotation_matrix(np.array([0.6, 0.0, 0.8]), 1.1)
COUNTS = np.full(6, 4)
FLOAT = 4 * np.finfo(np.float32).eps


def test_creased_corners_stay_creased_and_turn_with_the_body():
    corners = np.repeat(OUT, 4, axis=0)
    normals = AuthoredNormals(CUBE, COUNTS, FACES.reshape(-1), corners, "faceVarying")
    assert np.abs(normals.at(CUBE @ TURN.T) - corners @ TURN.T).max() < FLOAT


def test_corners_shaded_smooth_share_one_normal():
    diagonal = (2.0 * CUBE - 1.0)[FACES.reshape(-1)] / np.sqrt(3.0)
    normals = AuthoredNormals(CUBE, COUNTS, FACES.reshape(-1), diagonal, "faceVarying")
    assert np.abs(normals.at(CUBE @ TURN.T) - diagonal @ TURN.T).max() < FLOAT      # three equal faces meet at a corner


def test_uniform_normals_are_those_of_the_faces():
    normals = AuthoredNormals(CUBE, COUNTS, FACES.reshape(-1), OUT, "uniform")
    assert np.abs(normals.at(CUBE * np.float32(3.0)) - OUT).max() < FLOAT


def test_vertex_normals_stay_smooth_over_a_seam_of_duplicate_points():
    left, right = [[0, 0, 0], [1, 0, 0], [1, 0, 1]], [[1, 0, 0], [2, 0, 0], [1, 0, 1]]
    points = np.array(left + right, float)
    up = np.tile([0.0, -1.0, 0.0], (6, 1))
    folded = points.copy()
    folded[4] = 1, 1, 0                                       # the right triangle turns up about the seam x = 1
    found = AuthoredNormals(points, [3, 3], np.arange(6), up, "vertex").at(folded)
    flat, upright = [0, -1, 0], [1, 0, 0]
    seam = np.add(flat, upright) / np.sqrt(2.0)               # equal areas: half way between
    assert np.abs(found - [flat, seam, seam, seam, upright, seam]).max() < FLOAT


def test_a_mesh_shaded_inside_out_stays_inside_out():
    normals = AuthoredNormals(CUBE, COUNTS, FACES.reshape(-1), -OUT, "uniform")
    assert np.abs(normals.at(CUBE) + OUT).max() < FLOAT


def test_where_all_area_is_gone_the_last_normal_stays():
    normals = AuthoredNormals(CUBE, COUNTS, FACES.reshape(-1), OUT, "uniform")
    normals.at(CUBE @ TURN.T)
    assert np.abs(normals.at(np.zeros((8, 3))) - OUT @ TURN.T).max() < FLOAT


def test_a_concave_polygon_has_the_area_of_what_it_covers():
    arrow = np.array([[0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]], float)
    triangles, face = polygon_fans(np.array([4]), np.arange(4))
    a, b, c = (arrow[triangles[:, k]] for k in range(3))
    assert np.array_equal(0.5 * np.cross(b - a, c - a).sum(axis=0), [0, 0, 1]) and list(face) == [0, 0]


@pytest.mark.parametrize(("values", "interpolation", "text"), [
    (OUT, "vertex", "6 normals where 'vertex' needs 8"), (OUT[:1], "constant", "'constant' normals")])
def test_normals_that_do_not_fit_are_refused_in_words(values, interpolation, text):
    with pytest.raises(ValueError, match=text):
        AuthoredNormals(CUBE, COUNTS, FACES.reshape(-1), values, interpolation)


def shaded(path, *, values, interpolation, indices=None, primvar=False):
    """A source whose mesh has these normals."""
    scene = author(path, mesh=grid)
    stage = Usd.Stage.Open(scene.source)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(CLOTH))
    if primvar:
        made = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, interpolation)
        made.Set(Vt.Vec3fArray.FromNumpy(np.asarray(values, np.float32)))
        made.SetIndices(indices)
    else:
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.asarray(values, np.float32)))
        mesh.SetNormalsInterpolation(interpolation)
    stage.Save()
    return scene


def test_normals_of_a_result_follow_the_points(tmp_path):
    scene = shaded(tmp_path / "s.usda", values=np.tile([0, 1, 0], (16, 1)), interpolation="vertex")
    turned = scene.cloths[0].points @ TURN.T
    with Recorder(scene, tmp_path / "out.usdc") as recorder:
        recorder.append(1.0, {CLOTH: turned}, {CLOTH: turned})
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(CLOTH))
    found = np.array(mesh.GetNormalsAttr().Get(1.0))
    assert mesh.GetNormalsInterpolation() == "vertex"
    assert np.abs(found - [0, 1, 0] @ TURN.T).max() < 8 * FLOAT      # from points rounded at 1 m, cells of 1/3 m


def test_indexed_normals_are_written_out_since_points_that_shared_one_part(tmp_path):
    scene = shaded(tmp_path / "s.usda", values=[[0, 1, 0]], interpolation="faceVarying", indices=[0] * 36, primvar=True)
    record(scene, tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(CLOTH)).GetPrimvar("normals")
    found = np.array(primvar.ComputeFlattened(2.0))
    assert not primvar.IsIndexed() and found.shape == (36, 3) and primvar.GetInterpolation() == "faceVarying"
    assert len(np.unique(found, axis=0)) == 16                       # flat at rest, hence smooth: one a point


def test_normals_of_another_count_are_blocked_with_a_note(tmp_path):
    scene = shaded(tmp_path / "s.usda", values=np.tile([0, 1, 0], (7, 1)), interpolation="vertex")
    with Recorder(scene, tmp_path / "out.usdc") as recorder:
        recorder.append(1.0, *world())
    assert [(p.path, p.fatal) for p in recorder.notes] == [(CLOTH, False)]
    assert "7 normals where 'vertex' needs 16" in recorder.notes[0].text
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert UsdGeom.Mesh(stage.GetPrimAtPath(CLOTH)).GetNormalsAttr().Get(1.0) is None
