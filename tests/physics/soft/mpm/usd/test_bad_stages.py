"""Stages of material points that are wrong: each ends in one line with the prim and the mend, and none in a traceback."""

import warnings

import pytest

import wsim

HEAD = '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Y"\n timeCodesPerSecond = 60\n endTimeCode = 2\n)\n'
FOUR = "point3f[] points = [(0, 0, 0), (0.02, 0, 0), (0, 0.02, 0), (0.02, 0.02, 0)]"
VOLUMES, CELL = "double[] wsim:mpm:volumes = [0.000008]", "double wsim:mpm:cellSize = 0.04"
OPEN = "point3f[] points = [{}, (1, 0, 0), (0, 1, 0)]\nint[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]"


def prim(kind, apis, *lines):
    named = ", ".join(f'"{api}"' for api in apis)
    return f'def {kind} "m" (prepend apiSchemas = [{named}]) {{\n' + "\n".join(lines) + "\n}\n"


def points(*more, places=FOUR, volumes=VOLUMES, cell=CELL):
    return prim("Points", ["WsimMaterialPointsAPI"], places, volumes, cell, *more)


def cube(*more, cell=CELL, size="double size = 0.2"):
    return prim("Cube", ["WsimMaterialPointsAPI"], size, cell, *more)


def of(name, *lines):
    return points(f'uniform token wsim:mpm:material = "{name}"', *lines)


def newton(*lines, scene="", material="", widths="float[] widths = [0.02]", places=FOUR):
    head = f'def PhysicsScene "S" (prepend apiSchemas = ["NewtonMPMSceneAPI"]) {{\n{scene}\n}}\n'
    head += f'def Material "mat" (prepend apiSchemas = ["NewtonMPMMaterialAPI"]) {{\n{material}\n}}\n'
    bound = "rel material:binding:physics = </mat>" if material else ""
    return head + prim("Points", ["NewtonPointsDeformableSimAPI", "PhysicsDeformableBodyAPI", "MaterialBindingAPI"], places,
                       widths, bound, *lines)


def physx(*lines, system="float fluidRestOffset = 0.01", material=""):
    bound = "rel material:binding:physics = </mat>" if material else ""
    head = f'def PhysxParticleSystem "S" (prepend apiSchemas = ["MaterialBindingAPI"]) {{\n{system}\n{bound}\n}}\n'
    head += f'def Material "mat" (prepend apiSchemas = ["PhysxPBDMaterialAPI"]) {{\n{material}\n}}\n'
    return head + prim("Points", ["PhysxParticleSetAPI"], FOUR, "rel physxParticle:particleSystem = </S>", *lines)


WRONG = {
    "no point": (points(places=""), "0 points"),
    "a point that is no number": (points(places="point3f[] points = [(0, 0, 0), (nan, 0, 0)]"), "not finite"),
    "points 1e9 m apart": (points(places="point3f[] points = [(0, 0, 0), (1e9, 0, 0)]"), "give larger cells"),
    "points 1e30 m apart": (points(places="point3f[] points = [(0, 0, 0), (1e30, 0, 0)]"), "give larger cells"),
    "points of another type": (points(places="float[] points = [1, 2, 3]"), "allowed is point3f[]"),
    "points that are flattened": (points("double3 xformOp:scale = (0, 1, 1)",
                                         'uniform token[] xformOpOrder = ["xformOp:scale"]'), "flattens"),
    "no volumes": (points(volumes=""), "no volume"),
    "two volumes for four points": (points(volumes="double[] wsim:mpm:volumes = [1e-6, 1e-6]"), "or 4 of them"),
    "a volume of 0": (points(volumes="double[] wsim:mpm:volumes = [0]"), "above 0"),
    "volumes far larger than cells": (points(volumes="double[] wsim:mpm:volumes = [1]"), "come apart"),
    "volumes of another type": (points(volumes="double wsim:mpm:volumes = 1e-6"), "allowed is double[]"),
    "a cell of 0": (points(cell="double wsim:mpm:cellSize = 0"), "cell is 0"),
    "a cell that is no number": (points(cell="double wsim:mpm:cellSize = nan"), "cell is nan"),
    "tiny cells": (cube(cell="double wsim:mpm:cellSize = 1e-6"), "GB"),
    "huge cells": (cube(cell="double wsim:mpm:cellSize = 10"), "holds no particle"),
    "two cell sizes": (cube() + cube(cell="double wsim:mpm:cellSize = 0.05").replace('"m"', '"n"'), "one cell size"),
    "a velocity of another type": (points("double wsim:mpm:velocity = 3"), "allowed is vector3d"),
    "a velocity that no step holds": (points("vector3d wsim:mpm:velocity = (1e30, 0, 0)"), "a lower speed"),
    "a material that is not": (of("mud"), "jelly, snow, sand, water"),
    "a density of 0": (points("double wsim:mpm:density = 0"), "density is 0"),
    "a stiffness without end": (points("double wsim:mpm:youngsModulus = 1e30"), "1e+24 Pa"),
    "poisson of a half": (points("double wsim:mpm:poissonsRatio = 0.5"), "below 0.5"),
    "an angle in degrees": (of("sand", "double wsim:mpm:frictionAngle = 30"), "radians"),
    "snow that packs by more than all": (of("snow", "double wsim:mpm:compressionLimit = 2"), "0 up to 1"),
    "snow that softens": (of("snow", "double wsim:mpm:hardening = -5"), "hardening is -5"),
    "an exponent below 1": (of("water", "double wsim:mpm:exponent = 0.5"), "> 1"),
    "a drag that is no number": (points("double wsim:mpm:drag = nan"), "drag is nan"),
    "ids twice": (points("int64[] ids = [1, 1, 2, 3]"), "ids are the same"),
    "two widths for four points": (points("float[] widths = [1, 2]"), "one or 4"),
    "an Xform": (prim("Xform", ["WsimMaterialPointsAPI"], CELL), "closed shape"),
    "an open mesh": (prim("Mesh", ["WsimMaterialPointsAPI"], CELL, OPEN.format("(0, 0, 0)")), "its mesh is open"),
    "a mesh with no number": (prim("Mesh", ["WsimMaterialPointsAPI"], CELL, OPEN.format("(nan, 0, 0)")), "not finite"),
    "an open sink": (cube() + prim("Mesh", ["WsimMaterialSinkAPI"], OPEN.format("(0, 0, 0)")).replace('"m"', '"n"'), "open"),
    "a box of size 0": (cube(size="double size = 0"), "half is 0"),
    "a pour without velocity": (cube("double wsim:mpm:pourStart = 0"), "not all 0"),
    "a pour from no time": (cube("double wsim:mpm:pourStart = nan", "vector3d wsim:mpm:velocity = (0, -1, 0)"), "start of"),
    "Newton without widths": (newton(widths=""), "author float[] widths"),
    "Newton without points": (newton(places="point3f[] points = []"), "no points"),
    "Newton's cell of 0": (newton(scene="float newton:mpm:voxelSize = 0"), "voxelSize is 0"),
    "Newton's friction below 0": (newton(material="float newton:mpm:internalFriction = -1"), "0 or more"),
    "Newton's masses for one": (newton("float[] physics:masses = [1]"), "author 4"),
    "an offset of PhysX below 0": (physx(system="float fluidRestOffset = -1"), "finite length"),
    "a mass of PhysX below 0": (physx("float physics:mass = -1"), "physics:mass is -1"),
    "friction of PhysX that is no number": (physx("bool physxParticle:fluid = 0",
                                                  material="float physxPBDMaterial:friction = nan"), "nan"),
    "a flag of PhysX in words": (physx('string physxParticle:fluid = "no"'), "allowed is bool"),
    "places of PhysX of another type": (physx("float[] physxParticle:simulationPoints = [1, 2, 3, 4]"), "point3f[]"),
}


@pytest.mark.parametrize("name", WRONG)
def test_one_line_says_what_is_wrong(name, tmp_path):
    text, words = WRONG[name]
    path = tmp_path / "s.usda"
    path.write_text(HEAD + text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(wsim.SceneError) as error:
            wsim.Simulation(wsim.load(str(path)), device="cpu").run(1)
    said = [str(problem) for problem in error.value.problems if problem.fatal]
    assert len(said) == 1 and words in said[0] and "\n" not in said[0], said
    assert "/m" in said[0] or "/n" in said[0] or "/S" in said[0]


def test_what_is_left_out_is_named(tmp_path):
    for text, words in ((points("vector3f[] velocities = [(1, 0, 0)]"), "1 velocities and 4 points"),
                        (points("color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)]"), "2 displayColor and 4 points"),
                        (physx("point3f[] physxParticle:simulationPoints = [(0, 0, 0)]"), "the points count")):
        path = tmp_path / "s.usda"
        path.write_text(HEAD + text)
        assert any(words in str(note) for note in wsim.load(str(path)).notes)
