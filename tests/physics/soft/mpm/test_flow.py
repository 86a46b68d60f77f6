"""Material that pours in and that sinks take: masses, streams, growth, bits, restarts, bad input."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly, Pour, Water
from wsim.scene.check.scene import check_scene

CELL = 0.05
SOFT = Granular(young=2e4)


def make_scene(frames=12, gravity=(0, 0, 0)):
    return wsim.Scene(fps=60, frames=frames, gravity=gravity)


def find_method(simulation):
    return next(m for m in simulation.plan.methods if m.name == "mpm")


def pour(scene, path="/spout", at=(0, 0, 0), velocity=(3, 0, 0), **more):
    given = {"start": 0.0, "end": 0.1, "rate": None} | {k: more.pop(k) for k in ("start", "end", "rate") if k in more}
    return scene.mpm(path, wsim.Box((0.1, 0.1, 0.1)), at=at, cell=CELL, material=SOFT, velocity=velocity, pour=Pour(**given),
                     **more)


def run(scene, frames=None, **more):
    simulation = wsim.Simulation(scene, device="cpu", **more)
    simulation.run(frames)
    return simulation


@pytest.mark.parametrize("rate", [None, 40.0])
def test_a_rate_is_kept_to_half_a_particle(rate):
    """None: a square of 0.2 m of density 1600 at 3 m/s. What has come is rate (t - start), whatever steps are taken."""
    scene = make_scene()
    pour(scene, start=0.02, end=0.1, rate=rate)
    simulation = wsim.Simulation(scene, device="cpu")
    m = 1600 * (CELL / 2)**3
    for frame in range(1, 9):
        simulation.step()
        said = find_method(simulation).indicators(None, None)
        expected = (192.0 if rate is None else rate) * np.clip(frame / 60 - 0.02, 0.0, 0.08)
        assert abs(said["mpm_poured_mass"] - expected) <= 0.501 * m
        assert np.isclose(said["mpm_mass"], m * said["mpm_particles"], rtol=1e-12)
    total = (192.0 if rate is None else rate) * 0.08
    assert abs(said["mpm_poured_mass"] - total) <= 0.5 * m and said["mpm_mass"] == said["mpm_poured_mass"]


def test_a_stream_keeps_its_spacing_and_speed():
    """Without gravity a stream at its greatest rate goes on as columns with a particle each d: nothing acts within it."""
    scene = make_scene()
    pour(scene, end=0.06)
    simulation = run(scene, 5)
    now = find_method(simulation).read_particles(0)
    assert np.allclose(now["v"], [3, 0, 0], atol=1e-4)
    of = np.floor(now["x"][:, 1:] / (CELL / 2))
    columns = np.unique(of, axis=0)
    for column in columns[::7]:
        x = np.sort(now["x"][(of == column).all(axis=1), 0])
        assert len(columns) == 64 and len(x) >= 7 and np.allclose(np.diff(x), CELL / 2, rtol=2e-3)


def test_a_source_that_moves_adds_its_velocity():
    """A spout that goes up at 2 m/s and is turned a quarter: velocity along its own axes, and its own motion."""
    turned = np.eye(4)
    turned[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    values = np.array([turned, turned])
    values[1, 2, 3] = 2.0
    scene = make_scene()
    scene.mpm("/spout", wsim.Box((0.1, 0.1, 0.1)), motion=wsim.Motion(np.array([0.0, 1.0]), values), cell=CELL, material=SOFT,
              velocity=(3, 0, 0), pour=Pour(end=0.05))
    now = find_method(run(scene, 4)).read_particles(0)
    assert len(now["x"]) and np.allclose(now["v"], [0, 3, 2], atol=1e-3)
    assert abs(now["x"][:, 2].mean() - 2.0 * 4 / 60) < 0.01 and np.ptp(now["x"][:, [0, 2]], axis=0).max() < 0.2


def test_a_sink_takes_what_comes_and_nothing_is_lost():
    """Start + poured - taken = there, in whole particles; a thin sink takes all of a stream of 0.05 m a frame."""
    scene = make_scene()
    pour(scene, end=0.08)
    scene.mpm("/rest", wsim.Box((0.1, 0.1, 0.1)), at=(0, 1, 0), cell=CELL, material=SOFT)
    scene.sink("/drain", wsim.Box((0.03, 0.3, 0.3)), at=(0.3, 0, 0))
    scene.sink("/none", wsim.Sphere(0.1), at=(0, -3, 0))
    simulation = run(scene, 12)
    m = find_method(simulation)
    said = m.indicators(None, None)
    there = m.part.arrays["there"].numpy()
    assert np.count_nonzero(there == 2) == said["mpm_taken_particles"] == said["mpm_poured_particles"] > 600
    assert not (there > 2).any()
    assert said["mpm_particles"] == 512 + said["mpm_poured_particles"] - said["mpm_taken_particles"]
    assert m.read_particles(0)["x"][:, 0].max(initial=0.0) < 0.4 and len(m.read_particles(1)["x"]) == 512
    (spout, rest) = simulation.samples()
    assert len(spout.ids) == len(spout.positions) == len(spout.widths) and len(np.unique(spout.ids)) == len(spout.ids)
    assert len(rest.ids) == 512


def test_ids_stay_with_particles():
    scene = make_scene()
    pour(scene, end=0.2, rate=30.0)
    scene.sink("/drain", wsim.Box((0.03, 0.3, 0.3)), at=(0.35, 0, 0))
    simulation = wsim.Simulation(scene, device="cpu")
    before = None
    for _ in range(12):
        simulation.step()
        (sample,) = simulation.samples()
        if before is not None:
            both, a, b = np.intersect1d(before.ids, sample.ids, return_indices=True)
            if len(both):
                assert np.allclose(sample.positions[b] - before.positions[a], [3 / 60, 0, 0], atol=0.02)
        before = sample


def test_a_run_beyond_the_planned_frames_grows_seldom():
    """Rows are reserved for the scene's frames, then for half as many more: a capture of the frame each time, no other."""
    scene = make_scene(frames=4)
    pour(scene, end=np.inf, rate=20.0)
    simulation = run(scene, 30)
    m = find_method(simulation)
    planned = make_scene(frames=30)
    pour(planned, end=np.inf, rate=20.0)
    other = find_method(run(planned, 30))
    assert m.indicators(None, None)["mpm_poured_particles"] == other.indicators(None, None)["mpm_poured_particles"] > 300
    assert np.array_equal(m.read_particles(0)["x"], other.read_particles(0)["x"])
    assert [c.frame for c in simulation.graphs.log if "something else" in c.why] == [5, 21]


def test_a_planned_stream_that_falls_and_spreads_is_captured_once():
    """A stream of two cells falls 1.5 m on a floor and spreads: there is room for all of its blocks from the start."""
    scene = make_scene(frames=40, gravity=(0, -9.81, 0))
    scene.collider("/floor", wsim.Box((3, 0.5, 3)), at=(0, -2.0, 0), static_friction=0.3, dynamic_friction=0.3)
    pour(scene, end=np.inf, rate=20.0, velocity=(0, -2, 0))
    simulation = run(scene, 40)
    assert find_method(simulation).indicators(None, None)["mpm_poured_particles"] > 500
    assert {c.frame for c in simulation.graphs.log} <= {1, 2}


def test_worlds_and_runs_have_the_same_bits():
    def samples(worlds):
        scene = make_scene(gravity=(0, -9.81, 0))
        scene.collider("/floor", wsim.Box((2, 0.5, 2)), at=(0, -1.0, 0))
        pour(scene, velocity=(0, -2, 0))
        simulation = run(scene, 10, worlds=worlds)
        return [simulation.samples(world)[0].positions for world in range(worlds)]
    one, two = samples(1), samples(2)
    assert len(one[0]) and np.array_equal(one[0], two[0]) and np.array_equal(two[0], two[1])


STAGE = '''#usda 1.0
(
 metersPerUnit = 0.01
 upAxis = "Y"
 timeCodesPerSecond = 60
 startTimeCode = 1
 endTimeCode = 9
)
def Cube "spout" (prepend apiSchemas = ["WsimMaterialPointsAPI"]) {
 double size = 20
 color3f[] primvars:displayColor = [(0.5, 0.25, 0.125)]
 double wsim:mpm:cellSize = 5
 uniform token wsim:mpm:material = "sand"
 double wsim:mpm:youngsModulus = 200
 vector3d wsim:mpm:velocity = (0, -200, 0)
 double wsim:mpm:pourStart = 2
 double wsim:mpm:pourEnd = 8
 double wsim:mpm:pourRate = 30
}
def Cube "drain" (prepend apiSchemas = ["WsimMaterialSinkAPI"]) {
 double size = 40
 double3 xformOp:translate = (0, -28, 0)
 uniform token[] xformOpOrder = ["xformOp:translate"]
}
'''


def test_a_stage_runs_reopens_and_restarts_to_the_bit(tmp_path):
    from pxr import Usd, UsdGeom

    from wsim.cli.run import prepare_recorded_run
    (tmp_path / "s.usda").write_text(STAGE)

    def go(output, frames, restart=None):
        scene = replace(wsim.load(str(tmp_path / "s.usda")), frames=frames)
        assert not scene.notes and scene.things("MaterialPoints")[0].pour == Pour(1 / 60, 7 / 60, 30.0)
        job = prepare_recorded_run(scene, str(tmp_path / output), lambda s: wsim.Simulation(s, device="cpu"),
                                   restart=restart and str(tmp_path / restart))
        job.frames()
        return job.simulation
    whole, _ = go("o.usdc", 8), go("half.usdc", 3)
    rest = go("rest.usdc", 8, "half.usdc")
    assert not rest.warnings
    a, b = (find_method(s) for s in (whole, rest))
    assert 0 < a.indicators(None, None)["mpm_taken_particles"] < a.indicators(None, None)["mpm_poured_particles"]
    for field in a.part.kept:
        assert np.array_equal(a.part.arrays[field.name].numpy()[a.part.rows["/spout", 0]],
                              b.part.arrays[field.name].numpy()[b.part.rows["/spout", 0]]), field.name
    stage = Usd.Stage.Open(str(tmp_path / "rest.usdc"))
    drops = UsdGeom.Points(stage.GetPrimAtPath("/spout_drops"))
    (sample,) = whole.samples()
    assert np.allclose(np.array(drops.GetPointsAttr().Get(9)) / 100, sample.positions, atol=1e-5)
    assert np.array_equal(drops.GetIdsAttr().Get(9), sample.ids) and len(drops.GetPointsAttr().Get(2)) == 0
    assert np.allclose(drops.GetDisplayColorPrimvar().Get(9), [[0.5, 0.25, 0.125]])
    wsim.save(wsim.load(str(tmp_path / "s.usda")), str(tmp_path / "again.usda"))
    one, two = (wsim.load(str(tmp_path / name)) for name in ("s.usda", "again.usda"))
    assert one.things("MaterialPoints")[0] == two.things("MaterialPoints")[0]
    assert one.things("MaterialSink")[0] == two.things("MaterialSink")[0]


def test_points_with_widths_pour_as_balls():
    scene = make_scene()
    scene.mpm("/sparks", wsim.PointCloud([(0, 0, 0), (0, 1, 0)], radii=0.06), cell=CELL, material=Water(bulk=1e4), pour=Pour(),
              velocity=(0, 0, 2))
    x = find_method(run(scene, 6)).read_particles(0)["x"]
    assert {round(float(y)) for y in x[:, 1]} == {0, 1} and x[:, 2].max() > 0.1


@pytest.mark.parametrize("more, text", [
    ({"velocity": (0, 0, 0)}, "it pours with the velocity"),
    ({"rate": 1e4}, "carries 192 kg/s at 3 m/s"),
    ({"rate": 0.0}, "it pours 0 kg/s"),
    ({"end": -1.0}, "it pours from 0 s to -1 s"),
    ({"spin": (1, 0, 0)}, "it pours, and has a spin"),
    ({"at": (0, -0.9, 0)}, "it pours into /floor"),
])
def test_bad_sources_get_one_line(more, text):
    scene = make_scene()
    scene.collider("/floor", wsim.Box((2, 0.5, 2)), at=(0, -1.0, 0))
    pour(scene, **more)
    with pytest.raises(wsim.SceneError, match=text) as caught:
        wsim.Simulation(scene, device="cpu")
    assert len(caught.value.problems) == 1 and caught.value.problems[0].path == "/spout"


def test_bodies_that_begin_within_solids_are_named():
    scene = make_scene()
    scene.collider("/floor", wsim.Box((2, 0.5, 2)), at=(0, -1.0, 0))
    scene.mpm("/a", wsim.Sphere(0.2), at=(0, -0.5, 0), cell=CELL, material=Jelly())
    (said,) = wsim.Simulation(scene, device="cpu").warnings
    assert "/a: it begins within /floor: " in said and "up to 0.188 m deep" in said


def test_memory_is_told_before_it_is_taken():
    """3e10 particles: one line with the bytes and the cells that fit, in no time; a check warns of it."""
    scene = make_scene()
    scene.mpm("/a", wsim.Box((5, 5, 5)), cell=0.0065, material="sand")
    (said,) = check_scene(scene)
    assert not said.fatal and "about 3e+10 particles take" in said.text
    with pytest.raises(wsim.SceneError, match=r"/a: about 3e\+10 particles take .* GB, .* fix: give cells of"):
        wsim.Simulation(scene, device="cpu")
