"""Pictures: the ray caster against closed forms, the camera, and what is drawn of a stage."""

import errno
import os

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.make.show.picture import SIDES, ball
from wsim.geometry import primitives, topology
from wsim.kernels.picture import ray
from wsim.scene import SceneError
from wsim.show import camera as cameras
from wsim.show import picture as pictures
from wsim.show import raycast as casters
from wsim.show.camera import Camera, fit_camera_to_points, subjects_in_view
from wsim.show.picture import RayCaster, picture, render
from wsim.show.shading import MeshLook, smoothing_groups
from wsim.show.visible import read_visible_stage

GROUND, SURFACE = int(ray.GROUND), int(ray.SURFACE)


def taken(meshes, camera: Camera, size=(96, 64), floor: float | None = None) -> RayCaster:
    """The caster after one image, its samples and light ready to be read."""
    caster = RayCaster([look for _, look in meshes], size, "cpu")
    caster.image([points for points, _ in meshes], camera, "Y", floor)
    return caster


# The ray caster

def test_a_ball_covers_the_disc_that_geometry_says():
    """Seen from distance D, a ball of radius r ends at the tangent r / sqrt(D^2 - r^2): a disc in the image."""
    D, angle = 5.0, 0.6
    caster = taken([ball()], Camera.look((0, 0, D), (0, 0, 0), angle=angle), size=(96, 96))
    covered = np.count_nonzero(caster.samples.what.numpy() == SURFACE)
    radius = 96 * (1.0 / np.sqrt(D**2 - 1.0)) / np.tan(0.5 * angle)             # in traced pixels
    # half the rim's pixels may go either way (perimeter / 2), and the polygon lies inside by 1 - cos(pi / sides)
    slack = np.pi * radius + np.pi * radius**2 * 2 * (1 - np.cos(np.pi / SIDES))
    assert abs(covered - np.pi * radius**2) < slack


def test_hits_lie_on_the_ball_and_normals_point_outwards():
    caster = taken([ball()], Camera.look((0, 1.0, 5.0), (0, 0, 0), angle=0.5))
    hit = caster.samples.what.numpy() == SURFACE
    place, normal = caster.samples.place.numpy()[hit], caster.samples.normal.numpy()[hit]
    size = np.sqrt(3.0)                                  # half the diagonal of the ball's box: the unit of the caster
    sag = 1.0 - np.cos(np.pi / SIDES) ** 2               # of a facet, in both directions
    r = np.linalg.norm(place, axis=1) * size
    assert r.min() > 1.0 - sag - 1e-4 and r.max() < 1.0 + 4e-4 * size
    facing = (normal * place).sum(axis=1) * size
    assert facing[r > 0].min() > 0.9                     # smooth normals, bent towards the eye at the very rim only
    assert np.median(facing) > 1.0 - 2 * sag


def test_sky_light_on_a_free_ground_is_the_exact_integral():
    """Each of the 64 samples must count the same: then the sum is the midpoint rule of the cosine mean."""
    points, look = ball()
    view = Camera(np.array([30.0, 20.0, 0.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, 0, 1]), 0.05, 0.05)
    caster = taken([(points - [0, 5.0, 0], look)], view, size=(32, 32), floor=0.0)          # the ball is under it
    light = caster.light.numpy()[24:40, 24:40]           # away from the border, where the filter is cut
    s = np.sqrt(1.0 - (np.arange(64) + 0.5) / 64)        # sine of the elevation of each sample
    mean = np.mean(np.sqrt(s))
    expected = [1.0, *(np.array(casters.HORIZON) * (1 - mean) + np.array(casters.ZENITH) * mean)]
    # the rotation of the samples costs rounding of 1e-7 on a slope of sqrt(s) up to 1 / (2 sqrt(s_min)) = 2
    np.testing.assert_allclose(light, np.broadcast_to(expected, light.shape), atol=5e-6)
    assert abs(mean - 0.8) < 0.005                       # and the rule is near the integral that `develop` divides by


def test_a_plate_throws_its_shadow_along_the_light():
    points, triangles = primitives.plate_outline(1.0, 1.0)
    plate = points[:, [1, 2, 0]] + [0.0, 1.0, 0.0], MeshLook(triangles)
    view = Camera.look((0.0, 8.0, 12.0), (0.0, 0.5, 0.0), angle=0.7)
    caster = taken([plate], view, size=(288, 192), floor=0.0)
    what, lit = caster.samples.what.numpy(), caster.light.numpy()[..., 0]
    center, scale = np.array([0.0, 1.0, 0.0]), np.sqrt(2.0)
    ground = caster.samples.place.numpy() * scale + center
    toward = np.array(casters._ray_view(view, "Y", 0.0, center, scale).light)
    at = ground + toward * ((1.0 - ground[..., 1]) / toward[1])[..., None]    # where the ray to the light meets y = 1
    # penumbra: the disc of the light at distance 1 / toward_y, laid on the level; filter: 1 + 2 + 4 pixels of 0.05 m
    blur = casters.SPREAD / toward[1] ** 2 + 7 * 0.05
    off = np.maximum(np.abs(at[..., 0]), np.abs(at[..., 2])) - 1.0
    inside, outside = (what == GROUND) & (off < -blur), (what == GROUND) & (off > blur)
    assert inside.sum() > 50 and outside.sum() > 500
    assert lit[inside].max() < 1e-6 and lit[outside].min() > 1.0 - 1e-6


def test_pictures_are_the_same_to_the_bit_and_follow_moved_points():
    """A refitted tree must give what a fresh one gives."""
    (points, look), (corners, triangles) = ball(), primitives.plate_outline(2, 2)
    view, looks = Camera.look((1, 1, 4), (0, 0, 0)), [look, MeshLook(triangles)]
    here, there = [points, corners], [points + [0.3, 0, 0], corners]      # the plate keeps the size of the whole
    caster = RayCaster(looks, (48, 32), "cpu")
    first, moved = (caster.image(sets, view, "Y", -1.0) for sets in (here, there))
    np.testing.assert_array_equal(caster.image(here, view, "Y", -1.0), first)
    np.testing.assert_array_equal(RayCaster(looks, (48, 32), "cpu").image(there, view, "Y", -1.0), moved)
    assert (moved != first).any()


def test_far_from_the_origin_nothing_is_lost():
    points, look = ball()
    here, there = np.zeros(3), np.array([1e6, -2e6, 3e6])
    images = [render([(points + o, look)], size=(48, 32), device="cpu", floor=o[1] - 1) for o in (here, there)]
    difference = np.abs(images[0].astype(int) - images[1])
    assert difference.max() <= 2 and difference.mean() < 0.05     # float64 until the scene's own size: a few last bits


# Solids, normals, camera

@pytest.mark.parametrize(("outline", "volume"), [
    (lambda: primitives.box_outline((1, 2, 3)), 48.0),
    (lambda: primitives.cylinder_outline(2.0, 2.0, 1.5), 12 * np.pi),
    (lambda: primitives.cylinder_outline(2.0, 0.0, 1.5), 4 * np.pi),
    (lambda: primitives.sphere_outline(1.0), 4 / 3 * np.pi),
    (lambda: primitives.capsule_outline(1.0, 1.0, 2.0), 16 / 3 * np.pi),
    (lambda: primitives.rod_outlines(np.array([[0, 0, 0], [1.0, 2, 2]]), np.array([[0, 1]]), 0.5, SIDES), 0.75 * np.pi),
], ids=["box", "cylinder", "cone", "ball", "capsule", "rod"])
def test_a_solid_has_its_volume_and_faces_outwards(outline, volume):
    """By the divergence theorem; 64 sides lose 1 - sin(2 pi / 64) / (2 pi / 64) = 0.16 % of a circle's area, 32 steps
    of an arc twice that."""
    points, triangles = outline()
    points = points - points.mean(axis=0)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    found = (a * np.cross(b, c)).sum() / 6.0
    # a rod has no caps: its cones to the centre are missing, 2/3 of the volume is the side's
    expected = volume * (2 / 3 if len(points) == 2 * SIDES and volume < 3 else 1)
    assert (1 - 0.0017 - 0.0033) * expected <= found <= expected * (1 + 1e-12)


def test_a_box_has_edges_a_ball_none_a_cylinder_two():
    for outline, groups in ((primitives.box_outline((1, 1, 1)), 24), (primitives.sphere_outline(1.0), None),
                            (primitives.cylinder_outline(1, 1, 1), None)):
        points, triangles = outline
        group = smoothing_groups(points, triangles)
        places = len(np.unique(np.round(points[np.unique(triangles)], 9), axis=0))
        sharp = 2 * SIDES if len(points) == 2 * SIDES + 2 else 0
        assert group.max() + 1 == (groups or places + sharp)


def test_smooth_normals_of_a_ball_are_radial():
    points, look = ball()
    normals = look.normals(points)
    place = np.zeros_like(normals)
    place[look.normal_of.ravel()] = points[look.triangles.ravel()]
    # symmetric neighbours cancel along the parallel; along the meridian unequal areas tilt by less than half a step
    assert (normals * place).sum(axis=1).min() > np.cos(0.5 * np.pi / 32)


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_the_fitted_camera_shows_everything_and_no_more(up):
    points = np.random.default_rng(0).normal(size=(500, 3)) * [3.0, 1.0, 0.5] + [10.0, -4.0, 100.0]
    view = fit_camera_to_points(points, up, 16 / 9)
    right, above, forward = view.axes()
    local = points - view.eye
    depth = local @ forward
    x, y = np.abs(local @ right) / (depth * view.tan_x), np.abs(local @ above) / (depth * view.tan_y)
    fill = max(x.max(), y.max())
    assert depth.min() > 0 and fill == pytest.approx(cameras.MARGIN, abs=1e-9)
    assert view.eye["XYZ".index(up)] > points[:, "XYZ".index(up)].mean()       # from above


def test_a_vast_floor_does_not_steer_the_camera():
    small, floor = np.random.default_rng(0).normal(size=(50, 3)), 1e3 * np.array([[-1, 0, -1], [1, 0, 1.0]])
    assert subjects_in_view([floor, small, small + 3]) == [1, 2]
    assert subjects_in_view([small, 2 * small]) == [0, 1]


# Stages

def stage(path, up="Y", meters=1.0) -> Usd.Stage:
    made = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(made, up)
    UsdGeom.SetStageMetersPerUnit(made, meters)
    return made


def sheet(made: Usd.Stage, path: str = "/cloth", n: int = 5, samples=()) -> UsdGeom.Mesh:
    """An n by n sheet in the xy plane, facing +z; samples: time codes at which it has moved up by the code."""
    y, x = np.mgrid[:n, :n] / (n - 1.0)
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    i = np.arange(n * n).reshape(n, n)
    quads = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]], axis=-1).reshape(-1)
    mesh = UsdGeom.Mesh.Define(made, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    for t in samples:
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy((points + [0, 0.1 * t, 0]).astype(np.float32)), t)
    mesh.CreateFaceVertexCountsAttr([4] * ((n - 1) ** 2))
    mesh.CreateFaceVertexIndicesAttr(quads.tolist())
    mesh.GetPrim().AddAppliedSchema("PhysicsSurfaceDeformableSimAPI")
    return mesh


def flag(path, last=4) -> str:
    made = stage(path)
    sheet(made, samples=range(last + 1))
    made.SetStartTimeCode(0)
    made.SetEndTimeCode(last)
    made.Save()
    return str(path)


def drawn(made: Usd.Stage):
    """The visible stage, which must be kept, and what is drawn of it, by path."""
    made.Save()
    seen = read_visible_stage(made.GetRootLayer().realPath)
    return seen, {d.look.path: d for d in seen.drawn}


def test_points_come_out_in_metres_of_the_world(tmp_path):
    made = stage(tmp_path / "a.usda", "Z", 0.01)
    UsdGeom.Xform.Define(made, "/place").AddTranslateOp().Set((100.0, 0.0, 50.0))
    sheet(made, "/place/cloth")
    _seen, shown = drawn(made)
    points = shown["/place/cloth"].points(0.0)
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [[1, 0, 0.5], [1.01, 0.01, 0.5]], atol=1e-9)


@pytest.mark.parametrize(("mirror", "orientation"), [(1, "rightHanded"), (-1, "rightHanded"), (1, "leftHanded")])
def test_the_front_stays_in_front(tmp_path, mirror, orientation):
    """A mirrored transform keeps the author's front (+z here); a left-handed mesh has its front on the other side."""
    made = stage(tmp_path / "a.usda")
    mesh = sheet(made)
    mesh.AddScaleOp().Set((mirror, 1, 1))
    mesh.CreateOrientationAttr(orientation)
    _seen, shown = drawn(made)
    front = topology.area_normals(shown["/cloth"].points(0.0), shown["/cloth"].look.triangles)[:, 2]
    assert (front > 0).all() if orientation == "rightHanded" else (front < 0).all()


def test_what_is_hidden_is_not_drawn(tmp_path):
    made = stage(tmp_path / "a.usda")
    sheet(made)
    UsdGeom.Sphere.Define(made, "/guide").CreatePurposeAttr("guide")
    UsdGeom.Xform.Define(made, "/hidden").MakeInvisible()
    UsdGeom.Sphere.Define(made, "/hidden/ball")
    UsdGeom.Sphere.Define(made, "/off").GetPrim().SetActive(False)
    assert set(drawn(made)[1]) == {"/cloth"}


def test_a_level_plane_is_the_ground_and_a_tilted_one_a_plate(tmp_path):
    made = stage(tmp_path / "a.usda", "Z")
    UsdGeom.Plane.Define(made, "/level").AddTranslateOp().Set((0, 0, -0.25))
    tilted = UsdGeom.Plane.Define(made, "/tilted")
    tilted.CreateAxisAttr("X")
    made.Save()
    seen = read_visible_stage(tmp_path / "a.usda")
    assert seen.floor(0.0) == -0.25 and [d.look.path for d in seen.drawn] == ["/tilted"]
    np.testing.assert_allclose(np.ptp(seen.drawn[0].points(0.0), axis=0), [0, 2, 2])


@pytest.mark.parametrize(("interpolation", "count"), [
    ("constant", 1), ("uniform", 16), ("vertex", 25), ("faceVarying", 64)])
def test_display_colours_reach_their_corners(tmp_path, interpolation, count):
    made = stage(tmp_path / "a.usda")
    mesh = sheet(made)
    values = np.random.default_rng(0).random((count, 3)).astype(np.float32)
    mesh.CreateDisplayColorPrimvar(interpolation).Set(Vt.Vec3fArray.FromNumpy(values))
    look = drawn(made)[1]["/cloth"].look
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    for triangle, colors in zip(look.triangles, look.colors[look.color_of], strict=True):
        face = next(f for f in range(16) if set(triangle) <= set(indices[f]))
        corners = [4 * face + int(np.flatnonzero(indices[face] == p)[0]) for p in triangle]
        expected = {"constant": [0, 0, 0], "uniform": [face] * 3, "vertex": triangle, "faceVarying": corners}
        np.testing.assert_array_equal(colors, values[expected[interpolation]])


def test_every_shape_is_drawn(tmp_path):
    made = stage(tmp_path / "a.usda", "Z")
    sizes = {"Sphere": (2, 2, 2), "Cube": (2, 2, 2), "Capsule": (1, 1, 2), "Cylinder": (2, 2, 2), "Cone": (2, 2, 2)}
    for name in sizes:
        getattr(UsdGeom, name).Define(made, f"/{name}")
    curves = UsdGeom.BasisCurves.Define(made, "/net")
    curves.CreatePointsAttr([(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1)])
    curves.CreateCurveVertexCountsAttr([2, 2])
    curves.CreateWidthsAttr([0.1])
    tet = UsdGeom.TetMesh.Define(made, "/tet")
    tet.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    tet.CreateTetVertexIndicesAttr([Gf.Vec4i(0, 1, 2, 3)])
    _seen, shown = drawn(made)
    for name, size in sizes.items():
        np.testing.assert_allclose(np.ptp(shown[f"/{name}"].points(0.0), axis=0), size, atol=1e-12)
    np.testing.assert_allclose(np.ptp(shown["/net"].points(0.0), axis=0), [1.1, 0.1, 1.1], atol=1e-6)
    assert len(shown["/tet"].look.triangles) == 4


# Files

def head(path) -> tuple[int, int]:
    """Width and height of a PNG."""
    data = path.read_bytes()
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_a_still_a_sheet_and_animations_are_written(tmp_path):
    source = flag(tmp_path / "flag.usda")
    still = picture(source, tmp_path / "a.png", size=(48, 27), device="cpu")
    assert still["frames"] == [4.0] and head(tmp_path / "a.png") == (48, 27)
    sheets = picture(source, tmp_path / "b.png", size=(96, 54), sheet=3, device="cpu")
    assert sheets["frames"] == [0.0, 2.0, 4.0] and head(tmp_path / "b.png") == (46 * 2 + 4, 26 * 2 + 4)
    moving = picture(source, tmp_path / "c.png", size=(48, 27), frames="all", device="cpu")
    assert moving["frames"] == [0.0, 1.0, 2.0, 3.0, 4.0] and b"acTL" in (tmp_path / "c.png").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.png", "c.png", "flag.usda"]


def test_a_camera_of_the_stage_is_used(tmp_path):
    made = stage(tmp_path / "a.usda")
    ball_ = UsdGeom.Sphere.Define(made, "/ball")
    ball_.AddTranslateOp().Set((5, 0, 0))
    lens = UsdGeom.Camera.Define(made, "/lens")
    lens.AddTranslateOp().Set((5, 0, 40))
    made.Save()
    seen = read_visible_stage(tmp_path / "a.usda")
    (view,), _ = pictures._cameras_and_ground(seen, [0.0], None, 1.5)
    np.testing.assert_allclose([*view.eye, *view.forward], [5, 0, 40, 0, 0, -1], atol=1e-12)
    assert view.tan_x == pytest.approx(0.5 * 20.955 / 50.0)        # USD's fallback aperture and focal length
    (auto,), _ = pictures._cameras_and_ground(seen, [0.0], "auto", 1.5)
    assert auto.eye[1] > 0
    with pytest.raises(SceneError, match="/lens"):
        pictures._cameras_and_ground(seen, [0.0], "/other", 1.5)


@pytest.mark.parametrize(("arguments", "error", "words"), [
    ({"frames": 99}, SceneError, "0 to 4"), ({"frames": "some"}, SceneError, "'all'"),
    ({"sheet": 0}, SceneError, "at least 1"), ({"size": (4, 4)}, SceneError, "8 to 8192"),
    ({"device": "abacus:7"}, SceneError, "cpu"), ({"out": "a.jpg"}, SceneError, ".png"),
    ({"out": "nowhere/a.png"}, FileNotFoundError, "make it"), ({"stage_path": "gone.usda"}, FileNotFoundError, "gone"),
    ({"camera": "/none"}, SceneError, "none"),
])
def test_what_cannot_be_drawn_is_said(tmp_path, arguments, error, words):
    flag(tmp_path / "flag.usda")
    given = {"stage_path": "flag.usda", "out": "a.png", "size": (16, 16), "device": "cpu", **arguments}
    source, out = tmp_path / given.pop("stage_path"), tmp_path / given.pop("out")
    with pytest.raises(error, match=words):
        picture(source, out, **given)
    assert not out.exists()


def test_broken_stages_are_named(tmp_path):
    (tmp_path / "text.usda").write_text("no stage")
    with pytest.raises(SceneError, match="not a readable USD stage"):
        picture(tmp_path / "text.usda", tmp_path / "a.png")
    stage(tmp_path / "empty.usda").Save()
    with pytest.raises(SceneError, match="nothing visible"):
        picture(tmp_path / "empty.usda", tmp_path / "a.png")
    made = stage(tmp_path / "nan.usda")
    mesh = sheet(made, samples=[0, 1])
    points = np.array(mesh.GetPointsAttr().Get(0))
    points[7, 1] = np.nan
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), 2)
    made.Save()
    with pytest.raises(SceneError, match="/cloth: at time code 2: point 7 is not finite"):
        picture(tmp_path / "nan.usda", tmp_path / "a.png", device="cpu")
    picture(tmp_path / "nan.usda", tmp_path / "a.png", frames=1, size=(16, 16), device="cpu")
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 400] * 16)
    made.Save()
    with pytest.raises(SceneError, match="/cloth.*400"):
        picture(tmp_path / "nan.usda", tmp_path / "a.png", frames=1)


def test_a_full_disk_leaves_the_old_picture(tmp_path, monkeypatch):
    out = tmp_path / "a.png"
    out.write_bytes(b"old")

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="free space") as caught:
        picture(flag(tmp_path / "flag.usda"), out, size=(16, 16), device="cpu")
    assert caught.value.errno == errno.ENOSPC and out.read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "flag.usda"]


def test_a_result_layer_is_drawn_with_its_source(tmp_path):
    made = stage(tmp_path / "scene.usda")
    sheet(made)
    made.Save()
    layer = Sdf.Layer.CreateNew(str(tmp_path / "out.usdc"))
    layer.subLayerPaths.append("./scene.usda")
    over = Usd.Stage.Open(layer)
    UsdGeom.SetStageMetersPerUnit(over, 1.0)             # root metadata does not come from sublayers
    mesh = UsdGeom.Mesh(over.GetPrimAtPath("/cloth"))
    points = np.array(mesh.GetPointsAttr().Get())
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points + np.float32(2.0)), 5)
    over.Save()
    seen = read_visible_stage(tmp_path / "out.usdc")
    np.testing.assert_allclose(seen.drawn[0].points(5.0), points + 2.0)
