# ruff: noqa: E501   (rows of a table)
"""Stages with exactly one fault each: `wsim check` names the prim, the fault and the fix in one line. Stages without any: none is
refused, by check or by the start of a run."""

import re

import pytest

from tests.make.cli.check import AIR, HEAD, WATER, instances, stage
from tests.make.cli.faults import GROUND, MASS, SPHERE, UNUSUAL, VALID, air, box, cloth, hull, joint, keyed, passing, rig, rods
from wsim import cli, load
from wsim.usd.result.recorder import Recorder


def settings(more="", apis="") -> str:
    return f'def PhysicsScene "Scene" {f"(prepend apiSchemas = [{apis}])" if apis else ""} {{ {more} }}'


OPEN = "int[] faceVertexCounts = [3]\n    int[] faceVertexIndices = [0, 1, 2]\n    point3f[] points = [(0, 0, 0), (.2, 0, 0), (0, .2, 0)]"
SEALED = 'uniform token[] wsim:fluid:sides = ["closed", "closed", "closed", "closed", "closed", "closed"]'
TWO = AIR + AIR.replace('"Air"', '"More"').replace('"Smoke"', '"Fire"')


def pin(more: str) -> str:
    return f'def PhysicsAttachment "Pin" {{ rel physics:src0 = </Cloth>; int[] physics:indices0 = [0]; {more} }}'


# name: (stage, prim, words of the fault, words of the fix)
FAULTS = {
    "axes are NaN": (box(apis=MASS, more="float physics:mass = 1; float3 physics:diagonalInertia = (1, 1, 1); "
                         "quatf physics:principalAxes = (nan, 0, 0, 0)") + GROUND, "/Box", "axes is (", "author another axes"),
    "mass is negative": (box(apis=MASS, more="float physics:mass = -1") + GROUND, "/Box", "physics:mass is -1", "mass"),
    "density is infinite": (box(apis=MASS, more="float physics:density = inf") + GROUND, "/Box", "density is inf", "density"),
    "velocity is NaN": (box(more="vector3f physics:velocity = (nan, 0, 0)") + GROUND, "/Box", "velocity", "author"),
    "size is 0": (box(more="double3 xformOp:scale = (0, 1, 1); uniform token[] xformOpOrder = ['xformOp:scale']".replace("'", '"'))
                  .replace('uniform token[] xformOpOrder = ["xformOp:translate"]; ', "") + GROUND, "/Box", "", "scale"),
    "drag is negative": (box(apis=', "WsimRigidBodyAPI"', more="double wsim:linearDamping = -1") + GROUND, "/Box", "drag is -1",
                         "author another drag"),
    "force is NaN": (box(apis=', "WsimRigidBodyAPI"', more="vector3d wsim:force = (0, nan, 0)") + GROUND, "/Box", "force", "author"),
    "too deep": (box(at="0, 0, 0.3") + GROUND, "/Box", "starts 0.2 m deep in /Ground, 20 % of its size", "move them apart"),
    "two too deep": (box("A") + box("B", "0.8, 0, 0.5") + GROUND, "/A", "starts 0.2 m deep in /B", "filter the pair"),
    "falls beside": (box(at="5, 0, 3") + 'def Cube "Table" (prepend apiSchemas = ["PhysicsCollisionAPI"]) { double size = 2 }',
                     "/Box", "falls beside everything", "move it above a collider"),
    "friction is negative": (box(apis=', "MaterialBindingAPI"', more="rel material:binding = </Ice>") + GROUND + 'def Material "Ice" '
                             '(prepend apiSchemas = ["PhysicsMaterialAPI"]) { float physics:dynamicFriction = -1 }', "/Ice",
                             "dynamicFriction is -1", "allowed is a finite number >= 0"),
    "limits inverted": (joint(more="float physics:lowerLimit = 30; float physics:upperLimit = -30"), "/Joint",
                        "lowerLimit is 30, above physics:upperLimit", "swap them"),
    "slide inverted": (joint("Prismatic", "float physics:lowerLimit = 1; float physics:upperLimit = -1"), "/Joint",
                       "lowerLimit is 1, above physics:upperLimit", "swap them"),
    "limit is NaN": (joint(more="float physics:lowerLimit = nan"), "/Joint", "physics:lowerLimit is nan", "author them again"),
    "limit violated": (joint(more="float physics:lowerLimit = 30; float physics:upperLimit = 60"), "/Joint",
                       "starts 0 m and 0.524 rad apart", "limits"),
    "slide violated": (joint("Prismatic", "float physics:lowerLimit = 0.5; float physics:upperLimit = 1"), "/Joint",
                       "starts 0.5 m and 0 rad apart", "limits"),
    "cone is NaN": (joint("Spherical", "float physics:coneAngle0Limit = nan"), "/Joint", "coneAngle0Limit is nan", "author it again"),
    "distances inverted": (joint("Distance", "float physics:minDistance = 2; float physics:maxDistance = 1"), "/Joint",
                           "minDistance is 2, above physics:maxDistance", "swap them"),
    "drive of no axis": (joint(apis='"PhysicsDriveAPI:linear"'), "/Joint", "has PhysicsDriveAPI:linear, which is not used",
                         "author PhysicsDriveAPI:angular"),
    "drive of a locked axis": (joint("", apis='"PhysicsDriveAPI:rotX", "PhysicsLimitAPI:rotX"', more="float limit:rotX:physics:low = 1; "
                                     "float limit:rotX:physics:high = -1"), "/Joint", "drives rotX, which its limits lock", "limits"),
    "stiffness is negative": (joint(apis='"PhysicsDriveAPI:angular"', more="float drive:angular:physics:stiffness = -5"), "/Joint",
                              "stiffness of the drive", "author another stiffness"),
    "axis W": (joint(more='uniform token physics:axis = "W"'), "/Joint", "physics:axis is 'W'", "author one of them"),
    "joins nothing": (box() + GROUND + 'def PhysicsRevoluteJoint "Joint" {}\n', "/Joint", "joins no body", "author physics:body0"),
    "index out of range": (cloth(indices="0, 1, 2, 0, 2, 9"), "/Cloth", "9", "point"),
    "point is NaN": (cloth(points="(0, 0, 1), (1, 0, nan), (1, 1, 1), (0, 1, 1)"), "/Cloth", "is not finite", "give each three finite coordinates"),
    "velocities are few": (cloth("vector3f[] velocities = [(0, 0, 1)]"), "/Cloth", "1 velocities", "4"),
    "masses are negative": (cloth('float[] physics:masses = [1, 1, -1, 1]; uniform token physics:masses:elementType = "point"'),
                            "/Cloth", "masses[2] is -1", "finite number > 0"),
    "widths are NaN": (rods("float[] widths = [nan]; float[] physics:thicknesses = [0.001]; uniform token "
                            'physics:thicknesses:elementType = "constant"'), "/Hair", "widths[0] is nan", "author it again"),
    "widths are negative": (rods("float[] widths = [-0.1]; float[] physics:thicknesses = [0.001]; uniform token "
                                 'physics:thicknesses:elementType = "constant"'), "/Hair", "widths[0] is -0.1", "author it again"),
    "cells are tiny": (AIR.replace("0.125", "1e-300"), "/Air", "cells", "give cells of"),
    "cells are negative": (AIR.replace("0.125", "-1"), "/Air", "cell is -1", "cellSize"),
    "steps without end": (air("int wsim:fluid:steps = 2000000"), "/Air", "steps is 2e+06", "author fewer steps"),
    "expansion sealed": (air(SEALED, "double wsim:fluid:expansion = 3"), "/Smoke", "which has no open side", "an open one"),
    "source is open": (air(shape="Mesh", body=OPEN), "/Smoke", "an open mesh, which has no inside", "close its holes"),
    "domains overlap": (TWO, "/Air", "it overlaps /More", "move one of them"),
    "CFL is cut": (air("int wsim:fluid:mostSteps = 2", "vector3d wsim:fluid:velocity = (48, 0, 0)"), "/Air",
                   "needs 8 steps a frame at a CFL number of 2, and most_steps is 2", "larger most_steps"),
    "CFL is cut by a collider": (air("int wsim:fluid:mostSteps = 2") + passing(60), "/Air", "/Fast moves at 60 m/s, which needs 10 "
                                 "steps a frame", "most_steps of 10 or more"),
    "waves are cut": (WATER.replace("    double wsim:liquid", "    int wsim:liquid:mostSteps = 1\n    double wsim:liquid", 1), "/Water",
                      "waves of its surface need 2 steps a frame, and most_steps is 1", "larger most_steps"),
    "air is filled": (AIR + SPHERE, "/Air", "/Ball fills all of it", "move /Ball"),
    "tank is filled": (WATER + SPHERE, "/Water", "/Ball fills all of it", "move /Ball"),
    "tank is empty": (WATER.split("def Cube \"Pool\"")[0], "/Water", "nothing fills it", "WsimLiquidSourceAPI"),
    "name is taken": (AIR + 'def Mesh "Air_volume" {}\n', "/Air_volume", "is a Mesh", "rename one of the two"),
    "instance of nothing": (instances("0, 0, 7"), "/Rocks", "protoIndices[2] is 7", "name one of them"),
    "id twice": (instances(more="int64[] ids = [1, 1, 2]"), "/Rocks", "ids has 1 2 times", "author other ids"),
    "solver is unknown": (box() + GROUND + settings('uniform token wsim:solver = "magic"', '"WsimSceneAPI"'), "/", "solver is 'magic'", "choose one of them"),
    "gravity is NaN": (box() + GROUND + settings("vector3f physics:gravityDirection = (nan, 0, 0)"), "/Scene",
                       "gravityDirection is (nan", "three finite numbers"),
    "smoke is negative": (AIR.replace("smoke = 1", "smoke = -1"), "/Smoke", "smoke is -1", "author another smoke"),
    "five sides": (air('uniform token[] wsim:fluid:sides = ["open", "open", "open", "open", "open"]'), "/Air", "has 5 entries", "author 6"),
    "role is unknown": (WATER.replace("    double size = 0.5", '    double size = 0.5\n    uniform token wsim:liquid:role = "tap"'), "/Pool",
                        "role is 'tap'", "choose one of them"),
    "hull of nothing": (hull("0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 9"), "/Rock", "first: point 9 in face 3", "allowed is 0 to 3"),
    "drive type": (joint(apis='"PhysicsDriveAPI:angular"', more='uniform token drive:angular:physics:type = "speed"'), "/Joint",
                   "physics:type is 'speed', and is read as force", "choose one"),
    "animation unused": (rig(api=""), "/Char/Skel", "has no SkelBindingAPI", "apply SkelBindingAPI"),
    "joint of nothing": (rig(joints="0, 0, 7, 0"), "/Char/Skin", "jointIndices[2] is 7; allowed are 0 to 0", "author it again"),
    "weights are few": (rig(weights="1, 1, 1"), "/Char/Skin", "jointWeights has 3 values; allowed are 4", "author as many"),
    "bind transforms are few": (rig(names='"Root", "Root/Arm"'), "/Char/Skel", "has 2 joints and 0 bind transforms", "one a joint"),
    "thicknesses of what": (rods('float[] physics:thicknesses = [0.001, 0.001]; uniform token physics:thicknesses:elementType = "point"'),
                            "/Hair", "has 2 values of elementType 'point'", "3 for 'point'"),
    "not in the order": (keyed("translate", "double3", "{0: (0, 0, 9), 2: (1, 0, 9)}", ""), "/Mover", "xformOp:translate is not in xformOpOrder",
                         "add it there"),
    "only in the order": (keyed("translate", "double3", "{0: (0, 0, 9), 2: (1, 0, 9)}", '"xformOp:translate", "xformOp:rotateX"'), "/Mover",
                          "names xformOp:rotateX, which is not authored", "remove its name"),
    "quaternion of 0": (keyed("orient", "quatf", "{0: (1, 0, 0, 0), 2: (0, 0, 0, 0)}", '"xformOp:orient"'), "/Mover",
                        "a quaternion of length 0 at time code 2", "divide it by its length"),
    "key is NaN": (keyed("translate", "double3", "{0: (0, 0, 9), 2: (nan, 0, 9)}", '"xformOp:translate"'), "/Mover", "holds NaN or infinity",
                   "author its xformOps again"),
    "material is gone": (box(apis=', "MaterialBindingAPI"', more="rel material:binding:physics = </Gone>") + GROUND, "/Box",
                         "names /Gone, which is no prim", "name a Material"),
    "material's density": (box(apis=', "MaterialBindingAPI"', more="rel material:binding = </Lead>") + GROUND + 'def Material "Lead" '
                           '(prepend apiSchemas = ["PhysicsMaterialAPI"]) { float physics:density = -5 }', "/Lead", "physics:density is -5",
                           "author another density"),
    "owner is gone": (box(more="rel physics:simulationOwner = </Gone>") + GROUND, "/Box", "simulationOwner names /Gone", "name one"),
    "held far away": (cloth() + pin("vector3f[] physics:coords1 = [(50, 0, 1)]"), "/Pin", "holds point 0 of /Cloth 50 m from where it starts",
                      "author physics:coords1"),
    "held by itself": (cloth() + pin("rel physics:src1 = </Cloth>"), "/Pin", "src1 names /Cloth, the body that it holds", "name an Xform"),
    "rigid and soft": (cloth().replace('"PhysicsDeformableBodyAPI",', '"PhysicsRigidBodyAPI", "PhysicsDeformableBodyAPI",'), "/Cloth",
                       "has PhysicsRigidBodyAPI and PhysicsDeformableBodyAPI", "remove one of them"),
    "two domains": (WATER.replace('["WsimLiquidDomainAPI"]', '["WsimLiquidDomainAPI", "WsimFluidDomainAPI"]'), "/Water",
                    "one prim is one domain", "on another Cube"),
    "variant is none": ('def Xform "Set" (variants = {\nstring look = "red"\n}\nprepend variantSets = "look"\n) {\nvariantSet "look" = {\n"blue" '
                        '{\n}\n}\n}\n' + box() + GROUND, "/Set", "variant set look has no variant 'red'", "choose one of blue"),
    "size is NaN": ('def Cylinder "Post" (prepend apiSchemas = ["PhysicsCollisionAPI"]) { double height = nan }' + box(at="4, 0, 0.5") + GROUND,
                    "/Post", "height is nan", "author another height"),
    "one in another": (box("A") + box("B") + GROUND, "/A", "starts 0.5 m deep in /B", "move them apart"),
    "wind is NaN": (cloth() + settings("vector3d wsim:wind = (nan, 0, 0)", '"WsimSceneAPI"'), "/", "wind is (nan", "author another wsim:wind"),
    "file is gone": (box() + GROUND + 'def Xform "Set" (prepend references = @./gone.usda@) { double x = 1 }', "/Set", "Could not open asset",
                     "add what is missing"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_check_names_prim_fault_and_fix(tmp_path, capsys, name):
    text, path, fault, fix = FAULTS[name]
    head = HEAD.replace('def PhysicsScene "Scene" {}', "") if "def PhysicsScene" in text else HEAD
    cli.main(["check", stage(tmp_path, text, head)])
    lines = [line for line in capsys.readouterr().out.splitlines() if re.match("error: |warning: ", line)]
    assert len(lines) == 1, lines
    assert lines[0].split(": ")[1] == path and fault in lines[0] and fix in lines[0], lines
    assert len(lines[0]) <= 300 and "please report" not in lines[0]


@pytest.mark.parametrize("name", VALID)
def test_a_sound_stage_is_refused_by_nothing(tmp_path, capsys, name):
    source = stage(tmp_path, VALID[name])
    assert cli.main(["check", source]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if re.match("error: |warning: ", line)]
    assert not lines
    Recorder(load(source), tmp_path / "o.usdc").close()


@pytest.mark.parametrize("name", [name for name, (_, swap) in UNUSUAL.items() if swap])
def test_a_stage_of_other_units_and_times_is_refused_by_nothing(tmp_path, capsys, name):
    text, (old, new) = UNUSUAL[name]
    source = stage(tmp_path, text, HEAD.replace(old, new))
    assert old in HEAD and cli.main(["check", source]) == 0
    assert "warning" not in capsys.readouterr().out.replace("0 warnings", "")
    Recorder(load(source), tmp_path / "o.usdc").close()


def test_there_are_forty_of_each():
    assert len(FAULTS) >= 40 and len(VALID) >= 40
