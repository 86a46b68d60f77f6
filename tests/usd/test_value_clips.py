"""Animation in value clips (`UsdClipsAPI`): colliders, what cloth is pinned to, and skeletons move as the samples of the clips
say, at the times that clips are given, and are read as if the samples stood in the layer itself."""

import numpy as np
import pytest
from pxr import Sdf, Usd

import wsim
from tests.make.usd.prims.skeleton import COLLIDES, character, mesh
from tests.make.usda import cloth

CODES = np.arange(0.0, 25.0, 6.0)
PINNED = """
def Xform "rail" {
    double3 xformOp:translate
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def PhysicsAttachment "held" {
    rel physics:src0 = </cloth>
    rel physics:src1 = </rail>
    uniform token physics:type0 = "point"
    uniform token physics:type1 = "xform"
    int[] physics:indices0 = [0, 3]
    vector3f[] physics:coords1 = [(0, 0, 0), (1, 0, 0)]
}
def Xform "moved" {
    double3 xformOp:translate
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Sphere "ball" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
        double radius = 0.2
    }
}
"""


def way(code: float) -> tuple:
    return (0.1 * code, -3.0 + 0.02 * code * code, 0.0)


def written(layer: Sdf.Layer, shift: float = 0.0, scale: float = 1.0) -> None:
    """The samples of all that moves, over what there is."""
    stage = Usd.Stage.Open(layer)
    for path in ("/rail", "/moved"):
        op = stage.OverridePrim(path).CreateAttribute("xformOp:translate", Sdf.ValueTypeNames.Double3)
        for code in CODES.tolist():
            op.Set(way(code), shift + scale * code)
    walk = stage.OverridePrim("/char/walk")
    lift = walk.CreateAttribute("translations", Sdf.ValueTypeNames.Float3Array, False)
    for code in CODES.tolist():
        lift.Set([(0.0, 0.01 * code, 0.0)], shift + scale * code)
    stage.Save()


def scene_file(folder, clips: bool):
    """The scene with its samples in a layer, or in a clip whose codes are twice as far apart and begin at 100."""
    text = "#usda 1.0\n(timeCodesPerSecond = 24\n endTimeCode = 24\n metersPerUnit = 1\n upAxis = \"Y\")\n"
    base = Sdf.Layer.CreateNew(str(folder / ("clipped.usda" if clips else "plain.usda")))
    base.ImportFromString(text + cloth() + character(mesh(COLLIDES)) + PINNED)
    walk = base.GetPrimAtPath("/char/walk")
    del walk.properties["translations"]
    base.Save()
    if not clips:
        written(base)
        return base.realPath
    clip = Sdf.Layer.CreateNew(str(folder / "clip.usda"))
    written(clip, 100.0, 2.0)
    stage = Usd.Stage.Open(base)
    for path in ("/rail", "/moved", "/char"):
        api = Usd.ClipsAPI(stage.GetPrimAtPath(path))
        api.SetClipPrimPath(path), api.SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])
        api.SetClipActive([(0.0, 0.0)]), api.SetClipTimes([(0.0, 100.0), (24.0, 148.0)])
    stage.Save()
    return base.realPath


@pytest.fixture
def both(tmp_path):
    return [wsim.load(scene_file(tmp_path, clips)) for clips in (False, True)]


def test_colliders_pins_and_skeletons_are_where_their_clips_say(both):
    plain, clipped = both
    times = CODES / 24.0
    for scene in both:
        ball = next(c for c in scene.colliders if c.path == "/moved/ball")
        for motion in (ball.motion, scene.pins[0].motion):
            np.testing.assert_allclose([motion.at(t)[:3, 3] for t in times], [way(code) for code in CODES], atol=1e-12)
        skin = next(c.shape.poses for c in scene.colliders if c.path == "/char/skin")
        np.testing.assert_allclose(skin.over(times)[:, 0, 1] - skin.at(0.0)[0, 1], 0.01 * CODES, atol=1e-7)
    assert clipped.colliders == plain.colliders and clipped.pins == plain.pins


def test_a_run_with_clips_has_the_bits_of_one_without(both):
    ends = []
    for scene in both:
        sim = wsim.Simulation(scene, device="cpu")
        sim.run(3)
        ends.append(sim.positions("/cloth"))
    assert np.array_equal(*ends)
