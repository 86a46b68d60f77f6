# ruff: noqa: E501   (rows of a table)
"""Stages with exactly one fault each: `wsim check` names the prim, the fault and the fix in one line. Stages without any: none is
refused, by check or by the start of a run."""

import re

import pytest

from tests.cli.test_check import AIR, HEAD, WATER, instances, stage
from wsim import cli, load
from wsim.usd.result.recorder import Recorder

GROUND = 'def Plane "Ground" (prepend apiSchemas = ["PhysicsCollisionAPI"]) { uniform token axis = "Z" }'


def box(name="Box", at="0, 0, 0.5", more="", apis="") -> str:
    return (f'def Cube "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"{apis}]) {{ double size = 1; '
            f'double3 xformOp:translate = ({at}); uniform token[] xformOpOrder = ["xformOp:translate"]; {more} }}')


def joint(kind="Revolute", more="", apis="", turn="1, 0, 0, 0", name="Joint") -> str:
    return box("A", "0, 0, 2") + box("B", "2, 0, 2") + (
        f'def Physics{kind}Joint "{name}" {f"(prepend apiSchemas = [{apis}])" if apis else ""} {{ rel physics:body0 = </A>; rel physics:body1 = </B>; '
        f'point3f physics:localPos0 = (1, 0, 0); point3f physics:localPos1 = (-1, 0, 0); quatf physics:localRot1 = ({turn}); '
        f'{more} }}') + GROUND


STUFF = ('def Material "Stuff" (prepend apiSchemas = ["PhysicsSurfaceDeformableMaterialAPI", '
         '"PhysicsCurvesDeformableMaterialAPI"]) { float physics:youngsModulus = 1e6; float physics:density = 300; '
         'float physics:staticFriction = 0.5; float physics:dynamicFriction = 0.5 }')
BOUND = "rel material:binding:physics = </Stuff>; "


def settings(more="", apis="") -> str:
    return f'def PhysicsScene "Scene" {f"(prepend apiSchemas = [{apis}])" if apis else ""} {{ {more} }}'


def cloth(more="", indices="0, 1, 2, 0, 2, 3", points="(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)", name="Cloth") -> str:
    return (f'def Mesh "{name}" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI"]) {{ '
            f'{BOUND}int[] faceVertexCounts = [3, 3]; int[] faceVertexIndices = [{indices}]; point3f[] points = [{points}]; {more} }}'
            + GROUND + STUFF)


def rods(more="", apis="") -> str:
    return ('def BasisCurves "Hair" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI"'
            f'{apis}]) {{ {BOUND}uniform token type = "linear"; int[] curveVertexCounts = [3]; point3f[] points = [(0, 0, 1), (0, 0, 1.1), '
            f'(0, 0, 1.2)]; {more} }}' + GROUND + STUFF)


def air(domain="", source="", shape="Sphere", body="double radius = 0.2") -> str:
    return (AIR.replace("    double wsim:fluid:cellSize", f"    {domain}\n    double wsim:fluid:cellSize")
            .replace("    double wsim:fluid:smoke", f"    {source}\n    double wsim:fluid:smoke")
            .replace('Sphere "Smoke"', f'{shape} "Smoke"').replace("double radius = 0.2", body))


OPEN = "int[] faceVertexCounts = [3]\n    int[] faceVertexIndices = [0, 1, 2]\n    point3f[] points = [(0, 0, 0), (.2, 0, 0), (0, .2, 0)]"
CLOSED = ("int[] faceVertexCounts = [3, 3, 3, 3]\n    int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]\n"
          "    point3f[] points = [(0, 0, 0), (.2, 0, 0), (0, .2, 0), (0, 0, .2)]")
SPHERE = 'def Sphere "Ball" (prepend apiSchemas = ["PhysicsCollisionAPI"]) { double radius = 5 }'
SEALED = 'uniform token[] wsim:fluid:sides = ["closed", "closed", "closed", "closed", "closed", "closed"]'
TWO = AIR + AIR.replace('"Air"', '"More"').replace('"Smoke"', '"Fire"')
MASS = ', "PhysicsMassAPI"'



ONE = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"


def rig(joints="0, 0, 0, 0", weights="1, 1, 1, 1", names='"Root"', api='(prepend apiSchemas = ["SkelBindingAPI"])') -> str:
    """A quad that a skeleton of one joint moves, above a cloth."""
    influence = ' (\nelementSize = 1\ninterpolation = "vertex"\n)'
    return (f'def SkelRoot "Char" {{ def Skeleton "Skel" {api} {{ uniform token[] joints = [{names}]; uniform matrix4d[] bindTransforms = [{ONE}]; '
            f'uniform matrix4d[] restTransforms = [{ONE}]; rel skel:animationSource = </Char/Skel/Anim>; def SkelAnimation "Anim" {{ uniform token[] '
            'joints = ["Root"]; float3[] translations = [(0, 0, 0)]; quatf[] rotations = [(1, 0, 0, 0)]; half3[] scales = [(1, 1, 1)] } }; '
            'def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI", "PhysicsCollisionAPI"]) { int[] faceVertexCounts = [4]; '
            'int[] faceVertexIndices = [0, 1, 2, 3]; point3f[] points = [(-2, -2, 0.2), (3, -2, 0.2), (3, 3, 0.2), (-2, 3, 0.2)]; rel skel:skeleton = '
            f'</Char/Skel>; int[] primvars:skel:jointIndices = [{joints}]{influence}; float[] primvars:skel:jointWeights = [{weights}]{influence} }}; }}'
            '\n' + cloth())


def hull(indices: str) -> str:
    return ('def Mesh "Rock" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]) { uniform token '
            f'physics:approximation = "convexHull"; int[] faceVertexCounts = [3, 3, 3, 3]; int[] faceVertexIndices = [{indices}]; point3f[] points = '
            '[(0, 0, 1), (1, 0, 1), (0, 1, 1), (0, 0, 2)] }' + GROUND)


def pin(more: str) -> str:
    return f'def PhysicsAttachment "Pin" {{ rel physics:src0 = </Cloth>; int[] physics:indices0 = [0]; {more} }}'


def keyed(op: str, kind: str, samples: str, order: str) -> str:
    """An obstacle whose transform has keys, beside a box on the ground."""
    return (f'def Cube "Mover" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{ double size = 0.5; {kind} xformOp:{op}.timeSamples = {samples}; '
            f'uniform token[] xformOpOrder = [{order}] }}' + box(at="3, 0, 0.5") + GROUND)


def passing(speed: float, height: float = 0.0) -> str:
    """A ball that passes through the air, or above it."""
    return (f'def Sphere "Fast" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{ double radius = 0.1; double3 xformOp:translate.timeSamples '
            f'= {{0: (-1, 0, {height}), 24: ({speed - 1}, 0, {height})}}; uniform token[] xformOpOrder = ["xformOp:translate"] }}')


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
VALID = {
    "box": box() + GROUND, "touching": box("A") + box("B", "1, 0, 0.5") + GROUND, "shallow": box(at="0, 0, 0.46") + GROUND,
    "stack": box("A") + box("B", "0, 0, 1.5") + GROUND, "falls": box(at="0, 0, 9") + GROUND,
    "mass": box(apis=MASS, more="float physics:mass = 2") + GROUND,
    "inertia": box(apis=MASS, more="float physics:mass = 1; float3 physics:diagonalInertia = (1, 1, 1)") + GROUND,
    "asleep": box(more="uniform bool physics:startsAsleep = 1") + GROUND,
    "thrown past": box(at="5, 0, 3", more="vector3f physics:velocity = (-1, 0, 0)") + SPHERE.replace("5", "1"),
    "deep and filtered": box("A", apis=', "PhysicsFilteredPairsAPI"', more="rel physics:filteredPairs = </B>") + box(
        "B", "0.5, 0, 0.5") + GROUND,
    "revolute": joint(), "limits": joint(more="float physics:lowerLimit = -30; float physics:upperLimit = 30"),
    "prismatic": joint("Prismatic"), "fixed": joint("Fixed"), "spherical": joint("Spherical", "float physics:coneAngle0Limit = 20"),
    "distance": joint("Distance", "float physics:maxDistance = 1"), "free": joint(""),
    "locked": joint("", "float limit:rotX:physics:low = 1; float limit:rotX:physics:high = -1", '"PhysicsLimitAPI:rotX"'),
    "drive": joint(apis='"PhysicsDriveAPI:angular"', more="float drive:angular:physics:stiffness = 5"),
    "slide drive": joint("Prismatic", "float drive:linear:physics:damping = 5", '"PhysicsDriveAPI:linear"'),
    "cloth": cloth(), "moving cloth": cloth("vector3f[] velocities = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]"),
    "masses": cloth('float[] physics:masses = [1, 1, 1, 1]; uniform token physics:masses:elementType = "point"'),
    "hair": rods(), "thick hair": rods('float[] physics:thicknesses = [0.01]; uniform token physics:thicknesses:elementType = '
                                       '"constant"; float[] widths = [0.01]'),
    "air": AIR, "mesh source": air(shape="Mesh", body=CLOSED), "hot": air(source="double wsim:fluid:temperature = 100"),
    "open air": air('uniform token[] wsim:fluid:sides = ["open", "open", "open", "open", "open", "open"]',
                    "double wsim:fluid:expansion = 3"),
    "counted": air("int wsim:fluid:steps = 4"), "blown": air(source="vector3d wsim:fluid:velocity = (4, 0, 0)"),
    "fast beside": air("int wsim:fluid:mostSteps = 2") + passing(60, 2), "still": air("int wsim:fluid:mostSteps = 1"),
    "obstacle": AIR + SPHERE.replace("5", "0.1"), "water": WATER, "stone in water": WATER + SPHERE.replace("5", "0.1"),
    "box in water": WATER + box().replace("size = 1", "size = 0.2").replace("0, 0, 0.5", "0, 0, 0.4"),
    "two airs": AIR + AIR.replace('"Air"', '"More"').replace('"Smoke"', '"Fire"').replace(
        "    double size = 1\n", "    double size = 1\n    double3 xformOp:translate = (2, 0, 0)\n    uniform token[] xformOpOrder = "
        "[\"xformOp:translate\"]\n", 1).replace('double radius = 0.2', "double radius = 0.2\n    double3 xformOp:translate = "
        "(2, 0, 0)\n    uniform token[] xformOpOrder = [\"xformOp:translate\"]"),
    "instances": instances(), "ids": instances(more="int64[] ids = [3, 1, 2]"), "air and volume": AIR + 'def Volume "Air_volume" {}\n',
    "rig": rig(), "hull": hull("0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2"), "mover": keyed(
        "translate", "double3", "{0: (0, 0, 9), 2: (1, 0, 9)}", '"xformOp:translate"'),
    "box and cloth": box("Box", "3, 0, 0.5") + cloth(),
}


MIRROR = 'double3 xformOp:scale = (-1, 1, 1); uniform token[] xformOpOrder = ["xformOp:scale"]; '
ROCK = hull("0, 1, 2, 0, 3, 1, 1, 3, 2, 0, 2, 3").replace("uniform token physics:approximation", 'uniform token orientation = "leftHanded"; '
                                                          "uniform token physics:approximation")
UNUSUAL = {
    "centimetres": (box(at="0, 0, 50").replace("size = 1", "size = 100") + GROUND, ("metersPerUnit = 1", "metersPerUnit = 0.01")),
    "Y up": (box(at="0, 0.5, 0") + GROUND.replace('"Z"', '"Y"'), ('upAxis = "Z"', 'upAxis = "Y"')),
    "grams": (box(apis=MASS, more="float physics:mass = 500") + GROUND, ("metersPerUnit = 1", "metersPerUnit = 1\n    kilogramsPerUnit = 0.001")),
    "late start": (box() + GROUND, ("startTimeCode = 0\n    endTimeCode = 4", "startTimeCode = 101.5\n    endTimeCode = 105")),
    "left-handed": (ROCK, ()), "left-handed triangles": (ROCK.replace("convexHull", "none"), ()),
    "mirrored": (f'def Xform "Top" {{ {MIRROR}{box(at="2, 0, 0.5")} }}' + GROUND, ()),
    "mirrored rock": (hull("0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2").replace("uniform token", MIRROR + "uniform token", 1), ()),
    "mirrored cloth": (cloth(MIRROR), ()),
    "turned in place": (box().replace('["xformOp:translate"]', '["xformOp:translate", "xformOp:translate:pivot", "xformOp:rotateXYZ", '
                                      '"!invert!xformOp:translate:pivot"]').replace("double size", "double3 xformOp:translate:pivot = (0.5, 0, 0); "
                                                                                    "float3 xformOp:rotateXYZ = (0, 0, 30); double size") + GROUND, ()),
    "half quaternion": (box().replace('["xformOp:translate"]', '["xformOp:translate", "xformOp:orient"]').replace(
        "double size", "quath xformOp:orient = (0.707, 0, 0, 0.707); double size") + GROUND, ()),
    "stack is reset": (f'def Xform "Top" {{ {MIRROR}' + box().replace('["xform', '["!resetXformStack!", "xform') + " }" + GROUND, ()),
    "inactive": (box() + GROUND + 'def Mesh "Bad" (active = false\nprepend apiSchemas = ["PhysicsCollisionAPI"]) { int[] faceVertexIndices = [9] }',
                 ()),
    "inherited": (box("Two").replace('def Cube "Two" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])', 'class Cube "_Box" '
                                     '(prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])')
                  + 'def "One" (prepend inherits = </_Box>) { double size = 1 }' + GROUND, ()),
    "empty mesh": (box() + GROUND + 'def Mesh "Hollow" { point3f[] points = [(0, 0, 0)] }', ()),
    "guide": (box(more='uniform token purpose = "guide"; token visibility = "invisible"') + GROUND, ()),
    "some instances": (instances(more="int64[] ids = [3, 1, 2]; int64[] invisibleIds = [1]").replace(
        '"Rocks"', '"Rocks" (inactiveIds = [3])'), ()),
}
VALID |= {name: text for name, (text, swap) in UNUSUAL.items() if not swap}


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
