"""Doubles that a scene is given, or that follow from units, in float64 and in float32 runs and in files."""

import numpy as np

from wsim.scene import Scene, shapes
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save


def test_doubles_of_a_scene_are_not_rounded(tmp_path):
    """A chain of ten links of 0.1 m, as float64 arrays, pinned at a place of its own, at rest without gravity: in float64 every
    number is as given and nothing moves. Rounded to float32 springs are strained by 1e-8 and pull."""
    links = np.arange(11) * 0.1
    points = np.stack([links, 0.3 * links, np.zeros(11)], axis=1)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    scene = Scene(gravity=(0.0, 0.0, 0.0), solver="explicit", integrator="leapfrog", substeps=50)
    net = scene.net("/net", points, np.stack([np.arange(10), np.arange(1, 11)], 1), [100.0], [0.1], lengths=lengths)
    pin = scene.pin("/pin", net, [0], places=points[:1])
    sim = Simulation(scene, device="cpu", precision="float64")
    assert np.array_equal(sim.positions(), points) and pin.places.dtype == np.float64
    sim.run(2)
    assert np.abs(sim.positions() - points).max() < 1e-15 and sim.indicators()["elastic_energy"] < 1e-28
    save(scene, str(tmp_path / "net.usda"))
    again = load(str(tmp_path / "net.usda"))
    assert again == scene and again.springs[0].points.dtype == np.float32            # what points3f hold
    scene.springs[0].lengths, again.springs[0].lengths = None, None
    ends = []
    for given in (scene, again):                          # float32 takes doubles as a file holds them: to the bit
        given.gravity = (0.0, -9.81, 0.0)
        sim = Simulation(given, device="cpu")
        sim.run(2)
        ends.append(sim.positions())
    assert np.array_equal(*ends)


def test_points_in_centimetres_are_metres_in_double(tmp_path):
    """And masses authored as doubles stay so (points are of a type that USD has fixed)."""
    from pxr import Sdf, Usd, UsdGeom, Vt
    path = str(tmp_path / "sheet.usda")
    scene = Scene()
    scene.cloth("/cloth", *shapes.sheet(0.7, 0.7, 3, 3))
    save(scene, path)
    stage = Usd.Stage.Open(path)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.Save()
    stored = np.array(stage.GetPrimAtPath("/cloth").GetAttribute("points").Get())
    assert np.array_equal(load(path).cloths[0].points, stored.astype(np.float64) * 0.01)
    doubles = np.arange(1.0, 17.0) / 3.0
    stage.GetPrimAtPath("/cloth").CreateAttribute("physics:masses", Sdf.ValueTypeNames.DoubleArray).Set(
        Vt.DoubleArray.FromNumpy(doubles))
    stage.Save()
    assert np.array_equal(load(path).cloths[0].masses, doubles)
