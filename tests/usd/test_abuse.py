"""Nothing that can be written into a stage ends as a traceback: it loads, or it is a SceneError."""

import pytest
from pxr import Sdf, Usd

from tests.make.usd.abuse import refusals
from tests.make.usd.usd import _scene
from tests.make.usda import BIND, Reader, cloth, errors, fabric
from wsim.scene import SceneError
from wsim.usd import save
from wsim.usd.load import read_stage


def test_a_spoilt_attribute_is_read_or_refused(tmp_path):
    scene = _scene(3)
    scene.cloths, scene.springs = scene.cloths[1:2], scene.springs[:1]
    scene.frames, scene.colliders = 3, scene.colliders[::2]
    save(scene, tmp_path / "s.usda")
    refused, tried = refusals(tmp_path / "s.usda")
    assert tried > 300 and refused > tried / 4


def test_an_attribute_of_another_type_is_refused_or_passed_over(tmp_path):
    save(_scene(1), tmp_path / "s.usda")
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    stage.SetEditTarget(stage.GetSessionLayer())
    custom = [a.GetPath() for p in stage.Traverse() for a in p.GetAuthoredAttributes()
              if a.GetName().startswith("physics:") and not p.GetPrimDefinition().GetAttributeDefinition(a.GetName())]
    assert len(custom) > 20
    for path in custom:
        stage.GetSessionLayer().Clear()
        spec = Sdf.CreatePrimAttributeInLayer(stage.GetSessionLayer(), path, Sdf.ValueTypeNames.String)
        spec.default = "text"
        try:
            read_stage(stage)
        except SceneError as error:
            assert str(path.GetPrimPath()) in str(error)


@pytest.mark.parametrize("name", ["metersPerUnit", "kilogramsPerUnit", "timeCodesPerSecond"])
@pytest.mark.parametrize("value", ["0", "-1", "nan"])
def test_units_that_say_nothing_are_an_error(tmp_path, name, value):
    assert f"{name} is {value}" in errors(Reader(tmp_path), cloth(), header=f"{name} = {value}")


def test_collision_filters_that_do_not_count_yet_are_noted(tmp_path):
    read = Reader(tmp_path)
    scene = read(cloth() + """
        def PhysicsCollisionGroup "group" {
            rel physics:filteredGroups = </group>
        }
        def Sphere "ball" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsFilteredPairsAPI"]) {
            rel physics:filteredPairs = </cloth>
        }
        def Sphere "other" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsFilteredPairsAPI"]) {
        }""")
    filters = [note.path for note in scene.notes if "every collider acts on every body" in note.text]
    assert filters == ["/group", "/ball"] and len(scene.colliders) == 2


def test_where_nothing_is_left_the_reference_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(SceneError) as error:
        Reader(tmp_path)('def "World" (references = @gone.usda@) {}')
    fatal, note = error.value.problems
    assert fatal.fatal and "nothing in it can be simulated" in fatal.text
    assert not note.fatal and "@gone.usda@" in note.text and note.path == "/World"


@pytest.mark.parametrize(("authored", "words"), [("-100", "is -100; allowed is a finite number > 0"),
                                                 ("nan", "is nan; allowed is a finite number > 0")])
def test_a_stretch_stiffness_out_of_range_is_named_as_authored(tmp_path, authored, words):
    text = cloth(BIND) + fabric(f"float physics:surfaceStretchStiffness = {authored}\nfloat physics:poissonsRatio = 0.3")
    assert f"/mat: physics:surfaceStretchStiffness {words}" in errors(Reader(tmp_path), text)


@pytest.mark.parametrize("name", ["x", "y", "z"])
def test_a_weld_that_floating_point_cannot_tell_is_an_error(tmp_path, name):
    place = ", ".join("1e200" if axis == name else "0" for axis in "xyz")
    text = cloth(f'double wsim:weld = 0.001\ndouble3 xformOp:translate = ({place})\n'
                 'uniform token[] xformOpOrder = ["xformOp:translate"]')
    assert "/cloth: weld tolerance 0.001 m is too small for points 1e+200 m away" in errors(Reader(tmp_path), text)
