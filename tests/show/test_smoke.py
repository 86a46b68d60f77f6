"""Smoke in pictures and in the viewer: Beer and Lambert's law, shadows, depth among meshes, and what is read of a stage."""

import subprocess
import sys

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdVol

from tests.make.show.smoke import N, cloud, plate
from tests.make.show.view import needs_rerun, rows
from wsim.geometry import primitives
from wsim.kernels.picture import ray
from wsim.scene import SceneError
from wsim.scene.samples import VolumeSample
from wsim.show.camera import Camera
from wsim.show.picture import RayCaster, picture
from wsim.show.shading import MeshLook
from wsim.show.smoke.read import DENSE, SmokeDensity, smoke_beads
from wsim.show.visible import read_visible_stage
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.kinds.rows import sample_attribute_values


def taken_from(meshes, clouds, eye=(0.0, 0.0, 9.0), size=(64, 64), floor=None, seen=None) -> np.ndarray:
    """Linear image (h, w, 3) before tones, by the caster's own buffers where `seen` is given."""
    caster = RayCaster([look for _, look in meshes], size, "cpu")
    found = caster.image([points for points, _ in meshes], Camera.look(eye, (0, 0, 0), angle=0.3), "Y", floor, None, clouds)
    if seen is not None:
        seen.append(caster)
    return found


def linear(image: np.ndarray) -> np.ndarray:
    c = image / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("depth", [0.3, 1.0, 3.0])
def test_what_is_behind_is_dimmed_by_beer_and_lambert(depth):
    """Black smoke before a wall, whose middle it leaves in the light: exp(-depth) of its radiance, to half a byte's step. The
    integral of the trilinear density along a line through the middle is that of the voxels."""
    smoke, density = cloud(np.ones((N, N, N)), depth=depth)
    smoke.albedo = np.zeros(3)
    wall = plate(-3.0, color=(0.6, 0.6, 0.6))
    middle = (slice(28, 36), slice(28, 36))
    with_, without = (linear(taken_from([wall], clouds))[middle].mean() for clouds in ([(smoke, density)], []))
    assert abs(with_ / without - np.exp(-depth)) < 0.01


def test_smoke_behind_a_surface_is_not_seen_and_half_of_it_before_one_is():
    """A black wall at z = 0 within the cloud leaves the front half: 1 - exp(-depth / 2) of white smoke's light."""
    smoke, density = cloud(np.ones((N, N, N)), depth=2.0)
    middle = (slice(30, 34), slice(30, 34))
    behind, half, front = (linear(taken_from([plate(z)], [(smoke, density)]))[middle].mean() for z in (1.6, 0.0, -2.0))
    black = linear(taken_from([plate(1.6)], []))[middle].mean()
    assert behind == black
    assert black < 0.5 * half < 0.5 * front


def test_a_cloud_shades_what_the_light_meets_behind_it():
    """On the ground below black smoke of depth 50: no key light where the way to the light leads through its core, all of it
    where that misses the cloud, and the sky's light everywhere."""
    clouds, ball = [cloud(np.ones((N, N, N)), low=(-1.0, 0.5, -1.0), depth=50.0)], primitives.sphere_outline(0.05, 16)
    casters: list = []
    for there in (clouds, []):
        balls = [(ball[0] + [x, 6.0, -4.0], MeshLook(ball[1])) for x in (-4.0, 4.0)]
        taken_from(balls, there, (0.0, 40.0, 8.0), (96, 96), 0.0, casters)
    with_, without = (caster.light.numpy() for caster in casters)
    from wsim.show.raycast import _ray_view
    light = np.array(_ray_view(Camera.look((0.0, 40.0, 8.0), (0, 0, 0), angle=0.3).filled(1.0), "Y", 0.0, np.zeros(3),
                               1.0).light)
    ground = casters[0].samples.what.numpy() == int(ray.GROUND)
    place = casters[0].samples.place.numpy() * casters[0].scale + casters[0].center
    at = place + light * ((1.5 - place[..., 1]) / light[1])[..., None]           # where the way is as high as the middle
    off = np.abs(at - [0.0, 1.5, 0.0]).max(axis=2)
    core, clear = ground & (off < 0.4), ground & (off > 4.0)
    assert core.sum() > 20 and clear.sum() > 100
    assert with_[core][:, 0].max() < 0.02 < 0.9 < without[core][:, 0].min()
    assert np.abs(with_ - without)[clear].max() < 1e-6 and np.abs(with_ - without)[ground][:, 1:].max() < 1e-6


def test_light_in_a_cloud_falls_off_towards_its_far_side():
    """V of voxels along the light, as the exponential of what lies before them; behind a plate it is 0."""
    import warp as wp

    from wsim.show.raycast import _ray_view
    from wsim.show.smoke.media import SmokeMedia
    depth = 3.0
    smoke, density = cloud(np.ones((N, N, N)), depth=depth)
    for half, hidden in ((4.0, True), (1e-3, False)):
        points, look = plate(0.0, half)
        camera = Camera.look((0, 0, 9.0), (0, 0, 0), angle=0.3).filled(1.0)
        view = _ray_view(camera, "Y", None, np.zeros(3), 1.0)
        light = np.array(view.light)
        caster = RayCaster([look], (8, 8), "cpu")
        # the plate stands between the cloud and the light, across it
        z, x = light, np.cross(light, [0.0, 1.0, 0.0])
        x /= np.linalg.norm(x)
        turned = points[:, :1] * x + points[:, 1:2] * np.cross(z, x) + 3.0 * z
        caster.image([turned], camera, "Y", None)
        caster.center, caster.scale = np.zeros(3), 1.0
        caster.mesh = None
        surfaces = caster._refit_surfaces([turned])
        with wp.ScopedDevice("cpu"):
            media = SmokeMedia([(smoke, density)], np.array([0.0, 0.0, 9.0]), np.zeros(3), 1.0)
            media.light(surfaces, view, caster.samples, caster.light, caster.other)
        V = media.media[0].lit.numpy()
        if hidden:
            assert not V.any()
            continue
        h = 2.0 / N
        for index in ((8, 8, 8), (3, 12, 6), (10, 4, 4)):
            p = -1.0 + h * (np.array(index) + 0.5)
            exits = np.where(light > 0, (1.0 - p) / light, (-1.0 - p) / light).min()
            # the density is trilinear: at a face its support ends half a voxel out, and within it falls from half a voxel in
            assert V[index] == pytest.approx(np.exp(-0.5 * depth * exits), rel=float(0.5 * depth * h / np.abs(light).max()))


def test_finer_grids_than_a_picture_shows_are_lit_in_blocks(monkeypatch):
    """A cloud of 64 voxels an edge, in blocks of one and of two: the same to few steps of a byte."""
    from wsim.show.smoke import media
    images = []
    for blocks in (64, 32):
        monkeypatch.setattr(media, "BLOCKS", blocks)
        x = (np.stack(np.meshgrid(*[np.arange(64) + 0.5] * 3, indexing="ij")) / 64 - 0.5) * 2.0
        images.append(taken_from([plate(-3.0)], [cloud(np.clip(2.0 - 2.0 * np.sqrt((x**2).sum(0)), 0.0, 1.0), depth=4.0)]))
    difference = np.abs(images[0].astype(int) - images[1])
    assert images[0].max() > 100 and 0 < difference.max() <= 4


def stage_with(path, values: np.ndarray, codes=(1.0, 2.0), metres: float = 0.01) -> str:
    """A volume of a fluid's domain in centimetres, in each frame as dense as its code says."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetStartTimeCode(codes[0])
    stage.SetEndTimeCode(codes[-1])
    box = UsdGeom.Cube.Define(stage, "/air")
    box.GetPrim().AddAppliedSchema("WsimFluidDomainAPI")
    beside = SidecarFiles(str(path))
    for code in codes:
        sample = VolumeSample("/air", np.array([0.0, 0.0, 0.0]), 0.25, {"density": (code * values).astype(np.float32)})
        for attribute, value in sample_attribute_values(stage, sample, code, beside):
            attribute.Set(value, code)
    stage.GetRootLayer().Save()
    return str(path)


def test_a_volume_of_a_stage_is_read_in_metres_at_its_time(tmp_path):
    values = np.zeros((8, 8, 16))
    values[2:5, 3:6, 4:9] = 1.0
    path = stage_with(tmp_path / "s.usda", values)
    seen = read_visible_stage(path)
    assert [s.path for s in seen.smoke] == ["/air_volume"] and not seen.drawn and seen.times == [1.0, 2.0] and not seen.notes
    smoke = seen.smoke[0]
    for code in (1.0, 2.0):
        density = smoke.at(code)
        full = np.argwhere(density.values == code)
        places = full @ density.world[:3, :3].T + density.world[:3, 3]
        assert len(full) == 45 and np.allclose(places.min(0), [0.625, 0.875, 1.125])
        assert np.allclose(places.max(0), [1.125, 1.375, 2.125])
    assert np.allclose([smoke.corners(1.0).min(0), smoke.corners(1.0).max(0)], [(0, 0, 0), (2, 2, 4)])
    assert np.isclose(smoke.extinction, DENSE / 4.0)


def test_a_picture_of_a_result_shows_its_smoke(tmp_path):
    path = stage_with(tmp_path / "s.usda", np.ones((8, 8, 8)))
    images = []
    for code in (1.0, 2.0):
        said = picture(path, tmp_path / f"{code:g}.png", frames=code, size=(64, 64), device="cpu")
        images.append((tmp_path / f"{code:g}.png").read_bytes())
        assert said["frames"] == [code] and not said["notes"]
    assert images[0] != images[1]
    again = picture(path, tmp_path / "again.png", frames=2.0, size=(64, 64), device="cpu")
    assert (tmp_path / "again.png").read_bytes() == images[1] and again["size"] == [64, 64]


def test_what_cannot_be_drawn_of_a_volume_is_noted(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    UsdGeom.Sphere.Define(stage, "/ball")
    UsdVol.Volume.Define(stage, "/bare")
    for name, file in (("lost", "lost.vdb"), ("wrong", "wrong.vdb")):
        volume = UsdVol.Volume.Define(stage, f"/{name}")
        asset = UsdVol.OpenVDBAsset.Define(stage, f"/{name}/density")
        asset.CreateFilePathAttr(Sdf.AssetPath(file))
        volume.CreateFieldRelationship("density", asset.GetPath())
        volume.CreateExtentAttr([Gf.Vec3f(-1), Gf.Vec3f(1)])
    stage.GetRootLayer().Save()
    (tmp_path / "wrong.vdb").write_bytes(b"no such thing")
    notes = picture(tmp_path / "s.usda", tmp_path / "o.png", size=(32, 32), device="cpu")["notes"]
    for said in ("/bare: has no field density", "/lost: is not drawn at time code 0: ", "wrong.vdb is no OpenVDB file"):
        assert any(said in note for note in notes), said
    stage.RemovePrim("/ball")
    for name in ("lost", "wrong"):
        stage.RemovePrim(f"/{name}")
    stage.GetRootLayer().Save()
    with pytest.raises(SceneError, match="nothing visible to draw"):
        read_visible_stage(tmp_path / "s.usda")


def test_kernels_of_smoke_are_loaded_for_smoke_alone(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    UsdGeom.Sphere.Define(stage, "/ball")
    stage.GetRootLayer().Save()
    with_ = stage_with(tmp_path / "v.usda", np.ones((4, 4, 4)))
    for path, wanted in ((tmp_path / "s.usda", []), (with_, ["wsim.kernels.picture.smoke", "wsim.show.smoke.media"])):
        done = subprocess.run([sys.executable, "-c", f"""
import sys
from wsim.show.picture import picture
picture({str(path)!r}, {str(tmp_path / 'o.png')!r}, size=(16, 16), device="cpu")
print("found", *sorted(m for m in sys.modules if m in ("wsim.kernels.picture.smoke", "wsim.show.smoke.media")))
"""], capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1].split()[1:] == wanted


def test_beads_are_few_and_hold_the_smoke():
    """Voxels where they are few, else blocks; radii grow with the density up to the block."""
    values = np.zeros((4, 4, 4), np.float32)
    values[1, 2, 3], values[0, 0, 0] = 1e6, 1.0
    M = np.diag([0.5, 0.5, 0.5, 1.0])
    places, radii = smoke_beads(SmokeDensity(values, M), 1.0)
    assert np.allclose(places, [(0, 0, 0), (0.5, 1.0, 1.5)]) and np.isclose(radii[1], 0.25) and radii[0] < 0.2
    rng = np.random.default_rng(0)
    large = rng.random((70, 60, 50)).astype(np.float32)
    places, radii = smoke_beads(SmokeDensity(large, M), 1.0)
    assert 1000 < len(places) <= 20000 and radii.max() <= 0.5 * 0.5 * 4


@needs_rerun
def test_the_viewer_has_the_smoke_of_every_frame(tmp_path):
    from wsim.show.viewer import view
    view(stage_with(tmp_path / "s.usda", np.ones((4, 4, 4))), tmp_path / "o.rrd")
    found = rows(tmp_path / "o.rrd")
    assert found["/world/air_volume positions"] == found["/world/air_volume radii"] == 2
