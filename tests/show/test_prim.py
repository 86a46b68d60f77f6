"""Soft bodies as they are seen: by the outside of their tets, or by the meshes that follow them."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from wsim.scene import SceneError, shapes
from wsim.show.shading import palette_colour
from wsim.show.visible import read_visible_stage


def stage(path) -> Usd.Stage:
    made = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(made, 1.0)
    return made


def soft(made: Usd.Stage, path: str = "/soft", turned: bool = False) -> UsdGeom.TetMesh:
    """A cube of 2 x 2 x 2 cells, 1 m wide, as a soft body; turned: left-handed, its tets wound the other way."""
    points, tets = shapes.block((1, 1, 1), 2)
    mesh = UsdGeom.TetMesh.Define(made, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(tets[:, [1, 0, 2, 3]] if turned else tets))
    mesh.CreateOrientationAttr("leftHanded" if turned else "rightHanded")
    for name in ("PhysicsDeformableBodyAPI", "PhysicsVolumeDeformableSimAPI"):
        mesh.GetPrim().AddAppliedSchema(name)
    return mesh


def drawn(made: Usd.Stage):
    """The visible stage, which must be kept, and what is drawn of it, by path."""
    made.Save()
    seen = read_visible_stage(made.GetRootLayer().realPath)
    return seen, {d.look.path: d for d in seen.drawn}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("mirror", [1, -1])
def test_a_tet_mesh_shows_its_outside(tmp_path, turned, mirror):
    """Wound outwards whatever its handedness and however it is placed, so that it encloses its volume; it keeps the winding
    where all of it is turned inside out. Edges of a cube are sharp, its faces smooth: 9 normals each."""
    made = stage(tmp_path / "a.usda")
    mesh = soft(made, turned=turned)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(-np.array(mesh.GetPointsAttr().Get())), 1)
    mesh.AddScaleOp().Set((mirror, 2, 1))
    made.SetStartTimeCode(1)
    _seen, shown = drawn(made)
    look = shown["/soft"].look
    assert shown["/soft"].kind == "soft" and len(look.triangles) == 6 * 4 * 2 and look.normal_of.max() + 1 == 6 * 9
    a, b, c = shown["/soft"].points(1.0)[look.triangles].transpose(1, 0, 2)
    assert (a * np.cross(b, c)).sum() / 6.0 == pytest.approx(-2.0)
    assert np.allclose(look.colors, palette_colour("soft", 0))


def test_a_soft_body_with_a_skin_is_seen_by_the_skin(tmp_path):
    made = stage(tmp_path / "a.usda")
    UsdGeom.Xform.Define(made, "/body").GetPrim().AddAppliedSchema("PhysicsDeformableBodyAPI")
    soft(made, "/body/tets").GetPrim().RemoveAppliedSchema("PhysicsDeformableBodyAPI")
    skin = UsdGeom.Mesh.Define(made, "/body/look/skin")
    skin.CreatePointsAttr([(0, 0, 0), (0.2, 0, 0), (0, 0.2, 0)])
    skin.CreateFaceVertexCountsAttr([3])
    skin.CreateFaceVertexIndicesAttr([0, 1, 2])
    soft(made, "/bare")
    _seen, shown = drawn(made)
    assert set(shown) == {"/body/look/skin", "/bare"} and {d.kind for d in shown.values()} == {"soft"}


def test_colours_of_its_points_are_shown(tmp_path):
    made = stage(tmp_path / "a.usda")
    values = np.random.default_rng(0).random((27, 3)).astype(np.float32)
    soft(made).CreateDisplayColorPrimvar("vertex").Set(Vt.Vec3fArray.FromNumpy(values))
    look = drawn(made)[1]["/soft"].look
    assert np.array_equal(look.colors[look.color_of], values[look.triangles])


def test_wrong_indices_are_named(tmp_path):
    made = stage(tmp_path / "a.usda")
    soft(made).GetTetVertexIndicesAttr().Set(Vt.Vec4iArray([(0, 1, 2, 27)]))
    with pytest.raises(SceneError, match=r"/soft: its tetVertexIndices.*tet 0.*27"):
        drawn(made)
