# ruff: noqa: E501   (rows of a table)
"""What tests/cli/test_faults.py shares with other tests: VALID."""

from tests.make.cli.check import AIR, WATER, instances

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


CLOSED = ("int[] faceVertexCounts = [3, 3, 3, 3]\n    int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]\n"
          "    point3f[] points = [(0, 0, 0), (.2, 0, 0), (0, .2, 0), (0, 0, .2)]")
SPHERE = 'def Sphere "Ball" (prepend apiSchemas = ["PhysicsCollisionAPI"]) { double radius = 5 }'
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


def keyed(op: str, kind: str, samples: str, order: str) -> str:
    """An obstacle whose transform has keys, beside a box on the ground."""
    return (f'def Cube "Mover" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{ double size = 0.5; {kind} xformOp:{op}.timeSamples = {samples}; '
            f'uniform token[] xformOpOrder = [{order}] }}' + box(at="3, 0, 0.5") + GROUND)


def passing(speed: float, height: float = 0.0) -> str:
    """A ball that passes through the air, or above it."""
    return (f'def Sphere "Fast" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{ double radius = 0.1; double3 xformOp:translate.timeSamples '
            f'= {{0: (-1, 0, {height}), 24: ({speed - 1}, 0, {height})}}; uniform token[] xformOpOrder = ["xformOp:translate"] }}')


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
