"""Arguments that nothing takes, and arguments that lack: a line with the path, what is allowed and a fix."""

import pytest

import wsim
from wsim import Box, Scene, SceneError, shapes
from wsim.scene.check.scene import check_scene

HALF = (0.1, 0.1, 0.1)
STRAND = [(0.0, 1.0, 0.0), (0.0, 0.9, 0.0)]


def pair(s: Scene) -> None:
    a, b = s.body("/a", Box(HALF)), s.body("/b", Box(HALF), at=(0.3, 0, 0))
    s.joint("revolute", "/j", a, b, at=(0.15, 0, 0), axis=(0, 0, 1))


WRONG = {
    "body": (lambda s: s.body("/x", Box(HALF), densty=1.0), "/x: densty is no argument of scene.body", "fix: write density"),
    "spin": (lambda s: s.body("/x", Box(HALF), angular_velocity=(0, 1, 0)), "/x: angular_velocity is no", "write spin"),
    "no spin": (lambda s: s.particles("/x", Box(HALF), omega=(0, 1, 0)), "/x: omega is no argument", "fix: leave it out"),
    "turned": (lambda s: s.collider("/x", Box(HALF), orientation=(1, 0, 0, 0)), "/x: orientation is no", "give motion="),
    "kinematic": (lambda s: s.body("/x", Box(HALF), kinematic=True), "/x: kinematic is no argument", "scene.collider(PATH"),
    "particles": (lambda s: s.particles("/x", Box(HALF), radiuss=0.1), "/x: radiuss is no argument of scene.particles",
                  "fix: write radius"),
    "rods": (lambda s: s.rods("/x", STRAND, [2], diameter=0.1), "/x: diameter is no argument of scene.rods",
             "fix: write diameters"),
    "cloth": (lambda s: s.cloth("/x", *shapes.sheet(1.0, 1.0, 2, 2), dragg=1.0), "/x: dragg is no argument", "fix: write drag"),
    "joint": (lambda s: s.joint("revolute", "/x", None, "/a", lower=0.0), "/x: lower is no argument of", "low, high"),
    "by name": (lambda s: s.body(shape=Box(HALF), path="/x", zzz=1.0), "/x: zzz is no argument", "help(wsim.Scene.body) says"),
    "servo": (lambda s: s.actuator("position", "/x", "/j", kp=5.0), "/x: has no stiffness", "fix: give scene.actuator("),
    "motor": (lambda s: s.actuator("motor", "/x", "/j", stifness=5.0), "/x: stifness is no argument", "control_range"),
    "axis": (lambda s: s.joint("revolute", "/x", None, "/a", axis="z"), "/x: axis is 'z'; allowed: three", "fix: "),
    "no axis": (lambda s: s.joint("revolute", "/x", None, "/a", axis=(0, 0, 0)), "/x: axis is (0, 0, 0)", "not all 0"),
    "onto": (lambda s: s.pin("/x", s.cloth("/c", *shapes.sheet(1.0, 1.0, 2, 2)), [0], onto="/a"),
             "/x: onto is '/a', which is no collider", "scene.tie("),
    "shape": (lambda s: s.particles("/x", "/mesh"), "/x: shape is '/mesh'; allowed is a closed shape", "fix: give Box("),
    "pour": (lambda s: s.particles("/x", points=[(0, 1, 0)], pour=1), "/x: has points and a pour", "fix: give a shape"),
}


@pytest.mark.parametrize("name", WRONG)
def test_the_path_the_name_and_a_fix_are_told(name):
    wrong, said, fix = WRONG[name]
    scene = Scene()
    pair(scene)
    with pytest.raises(SceneError) as caught:
        wrong(scene)
    text = str(caught.value)
    assert text.startswith(said) and fix in text and "\n" not in text and "__init__" not in text


def test_a_mistake_in_the_call_itself_stays_pythons():
    """Names of wsim's own functions are not blamed on a caller who did not give them."""
    with pytest.raises(TypeError, match="points"):
        Scene().cloth("/x")
    with pytest.raises(TypeError, match="counts"):
        Scene().rods("/x", STRAND)


def test_help_names_the_arguments():
    from inspect import signature
    assert [*signature(wsim.Scene.body).parameters][:4] == ["self", "path", "shape", "at"]


@pytest.mark.parametrize("high, told", [(1.5, False), (6.3, False), (90.0, True), (float("inf"), False)])
def test_limits_that_look_like_degrees(high, told):
    scene = Scene()
    pair(scene)
    scene.joint("revolute", "/k", None, "/a", axis=(0, 0, 1), low=-1.0, high=high)
    assert any(p.path == "/k" and "np.radians(90)" in p.text and not p.fatal for p in check_scene(scene)) == told
