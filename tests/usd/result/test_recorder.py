"""Result layers: what they hold, what they leave alone, and where they refuse to be."""

import hashlib
import os

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.make.usd.result.recorder import CLOTH, EPS, SIDE, author, matrix, record, triangles, world
from tests.make.usd.validate import validate
from wsim.scene import Plane, Scene, SceneError
from wsim.scene.curve import Motion
from wsim.usd.result.recorder import Recorder
from wsim.usd.result.restart import ResultReader, load_restart


def digest(path) -> str:
    return hashlib.sha256(open(path, "rb").read()).hexdigest()


FRAMES = {
    "identity": {},
    "mirrored, sheared and stretched": {None: matrix([[-2, 0, 0], [0.5, 3, 0], [0, 0.25, 0.5]], (10, -20, 30))},
    "animated": {1.0: matrix(np.eye(3)), 4.0: matrix(2 * np.eye(3), (300, 0, 60))},
}


@pytest.mark.parametrize("matrices", FRAMES.values(), ids=FRAMES)
def test_world_positions_come_back_through_the_prims_frame(tmp_path, matrices):
    scene = author(tmp_path / "s.usda", matrices=matrices)
    record(scene, tmp_path / "out.usdc")
    result = ResultReader(tmp_path / "out.usdc")
    for f in range(3):
        p, v = world(frame=f)
        reach = 1.8 + 0.4                           # [m]: the places and the frame's own shift, rounded once to float32
        assert np.abs(result.positions(CLOTH, 1.0 + f) - p[CLOTH]).max() < 4 * EPS * reach
        assert np.abs(result.velocities(CLOTH, 1.0 + f) - v[CLOTH]).max() < 4 * EPS * (reach + 30 * 3)


@pytest.mark.parametrize("matrices", FRAMES.values(), ids=FRAMES)
def test_usd_moves_the_points_by_their_velocity_between_samples(tmp_path, matrices):
    scene = author(tmp_path / "s.usda", matrices=matrices)
    record(scene, tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    prim = stage.GetPrimAtPath(CLOTH)
    p, v = world(frame=1)
    dc = 1 / 64                                     # [time codes]
    local = np.array(UsdGeom.PointBased(prim).ComputePointsAtTime(2.0 + dc, 2.0))
    M = np.array(UsdGeom.XformCache(2.0 + dc).GetLocalToWorldTransform(prim))
    found = 0.01 * (local @ M[:3, :3] + M[3, :3])
    # M' w dt^2: the animated frame's scale of 4/3 grows by 10/s, its place by 30 m/s, and |q| < 1.5 m
    second_order = 10 * (1 + 30 + 10 * 1.5) / (4 / 3) * (dc / 30) ** 2
    assert np.abs(found - p[CLOTH] - v[CLOTH] * dc / 30).max() < 16 * EPS + (second_order if len(matrices) > 1 else 0)


def test_a_cloth_a_kilometre_away_loses_nothing_where_its_prim_is_there_too(tmp_path):
    away = np.array([1000.0, 0.0, -1000.0])
    scene = author(tmp_path / "s.usda", matrices={None: matrix(np.eye(3), 100.0 * away)})
    p, v = world(around=away)
    with Recorder(scene, tmp_path / "out.usdc") as recorder:
        recorder.append(1.0, p, v)
    found = ResultReader(tmp_path / "out.usdc").positions(CLOTH, 1.0)
    assert np.abs(found - p[CLOTH]).max() < EPS                     # local places are below 1 m


def test_the_source_stays_byte_identical_and_its_folder_untouched(tmp_path):
    folder = tmp_path / "asset"
    folder.mkdir()
    scene = author(folder / "s.usda")
    before = digest(folder / "s.usda")
    folder.chmod(0o555)
    try:
        record(scene, tmp_path / "out.usdc", restart_fields=lambda: {CLOTH: {"e": np.ones(3)}})
        assert os.listdir(folder) == ["s.usda"] and digest(folder / "s.usda") == before
    finally:
        folder.chmod(0o755)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usdc"))
    assert list(layer.subLayerPaths) == ["./asset/s.usda"]


def test_the_result_holds_overs_only_and_leaves_the_rest_shape_alone(tmp_path):
    record(author(tmp_path / "s.usda"), tmp_path / "out.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    specifiers = set()
    layer.Traverse("/", lambda path: specifiers.add(layer.GetPrimAtPath(path).specifier) if path.IsPrimPath() else None)
    assert specifiers == {Sdf.SpecifierOver}
    assert not layer.GetAttributeAtPath(CLOTH + ".points").HasDefaultValue()
    stage = Usd.Stage.Open(layer)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(CLOTH))
    assert np.array_equal(mesh.GetPointsAttr().Get(), triangles()[0] / np.float32(0.01))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"


def test_root_metadata_is_that_of_the_source_and_the_range_that_of_the_run(tmp_path):
    record(author(tmp_path / "s.usda"), tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01 and UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/World"
    root = stage.GetRootLayer()
    assert (root.timeCodesPerSecond, root.startTimeCode, root.endTimeCode) == (30.0, 1.0, 3.0)
    assert root.pseudoRoot.HasInfo("kilogramsPerUnit") and root.pseudoRoot.GetInfo("kilogramsPerUnit") == 1.0


def test_extents_follow_at_every_sample_subframes_included(tmp_path):
    with Recorder(author(tmp_path / "s.usda"), tmp_path / "out.usdc") as recorder:
        for k, code in enumerate((1.0, 1.25, 1.5, 2.0)):
            recorder.append(code, *world(frame=k))
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(CLOTH))
    assert mesh.GetExtentAttr().GetTimeSamples() == [1.0, 1.25, 1.5, 2.0]
    for code in (1.0, 1.25, 1.5, 2.0):
        extent = UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get(code))
        assert np.array_equal(mesh.GetExtentAttr().Get(code), extent)


def test_what_is_not_written_is_blocked_so_that_nothing_stale_moves_the_points(tmp_path):
    scene = author(tmp_path / "s.usda")
    source = Usd.Stage.Open(scene.source)
    mesh = UsdGeom.Mesh(source.GetPrimAtPath(CLOTH))
    for attribute in (mesh.CreateVelocitiesAttr(), mesh.CreateAccelerationsAttr(), mesh.CreateNormalsAttr()):
        attribute.Set([(0, 1, 0)] * SIDE * SIDE)
    source.Save()
    record(scene, tmp_path / "out.usdc", velocities=False, normals=False)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(CLOTH))
    for attribute in (mesh.GetVelocitiesAttr(), mesh.GetAccelerationsAttr(), mesh.GetNormalsAttr()):
        assert attribute.Get(2.0) is None


# springs and instances


def test_every_curve_end_goes_where_its_particle_goes(tmp_path):
    scene = author(tmp_path / "s.usda", metres=1.0)
    source = Usd.Stage.Open(scene.source)
    curves = UsdGeom.BasisCurves.Define(source, "/World/net")
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([2, 2])
    curves.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0)])
    curves.CreateWidthsAttr([0.5])
    curves.GetPrim().CreateAttribute("wsim:particles", Sdf.ValueTypeNames.IntArray).Set([0, 1, 1, 2])
    source.Save()
    scene.net("/World/net", [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1), (1, 2)], [1.0], [1.0])
    p, v = world()
    p["/World/net"] = v["/World/net"] = np.array([[0, 0, 0], [0, 4, 0], [8, 0, 0]], float)
    with Recorder(scene, tmp_path / "out.usdc") as recorder:
        recorder.append(1.0, p, v)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    net = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/net"))
    assert np.array_equal(net.GetPointsAttr().Get(1.0), p["/World/net"][[0, 1, 1, 2]])
    assert np.array_equal(net.GetExtentAttr().Get(1.0), [[-0.25] * 3, [8.25, 4.25, 0.25]])
    assert np.array_equal(load_restart(tmp_path / "out.usdc", scene).velocities["/World/net"], v["/World/net"])


def test_the_variant_that_was_loaded_is_the_one_in_the_result(tmp_path):
    scene = author(tmp_path / "s.usda")
    stage = Usd.Stage.Open(scene.source)
    prim = stage.GetPrimAtPath(CLOTH)
    sizes = prim.GetVariantSets().AddVariantSet("size")
    points = prim.GetAttribute("points").Get()
    prim.RemoveProperty("points")
    for name, count in (("small", 16), ("tiny", 3)):
        sizes.AddVariant(name)
        sizes.SetVariantSelection(name)
        with sizes.GetVariantEditContext():
            prim.GetAttribute("points").Set(points[:count])
    stage.Save()                                          # the file itself says tiny
    with pytest.raises(SceneError, match="has 3 points"):
        Recorder(scene, tmp_path / "out.usdc")
    scene.variants = {CLOTH: {"size": "small"}}
    record(scene, tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert stage.GetPrimAtPath(CLOTH).GetVariantSet("size").GetVariantSelection() == "small"


def test_a_cloth_inside_an_instance_is_refused_by_the_instances_name(tmp_path):
    author(tmp_path / "asset.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    copy = stage.DefinePrim("/room/copy")
    copy.GetReferences().AddReference("./asset.usda")
    copy.SetInstanceable(True)
    stage.Save()
    scene = Scene(source=str(tmp_path / "s.usda"))
    scene.cloth("/room/copy/Frame/cloth", *triangles())
    with pytest.raises(SceneError, match=r"Frame/cloth: is inside the instance /room/copy.*instanceable = false"):
        Recorder(scene, tmp_path / "out.usdc")
    assert sorted(os.listdir(tmp_path)) == ["asset.usda", "s.usda"]


def test_a_body_that_the_source_lacks_or_that_has_other_points_is_named(tmp_path):
    scene = author(tmp_path / "s.usda")
    scene.cloth("/new", *triangles())
    scene.cloths[0].points = scene.cloths[0].points[:5]
    with pytest.raises(SceneError) as caught:
        Recorder(scene, tmp_path / "out.usdc")
    assert [(p.path, p.text[:22]) for p in caught.value.problems] == [(CLOTH, "has 16 points in " + str(tmp_path)[:5]),
                                                                     ("/new", "is not in " + str(tmp_path)[:12])]


# colliders


def moving_plane(scene: Scene, keys) -> None:
    """A plane in the source that moves 1 m a key along x, [units], and in the scene."""
    stage = Usd.Stage.Open(scene.source)
    op = UsdGeom.Plane.Define(stage, "/World/floor").AddTranslateOp()
    for code in keys:
        op.Set((100.0 * (code - 1), 0, 0), code)
    stage.Save()
    M = np.tile(np.eye(4), (len(keys), 1, 1))
    M[:, 0, 3] = np.array(keys) - 1
    scene.collider("/World/floor", Plane(), motion=Motion((np.array(keys) - 1) / scene.fps, M))


def test_a_collider_that_moves_as_in_the_source_is_not_written(tmp_path):
    scene = author(tmp_path / "s.usda")
    moving_plane(scene, [1, 2, 3])
    with Recorder(scene, tmp_path / "out.usdc") as recorder:
        for f in range(3):
            recorder.append(1.0 + f, *world(), {"/World/floor": scene.colliders[0].motion.at(f / 30)})
    assert not Sdf.Layer.FindOrOpen(str(tmp_path / "out.usdc")).GetPrimAtPath("/World/floor")


def test_a_collider_moved_during_the_run_keeps_its_earlier_path(tmp_path):
    scene = author(tmp_path / "s.usda")
    moving_plane(scene, [1, 2, 3])
    lifted = np.eye(4)
    lifted[:3, 3] = 2.0, 0.0, 5.0
    with Recorder(scene, tmp_path / "out.usdc") as recorder:
        for f in range(3):
            pose = lifted if f == 2 else scene.colliders[0].motion.at(f / 30)
            recorder.append(1.0 + f, *world(), {"/World/floor": pose})
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    prim = stage.GetPrimAtPath("/World/floor")
    found = [UsdGeom.XformCache(c).GetLocalToWorldTransform(prim).ExtractTranslation() for c in (1.0, 2.0, 3.0)]
    assert np.allclose(found, [(0, 0, 0), (100, 0, 0), (200, 0, 500)], rtol=0, atol=1e-9)


# one file, usda, validators


@pytest.mark.parametrize("name", ["out.usdc", "out.usda", "out.usd"])
@pytest.mark.parametrize("flatten", [False, True])
def test_each_format_passes_the_validators_and_leaves_one_file(tmp_path, name, flatten):
    folder = tmp_path / "results"
    folder.mkdir()
    record(author(tmp_path / "s.usda"), folder / name, flatten=flatten,
           restart_fields=lambda: {CLOTH: {"e": np.ones(3)}})
    assert os.listdir(folder) == [name]
    assert validate(folder / name) == []
    layer = Sdf.Layer.FindOrOpen(str(folder / name))
    assert list(layer.subLayerPaths) == ([] if flatten else ["../s.usda"])
    assert np.abs(ResultReader(folder / name).positions(CLOTH, 3.0) - world(frame=2)[0][CLOTH]).max() < 2 * EPS


def test_the_validators_find_a_fault(tmp_path):
    Usd.Stage.CreateNew(str(tmp_path / "bad.usda")).Save()
    assert any("etersPerUnit" in line or "upAxis" in line for line in validate(tmp_path / "bad.usda"))


def test_a_flattened_file_finds_its_textures_beside_it(tmp_path):
    scene = author(tmp_path / "s.usda")
    (tmp_path / "cloth.png").write_bytes(b"")
    stage = Usd.Stage.Open(scene.source)
    stage.GetPrimAtPath(CLOTH).CreateAttribute("file", Sdf.ValueTypeNames.Asset).Set("./cloth.png")
    stage.Save()
    record(scene, tmp_path / "out.usda", flatten=True)
    assert "@./cloth.png@" in (tmp_path / "out.usda").read_text()


def test_a_scene_made_in_python_is_written_beside_its_result(tmp_path, scene):
    p = {"/cloth": scene.cloths[0].motion.points(scene.cloths[0].points)}
    for _ in range(2):                                   # the second run may replace what the first one wrote
        with Recorder(scene, tmp_path / "out.usdc") as recorder:
            recorder.append(0.0, p, p)
    assert sorted(os.listdir(tmp_path)) == ["out.usdc", "out_scene.usda"]
    with Recorder(scene, tmp_path / "flat.usda", flatten=True) as recorder:
        recorder.append(0.0, p, p)
    assert "flat_scene.usda" not in os.listdir(tmp_path)


def test_a_file_of_the_users_is_never_taken_for_the_scene_of_a_result(tmp_path, scene):
    (tmp_path / "out_scene.usda").write_text("#usda 1.0\n")
    with pytest.raises(FileExistsError, match="out_scene.usda is in the way"):
        Recorder(scene, tmp_path / "out.usdc")
    assert (tmp_path / "out_scene.usda").read_text() == "#usda 1.0\n"


# bad places, bad arrays, Ctrl-C


@pytest.mark.parametrize(("name", "error", "text"), [
    ("no/out.usdc", FileNotFoundError, "the folder .* is not there"), ("out.abc", ValueError, "endings"),
    ("s.usda", ValueError, "is the scene itself"), ("below.usda", ValueError, "is a file that the scene depends on"),
    ("folder.usdc", IsADirectoryError, "is a folder")])
def test_an_output_that_cannot_be_is_refused_before_anything_is_written(tmp_path, name, error, text):
    author(tmp_path / "below.usda")
    (tmp_path / "s.usda").write_text('#usda 1.0\n(\n    subLayers = [@./below.usda@]\n)\n')
    (tmp_path / "folder.usdc").mkdir()
    scene = Scene(source=str(tmp_path / "s.usda"))
    scene.cloth(CLOTH, *triangles())
    before = {f: digest(tmp_path / f) for f in ("s.usda", "below.usda")}
    with pytest.raises(error, match=text):
        Recorder(scene, str(tmp_path / name))
    assert {f: digest(tmp_path / f) for f in os.listdir(tmp_path) if f != "folder.usdc"} == before


def test_arrays_that_do_not_fit_are_named_and_write_nothing(tmp_path):
    p, v = world()
    with Recorder(author(tmp_path / "s.usda"), tmp_path / "out.usdc") as recorder:
        recorder.append(1.0, p, v)
        for bad, text in (({}, "are missing"), ({CLOTH: p[CLOTH][:3]}, r"shape \(16, 3\); found shape \(3, 3\)"),
                          ({CLOTH: p[CLOTH] * np.nan}, "finite")):
            with pytest.raises(ValueError, match=text):
                recorder.append(2.0, bad, v)
        with pytest.raises(ValueError, match="not later than 1"):
            recorder.append(1.0, p, v)
    assert ResultReader(tmp_path / "out.usdc").time_codes(CLOTH) == [1.0]


def test_an_interrupted_run_keeps_its_frames_beside_an_earlier_result_and_one_without_frames_leaves_no_file(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc")
    before = digest(tmp_path / "out.usdc")
    for error in (KeyboardInterrupt, SceneError([])):
        with pytest.raises(type(error) if isinstance(error, Exception) else error), \
                Recorder(scene, tmp_path / "out.usdc") as recorder:
            recorder.append(1.0, *world(frame=7))
            raise error
        kept = tmp_path / "out.partial.usdc"
        assert recorder.kept == str(kept) and recorder.result is None and digest(tmp_path / "out.usdc") == before
        assert ResultReader(kept).time_codes(CLOTH) == [1.0]
        assert Sdf.Layer.OpenAsAnonymous(str(kept)).customLayerData["wsim:interrupted"] is True
    assert sorted(os.listdir(tmp_path)) == ["out.partial.usdc", "out.recovered.usdc", "out.usdc", "s.usda"]
    with Recorder(scene, tmp_path / "none.usdc"):
        pass
    assert len(os.listdir(tmp_path)) == 4
