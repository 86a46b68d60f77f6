"""Stages that cannot be right: a line for each, with its path, what was found, what is allowed and a mend."""

import re

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from tests.physics.rigid.pairs import WHERE
from wsim.physics.rigid.joints.joint import Joint
from wsim.physics.rigid.objects import Body
from wsim.physics.rods.objects import Rods
from wsim.scene import Box, Collider, Plane, Scene, SceneError, Sphere, Surface, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation
from wsim.usd import load

NAN = float("nan")
TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]


def stage_with(path: str, points=None, scale: float = 1.0, metres: float = 1.0, orient=None, velocity=None, **mass) -> str:
    """A body /b, a cube of 2 or a tetrahedron of these points, with attributes of PhysicsMassAPI."""
    stage = Usd.Stage.CreateNew(path)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(5.0)
    if points is None:
        prim = UsdGeom.Cube.Define(stage, "/b").GetPrim()
    else:
        mesh = UsdGeom.Mesh.Define(stage, "/b")
        mesh.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
        mesh.CreateFaceVertexCountsAttr([3, 3, 3, 3])
        mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
        prim = mesh.GetPrim()
    xform = UsdGeom.Xformable(prim)
    if orient is not None:
        xform.AddOrientOp().Set(Gf.Quatf(*orient))
    xform.AddScaleOp().Set(Gf.Vec3f(scale))
    UsdPhysics.CollisionAPI.Apply(prim)
    api, given = UsdPhysics.RigidBodyAPI.Apply(prim), UsdPhysics.MassAPI.Apply(prim)
    if velocity is not None:
        api.CreateVelocityAttr(Gf.Vec3f(*velocity))
    for name, value in mass.items():
        getattr(given, f"Create{name}Attr")(value)
    stage.Save()
    return path


@pytest.mark.parametrize("more, said", [
    ({"Mass": -1.0}, "physics:mass is -1"), ({"Mass": NAN}, "physics:mass is nan"),
    ({"Mass": float("inf")}, "physics:mass is inf"),
    ({"Density": -5.0}, "physics:density is -5"), ({"Density": NAN}, "physics:density is nan"),
    ({"Mass": 1.0, "DiagonalInertia": Gf.Vec3f(-1, 1, 1)}, "moments of inertia are (-1, 1, 1)"),
    ({"Mass": 1.0, "DiagonalInertia": Gf.Vec3f(0, 1, 1)}, "moments of inertia are (0, 1, 1)"),
    ({"Mass": 1.0, "DiagonalInertia": Gf.Vec3f(NAN, 1, 1)}, "inertia is (nan, 1, 1)"),
    ({"Mass": 1.0, "DiagonalInertia": Gf.Vec3f(1, 1, 1), "PrincipalAxes": Gf.Quatf(2, 0, 0, 0)}, "quaternion of length 2"),
    ({"Mass": 1.0, "CenterOfMass": Gf.Vec3f(NAN, 0, 0)}, "physics:centerOfMass is (nan"),
    ({"orient": (1, 0, 0, 2)}, "quaternion of length 2.23"), ({"velocity": (NAN, 0, 0)}, "velocity is [nan"),
    ({"points": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]}, "enclose no volume"),
    ({"points": [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]}, "has an area"),
    ({"points": [(1, 1, 1)] * 4}, "has an area"), ({"points": [*TETRAHEDRON[:3], (0, 0, NAN)]}, "is not finite"),
    ({"scale": 1e-7}, "of which float32 holds the inverse"), ({"scale": 1e7}, "of which float32 holds the inverse"),
    ({"scale": 0.0}, "scale is zero")])
def test_what_cannot_run_is_refused_in_a_line_with_its_path(more, said, tmp_path):
    with pytest.raises(SceneError) as told:
        load(stage_with(str(tmp_path / "a.usda"), **more))
    lines = [line for line in str(told.value).splitlines() if said in line]
    assert lines and "/b" in lines[0]


@pytest.mark.parametrize("more, said", [
    ({"Mass": 0.0}, "physics:mass is 0, which USD takes as none"),
    ({"Mass": 1.0, "DiagonalInertia": Gf.Vec3f(1, 1, 5)}, "which no solid has"),
    ({"Mass": 1.0, "CenterOfMass": Gf.Vec3f(50, 0, 0)}, "from its colliders"),
    ({"scale": 1e-4}, "m small"), ({"scale": 1e4}, "m large"),
    ({"points": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], "Mass": 1.0, "DiagonalInertia": Gf.Vec3f(1, 1, 1.5)},
     "without a volume")])
def test_what_is_odd_is_a_warning_with_a_mend_and_runs(more, said, tmp_path):
    scene = load(stage_with(str(tmp_path / "a.usda"), **more))
    problems = [p for p in (*scene.notes, *check_scene(scene)) if said in p.text]
    assert problems and all(p.path == "/b" and not p.fatal and "fix: " in p.text for p in problems)
    sim = Simulation(scene, **WHERE)
    sim.run(2)
    assert np.isfinite(sim.plan.method("rigid").poses()).all()


def test_a_sound_body_is_told_nothing(tmp_path):
    for k, more in enumerate([{}, {"points": TETRAHEDRON}, {"Mass": 2.0}, {"metres": 0.01, "scale": 20.0},
                              {"orient": (0.7071, 0, 0.7071, 0)}]):
        scene = load(stage_with(str(tmp_path / f"{k}.usda"), **more))
        found = [p for p in (*scene.notes, *check_scene(scene)) if p.path.startswith("/b")]
        said = ["no joint holds it and nothing lies below: it falls for ever"]
        assert [p.text.partition(";")[0] for p in found] == said, more


@pytest.mark.parametrize("said", [False, True])
def test_bodies_that_nothing_can_stop_are_warned_of_once(said):
    """One warning for all; none where there is a floor, something to hang from, no weight or a force."""
    def found(scene: Scene) -> list[str]:
        return [f"{p.path}: {p.text}" for p in check_scene(scene) if "for ever" in p.text]

    def two(**more) -> Scene:
        scene = Scene(**more)
        for name, x in (("/a", 0.0), ("/b", 2.0)):
            scene.add(Body(name, [Collider(name, Box((1.0, 1.0, 1.0)))], motion=Motion.still(np.array(
                [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]))))
        return scene

    if said:
        (text,) = found(two())
        assert text.startswith("/a: ") and "the 2 rigid bodies fall for ever" in text and "physics:gravityMagnitude = 0" in text
        return
    landed, hung, pushed = two(), two(), two()
    landed.collider("/floor", Plane())
    hung.add(Joint("/joint", body0="", body1="/b"))
    pushed.things("Body")[0].force[1] = 1.0
    assert not found(landed) and not found(hung) and not found(pushed) and not found(two(gravity=(0.0, 0.0, 0.0)))


@pytest.mark.parametrize("kind", ["cloth", "rods"])
@pytest.mark.parametrize("target", ["/box", "/box/shape", "/box/hook"])
def test_a_pin_whose_target_moves_with_a_body_is_an_error_in_python_too(kind, target):
    """It hung where the body starts; the stage that the scene saves is refused for it."""
    scene = Scene(frames=1)
    scene.add(Body("/box", [Collider("/box/shape", Box((0.1, 0.1, 0.1)))], Motion.at_place((0.0, 1.0, 0.0))))
    scene.collider("/floor", Plane())
    if kind == "cloth":
        scene.pin("/tied", scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 2, 2, horizontal=True)), [0], target=target)
    else:
        scene.add(Rods("/rope", [(0.05 * k, 1.5, 0.0) for k in range(3)], [3])).pin("/tied", [0], target=target)
    with pytest.raises(SceneError) as error:
        Simulation(scene, device="cpu")
    said = (f"/tied: its target is {target}, which moves with the rigid body /box; allowed: what is still, animated or "
            "kinematic: a pin would hang where the body starts; fix: scene.tie(")
    assert said in str(error.value)


@pytest.mark.parametrize("target", ["", "/boxes", "/box/lift"])
def test_a_pin_whose_target_does_not_move_with_a_body_holds(target):
    scene = Scene(frames=1)
    scene.add(Body("/box", [Collider("/box/shape", Box((0.1, 0.1, 0.1)))], Motion.at_place((0.0, 1.0, 0.0))))
    scene.collider("/box/lift", Plane())
    scene.pin("/tied", scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 2, 2, horizontal=True)), [0], target=target)
    assert not [p for p in check_scene(scene) if p.fatal]


def lying(n: int, body: Body) -> Scene:
    """A level sheet of 40 cm and n x n squares about the origin, and a body."""
    scene = Scene()
    points, counts, indices = shapes.sheet(0.4, 0.4, n, n, horizontal=True)
    scene.cloth("/sheet", points - points.mean(axis=0), counts, indices)
    scene.add(body)
    return scene


@pytest.mark.parametrize("shape", [Box((0.05, 0.05, 0.05)), Sphere(0.05), Surface(*shapes.box((0.05, 0.05, 0.05)))],
                         ids=["box", "ball", "mesh"])
def test_a_body_that_starts_inside_of_a_cloth_is_named_with_the_place(shape):
    """Only colliders were. One that rests on it is not named, nor one between whose points a chord sinks into a ball."""
    def said(y: float, n: int = 8) -> list[str]:
        of = Collider("/body/shape", shape, Motion.at_place((0.0, 0.02, 0.0)))
        found = check_scene(lying(n, Body("/body", [of], Motion.at_place((0.1, y, 0.05)))))
        return [str(p) for p in found if "start" in p.text]
    assert not said(0.0301) and not said(0.0301, 3) and not said(0.5)
    found, = said(-0.01)
    assert "/sheet: " in found and "of its 81 free points start inside of /body/shape, the deepest, point " in found
    assert "m at (0.1, 0, 0.05) m; expected: none; fix: move one of them apart: they are pushed out" in found


@pytest.mark.parametrize("n", [1, 2])
def test_a_body_that_starts_between_the_points_of_a_cloth_is_named_with_the_place(n):
    """These alone meet it: it would go through there."""
    body = Body("/body", [Collider("/body", Box((0.03, 0.03, 0.03)))], Motion.at_place((0.1, 0.01, 0.05)))
    found, = [str(p) for p in check_scene(lying(n, body)) if "start" in p.text]
    assert "/sheet: the rigid body /body starts in its triangles, between their points, by 0.02 m at (" in found
    x, z = re.search(r"at \(([\d.]+), 0, ([\d.]+)\) m: points alone meet rigid bodies", found).groups()
    assert abs(float(x) - 0.1) < 0.03 and abs(float(z) - 0.05) < 0.03
