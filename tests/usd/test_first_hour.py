"""Mistakes of a first hour, each answered by one line that names place and cure: by `wsim check`, `wsim new`, Python."""

from dataclasses import dataclass

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

import wsim
from tests.make.usda import BIND, SHEET, cloth, fabric
from wsim import cli
from wsim.physics.mpm.objects import MaterialPoints
from wsim.scene import shapes, solids

RANGE = 'metersPerUnit = 1\nupAxis = "Y"\nstartTimeCode = 0\nendTimeCode = 24\ntimeCodesPerSecond = 24\n'
SOUND = fabric("float physics:density = 300\nfloat physics:staticFriction = 0.4\nfloat physics:dynamicFriction = 0.4",
               apis='"PhysicsSurfaceDeformableMaterialAPI", "PhysicsMaterialAPI"')
LIGHT = SOUND.replace("float physics:density = 300", "")
FLOOR = ('def Plane "floor" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {\nuniform token axis = "AXIS"\n'
         'double3 xformOp:translate = (0.5, HEIGHT, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n}\n')
GRAVITY = ('def PhysicsScene "physics" {\nvector3f physics:gravityDirection = DIRECTION\n'
           'float physics:gravityMagnitude = SIZE\n}\n')
PIN = ('def PhysicsAttachment "pin" {\nrel physics:src0 = </cloth>\nint[] physics:indices0 = [INDICES]\n}\n')


def sized(size: str) -> str:
    """The sheet of 1 with other numbers."""
    points, _, rest = SHEET.partition("int[]")
    return points.replace("1,", f"{size},") + "int[]" + rest


def floor(height: float, axis: str = "Y") -> str:
    return FLOOR.replace("HEIGHT", str(height)).replace("AXIS", axis)


def gravity(direction: str, size: str = "-inf") -> str:
    return GRAVITY.replace("DIRECTION", direction).replace("SIZE", size)


def pin(indices: str) -> str:
    return PIN.replace("INDICES", indices)


BODY = cloth(BIND) + SOUND
# what: (text of the stage, root metadata, where, what is found, the cure)
STAGES = {
    "no pin and nothing below": (BODY, RANGE, "/cloth", "it falls for ever", "apply PhysicsCollisionAPI to what it"),
    "floor through the middle": (BODY + floor(0.5), RANGE, "/cloth", "free points start inside of /floor", "move one of them"),
    "a floor that is a wall": (BODY + floor(-1, "X"), RANGE, "/cloth", "start inside of /floor", "move one of them"),
    "Z up, and gravity along -Y": (BODY + pin("0") + gravity("(0, -1, 0)"), RANGE.replace('"Y"', '"Z"'), "/",
                                   "gravity acts along -Y, and Z is up", "author upAxis = Y on the stage"),
    "centimetres taken for metres": (cloth(BIND, geometry=sized("170")) + SOUND + pin("0"), RANGE,
                                     "/cloth", "170 m large", "author metersPerUnit on the stage"),
    "metres taken for centimetres": (cloth(BIND, geometry=sized("0.05")) + SOUND + pin("0"),
                                     RANGE.replace("metersPerUnit = 1\n", ""), "/cloth", "0.0005 m small",
                                     "1 if its numbers are metres"),
    "981 in metres": (BODY + pin("0") + gravity("(0, -1, 0)", "981"), RANGE, "/", "gravity is 981 m/s^2", "in stage units"),
    "9.81 in centimetres": (BODY + pin("0") + gravity("(0, -1, 0)", "9.81"), RANGE.replace("Unit = 1", "Unit = 0.01"), "/",
                            "gravity is 0.0981 m/s^2", "author metersPerUnit (0.01 for centimetres), or"),
    "a material without density": (cloth(BIND) + LIGHT + pin("0"), RANGE, "/mat", "physics:density is not authored",
                                   "author it"),
    "no material": (cloth() + pin("0"), RANGE, "/cloth", "no physics material is bound", "bind one by material:binding"),
    "no frame rate and no range": (BODY + pin("0"), 'metersPerUnit = 1\nupAxis = "Y"\n', "scene.usda",
                                   "has no startTimeCode and endTimeCode", "author both and timeCodesPerSecond, or"),
    "a range and no frame rate": (BODY + pin("0"), RANGE.replace("timeCodesPerSecond = 24\n", ""), "scene.usda",
                                  "has no frame rate: 24 frames are a second", "author timeCodesPerSecond"),
    "a pin on a point that is not": (BODY + pin("0, 4"), RANGE, "/pin", "point 4 of /cloth", "count from 0"),
    "a pin without points": (BODY + 'def PhysicsAttachment "pin" {\nrel physics:src0 = </cloth>\n}\n', RANGE, "/pin",
                             "holds no point", ""),
    "everything pinned": (BODY + pin("0, 1, 2, 3"), RANGE, "/cloth", "all 4 points are pinned", "pin fewer points"),
    "an end before the start": (BODY + pin("0"), RANGE.replace("= 24\nt", "= -1\nt"), "scene.usda",
        "comes before startTimeCode",
                                "author endTimeCode"),
    "a bare mesh": (f'def Mesh "cloth" {{{SHEET}\n}}', RANGE, "scene.usda", "nothing in it can be simulated",
                    "`wsim new cloth scene.usda -o SCENE`"),
    "a mesh as a solid": (BODY.replace("PhysicsSurfaceDeformableSimAPI", "PhysicsVolumeDeformableSimAPI"), RANGE, "/cloth",
                          "it must be a TetMesh", "`wsim new softbody` makes one of a Mesh"),
    "a file without geometry": ('def Xform "World" {}', RANGE, "scene.usda", "nothing in it can be simulated", "no Mesh"),
}


@pytest.mark.parametrize("what", STAGES)
def test_check_answers_with_one_line_that_has_the_cure(what, tmp_path, capsys):
    text, header, where, found, cure = STAGES[what]
    (tmp_path / "scene.usda").write_text(f"#usda 1.0\n(\n{header})\n{text}")
    cli.main(["check", str(tmp_path / "scene.usda")])
    lines = [line for line in capsys.readouterr().out.splitlines() if found in line]
    assert len(lines) == 1 and where in lines[0].partition(found)[0] and cure in lines[0], lines
    assert lines[0].startswith(("error: ", "warning: "))


def test_a_sound_scene_is_not_told_off(tmp_path, capsys):
    (tmp_path / "scene.usda").write_text(f"#usda 1.0\n(\n{RANGE})\n{BODY}{pin('0, 3')}{floor(-1)}")
    assert cli.main(["check", str(tmp_path / "scene.usda")]) == 0
    assert "0 errors, 0 warnings" in capsys.readouterr().out


def write(path, points, counts, indices) -> str:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    mesh = UsdGeom.Mesh.Define(stage, "/thing/mesh")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.asarray(counts, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.asarray(indices, np.int32)))
    stage.Save()
    return str(path)


# what: (arguments of `wsim new` behind the kind, the mesh, where, what is found, the cure)
BALL, RAG = shapes.sphere(0.2, 12), shapes.sheet(1.0, 1.0, 3, 3)
NEW = {
    "an open mesh as a soft body": (["softbody"], RAG, "/thing/mesh", "a soft body needs a closed surface",
        "Close its holes, or"),
    "a half-open one": (["softbody"], (BALL[0], BALL[1][:-1], BALL[2][:-BALL[1][-1]]), "/thing/mesh", "is open at",
                        "close its holes to be sure"),
    "a pin that is none": (["cloth", "--pin", "collar"], RAG, "/thing/mesh", "--pin collar is no", "0.9..1@z"),
    "a flat sheet by its top": (["cloth", "--pin", "top"], shapes.sheet(1.0, 2.0, 3, 3, horizontal=True), "/thing/mesh",
                                "--pin top holds no point", "(the mesh is flat along y; one end of it is 0..0.01@z)"),
    "a collider that is not there": (["cloth", "--collider", "floor"], RAG, "floor", "is no file and no prim", "its shapes:"),
    "a fabric that is none": (["cloth", "--fabric", "tweed"], RAG, "fabric", "no fabric 'tweed'", "silk, cotton, denim"),
    "a garment of 170 m": (["cloth"], (RAG[0] * 170.0, *RAG[1:]), "/thing/mesh", "170 m large", "--meters-per-unit 0.01"),
    "a material that is none": (["cloth", "--material", "wool"], RAG, "wool", "is no material of the mesh's file",
        "(--material)"),
}


@pytest.mark.parametrize("what", NEW)
def test_new_answers_with_one_line_that_has_the_cure(what, tmp_path, capsys):
    arguments, mesh, where, found, cure = NEW[what]
    file = write(tmp_path / "mesh.usda", *mesh)
    cli.main(["new", arguments[0], file, "-o", str(tmp_path / "scene.usda"), *arguments[1:]])
    lines = [line for line in capsys.readouterr().err.splitlines() if found in line]
    assert len(lines) == 1 and where in lines[0] and cure in lines[0], lines


@pytest.mark.parametrize("mesh, offered", [(BALL, True), (RAG, False)])
def test_a_closed_mesh_is_offered_as_a_soft_body_too(mesh, offered, tmp_path, capsys):
    assert cli.main(["check", write(tmp_path / "mesh.usda", *mesh)]) == 1
    said = capsys.readouterr().out
    assert "`wsim new cloth mesh.usda" in said and ("`wsim new softbody mesh.usda" in said) == offered


def rag() -> wsim.Scene:
    scene = wsim.Scene()
    scene.cloth("/rag", *RAG)
    return scene


@dataclass(frozen=True)
class Brick:
    x: float
    y: float
    z: float
    rim: float


# what: (call, what is found, the cure)
PYTHON = {
    "a path without a slash": (lambda: wsim.Simulation(wsim.Scene(objects={"Cloth": [wsim.Cloth("rag", *RAG)]})),
                             "this is no prim path",
                               "begin it with /"),
    "a file that is not there": (lambda: wsim.Simulation("flagg.usda"), "flagg.usda: there is no such file", "give the path"),
    "nothing": (lambda: wsim.Simulation(None), "is a NoneType", "give a wsim.Scene, the path of a USD file or a Usd.Stage"),
    "an empty scene": (lambda: wsim.Simulation(wsim.Scene()), "nothing here can move", "wsim new cloth MESH"),
    "a wind over time as a field": (lambda: wsim.Simulation(wsim.Scene(wind=wsim.Curve([0.0, 1.0], [(0, 0, 0), (1, 0, 0)]))),
                                    "wind is Curve", 'simulation.set("/", "wind", curve)'),
    "a shape of four lengths": (lambda: solids.SOLIDS[0].size(Brick(1.0, 2.0, 3.0, 4.0)), "has 4 lengths", "holds three"),
    "a box of one length": (lambda: wsim.Box(0.1), "Box: half is 0.1", "allowed are three lengths [m]"),
    "a ball of three lengths": (lambda: wsim.Sphere((0.1, 0.2, 0.3)), "Sphere: radius is", "allowed is one length [m]"),
    "a place in a plane": (lambda: wsim.Scene().collider("/ball", wsim.Sphere(0.1), at=(0, 1)), "/ball: at is (0, 1)",
                           "allowed are three lengths [m]"),
    "a mask as points of a pin": (lambda: wsim.Pin("/pin", "/rag", np.array([True, False])), "found a mask",
                                  "numpy.flatnonzero(mask)"),
    "half a point": (lambda: wsim.Pin("/pin", "/rag", [0, 1.5]), "/pin: points: found 1.5", "whole numbers"),
    "words as points of a pin": (lambda: wsim.Pin("/pin", "/rag", ["top"]), "/pin: points: found ['top']", "whole numbers"),
    "a pin of nothing": (lambda: wsim.Pin("/pin", "/rag", None), "/pin: points is None", "such as [0, 1]"),
    "hair on a cloth": (lambda: wsim.Scene().hair("/hair", wsim.Cloth("/rag", *RAG), 10, 0.1), "/hair: collider is",
                        'scene.collider("/head"'),
    "a cell in words": (lambda: wsim.Simulation(wsim.Scene(objects={"MaterialPoints": [
        MaterialPoints("/heap", wsim.Sphere(0.1), cell="0.1")]})), "/heap: cell is '0.1'", "finite and > 0"),
    "a pour in words": (lambda: MaterialPoints("/heap", wsim.Sphere(0.1), pour=3), "/heap: pour is 3", "Pour(start=0.0"),
    "the name of a fabric": (lambda: wsim.Cloth("/rag", *RAG, material="silk"), "/rag: material is 'silk'",
                             'wsim.fabric("silk")'),
    "half a frame": (lambda: wsim.Simulation(wsim.Scene(frames=2.5, objects={"Cloth": [wsim.Cloth("/rag", *RAG)]})),
                     "frames is 2.5", "a whole number up to"),
    "triangles as tets": (lambda: wsim.Soft("/jelly", np.zeros((6, 3)), np.zeros((8, 3), int)), "found rows of 3", "rows of 4"),
    "points of a plane": (lambda: wsim.Cloth("/rag", np.zeros((6, 2)), *RAG[1:]), "found rows of 2", "rows of 3"),
    "a curve as a motion of a pin": (lambda: wsim.Pin("/pin", "/rag", [0], motion=wsim.Curve([0.0], [(0, 0, 0)])),
                                     "/pin: motion is Curve", "Motion.through(times, places)"),
    "another precision": (lambda: wsim.Simulation(rag(), precision="double"), "found 'double'", "allowed are float32, float64"),
    "a device that is none": (lambda: wsim.Simulation(rag(), device="gpu"), "there is no device 'gpu'", "allowed are"),
    "a fabric out of range": (lambda: wsim.Fabric(stretch=-1.0), "stretch is -1", "allowed is a finite number > 0"),
    "a solid that cannot be": (lambda: wsim.Bulk(poisson=0.5), "poisson is 0.5", "allowed is > -1 and < 0.5"),
    "a plane that faces nowhere": (lambda: wsim.Plane("up"), "axis is 'up'", "allowed is 'X', 'Y', 'Z', or None"),
    "a solver for cloth alone": (lambda: wsim.Simulation(wsim.Scene(solver="xpbd", objects={"Soft": [wsim.Soft(
        "/jelly", *shapes.block((1, 1, 1), 1))]})), "solver xpbd has no tetrahedra", "choose one of them"),
    "a name that is none": (lambda: wsim.Simulaton, "no attribute 'Simulaton'", "its names:"),
    "a body that is none": (lambda: wsim.Simulation(rag(), device="cpu").positions("/rug"), "/rug: world 0 has 0 prims",
        "there are ['/rag']"),
    "a live value that is none": (lambda: wsim.Simulation(rag(), device="cpu").set("/rag", "strech", 1.0), "strech", "stretch"),
}


@pytest.mark.parametrize("what", PYTHON)
def test_python_answers_with_the_cure(what):
    call, found, cure = PYTHON[what]
    with pytest.raises((wsim.SceneError, ValueError, KeyError, AttributeError)) as error:
        call()
    lines = [line for line in str(error.value).splitlines() if found in line]
    assert len(lines) == 1 and cure in lines[0], str(error.value)
