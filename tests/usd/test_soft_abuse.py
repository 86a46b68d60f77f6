"""Soft bodies that make no sense: each mistake of a stage is an error with its path and element, and never a traceback."""

import numpy as np
import pytest

from tests.make.usd.abuse import refusals
from tests.make.usd.prims.soft import soft_scene
from tests.make.usd.usda_soft import BONE, SOLID, TWO, part, solid, volume
from tests.make.usda import Reader, errors
from wsim.physics.soft import check as soft
from wsim.usd import save

BODIES = [
    (volume(geometry=TWO.replace("(1, 1, 1)", "(nan, 1, 1)")), "/ball: 1 of 5 points are NaN or infinite, first at index 4"),
    (volume(geometry=TWO.replace("3, 4)", "3, 7)")), "/ball: tet 1 is naming points that there are not; allowed are 0 to 4"),
    (volume(geometry=TWO.replace("3, 4)", "3, 3)")), "/ball: tet 1 is naming a point twice"),
    (volume(geometry=TWO.replace("(1, 2, 3, 4)", "(3, 2, 1, 0)")), "/ball: tet 1 is given before (the first as tet 0)"),
    (volume(geometry=TWO.replace("(1, 1, 1)", "(0.5, 0.5, 0)")), "/ball: tet 1 is flat"),
    (volume(geometry=""), "/ball: has no points, tetVertexIndices"),
    (volume(f"{SOLID}\npoint3f[] physics:restShapePoints = [(0, 0, 0)]"), "/ball: 1 rest points"),
    (volume(f"{SOLID}\nint4[] physics:restTetVertexIndices = [(0, 1, 2, 3)]"), "physics:restTetVertexIndices has 1 rows"),
    (volume(f"{SOLID}\nint4[] physics:restTetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 5)]"),
     "[1] is [1, 2, 3, 5]; allowed is 0 to 4"),
    (volume(f"{SOLID}\nfloat[] physics:masses = [1, 2, 0, 4, 5]"), "/ball: physics:masses[2] is 0"),
    (volume(f"{SOLID}\nfloat[] physics:masses = [1, 2, 3]"), "physics:masses has 3 values of elementType ''; allowed is 5 for"),
    (volume(f"{SOLID}\nfloat physics:mass = nan"), "/ball: physics:mass is nan"),
    (volume(f"{SOLID}\nfloat[] wsim:filled = [1, 1.5]"), "/ball: filled[1] is 1.5"),
    (volume(f"{SOLID}\nfloat[] wsim:filled = [1]"), "/ball: 1 filled; allowed: 2"),
    (volume(f"{SOLID}\ndouble wsim:pressure = nan"), "/ball: pressure is nan"),
    (volume(f"{SOLID}\nvector3f[] velocities = [(0, 0, 0)]"), "/ball: 1 velocities"),
    (volume().replace("TetMesh", "Mesh"), "/ball: has PhysicsVolumeDeformableSimAPI and is a Mesh; it must be a TetMesh"),
    (volume() + 'def PhysicsScene "s" (prepend apiSchemas = ["WsimSceneAPI"]) {\nuniform token wsim:solver = "xpbd"\n}\n',
     "/: solver xpbd has no tetrahedra, of which /ball is made; allowed: auto, implicit, explicit"),
]
MATERIALS = [
    ("float physics:youngsModulus = nan", "physics:youngsModulus: young is nan"),
    ("float physics:youngsModulus = -5", "physics:youngsModulus: young is -5"),
    ("float physics:poissonsRatio = 0.5", "physics:poissonsRatio: poisson is 0.5; allowed is > -1 and < 0.5"),
    ("float physics:density = inf", "physics:density: density is inf"),
    ('uniform token wsim:elasticModel = "jam"', "wsim:elasticModel: model is 'jam'; allowed is one of corotational"),
    ("double wsim:damping = -1", "wsim:damping: damping is -1"),
    ("float physics:dynamicFriction = -1", "physics:dynamicFriction is -1"),
    ("double wsim:yieldStrain = 0", "wsim:yieldStrain: yield_strain is 0"),
]


@pytest.mark.parametrize("text, said", BODIES)
def test_a_bad_body_is_an_error_that_names_the_prim_and_the_element(tmp_path, text, said):
    assert said in errors(Reader(tmp_path), text + solid())


@pytest.mark.parametrize("values, said", MATERIALS)
def test_a_bad_material_is_an_error_that_names_the_material(tmp_path, values, said):
    assert f"/jelly: {said}" in errors(Reader(tmp_path), volume() + solid(values))


def test_every_error_is_reported_together(tmp_path):
    text = volume(f"{SOLID}\nfloat physics:mass = -1" + part("7")) + volume(geometry="", name="b") + BONE
    found = errors(Reader(tmp_path), text + solid("float physics:poissonsRatio = 3\nfloat physics:youngsModulus = -1"))
    for said in ("/ball: physics:mass", "/ball/part: indices[0]", "/b: has no points", "poissonsRatio", "youngsModulus"):
        assert said in found


def test_a_spoilt_attribute_is_read_or_refused(tmp_path, monkeypatch):
    """Also where nothing says that it is not simulated yet."""
    monkeypatch.setattr(soft, "check_unsupported_material", lambda thing: ())
    scene = soft_scene(0)
    del scene.cloths[:], scene.softs[1:], scene.softs[0].skins[1:], scene.pins[:1], scene.colliders[:]
    scene.frames = 2
    save(scene, tmp_path / "s.usda")
    with np.errstate(over="ignore"):
        refused, tried = refusals(tmp_path / "s.usda")
    assert tried > 200 and refused > tried / 4
