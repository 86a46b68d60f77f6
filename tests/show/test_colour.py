"""Colours of strain, stress and contact: values against theory, and what ends up in results and pictures."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.make.physics.soft.soft_bar import bar
from tests.make.usda import Reader, cloth
from wsim import Cloth, Fabric, load, save
from wsim.cli import main
from wsim.model.model import make_body
from wsim.scene import SceneError
from wsim.show.colour import TOP, colour_scale, point_strain_or_stress
from wsim.show.picture import picture
from wsim.show.visible import read_visible_stage

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)


def sheet(**material) -> Cloth:
    return Cloth("/cloth", SQUARE, [4], [0, 1, 2, 3], material=Fabric(**material))


def turned(points: np.ndarray) -> np.ndarray:
    """The same shape elsewhere, turned by 40 degrees about an oblique axis (Rodrigues)."""
    axis, angle = np.array([1.0, 2.0, 2.0]) / 3.0, 0.7
    K = np.cross(np.eye(3), axis)
    return points @ (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) + [3.0, -1.0, 2.0]


def test_strain_of_a_sheet_is_the_larger_principal_one_however_it_lies():
    body = make_body(sheet(), 0, 0, 0)
    assert point_strain_or_stress(body, turned(SQUARE), "strain") == pytest.approx(np.zeros(4), abs=1e-12)
    assert point_strain_or_stress(body, turned(SQUARE * [1.05, 0.98, 1.0]), "strain") == pytest.approx(np.full(4, 0.05 / TOP))
    shear = SQUARE @ np.array([[1, 0, 0], [0.06, 1, 0], [0, 0, 1.0]])                # stretches of 1 + g/2 + g^2/8
    assert point_strain_or_stress(body, turned(shear), "strain") == pytest.approx(np.full(4, (0.03 + 0.06**2 / 8) / TOP),
                                                                                  rel=1e-3)


def test_stress_of_a_sheet_is_plane_stress():
    """Along the warp e: K e, nu K e, K = stretch / (1 - nu^2); von Mises K e sqrt(1 - nu + nu^2)."""
    body = make_body(sheet(stretch=500.0, poisson=0.3), 0, 0, 0)
    found = point_strain_or_stress(body, turned(SQUARE * [1.02, 1.0, 1.0]), "stress")
    assert found == pytest.approx(np.full(4, 0.02 * np.sqrt(0.79) / 0.91 / TOP))


def test_faces_that_are_stiffer_bear_more():
    mapped = Cloth("/cloth", np.concatenate([SQUARE, SQUARE[1:3] + [1, 0, 0]]), [4, 4], [0, 1, 2, 3, 1, 4, 5, 2],
                   stretches=[100.0, 300.0], material=Fabric(stretch=200.0))
    found = point_strain_or_stress(make_body(mapped, 0, 0, 0), mapped.points * [1.01, 1.0, 1.0], "stress")
    assert found[[0, 3]] == pytest.approx(0.5 * 0.01 / TOP) and found[[4, 5]] == pytest.approx(1.5 * 0.01 / TOP)


def test_stress_of_a_solid_is_youngs_modulus_times_strain_where_its_sides_are_free():
    """Uniaxial: e along, -nu e across; von Mises E e."""
    solid = bar().softs[0]
    nu, rest = solid.material.poisson, solid.points.astype(float)
    e = 0.01
    body = make_body(solid, 0, 0, 0)
    long = turned(rest * [1 + e, 1 - nu * e, 1 - nu * e])
    assert point_strain_or_stress(body, long, "stress") == pytest.approx(np.full(len(rest), e / TOP), rel=1e-6)
    assert point_strain_or_stress(body, long, "strain") == pytest.approx(np.full(len(rest), e * np.sqrt(1 + 2 * nu * nu) / TOP),
                                                                         rel=1e-6)


def test_the_scale_goes_from_blue_to_red_and_ends_there():
    blue, red, over, under = colour_scale(np.array([0.0, 1.0, 7.0, -1.0]))
    assert blue[2] > 3 * blue[0] and red[0] > 3 * red[2]
    assert np.array_equal(red, over) and np.array_equal(blue, under)


@pytest.fixture
def result(tmp_path):
    """A sheet that falls on a floor 5 cm below, its colours of strain with it."""
    floor = 'def Cube "floor" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {\ndouble size = 4\n' \
            'double3 xformOp:translate = (0, 0, -2.001)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    own = "color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = \"vertex\")\n" \
          "int[] primvars:displayColor:indices = [0, 1, 1, 0]"
    Reader(tmp_path)(cloth(own) + floor, 'metersPerUnit = 1\nupAxis = "Z"')
    out = tmp_path / "out.usdc"
    assert main(["run", str(tmp_path / "scene.usda"), "-o", str(out), "--frames", "3", "--device", "cpu", "--quiet",
                 "--colour", "strain"]) == 0
    return out


def test_a_run_writes_colours_of_each_frame(result):
    stage = Usd.Stage.Open(str(result))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/cloth")).GetPrimvar("displayColor")
    assert primvar.GetTimeSamples() == [0.0, 1.0, 2.0, 3.0] and primvar.GetInterpolation() == "vertex"
    assert not primvar.IsIndexed() and len(primvar.ComputeFlattened(2.0)) == 4
    assert np.asarray(primvar.Get(0.0)) == pytest.approx(colour_scale(np.zeros(4)))
    seen = read_visible_stage(result)
    drawn = next(d for d in seen.drawn if d.look.path == "/cloth")
    assert drawn.colors is not None and drawn.colors(0.0) == pytest.approx(colour_scale(np.zeros(4)))


@pytest.mark.parametrize("kind", ["strain", "stress"])
def test_the_surface_that_a_result_draws_of_a_solid_is_coloured(kind, tmp_path):
    """Its points have the colours of the same points of the TetMesh, which hangs from one end: not all alike."""
    from wsim.show.paint import paint_measured_colours
    scene = bar()
    scene.frames, scene.fps = 2, 10.0
    save(scene, tmp_path / "scene.usda")
    out = tmp_path / "out.usdc"
    assert main(["run", str(tmp_path / "scene.usda"), "-o", str(out), "--device", "cpu", "--quiet"]) == 0
    seen, path = read_visible_stage(out), f"{scene.softs[0].path}_surface"
    (drawn,) = [d for d in seen.drawn if d.look.path == path]
    assert drawn.colors is None
    paint_measured_colours(seen, kind, "cpu")
    tets = UsdGeom.TetMesh(seen.stage.GetPrimAtPath(scene.softs[0].path))
    x = np.array(tets.GetPointsAttr().Get(2.0))
    all_ = colour_scale(point_strain_or_stress(make_body(load(out).softs[0], 0, 0, 0), x, kind))
    nearest = np.linalg.norm(drawn.points(2.0)[:, None] - x[None], axis=2).argmin(axis=1)
    assert drawn.colors(2.0) == pytest.approx(all_[nearest], abs=1e-5) and np.ptp(drawn.colors(2.0), axis=0).max() > 1e-3


def test_contact_is_red_where_it_touches_and_blue_above(tmp_path, result):
    from wsim.show.paint import paint_measured_colours
    seen = read_visible_stage(result)
    paint_measured_colours(seen, "contact", "cpu")
    sheet_ = next(d for d in seen.drawn if d.look.path == "/cloth")
    assert sheet_.colors(0.0) == pytest.approx(np.tile(colour_scale(np.ones(1)), (4, 1)), abs=0.3)  # 1 mm above: nearly red
    lifted = sheet_.points
    sheet_.points = lambda t: lifted(t) + [0, 0, 1.0]
    assert sheet_.colors(0.0) == pytest.approx(np.tile(colour_scale(np.zeros(1)), (4, 1)))


def test_what_lies_at_the_distance_that_a_collider_keeps_touches_it(tmp_path, result):
    """A sheet of 1 mm at 2 cm + half a millimetre above a floor that keeps 2 cm."""
    from wsim.show.paint import paint_measured_colours
    text = (tmp_path / "scene.usda").read_text().replace("double size = 4", "double size = 4\ndouble wsim:thickness = 0.02")
    text = text.replace('["PhysicsCollisionAPI"]', '["PhysicsCollisionAPI", "WsimColliderAPI"]').replace("-2.001", "-2.0205")
    (tmp_path / "kept.usda").write_text(text)
    seen = read_visible_stage(tmp_path / "kept.usda")
    paint_measured_colours(seen, "contact", "cpu")
    sheet_ = next(d for d in seen.drawn if d.look.path == "/cloth")
    assert sheet_.colors(0.0) == pytest.approx(np.tile(colour_scale(np.ones(1)), (4, 1)), abs=0.01)


def test_pictures_of_different_measures_differ(tmp_path, result):
    for kind in ("strain", "stress", "contact", None):
        picture(result, tmp_path / f"{kind}.png", size=(64, 36), device="cpu", colour=kind)
    strain, contact, own = ((tmp_path / f"{kind}.png").read_bytes() for kind in ("strain", "contact", None))
    assert strain != contact and strain == own                       # the result is coloured by strain already


def test_colours_of_nothing_are_said(tmp_path, result):
    with pytest.raises(SceneError, match="allowed is strain, stress, contact"):
        picture(result, tmp_path / "a.png", size=(32, 18), device="cpu", colour="heat")
    bare = tmp_path / "bare"
    bare.mkdir()
    Reader(bare)(cloth())
    with pytest.raises(SceneError, match="no collider that is seen"):
        picture(bare / "scene.usda", tmp_path / "a.png", size=(32, 18), device="cpu", colour="contact")
