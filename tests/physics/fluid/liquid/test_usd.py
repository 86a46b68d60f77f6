"""Liquids on stages, in results, after a restart; what `check_scene` says of them."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.make.physics.fluid.liquid.flow import tap
from tests.physics.fluid.liquid.tanks import tank, water
from wsim.cli.run import prepare_recorded_run
from wsim.physics.fluid.liquid import memory
from wsim.physics.fluid.liquid.objects import Liquid
from wsim.scene import Motion, Scene, SceneError
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.simulation.simulation import Simulation
from wsim.usd import load, names, save

FRAMES = 6


def run(source, output, frames: int = FRAMES, restart=None):
    job = prepare_recorded_run(replace(load(str(source)), frames=frames), str(output), lambda s: Simulation(s, device="cpu"),
                               restart=restart and str(restart))
    job.frames()
    return job


def drops(result, code: float, path: str = "/tank_drops") -> dict[str, np.ndarray]:
    stage = Usd.Stage.Open(str(result))
    points = UsdGeom.Points(stage.GetPrimAtPath(path))
    return {"x": np.array(points.GetPointsAttr().Get(code)), "id": np.array(points.GetIdsAttr().Get(code)),
            "v": np.array(points.GetVelocitiesAttr().Get(code)), "w": np.array(points.GetWidthsAttr().Get(code))}


def test_a_scene_is_what_it_was_after_a_file(tmp_path):
    scene = tap()
    liquid, source = scene.things("Liquid")[0], scene.things("LiquidSource")[0]
    liquid.transfer, liquid.flip, liquid.volume, liquid.cfl, liquid.steps = "flip", 0.9, False, 1.5, 3
    source.strength, source.liquid = Curve(np.array([0.0, 0.5]), np.array([1.0, 0.0])), liquid.path
    save(scene, str(tmp_path / "s.usda"))
    again = load(str(tmp_path / "s.usda"))
    assert again.things("Liquid") == [liquid] and again.things("LiquidSource") == [source] and not again.notes


def test_a_result_has_particles_with_ids_and_velocities(tmp_path):
    save(tap(), str(tmp_path / "s.usda"))
    job = run(tmp_path / "s.usda", tmp_path / "o.usdc")
    (sample,) = job.simulation.samples()
    found = drops(tmp_path / "o.usdc", FRAMES)
    assert np.array_equal(found["id"], sample.ids) and found["id"].dtype == np.int64
    assert np.allclose(found["x"], sample.positions, atol=1e-7) and np.allclose(found["v"], sample.velocities, atol=1e-6)
    assert np.allclose(np.pi / 6 * found["w"] ** 3, (1 / 32) ** 3, rtol=1e-5)                # their volume
    assert len(drops(tmp_path / "o.usdc", 1)["id"]) < len(found["id"]) and not len(drops(tmp_path / "o.usdc", 0)["id"])


@pytest.mark.parametrize("scene", [tap, lambda: tank((16, 16), [(0, 0), (0.25, 0.375)])], ids=["tap", "dam"])
def test_a_restart_goes_on_to_the_bit(tmp_path, scene):
    save(scene(), str(tmp_path / "s.usda"))
    one = run(tmp_path / "s.usda", tmp_path / "o.usdc")
    run(tmp_path / "s.usda", tmp_path / "half.usdc", 3)
    two = run(tmp_path / "s.usda", tmp_path / "rest.usdc", FRAMES, tmp_path / "half.usdc")
    assert not two.simulation.warnings
    for name, part in one.simulation.state.parts.items():
        other = two.simulation.state.parts[name].arrays
        assert all(np.array_equal(part.arrays[f.name].numpy(), other[f.name].numpy()) for f in part.kept), name
    a, b = (drops(path, FRAMES) for path in (tmp_path / "o.usdc", tmp_path / "rest.usdc"))
    assert all(np.array_equal(a[name], b[name]) for name in a)


@pytest.mark.slow
def test_a_stage_in_centimetres_has_the_same_water(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetTimeCodesPerSecond(24.0)
    stage.SetEndTimeCode(4)
    for name, half, at, api in (("tank", (25, 25, 25), (25, 25, 25), names.WSIM_LIQUID),
                                ("water", (12.5, 12.5, 25), (12.5, 12.5, 25), names.WSIM_POUR)):
        cube = UsdGeom.Cube.Define(stage, f"/{name}")
        cube.AddTranslateOp().Set(Gf.Vec3d(*at))
        cube.AddScaleOp().Set(Gf.Vec3f(*half))
        cube.GetPrim().AddAppliedSchema(api)
    stage.GetPrimAtPath("/tank").GetAttribute("wsim:liquid:cellSize").Set(6.25)
    stage.GetRootLayer().Save()
    run(tmp_path / "s.usda", tmp_path / "o.usdc", 2)
    found = drops(tmp_path / "o.usdc", 2)
    assert len(found["id"]) == 4 * 4 * 8 * 8
    sim = Simulation(tank((8, 8, 8), [(0, 0, 0), (0.25, 0.25, 0.5)], cell=0.0625), device="cpu")
    for _ in range(2):
        sim.step()
    (sample,) = sim.samples()
    assert np.abs(found["x"] - 100.0 * sample.positions).max() < 1e-2
    assert np.abs(found["v"] - 100.0 * sample.velocities).max() < 0.5


def wrong(scene: Scene) -> str:
    return "\n".join(str(p) for p in check_scene(scene))


@pytest.mark.parametrize("change, words", [
    (lambda s: s.objects["LiquidSource"].clear(), "/tank: nothing fills it"),
    (lambda s: setattr(s.things("LiquidSource")[0], "motion", Motion.at_place((9.0, 0.0, 0.0))), "what fills it is outside"),
    (lambda s: s.add(water((5, 5, 5), (6, 6, 6), path="/far")), "/far: it is outside of its liquids"),
    (lambda s: setattr(s.things("Liquid")[0], "sides", ("wind",) * 6), "/tank: sides are"),
    (lambda s: setattr(s.things("Liquid")[0], "sides", ("periodic", *["closed"] * 5)), "both of an axis periodic"),
    (lambda s: setattr(s.things("Liquid")[0], "transfer", "sph"), "transfer is 'sph'"),
    (lambda s: setattr(s.things("Liquid")[0], "cell", 1e-5), "up to 1073741824 particles"),
    (lambda s: setattr(s.things("Liquid")[0], "density", 0.0), "density is 0"),
    (lambda s: setattr(s.things("Liquid")[0], "high", np.array([0.5, 0.0, 0.5])), "its box is empty"),
    (lambda s: setattr(s.things("LiquidSource")[0], "role", "tap"), "role is 'tap'"),
    (lambda s: setattr(s.things("LiquidSource")[0], "liquid", "/pool"), "which is no liquid here"),
    (lambda s: s.objects["Liquid"].clear(), "there is no liquid")])
def test_what_is_wrong_is_said_by_path(change, words):
    scene = tank((16, 16, 16), [(0, 0, 0), (0.25, 0.25, 0.5)])
    assert not wrong(scene)
    change(scene)
    assert words in wrong(scene)


def test_too_many_particles_are_refused_with_the_cells_that_fit(monkeypatch):
    monkeypatch.setattr(memory, "free_device_bytes", lambda device: 10_000_000)
    with pytest.raises(SceneError, match=r"/tank: about .*e\+04 particles in 32x32x32 cells take .*; give cells of 0.0[0-9]* "):
        Simulation(tank((32, 32, 32), [(0, 0, 0), (0.5, 0.5, 0.5)]), device="cpu")


def test_gradients_are_refused_by_its_row():
    with pytest.raises(SceneError, match="liquid"):
        Simulation(tank((8, 8), [(0, 0), (0.1, 0.1)]), device="cpu", gradients=True)


@pytest.mark.slow
def test_without_a_liquid_nothing_of_it_is_there():
    """No import, no part, no stage; smoke brings none of it either."""
    import subprocess
    import sys
    code = ("import sys, numpy as np\nfrom wsim import Scene, Simulation\nfrom wsim.physics.fluid.objects import Fluid\n"
            "s = Scene(frames=1)\ns.add(Fluid('/a', (0, 0, 0), (1, 1, 1), 0.25, velocity=np.ones((4, 4, 4, 3))))\n"
            "m = Simulation(s, device='cpu')\nprint([n for n in sys.modules if 'liquid' in n or 'particles' in n], "
            "[p for p in m.state.parts if 'liquid' in p], [r['stage'] for r in m.plan.skipped if r['stage'] == 'liquid'])")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip().splitlines()[-1] == "[] [] ['liquid']", done.stdout + done.stderr


def test_a_source_given_a_velocity_starts_with_it():
    scene = tank((8, 8), [(0, 0), (0.1, 0.1)], velocity=(0.0, 1.0, 0.0))
    sim = Simulation(scene, device="cpu")
    assert sim.indicators()["liquid_speed"] == 1.0 and isinstance(scene.things("Liquid")[0], Liquid)
