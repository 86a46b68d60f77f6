"""What a picture frames, the squares of its floor, and labels of tiles."""

import numpy as np
from pxr import Usd, UsdGeom

from tests.make.show.picture import ball
from wsim.show.camera import Camera
from wsim.show.image.label import label_image, rasterize_text
from wsim.show.picture import framed_points
from wsim.show.raycast import RayCaster, tile_size
from wsim.show.smoke.read import SmokeDensity, SmokeVolume
from wsim.show.visible import read_visible_stage
from wsim.sweep.pictures import describe_run


def test_frames_show_all_of_the_way_of_what_moves_and_a_still_where_it_is(tmp_path):
    """A ball of 0.1 m from x = 0 to 2 m in 24 frames."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(24)
    sphere = UsdGeom.Sphere.Define(stage, "/ball")
    sphere.CreateRadiusAttr(0.1)
    move = sphere.AddTranslateOp()
    move.Set((0, 0, 0), 0)
    move.Set((2, 0, 0), 24)
    stage.Save()
    seen = read_visible_stage(tmp_path / "a.usda")
    for whole, ends in ((True, (-0.1, 2.1)), (False, (1.9, 2.1))):
        (points,) = framed_points(seen, [24.0], whole)
        assert np.allclose([points[:, 0].min(), points[:, 0].max()], ends, atol=1e-3)


def test_smoke_is_framed_where_it_is():
    """One voxel of 16 x 16 x 16, of 10 cm, from -0.8 m: in a box of 1.6 m."""
    values, world = np.zeros((16, 16, 16), np.float32), np.diag([0.1, 0.1, 0.1, 1.0])
    values[4, 8, 12] = 1.0
    values[0, 0, 0] = 1e-3                                              # too thin to be seen
    world[:3, 3] = -0.75
    smoke = SmokeVolume("/smoke", np.ones(3), lambda t: SmokeDensity(values, world) if t else None, lambda t: np.zeros((8, 3)),
                        [0.0])
    assert smoke.filled(0.0) is None
    corners = smoke.filled(1.0)
    assert np.allclose(corners.min(axis=0), (-0.4, 0.0, 0.4)) and np.allclose(corners.max(axis=0), (-0.3, 0.1, 0.5))


def test_squares_of_a_floor_are_of_round_sizes():
    assert [round(tile_size(scale), 6) for scale in (1.0, 0.3, 6.0, 1000.0)] == [0.2, 0.1, 2.0, 200.0]


def test_every_second_square_of_a_floor_is_darker():
    """Seen from above, beside the ball: two lights, as many pixels of each; edges between squares as many as fit."""
    points, look = ball(0.1)
    camera = Camera.look((0.0, 1.0, 1e-4), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), angle=0.4)

    def shades(tiles: bool) -> np.ndarray:
        image = RayCaster([look], (200, 200), "cpu").image([points], camera, "Y", -0.1, tiles=tiles)
        return image[5:45, 5:195, 1].astype(float)
    plain, squares = shades(False), shades(True)
    ratio = squares / plain
    dark = ratio < 0.97
    assert 0.4 < dark.mean() < 0.6 and np.median(ratio[~dark]) > 0.995 and np.median(ratio[dark]) < 0.95
    turns = np.count_nonzero(np.diff(dark[20].astype(int)))
    assert abs(turns - 190 / 200 * 2.0 * np.tan(0.2) * 1.1 / tile_size(np.sqrt(3.0) * 0.1)) < 1.5


def test_letters_are_dots():
    dots = rasterize_text("1t")
    assert dots.shape == (7, 9) and dots[1:6, 1:4].astype(int).tolist() == [
        [0, 1, 0], [1, 1, 0], [0, 1, 0], [0, 1, 0], [1, 1, 1]]
    assert dots[1, 5:8].all() and not dots[:, [0, 4, 8]].any()


def test_a_label_stands_at_the_lower_left_and_leaves_the_rest():
    image = np.full((90, 160, 3), 100, np.uint8)
    out = label_image(image, ["STRETCH=500", "BEND=1e-4"])
    changed = np.argwhere((out != image).any(axis=2))
    assert changed[:, 0].min() > 70 and changed[:, 1].max() < 60 and changed[:, 1].min() == 0 and (image == 100).all()
    assert set(np.unique(out)) == {45, 100, 255} and label_image(image[:4, :6], ["long text"]).shape == (4, 6, 3)


def test_a_tile_says_what_varies():
    row = {"run": "3", "/World/Flag:stretch": "500.00000001", "solver": "explicit", "status": "done", "seconds": "1"}
    assert describe_run(row) == ["stretch=500", "solver=explicit"] and describe_run({"run": "0"}) == []
