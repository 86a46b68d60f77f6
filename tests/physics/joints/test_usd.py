"""Joints, collision groups and filtered pairs in files: units and frames, both ways, and what is wrong with them."""

from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from tests.physics.joints.make import rod, scene
from wsim.geometry import rotation
from wsim.physics.rigid.joints.filters.groups import FilteredPairs, Group, collision_filters, filtered_group_table
from wsim.physics.rigid.joints.joint import (
    Drive,
    Joint,
    fixed_joint,
    joint_between,
    locked_limits_except,
    prismatic_joint,
    revolute_joint,
    spherical_joint,
)
from wsim.scene import Box, Collider, Scene, SceneError
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion
from wsim.usd import load, save

LINE = Motion(np.array([0.0, 1.0]), np.array([np.eye(4), Motion.at_place((1.0, 0.0, 0.0)).at(0.0)]))
DRIVE = Drive(30.0, 2.0, 0.5, -0.25, 100.0)


def every():
    """A joint of each kind, of /b0 to /b3."""
    b = [rod(f"/b{k}", (float(k), 0.5 * k, 0.0)) for k in range(4)]
    tilted = {"at": (0.5, 0.1, 0.2), "axis": (0.6, 0.0, 0.8)}
    d6 = locked_limits_except("rotX", "rotY") | {"rotY": (-0.5, 1.0), "transZ": (0.1, 0.4)}
    return b, [fixed_joint("/j/fixed", b[0], b[1], **tilted, force=10.0, torque=3.0),
               revolute_joint("/j/hinge", b[1], b[2], -1.0, 2.0, **tilted, drives={"rotX": replace(DRIVE, acceleration=True)}),
               prismatic_joint("/j/slider", None, b[3], -inf, 0.25, **tilted, drives={"transX": DRIVE}, collides=True),
               spherical_joint("/j/ball", b[2], b[3], **tilted, cone=(0.5, inf)),
               spherical_joint("/j/free", None, b[0], **tilted, enabled=False),
               Joint("/j/rope", "/b0", "/b3", limits={"distance": (-inf, 9.0)}),
               joint_between("/j/six", b[1], b[3], **tilted, limits=d6, drives={"rotX": DRIVE, "transZ": DRIVE})]


def alike(a: Joint, b: Joint) -> bool:
    """But for float32, which attributes of joints have."""
    numbers = all(np.allclose(getattr(a, name), getattr(b, name), rtol=3e-7, atol=2e-7) for name in ("at0", "at1"))
    turns = all(abs(abs(getattr(a, name) @ getattr(b, name)) - 1.0) < 1e-6 for name in ("turn0", "turn1"))
    tables = a.limits.keys() == b.limits.keys() and a.drives.keys() == b.drives.keys()
    tables = tables and all(np.allclose(a.limits[k], b.limits[k], rtol=3e-7) for k in a.limits)
    drives = all(np.allclose(list(vars(a.drives[k]).values()), list(vars(b.drives[k]).values()), rtol=3e-7) for k in a.drives)
    same = all(getattr(a, k) == getattr(b, k) for k in ("path", "body0", "body1", "collides", "enabled", "motion"))
    cone = (a.cone is None) == (b.cone is None) and (a.cone is None or np.allclose(a.cone, b.cone, rtol=3e-7))
    return numbers and turns and tables and drives and same and cone and np.allclose((a.force, a.torque), (b.force, b.torque))


def test_joints_of_all_kinds_are_saved_and_loaded(tmp_path):
    bodies, joints = every()
    moving = joint_between("/j/led", None, bodies[0], limits={"transX": (0.0, 0.0)}, motion=LINE)
    save(scene(*bodies, *joints, moving), tmp_path / "a.usda")
    again = {j.path: j for j in load(tmp_path / "a.usda").things("Joint")}
    for joint in joints:
        assert alike(joint, again[joint.path]), (joint, again[joint.path])
    assert again["/j/led"].motion.moves
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    kinds = [stage.GetPrimAtPath(j.path).GetTypeName() for j in joints]
    assert kinds == [f"Physics{k}Joint" for k in ("Fixed", "Revolute", "Prismatic", "Spherical", "Spherical", "Distance", "")]


def stage_of(path, metres: float = 1.0):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    for name, x in (("a", 0.0), ("b", 100.0)):
        cube = UsdGeom.Cube.Define(stage, f"/{name}")
        cube.CreateSizeAttr(20.0)
        cube.AddTranslateOp().Set((x, 0.0, 0.0))
        cube.AddScaleOp().Set((1.0, 2.0, 4.0))
        UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath("/b"))
    return stage


def test_units_degrees_and_scales_are_those_of_the_stage(tmp_path):
    """Centimetres: 1 N is 100 units, 1 N m 10000; stiffness of a hinge is per degree."""
    stage = stage_of(tmp_path / "a.usda", 0.01)
    joint = UsdPhysics.RevoluteJoint.Define(stage, "/hinge")
    joint.CreateBody0Rel().SetTargets([Sdf.Path("/a")])
    joint.CreateBody1Rel().SetTargets([Sdf.Path("/b")])
    joint.CreateAxisAttr("Y")
    joint.CreateLocalPos1Attr(Gf.Vec3f(5.0, 5.0, 5.0))
    joint.CreateLowerLimitAttr(-90.0)
    joint.CreateUpperLimitAttr(45.0)
    joint.CreateBreakForceAttr(700.0)
    drive = UsdPhysics.DriveAPI.Apply(joint.GetPrim(), "angular")
    drive.CreateStiffnessAttr(3e4)
    drive.CreateTargetPositionAttr(30.0)
    drive.CreateTargetVelocityAttr(180.0)
    drive.CreateMaxForceAttr(2e4)
    stage.Save()
    (joint,) = load(tmp_path / "a.usda").things("Joint")
    assert (joint.body0, joint.body1, joint.still) == ("", "/b", "/a")
    assert np.allclose(joint.at1, (0.05, 0.1, 0.2)) and np.allclose(joint.limits["rotX"], (radians(-90.0), radians(45.0)))
    assert np.allclose(rotation.quat_rotate(joint.turn1, np.array([1.0, 0.0, 0.0])), (0.0, 1.0, 0.0), atol=1e-12)
    got = joint.drives["rotX"]
    wanted = (3.0 / radians(1.0), radians(30.0), np.pi, 2.0)
    assert np.allclose((got.stiffness, got.target, got.speed, got.most), wanted, rtol=1e-6)
    assert abs(joint.force - 7.0) < 1e-6 and set(joint.limits) == set(locked_limits_except())


def test_a_prim_below_a_body_stands_for_it(tmp_path):
    stage = stage_of(tmp_path / "a.usda")
    handle = UsdGeom.Xform.Define(stage, "/b/handle")
    handle.AddTranslateOp().Set((1.0, 1.0, 1.0))
    handle.AddRotateZOp().Set(90.0)
    joint = UsdPhysics.FixedJoint.Define(stage, "/joint")
    joint.CreateBody1Rel().SetTargets([Sdf.Path("/b/handle")])
    joint.CreateLocalPos1Attr(Gf.Vec3f(0.0, 1.0, 0.0))
    stage.Save()
    (found,) = load(tmp_path / "a.usda").things("Joint")
    assert found.body1 == "/b" and np.allclose(found.at1, (0.0, 2.0, 4.0), atol=1e-6)


def wrong(stage, name: str):
    joint = UsdPhysics.FixedJoint.Define(stage, "/joint")
    body = {"nothing": [], "lost": ["/c"], "itself": ["/b"], "several": ["/a", "/b"], "turn": []}[name]
    joint.CreateBody0Rel().SetTargets([Sdf.Path(p) for p in body])
    joint.CreateBody1Rel().SetTargets([] if name == "nothing" else [Sdf.Path("/b")])
    if name == "turn":
        joint.CreateLocalRot0Attr(Gf.Quatf(0.0, Gf.Vec3f(0.0)))


@pytest.mark.parametrize("name, said", [("nothing", "joins no body"), ("lost", "names /c, which is no prim"),
                                        ("itself", "joins /b to itself"), ("several", "names 2 prims"),
                                        ("turn", "quaternion of length 0;")])
def test_what_is_wrong_in_a_file_is_said_with_its_path(tmp_path, name, said):
    stage = stage_of(tmp_path / "a.usda")
    wrong(stage, name)
    stage.Save()
    with pytest.raises(SceneError, match=said) as error:
        load(tmp_path / "a.usda")
    assert "/joint" in str(error.value)


def test_a_joint_of_what_stands_is_left_out_with_a_word(tmp_path):
    stage = stage_of(tmp_path / "a.usda")
    UsdPhysics.FixedJoint.Define(stage, "/joint").CreateBody0Rel().SetTargets([Sdf.Path("/a")])
    stage.Save()
    found = load(tmp_path / "a.usda")
    assert not found.things("Joint") and any("joins nothing that moves" in p.text for p in found.notes)


@pytest.mark.parametrize("change, said", [
    ({"body0": "/b1"}, "to itself"), ({"body0": "/lost"}, "no rigid body that moves"), ({"body1": ""}, "joins no body"),
    ({"turn1": (0.0, 0.0, 0.0, 2.0)}, "quaternion of length 2"), ({"at0": (np.nan, 0.0, 0.0)}, "not finite"),
    ({"limits": {"rotX": (inf, inf)}}, "limits of rotX"), ({"limits": {"twist": (0.0, 0.0)}}, "no axis twist"),
    ({"drives": {"rotX": Drive(-1.0)}}, "stiffness of the drive of rotX is -1"), ({"cone": (-1.0, 0.5)}, "its cone is"),
    ({"drives": {"rotX": Drive(1.0, target=inf)}}, "goes to inf"), ({"force": -1.0}, "breaks at a force of -1"),
    ({"motion": Motion.still(2.0 * np.eye(4))}, "scales")])
def test_what_is_wrong_with_a_joint_is_said_in_a_line_with_a_mend(change, said):
    body = rod("/b1", (0.0, 0.0, 0.0))
    joint = replace(fixed_joint("/j", None, body), **change)
    problems = [p for p in check_scene(scene(body, joint)) if p.fatal]
    assert any(said in p.text and "fix: " in p.text and p.path == "/j" for p in problems), problems


def test_a_joint_that_starts_apart_is_a_warning():
    body = rod("/b", (0.0, 0.0, 0.0))
    joint = replace(fixed_joint("/j", None, body), at0=(0.5, 0.0, 0.0))
    (problem,) = [p for p in check_scene(scene(body, joint)) if "apart" in p.text]
    assert not problem.fatal and "0.5 m" in problem.text


def test_low_over_high_is_locked(tmp_path):
    stage = stage_of(tmp_path / "a.usda")
    joint = UsdPhysics.Joint.Define(stage, "/joint")
    joint.CreateBody1Rel().SetTargets([Sdf.Path("/b")])
    for name, low, high in (("transX", 1.0, -1.0), ("rotZ", -30.0, 60.0)):
        api = UsdPhysics.LimitAPI.Apply(joint.GetPrim(), name)
        api.CreateLowAttr(low)
        api.CreateHighAttr(high)
    stage.Save()
    (found,) = load(tmp_path / "a.usda").things("Joint")
    assert found.limits["transX"] == (0.0, 0.0) and np.allclose(found.limits["rotZ"], (radians(-30.0), radians(60.0)))
    assert set(found.limits) == {"transX", "rotZ"}


GROUPS = [Group("/g/a", ["/b0"], ["/g/b"]), Group("/g/b", ["/b1"]), Group("/g/c", ["/b2"], ["/g/a"], inverted=True),
          Group("/g/d", ["/b3"], ["/g/b"], merge="one"), Group("/g/e", ["/b4"], merge="one")]


def boxes(n: int) -> list:
    found = [rod(f"/b{k}", (2.0 * k, 0.0, 0.0)) for k in range(n)]
    for body in found:
        body.colliders = [Collider(body.path + "/box", Box((0.5, 0.5, 0.5)))]
    return found


def test_groups_are_apart_as_usd_has_it(tmp_path):
    """Against the table that USD computes from the same prims."""
    save(scene(*boxes(5), *GROUPS), tmp_path / "a.usda")
    table = UsdPhysics.CollisionGroup.ComputeCollisionGroupTable(Usd.Stage.Open(str(tmp_path / "a.usda")))
    theirs = [[not table.IsCollisionEnabled(Sdf.Path(a.path), Sdf.Path(b.path)) for b in GROUPS] for a in GROUPS]
    assert np.array_equal(filtered_group_table(scene(*GROUPS)), theirs)
    again = load(tmp_path / "a.usda").things("Group")
    assert [replace(g, members=[]) for g in again] == [replace(g, members=[]) for g in GROUPS]
    assert again[0].members == ["/b0/box"]


@pytest.mark.parametrize("rule, names, without, within", [
    ("expandPrims", ["/b1"], [], {1}), ("expandPrims", ["/"], ["/b2", "/b3/box"], {0, 1, 4}),
    ("explicitOnly", ["/b1"], [], set()), ("explicitOnly", ["/b1/box", "/b3/box"], [], {1, 3}),
    ("expandPrims", ["/b"], [], set())])
def test_members_of_groups_are_those_of_usd(tmp_path, rule, names, without, within):
    save(scene(*boxes(5), *GROUPS), tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    collection = Usd.CollectionAPI.Apply(stage.GetPrimAtPath(GROUPS[0].path), "colliders")
    collection.CreateExpansionRuleAttr(rule)
    collection.CreateIncludeRootAttr("/" in names)
    collection.CreateIncludesRel().SetTargets([Sdf.Path(n) for n in names if n != "/"])
    collection.CreateExcludesRel().SetTargets([Sdf.Path(n) for n in without])
    stage.GetRootLayer().Save()
    assert load(tmp_path / "a.usda").things("Group")[0].members == [f"/b{k}/box" for k in sorted(within)]


def kept_apart(one: Scene) -> set:
    shapes = [(c.path, 0) for b in one.things("Body") for c in b.colliders]
    found = collision_filters(one, shapes, [b.path for b in one.things("Body") for _ in b.colliders])
    n = len(shapes)
    if found is None:
        return set()
    listed = {(i, int(j)) for i in range(n) for j in found.parted[found.first[i]:found.first[i + 1]]}
    return {(i, j) for i in range(n) for j in range(i) if found.table[found.kind[i], found.kind[j]] or (i, j) in listed}


def test_pairs_and_joints_keep_colliders_apart(tmp_path):
    b = boxes(5)
    given = scene(*b, fixed_joint("/j", b[0], b[1]), fixed_joint("/k", b[1], b[2], collides=True),
                  fixed_joint("/l", b[3], b[4], enabled=False),
                  FilteredPairs("/b2/box", ["/b0", "/g"]), Group("/g", ["/b4/box"]))
    assert kept_apart(given) == {(1, 0), (2, 0), (4, 2)}
    save(given, tmp_path / "a.usda")
    assert kept_apart(load(tmp_path / "a.usda")) == {(1, 0), (2, 0), (4, 2)}
    assert not kept_apart(scene(*boxes(2)))


@pytest.mark.parametrize("still, free", [("", True), ("/w", True), ("/w/house", False), ("/w/house/floor", False)])
def test_a_joint_to_the_world_keeps_a_body_from_nothing_else(still, free):
    """Converters name the default prim as body 0, above all that there is: what hangs on it lands on the floor and on bodies. A
    prim that collides is an object of its own, as USD has it of two bodies."""
    hung, other = boxes(2)
    for body, name in ((hung, "/w/hung"), (other, "/w/other")):
        body.path, body.colliders[0].path = name, name + "/box"
    given = scene(hung, other, revolute_joint("/w/hung/j", None, hung, still=still))
    shapes = [(body.colliders[0].path, 0) for body in (hung, other)] + [("/w/house/floor", -1)]
    found = collision_filters(given, shapes, [hung.path, other.path, ""])
    assert (found is None) if free else (found.parted.tolist() == [2, 0])
