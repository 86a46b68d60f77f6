"""A simulation of a path or a stage, stepped and written from Python."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

import wsim
from wsim.usd import save


@pytest.fixture
def file(tmp_path) -> str:
    scene = wsim.Scene(frames=5, substeps=2)
    cloth = scene.cloth("/World/cloth", *wsim.shapes.sheet(1.0, 1.0, 3, 3))
    scene.pin("/World/pin", cloth, range(4))
    save(scene, tmp_path / "scene.usda")
    return str(tmp_path / "scene.usda")


def test_a_path_and_a_stage_are_simulated_as_their_scene_is(file):
    ends = []
    for given in (file, Usd.Stage.Open(file), wsim.load(file)):
        simulation = wsim.Simulation(given, device="cpu")
        assert list(simulation.frames(3)) == [1, 2, 3]
        ends.append(simulation.positions("/World/cloth"))
    assert np.array_equal(ends[0], ends[1]) and np.array_equal(ends[0], ends[2])


def test_frames_are_those_of_the_scene_where_none_are_given(file):
    assert list(wsim.Simulation(file, device="cpu").frames())[-1] == 5


def test_what_is_recorded_opens_over_the_scene(file, tmp_path):
    simulation, out = wsim.Simulation(file, device="cpu"), tmp_path / "out.usdc"
    with simulation.record(out) as record:
        simulation.run(2)
    simulation.step()                                      # after the end, not written
    assert record.result == str(out)
    stage = Usd.Stage.Open(str(out))
    points = UsdGeom.Mesh.Get(stage, "/World/cloth").GetPointsAttr()
    assert points.GetTimeSamples() == [0.0, 1.0, 2.0]
    simulation.reset()
    simulation.run(2)
    assert np.allclose(np.array(points.Get(2.0)), simulation.positions("/World/cloth"), atol=1e-6)


def test_a_block_that_fails_keeps_its_frames_apart(file, tmp_path):
    simulation = wsim.Simulation(file, device="cpu")
    with pytest.raises(KeyError), simulation.record(tmp_path / "out.usdc") as record:
        simulation.run(1)
        raise KeyError
    assert record.result is None and not (tmp_path / "out.usdc").exists() and (tmp_path / "out.partial.usdc").exists()


def test_a_recording_is_of_one_world(file, tmp_path):
    with pytest.raises(wsim.SceneError, match="holds one world, and the simulation has 2"):
        wsim.Simulation(file, device="cpu", worlds=2).record(tmp_path / "out.usdc")


def test_a_stage_with_edits_is_read_with_them(file, tmp_path):
    stage = Usd.Stage.Open(file)
    stage.SetEndTimeCode(7.0)
    scene = wsim.load(stage)
    assert scene.frames == 7 and scene.source is None and "is not saved" in scene.notes[0].text
    assert wsim.load(Usd.Stage.Open(file)).source is None            # the layer is shared, and still edited
    stage.GetRootLayer().Reload()
    assert wsim.load(stage).source == file


def test_forces_of_painted_pins_are_said_not_to_be_written(file, tmp_path):
    """They have no prim that could take them; those of a PhysicsAttachment are written."""
    stage = Usd.Stage.Open(file)
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/cloth"))
    primvars.CreatePrimvar("wsim:pin", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex).Set([0.0] * 12 + [1.0] * 4)
    stage.Save()
    simulation = wsim.Simulation(file, device="cpu")
    with simulation.record(str(tmp_path / "out.usdc"), reactions=True) as record:
        simulation.run(2)
    assert [note.path for note in record.notes] == ["/World/cloth/painted"]
    assert "PhysicsAttachment" in record.notes[0].text
    written = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert written.GetPrimAtPath("/World/pin").GetAttribute("wsim:reaction").GetTimeSamples() == [0.0, 1.0, 2.0]
    assert len(simulation.reactions("/World/cloth/painted")) == 4
