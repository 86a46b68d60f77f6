"""Whole scenes against closed forms, an independent integrator, conservation, and themselves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.make.simulation.simulation import chain, drape
from tools.bench.nets import reference
from wsim.model.stage import Remedy
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Plane, Scene, SceneError, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation import plan as plans
from wsim.simulation import retry
from wsim.simulation.simulation import Simulation

CPU = {"device": "cpu"}
DOUBLE = {"device": "cpu", "precision": "float64"}


def trajectory_error(scene: Scene, where, **options) -> list[float]:
    sim = Simulation(scene, **options)
    sim.run(15)
    first = reference.rms(sim.positions() - where[0])
    sim.run(15)
    return [first, reference.rms(sim.positions() - where[1])]


@pytest.fixture(scope="module")
def small_cloth():
    """Where a cloth of 12 x 12 points is at 0.25 and 0.5 s, by Runge-Kutta in float64."""
    scene = reference.spring_cloth(12)
    where, error = reference.exact(reference.net(scene), [0.25, 0.5], tolerance=1e-7)
    assert error < 1e-7
    return scene, where


def test_a_hanging_chain_has_its_exact_static_stretch():
    scene = chain(10, substeps=10, iterations=20, air_drag=6.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(240)
    lengths = -np.diff(sim.positions()[:, 1])
    exact = reference.chain_stretch(np.full(10, 200.0), np.full(10, 0.01))
    np.testing.assert_allclose(lengths - 0.1, exact, rtol=1e-3)


def test_a_chain_swings_along_itself_at_its_first_frequency():
    stiffness, masses = np.full(8, 200.0), np.full(8, 0.01)
    scene = chain(8, substeps=64, iterations=12, integrator="bdf2", gravity=(0.0, 0.0, 0.0))
    frequency = reference.chain_frequency(stiffness, masses) / (2.0 * np.pi)
    sim = Simulation(scene, **DOUBLE)
    mode = np.sin((np.arange(9)) * np.pi / (2 * 8 + 1))        # first eigenvector of the fixed-free chain
    velocity = np.zeros((9, 3))
    velocity[:, 1] = 1e-3 * mode
    sim.set("/chain", "velocities", velocity)
    start, tip = sim.positions()[-1, 1], []
    for _ in range(150):
        sim.step()
        tip.append(sim.positions()[-1, 1] - start)
    t, tip = np.arange(1, 151) / 60.0, np.array(tip)
    cross = np.flatnonzero((tip[:-1] < 0) & (tip[1:] >= 0))
    zeros = t[cross] - tip[cross] * (t[cross + 1] - t[cross]) / (tip[cross + 1] - tip[cross])
    measured = (len(zeros) - 1) / (zeros[-1] - zeros[0])
    assert measured == pytest.approx(frequency, rel=5e-3)


def test_converged_stiffness_depends_on_neither_substeps_nor_iterations():
    ends = []
    for substeps, iterations in [(5, 60), (10, 30), (20, 30), (10, 60)]:
        sim = Simulation(chain(6, substeps=substeps, iterations=iterations, air_drag=8.0), **DOUBLE)
        sim.run(200)
        ends.append(sim.positions()[-1, 1] + 0.6)
    np.testing.assert_allclose(ends, ends[0], rtol=1e-3)


@pytest.mark.parametrize("integrator, order", [("backward_euler", 1), ("bdf2", 2)])
def test_the_observed_order_is_the_declared_one(small_cloth, integrator, order):
    scene, where = small_cloth
    errors = [trajectory_error(replace(scene, substeps=n, iterations=24, integrator=integrator), where, **DOUBLE)[0]
              for n in (8, 16, 32)]
    slope = np.polyfit(np.log([8, 16, 32]), np.log(errors), 1)[0]
    assert -slope == pytest.approx(order, abs=0.2)


def test_bdf2_follows_runge_kutta_and_float32_follows_float64(small_cloth):
    scene, where = small_cloth
    fine = replace(scene, substeps=16, iterations=16, integrator="bdf2")
    double, single = trajectory_error(fine, where, **DOUBLE), trajectory_error(fine, where, **CPU)
    assert double[0] < 1e-4 and double[1] < 2e-3
    assert single[0] < 1.1 * double[0] and single[1] < 1.1 * double[1]


def test_a_kilometre_from_the_origin_nothing_is_lost(small_cloth):
    scene, where = small_cloth
    fine = {"substeps": 16, "iterations": 16, "integrator": "bdf2"}
    far = replace(reference.spring_cloth(12, at=(1000.0, 300.0, -700.0)), **fine)
    near = trajectory_error(replace(scene, **fine), where, **CPU)
    there = trajectory_error(far, where + np.array([1000.0, 300.0, -700.0]), **CPU)
    assert there[0] < 2 * near[0] and there[1] < 2 * near[1]


def test_small_steps_of_backward_euler_are_as_right_in_float32_as_in_float64(small_cloth):
    scene, where = small_cloth
    fine = replace(scene, substeps=256, iterations=2, integrator="backward_euler")
    double, single = trajectory_error(fine, where, **DOUBLE), trajectory_error(fine, where, **CPU)
    assert single[0] < 1.1 * double[0] and single[1] < 1.1 * double[1]


def lost_momenta(substeps: int) -> tuple[float, float]:
    """Change of linear and angular momentum of a free, shaken cloth after 10 frames, per mass [m/s], [m^2/s]."""
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=substeps, iterations=3)
    points, counts, indices = shapes.sheet(1.0, 1.0, 8, 8)
    scene.cloth("/cloth", points, counts, indices, velocities=np.random.default_rng(3).normal(size=points.shape))
    sim = Simulation(scene, **DOUBLE)
    masses = sim.model.stack("masses")[sim.model.body("/cloth").index]

    def momenta():
        x, v = sim.positions(), sim.velocities()
        return np.stack([masses @ v, (masses[:, None] * np.cross(x, v)).sum(axis=0)])
    before = momenta()
    sim.run(10)
    linear, angular = np.abs(momenta() - before).max(axis=1) / masses.sum()
    return linear, angular


def test_momentum_of_a_free_cloth_is_kept():
    """The linear one exactly; backward Euler loses the angular one at first order in the substep."""
    lost = np.array([lost_momenta(n) for n in (4, 8, 16, 32, 64)])
    assert lost[:, 0].max() < 1e-12
    slope = np.polyfit(np.log([4, 8, 16, 32, 64]), np.log(lost[:, 1]), 1)[0]
    assert -slope == pytest.approx(1.0, abs=0.15)


def test_two_runs_have_the_same_bits():
    ends = []
    for _ in range(2):
        sim = Simulation(drape(), **CPU)
        sim.run(20)
        ends.append(sim.positions())
    assert np.array_equal(*ends)


def test_replay_is_what_launches_are():
    captured, launched = Simulation(drape(), **CPU), Simulation(drape(), **CPU)
    captured.run(5)
    launched.load()
    for _ in range(5):
        launched.plan.before_frame(launched.time)
        launched.plan.frame()
        launched.frame += 1
    assert np.array_equal(captured.positions(), launched.positions())


def test_worlds_are_copies():
    alone, many = Simulation(drape(), **CPU), Simulation(drape(), worlds=3, **CPU)
    alone.run(15)
    many.run(15)
    for world in range(3):
        assert np.array_equal(many.positions("/cloth", world=world), alone.positions())


def test_the_author_s_order_does_not_matter():
    points, counts, indices = shapes.sheet(1.0, 1.0, 10, 10, horizontal=True)
    shuffle = np.random.default_rng(0).permutation(len(points))
    name = np.argsort(shuffle)
    ends = []
    for p, i, back in ((points, indices, slice(None)), (points[shuffle], name[indices], name)):
        scene = Scene(solver="xpbd", fps=60.0, substeps=32, iterations=40)
        cloth = scene.cloth("/cloth", p, counts, i, material=Fabric(stretch=300.0))
        scene.pin("/pin", cloth, [int(np.flatnonzero((p == points[k]).all(axis=1))[0]) for k in range(11)])
        sim = Simulation(scene, **DOUBLE)
        sim.run(10)
        ends.append(sim.positions()[back])
    np.testing.assert_allclose(*ends, atol=1e-12)                   # sweeps leave 1e-16: both are the solution


def test_a_moving_pin_carries_its_points():
    scene = chain(3, substeps=4)
    turn = np.eye(4)
    turn[:3, 3] = (0.5, 0.2, 0.0)
    scene.pins[0].motion = Motion([0.0, 0.25], np.stack([np.eye(4), turn]))
    sim = Simulation(scene, **CPU)
    sim.run(8)
    np.testing.assert_allclose(sim.positions()[0], (0.5 * 8 / 15, 0.2 * 8 / 15, 0.0), atol=1e-6)
    np.testing.assert_allclose(sim.velocities()[0], (2.0, 0.8, 0.0), rtol=1e-4)


def test_a_soft_pin_is_a_spring():
    scene = Scene(solver="xpbd", fps=60.0, substeps=8, iterations=2, air_drag=10.0)
    net = scene.net("/net", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [1.0e3], [0.1])
    scene.pin("/hold", net, [0, 1], stiffness=50.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(240)
    np.testing.assert_allclose(sim.positions()[:, 1], -0.1 * 9.81 / 50.0, rtol=1e-3)


def test_live_parameters_act_without_rebuilding():
    scene = chain(4, substeps=10, iterations=10, air_drag=8.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(150)
    plan, soft = sim.plan, sim.positions()[-1, 1] + 0.4
    sim.set("/chain", "stiffness", 400.0)
    sim.run(150)
    assert sim.positions()[-1, 1] + 0.4 == pytest.approx(soft / 2, rel=5e-3)
    sim.set("/", "gravity", (0.0, 0.0, 0.0))
    sim.run(150)
    assert sim.positions()[-1, 1] + 0.4 == pytest.approx(0.0, abs=1e-4)
    assert sim.plan is plan
    with pytest.raises(SceneError, match="no live parameter 'colour'"):
        sim.set("/chain", "colour", 1.0)


def test_reset_goes_back_to_the_start():
    sim = Simulation(drape(), **CPU)
    start = sim.positions()
    sim.run(6)
    first = sim.positions()
    sim.reset()
    assert np.array_equal(sim.positions(), start)
    sim.run(6)
    assert np.array_equal(sim.positions(), first)


@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
def test_a_restart_from_the_fields_is_exact(integrator):
    scene = drape(integrator=integrator)
    through = Simulation(scene, **CPU)
    through.run(6)
    fields = {"/cloth": through.fields("/cloth")}
    through.run(6)
    again = Simulation(scene, **CPU)
    again.restart(6, fields)
    again.run(6)
    assert np.array_equal(again.positions(), through.positions())


def test_device_arrays_are_the_state_itself():
    sim = Simulation(drape(), **CPU)
    sim.step()
    array, index = sim.positions(device=True)
    assert array is sim.state.x
    body = sim.model.body(None)
    np.testing.assert_allclose(array.numpy()[index] + body.origin, sim.positions(), atol=1e-6)


def test_a_frame_that_is_no_number_is_repeated_then_named():
    sim = Simulation(chain(3), **CPU)
    sim.step()
    bad = sim.state.v.numpy()
    bad[2] = np.inf
    sim.state.v.assign(bad)
    with pytest.raises(SceneError, match="/chain: point .* stopped being a number in frame 2"):
        sim.step()
    assert sim.frame == 1


def test_bdf2_gives_way_when_its_residual_is_missed():
    n = 24
    scene = replace(reference.spring_cloth(n, stretch=1.0e5, diagonal=1.0e5), substeps=16, iterations=1, integrator="bdf2")
    sim = Simulation(scene, **CPU)
    sim.run(40)
    assert not sim.plan.clock.watched and any("BDF2" in w for w in sim.warnings)
    end = sim.indicators()                           # it started at rest at height 0
    assert end["kinetic_energy"] + end["gravity_energy"] < 0.0


def test_the_midpoint_gives_way_when_its_residual_is_missed():
    """A stiff net, scattered, with a single sweep: doubled again and again, what is left would grow without end."""
    scene = replace(reference.spring_cloth(12, stretch=1.0e6, diagonal=1.0e6), substeps=2, iterations=1,
                    integrator="implicit_midpoint")
    sim = Simulation(scene, **CPU)
    path = sim.model.bodies[0].path
    sim.set(path, "positions", sim.positions() + 0.02 * np.random.default_rng(0).normal(size=(144, 3)))
    assert sim.plan.integrator == "implicit_midpoint"
    before = sim.indicators()["energy"]
    sim.run(40)
    assert sim.plan.integrator == "backward_euler" and sum("the implicit midpoint needs" in w for w in sim.warnings) == 1
    assert sim.indicators()["energy"] < before


def test_the_midpoint_stays_where_its_residual_is_met():
    sim = Simulation(chain(3, substeps=8, iterations=60, integrator="implicit_midpoint"), **CPU)
    sim.set("/chain", "positions", sim.positions() + 0.05 * np.arange(4.0)[:, None] * [1.0, 0.0, 0.0])
    sim.run(30)
    assert sim.plan.integrator == "implicit_midpoint" and not any("residual that" in w for w in sim.warnings)


def test_a_frame_that_lacked_room_is_repeated_before_an_integrator_gives_way():
    """Which contacts there was no room for is chance, and so is what they would have left."""
    sim = Simulation(chain(3, substeps=8, iterations=60, integrator="implicit_midpoint"), **CPU)
    said = [Remedy("grow", lambda: "8 pairs were near, and there was room for 4"), Remedy("give way")]
    sim.plan.methods[0].find_remedies = lambda status: said
    assert retry.prepare_frame_retry(sim) and sim.plan.integrator == "implicit_midpoint"
    said[0] = Remedy("grow", lambda: "")
    assert retry.prepare_frame_retry(sim) and sim.plan.integrator == "backward_euler"


def test_more_contacts_than_room_repeat_the_frame():
    scene = Scene(solver="xpbd", fps=60.0, substeps=4)
    net = scene.net("/net", [[0, 0.05, 0], [0.1, 0.05, 0]], [[0, 1]], [100.0], [0.1], radius=0.02)
    for k in range(5):
        turned = np.eye(4)
        turned[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
        scene.collider(f"/floor{k}", Plane(), motion=Motion.still(turned))
    sim = Simulation(scene, **CPU)
    sim.run(30)
    assert any("repeated" in w for w in sim.repeats) and not sim.warnings
    assert net.radius == pytest.approx(sim.positions()[:, 1].min(), abs=1e-5)


def test_what_a_scene_lacks_is_neither_planned_nor_allocated():
    sim = Simulation(chain(3), **CPU)
    assert [m.name for m in sim.plan.methods] == ["points", "pins", "xpbd", "watch", "balance"]
    assert not sim.state.has_point_field("a") and not sim.state.has_point_field("s")
    left_out = {s["stage"] for s in sim.plan.skipped}
    assert {"aero", "contact", "history", "gradients"} <= left_out


@pytest.mark.parametrize("options, text", [
    ({"device": "cuda:99"}, "there is no device 'cuda:99'"), ({"precision": "half"}, "allowed are float32, float64"),
    ({"worlds": 0}, "allowed is a whole number, 1 to")])
def test_wrong_options_are_named(options, text):
    with pytest.raises(SceneError, match=text):
        Simulation(chain(2), **options)


def test_out_of_memory_in_a_frame_is_said_in_words():
    sim = Simulation(chain(2), **CPU)

    def full(sim):
        raise RuntimeError("Failed to allocate 12000000 bytes on device 'cuda:0'")
    sim.host.before_frame = full
    with pytest.raises(SceneError, match="out of memory .*12000000.*use a smaller scene"):
        sim.step()


def test_what_a_graph_cannot_hold_is_not_called_lack_of_memory():
    sim = Simulation(chain(2), **CPU)

    def unsupported(sim):
        raise RuntimeError("Conditional body graph contains an unsupported operation (memory allocation)")
    sim.host.before_frame = unsupported
    with pytest.raises(RuntimeError, match="unsupported operation"):
        sim.step()


def test_worlds_have_their_own_parameters():
    sim = Simulation(chain(4, substeps=10, iterations=10, air_drag=8.0), worlds=3, **DOUBLE)
    sim.set("/", "gravity", (0.0, -4.905, 0.0), world=1)
    sim.set("/chain", "stiffness", 400.0, world=2)
    sim.run(200)
    first, light, stiff = (sim.positions("/chain", world=w)[-1, 1] + 0.4 for w in range(3))
    assert light == pytest.approx(first / 2, rel=5e-3) and stiff == pytest.approx(first / 2, rel=5e-3)
    here = sim.positions("/chain", world=1)
    sim.set("/chain", "positions", here + 1.0, world=1)
    np.testing.assert_allclose(sim.positions("/chain", world=1), here + 1.0, rtol=1e-12)
    assert sim.positions("/chain", world=0)[0, 1] == 0.0
    with pytest.raises(SceneError, match="in world 7 of 3"):
        sim.set("/chain", "stiffness", 1.0, world=7)


@pytest.mark.parametrize("bodies, more, where", [
    (3, {}, "cpu"), (49, {}, "gpu"), (3, {"worlds": 17}, "gpu"), (3, {"name": "gpu"}, "gpu"), (3, {"gradients": True}, "gpu"),
    (3, {"cloth": True}, "gpu"), (0, {}, "gpu")])
def test_few_rigid_bodies_alone_take_the_cpu_unless_a_device_is_named(monkeypatch, bodies, more, where):
    devices = {"cpu": SimpleNamespace(is_cuda=False), "gpu": SimpleNamespace(is_cuda=True)}
    monkeypatch.setattr(plans.kernel_cache, "warp_device", lambda name: devices[name or "gpu"])
    scene = Scene()
    for k in range(bodies):
        scene.add(Body(f"/ball{k}", [Collider(f"/ball{k}/shape", Sphere(1.0))]))
    if more.get("cloth"):
        scene.net("/net", np.eye(3), [[0, 1]], [1.0], [1.0])
    found = plans.choose_device(more.get("name"), scene, more.get("worlds", 1), more.get("gradients", False))
    assert found is devices[where]
