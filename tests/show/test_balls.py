"""Particles in pictures: round, of their widths, each before what is behind it."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from wsim.scene import SceneError
from wsim.show.camera import Camera
from wsim.show.picture import _cameras_and_ground, caster_of_stage, finite_points, image_of_stage
from wsim.show.visible import read_visible_stage

CAMERA = Camera.look((0, 0, 10), (0, 0, 0), angle=2 * np.arctan(0.2))         # 4 m high at the origin
RED, GREEN, BLUE = (0.9, 0.0, 0.0), (0.0, 0.9, 0.0), (0.0, 0.0, 0.9)


def stage(path, points, widths, colors, scale=1.0):
    made = Usd.Stage.CreateNew(str(path / "s.usda"))
    UsdGeom.SetStageMetersPerUnit(made, 1.0)
    prim = UsdGeom.Points.Define(made, "/sand")
    UsdGeom.XformCommonAPI(prim).SetScale(Gf.Vec3f(scale))
    for code, x in enumerate(points):
        prim.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.array(x, np.float32).reshape(-1, 3)), code)
        prim.CreateWidthsAttr().Set(Vt.FloatArray(widths[code]), code)
    prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(colors)
    return made


def look(made, time=0.0, size=(200, 200)):
    made.Save()
    seen = read_visible_stage(made.GetRootLayer().realPath)
    return image_of_stage(caster_of_stage(seen, size), seen, time, CAMERA, None).astype(float)


def of_color(image, k):
    """Pixels in which channel k leads."""
    return image[..., k] > 1.4 * np.delete(image, k, axis=2).max(axis=2)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_ball_is_a_disc_of_its_width(tmp_path, scale):
    """Seen from 10 m, a ball of radius r has a cone of the angle asin(r / 10), in a picture that is 4 m high there."""
    image = look(stage(tmp_path, [[(0, 0, 0)]], [[2.0 / scale]], [RED], scale))
    found = np.argwhere(of_color(image, 0))
    radius = np.tan(np.arcsin(0.1)) * 10 * 200 / 4
    assert abs(np.sqrt(len(found) / np.pi) / radius - 1) < 0.01
    assert np.abs(found.mean(axis=0) - 99.5).max() < 0.5
    assert np.abs(np.linalg.norm(found - 99.5, axis=1).max() - radius) < 1.5


def test_a_ball_is_lit_as_a_sphere(tmp_path):
    """Lighter towards the light, which is above, than below."""
    image = look(stage(tmp_path, [[(0, 0, 0)]], [[2.0]], [RED]))
    assert image[70, 100, 0] > 1.3 * image[130, 100, 0]


def test_the_nearer_hides_what_is_behind_it(tmp_path):
    """Two balls that overlap in the picture, in either order of the file, and a cube that cuts one in half."""
    for order in ([0, 1], [1, 0]):
        x, w, c = np.array([(0, 0, 1.0), (0, 0, -1.0)])[order], np.array([0.8, 2.0])[order], np.array([GREEN, RED])[order]
        image = look(stage(tmp_path / str(order[0]), [x], [w.tolist()], Vt.Vec3fArray.FromNumpy(c.astype(np.float32)))
                     if (tmp_path / str(order[0])).mkdir() is None else None)
        assert of_color(image, 1)[100, 100] and not of_color(image, 1)[100, 135] and of_color(image, 0)[100, 135]
    made = stage(tmp_path, [[(0, 0, 0)]], [[2.0]], [RED])
    cube = UsdGeom.Cube.Define(made, "/cube")
    cube.CreateSizeAttr(2.0)
    cube.CreateDisplayColorAttr([BLUE])
    UsdGeom.XformCommonAPI(cube).SetTranslate((1.0, 0, 0.2))
    image = look(made)
    assert of_color(image, 0)[100, 60] and of_color(image, 2)[100, 140]


def test_the_number_of_balls_may_change(tmp_path):
    made = stage(tmp_path, [[(0, 0, 0)], np.zeros((0, 3)), [(-1, 0, 0), (1, 0, 0)]], [[1.0], [], [1.0, 1.0]], [RED, GREEN])
    seen = read_visible_stage(made.GetRootLayer().realPath) if made.Save() is None else None
    (drawn,) = seen.drawn
    assert [len(drawn.points(t)) for t in (0.0, 1.0, 2.0)] == [1, 0, 2]
    assert np.array_equal(finite_points(drawn, 2.0, True).max(axis=0), [1.5, 0.5, 0.5])
    caster = caster_of_stage(seen, (200, 200))
    assert not of_color(image_of_stage(caster, seen, 1.0, CAMERA, None).astype(float), 0).any()
    assert of_color(image_of_stage(caster, seen, 2.0, CAMERA, None).astype(float), 0).any()        # of a run that begins empty
    image = look(made, 2.0)
    assert of_color(image, 0)[:, :100].any() and of_color(image, 1)[:, 100:].any()


def test_a_place_that_is_not_finite_is_named(tmp_path):
    made = stage(tmp_path, [[(0, 0, 0)], [(np.nan, 0, 0)]], [[1.0], [1.0]], [RED])
    with pytest.raises(SceneError, match="/sand: at time code 1: point 0 is not finite"):
        look(made, 1.0)


def test_particles_are_framed_and_the_shape_that_poured_them_is_not_drawn(tmp_path):
    """Beside a small cube, whose size is a tenth of theirs; one that flies 100 m away steers no camera. Sinks are not drawn."""
    x = np.random.default_rng(0).uniform(-1, 1, (400, 3))
    x[0] = (100.0, 0, 0)
    made = stage(tmp_path, [x], [[0.1] * 400], [RED] * 400)
    prim = UsdGeom.Cube.Define(made, "/small")
    prim.CreateSizeAttr(0.1)
    for path, api in (("/spout", "WsimMaterialPointsAPI"), ("/drain", "WsimMaterialSinkAPI")):
        UsdGeom.Cube.Define(made, path).GetPrim().AddAppliedSchema(api)
    UsdGeom.Points.Define(made, "/spout_drops").CreatePointsAttr([(0, 0, 0)])
    made.Save()
    seen = read_visible_stage(made.GetRootLayer().realPath)
    assert {d.look.path for d in seen.drawn} == {"/sand", "/small", "/spout_drops"}
    (camera,), _ = _cameras_and_ground(seen, [0.0], None, 1.0)
    assert 4.0 < np.linalg.norm(camera.eye) < 12.0
