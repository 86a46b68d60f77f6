"""Colliders that throw back: parabolas and bounces in closed form, energy, rest, sensitivities, USD.

A ball is a net of two points 1 m apart whose spring has its rest length: each moves as a free point, exactly."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import Run
from tests.make.physics.contact.restitution import UP, G, ball, bounced, cube, run
from wsim.gradient.recording import Recording
from wsim.kernels.contact import project
from wsim.kernels.contact import restitution as kernels
from wsim.kernels.motion.points import point_constants
from wsim.model.structs import fill_struct
from wsim.scene import Box, Scene, SceneError, Sphere, shapes
from wsim.scene.check import scene as check
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

EXACT = ["leapfrog", "midpoint", "rk4"]
IMPLICIT = [("xpbd", "backward_euler", 1), ("implicit", "backward_euler", 1), ("xpbd", "bdf2", 2), ("implicit", "bdf2", 2)]


@pytest.mark.parametrize("integrator", EXACT)
def test_three_bounces_follow_the_parabolas_to_rounding(integrator):
    sim, found = run(ball(v=(0.3, 0.25, 0.0), integrator=integrator), 118)
    exact = np.array([bounced((k + 1) / 60, 1.0, 0.25, 0.8) for k in range(118)])
    assert exact[-1, 2] == 3
    np.testing.assert_allclose(found, exact[:, :2], atol=1e-12)
    assert sim.positions()[0, 0] == pytest.approx(0.3 * 118 / 60, abs=1e-12)


@pytest.mark.parametrize("shape", [Box((4.0, 4.0, 4.0)), cube(4.0)])
def test_other_flat_floors_do_the_same(shape):
    _, found = run(ball(shape=shape), 118)
    np.testing.assert_allclose(found, [bounced((k + 1) / 60, 1.0, 0.0, 0.8)[:2] for k in range(118)], atol=1e-9)


def test_each_bounce_keeps_e_squared_of_the_energy():
    _, found = run(ball(e=0.7), 110)
    energy = (found[:, 0] * G + 0.5 * found[:, 1] ** 2) / G
    count = [bounced((k + 1) / 60, 1.0, 0.0, 0.7)[2] for k in range(110)]
    assert count[-1] == 3
    np.testing.assert_allclose(energy, 0.49 ** np.array(count), rtol=1e-12)


@pytest.mark.parametrize("solver, integrator, order", [*IMPLICIT, ("explicit", "symplectic_euler", 1)])
def test_others_converge_with_their_order(solver, integrator, order):
    def error(substeps):
        _, found = run(ball(solver=solver, integrator=integrator, substeps=substeps), 118)
        exact = [bounced((k + 1) / 60, 1.0, 0.0, 0.8)[0] for k in range(118)]
        return np.sqrt(np.mean((found[:, 0] - exact) ** 2))
    coarse, fine = error(8), error(32)
    assert np.log(coarse / fine) / np.log(4) == pytest.approx(order, abs=0.15) and coarse < 0.02


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("solver, integrator", [("explicit", "leapfrog"), ("explicit", "symplectic_euler"),
                                                *((s, i) for s, i, _ in IMPLICIT)])
def test_a_ball_comes_to_rest(solver, integrator, precision):
    ulp = 1e-8 if precision == "float32" else 1e-16
    for e in (0.3, 0.8):
        _, found = run(ball(e=e, height=0.05, solver=solver, integrator=integrator), 260, precision=precision)
        assert np.abs(found[200:]).max() < ulp


def test_a_bat_gives_the_ball_its_own_speed_and_that_of_the_approach():
    """u + e (u + v): from below at 3 m/s, without gravity; the ball comes at 2.1 m/s and they meet after 1 / 5.1 s."""
    keys = np.stack([UP, UP])
    keys[1, 1, 3] = 3.0
    _, found = run(ball(e=0.6, v=(0.0, -2.1, 0.0), gravity=(0.0, 0.0, 0.0), motion=Motion([0.0, 1.0], keys)), 30)
    t, meet, v, away = np.arange(1, 31) / 60, 1 / (3.0 + np.float32(2.1)), np.float32(2.1), 3.0 + 0.6 * (3.0 + np.float32(2.1))
    np.testing.assert_allclose(found[:, 1], np.where(t < meet, -v, away), atol=1e-12)
    np.testing.assert_allclose(found[:, 0], np.where(t < meet, 1.0 - v * t, 3.0 * meet + away * (t - meet)), atol=1e-12)


def test_the_floor_receives_the_impulse_of_the_bounce():
    sim = Simulation(ball(e=0.5, height=0.01, v=(0, -3.0, 0), gravity=(0, 0, 0), substeps=1), device="cpu", precision="float64")
    sim.step()
    push = sim.plan.method("contact").contacts.impulses(1 / 60)["/floor"]
    np.testing.assert_allclose(push, (0, -2 * 0.25 * 1.5 * 3.0, 0), atol=1e-12)


def thrown_sheet(e, solver, integrator, substeps=32, fps=60.0, bend=1e-5):
    scene = Scene(fps=fps, substeps=substeps, solver=solver, integrator=integrator, gravity=(0, 0, 0))
    points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8)
    flat = np.array(points, float) - np.mean(points, axis=0)
    flat = np.insert(flat[:, np.ptp(flat, axis=0) > 0], 1, 0.0, axis=1)
    scene.cloth("/cloth", flat, counts, indices, model="springs", velocities=np.tile([0.3, -2.0, 0.1], (len(flat), 1)),
                material=Fabric(stretch=50.0, shear=20.0, bend=bend, static_friction=0.0, dynamic_friction=0.0))
    scene.collider("/ball", Sphere(0.15), at=(0.02, -0.16, 0.01), thickness=0.0, restitution=e, static_friction=0.0,
                   dynamic_friction=0.0)
    return scene


def energies(scene, frames):
    sim = Simulation(scene, device="cpu", precision="float64")
    start = 0.5 * sim.model.stack("masses").sum() * (0.3**2 + 2.0**2 + 0.1**2)
    found = [1.0]
    for _ in range(frames):
        sim.step()
        found.append(sim.indicators()["energy"] / start)
    assert sim.indicators()["penetration"] == 0.0
    return np.array(found)


@pytest.mark.parametrize("solver, integrator, swing", [("explicit", "leapfrog", 5e-3), *((s, i, 0.0) for s, i, _ in IMPLICIT)])
def test_a_sheet_thrown_at_a_sphere_never_gains_energy(solver, integrator, swing):
    """Leapfrog's energy swings by parts of (h omega)^2 and comes back, though the sheet crumples and folds through itself; the
    others damp."""
    substeps = 64 if solver == "explicit" else 32
    for e in (0.5, 1.0):
        found = energies(thrown_sheet(e, solver, integrator, substeps), 40)
        assert found.max() <= 1.0 + 0.2 * swing and np.diff(found).max() <= swing
        assert found[-1] > 0.99 or e < 1.0 or solver != "explicit"         # nothing is lost by e = 1


def test_a_sheet_loses_what_its_impacts_take_and_no_more():
    """m (1 - e^2) S^2 / 2 each; S from the impulse (1 + e) m S. What is pressed slowly loses all of its speed."""
    e, substeps = 0.5, 2400
    sim = Simulation(thrown_sheet(e, "explicit", "leapfrog", 1, substeps), device="cpu", precision="float64")
    masses, method = sim.model.stack("masses"), sim.plan.method("contact")
    start, lost, slow = 0.5 * masses.sum() * (0.3**2 + 2.0**2 + 0.1**2), 0.0, 0.0
    for _ in range(900):
        sim.step()
        count = method.contacts.slots.count.numpy() > 0
        if count.any():
            change = np.linalg.norm(method.contacts.push.numpy()[:len(masses)], axis=1) * count * substeps
            thrown = np.linalg.norm(method.bounce.normal.numpy(), axis=1) > 0.5
            lost += 0.5 * np.sum((masses * (1 - e * e) * (change / (1 + e)) ** 2)[thrown])
            slow += 0.5 * np.sum((masses * change**2)[~thrown])
    drop = start - sim.indicators()["energy"]
    assert drop > 0.2 * start and slow < 0.1 * drop
    assert lost - 0.02 * start < drop < lost + slow + 0.02 * start


def sensitivities(integrator, frames, solver="explicit"):
    """(rows of values, found) of the derivatives of height and velocity by initial height, initial velocity and gravity."""
    substeps = 3 if solver == "explicit" else 8
    sim = Simulation(ball(v=(0.0, 0.25, 0.0), solver=solver, integrator=integrator, substeps=substeps), device="cpu",
                     precision="float64", gradients=True)
    recording = Recording(sim, frames)
    recording.run()
    one, none, found, t, i = np.zeros((2, 3)), np.zeros((2, 3)), [], frames / 60, 1e-30j
    one[0, 1] = 1.0
    for x, v in ((one, none), (none, one)):
        by = recording.backward({frames: {"/ball": x}}, {frames: {"/ball": v}})
        found.append([by.positions("/ball")[:, 1].sum(), by.velocities("/ball")[:, 1].sum(), -by.gravity()[1]])
    exact = [bounced(t, 1.0 + i, 0.25, 0.8), bounced(t, 1.0, 0.25 + i, 0.8), bounced(t, 1.0, 0.25, 0.8, G + i)]
    return np.array([[b[k].imag / 1e-30 for b in exact] for k in (0, 1)]), np.array(found), exact[0][2]


@pytest.mark.parametrize("integrator, frames, bounces", [("leapfrog", 60, 1), ("leapfrog", 90, 2), ("leapfrog", 118, 3),
                                                         ("midpoint", 118, 3), ("rk4", 118, 3)])
def test_sensitivities_are_those_of_the_motion(integrator, frames, bounces):
    expected, found, count = sensitivities(integrator, frames)
    assert count == bounces
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_sensitivities_of_xpbd_are_of_first_order():
    expected, found, _ = sensitivities("backward_euler", 60, "xpbd")
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize("solver, integrator", [("explicit", "leapfrog"), ("xpbd", "backward_euler"), ("xpbd", "bdf2")])
def test_a_sheet_thrown_at_a_sphere_has_the_gradients_of_its_scheme(solver, integrator):
    """Differences of steps of 1e-8 m, within which no list and no branch changes."""
    run = Run(replace(thrown_sheet(0.6, solver, integrator), iterations=10 if integrator == "bdf2" else 4), frames=4)
    assert np.abs(run.recording.velocities(4)[:, 1]).max() > 0.5 and run.recording.velocities(4)[:, 1].max() > 0.0
    for name, step in (("positions", 1e-8), ("velocities", 1e-6)):
        start = getattr(run.recording, name)(0, "/cloth")
        way = np.random.default_rng(6).normal(size=start.shape)
        found = (getattr(run.gradient, name)("/cloth") * way).sum()
        run.check(found, lambda s, start=start, way=way, name=name: ("/cloth", name, start + s * way), step, 1e-6)


def device(rng, **lengths):
    return {name: wp.array(rng.normal(size=(n, 3)), dtype=wp.vec3d, device="cpu", requires_grad=True)
            for name, n in lengths.items()}


@pytest.mark.parametrize("free", [True, False])
def test_the_kernel_alone_differentiates(free):
    """50 points, two contacts each, random; loss linear in what is written; against central differences of 1e-6."""
    rng, n = np.random.default_rng(3), 50
    real, module = wp.float64, f"test_bounce_{free}_adjoint"
    kernel = (kernels.explicit_restitution_kernel if free else kernels.implicit_restitution_kernel)(real, module)
    s, c, k = project.slot_type(real)(), kernels.bounce_type(real)(), point_constants(real)()
    a = device(rng, push=2 * n, d=n, a=n, e=n, v=n, pair=4 * n, n=2 * n, u=2 * n, gravity=n)
    b = wp.array(rng.uniform(0.3, 0.5, 2 * n), dtype=real, device="cpu", requires_grad=True)
    normals = a["n"].numpy() / np.linalg.norm(a["n"].numpy(), axis=1)[:, None]
    a["n"].assign(normals)
    a["push"].assign(0.3 * normals + 0.1 * a["push"].numpy())
    for name in ("d", "a", "e", "u"):
        a[name].assign(0.01 * a[name].numpy())
    toward = -3.0 * normals.reshape(2, n, 3).sum(0)                       # per second; h = 0.3 s
    a["v"].assign(toward + 0.1 * a["v"].numpy())
    a["pair"].assign(np.concatenate([0.3 * toward, 0.3 * toward, toward, toward]) + 0.02 * a["pair"].numpy())
    ints = dict(count=np.full(n, 2), mark=np.zeros(n), row=rng.integers(0, 2, 2 * n), wanted=[0], site=[], tie=[])
    for name, values in ints.items():
        setattr(s, name, wp.array(np.array(values, np.int32), dtype=int, device="cpu"))
    s.points, s.capacity, s.n, s.b, s.u = n, 2, a["n"], b, a["u"]
    c.restitution, c.h, c.g, c.source, c.bend = wp.array([[0.5], [0.9]], dtype=real, device="cpu"), 0.3, 0.3, 0, 2.0
    k.gravity, k.w = a["gravity"], wp.ones(n, dtype=real, device="cpu")
    k.object, now = (wp.array(np.arange(m), dtype=int, device="cpu") for m in (n, 0))
    k.decay = wp.array(rng.uniform(0, 0.1, n), dtype=real, device="cpu", requires_grad=True)
    outs = {"d": n, "a": n, "push": 2 * n, "normal": n}
    weight = {name: rng.normal(size=(m, 3)) for name, m in outs.items()}
    at = fill_struct(project.read_type(real), x=a["d"], now=now, **{name: a[name] for name in ("v", "e", "d", "a", "push")})
    given = [c, s, at, a["pair"]] if free else [c, k, s, at]
    into = [wp.zeros(m, dtype=wp.vec3d, device="cpu", requires_grad=True) for m in outs.values()]
    if not free:
        into[3] = None

    def loss():
        for array in into:
            array and array.zero_()
        wp.launch(kernel, n, given, into, device="cpu")
        return sum((array.numpy() * weight[name]).sum() for name, array in zip(outs, into, strict=True) if array)
    with wp.Tape() as tape:
        loss()
    hit = np.linalg.norm(into[0].numpy(), axis=1) > 0
    assert 0.3 < hit.mean() < 1.0
    tape.backward(grads={array: wp.array(weight[name], dtype=wp.vec3d, device="cpu")
                         for name, array in zip(outs, into, strict=True) if array})
    for name, array in {**a, "b": b}.items():
        grad, start, way = array.grad.numpy().copy(), array.numpy().copy(), rng.normal(size=array.numpy().shape)
        ends = []
        for step in (1e-6, -1e-6):
            array.assign(start + step * way)
            ends.append(loss())
        array.assign(start)
        assert (grad * way).sum() == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6, abs=1e-7), name


def test_without_restitution_nothing_of_it_is_planned_or_compiled():
    plain, thrown = (Simulation(ball(e=e), device="cpu") for e in (0.0, 0.5))
    assert plain.model.module != thrown.model.module
    for sim, wanted in ((plain, False), (thrown, True)):
        sim.step()
        assert any("bounce" in key for key in wp.get_module(sim.model.module).kernels) == wanted
        assert ("bounce" in [row["name"] for row in sim.plan.table()]) == wanted


@pytest.mark.parametrize("e", [-0.1, 1.1, np.nan])
def test_restitution_is_a_number_from_0_to_1(e):
    problems = [p for p in check.check_scene(ball(e=e)) if p.fatal]
    assert [p.path for p in problems] == ["/floor"] and "restitution is" in problems[0].text


def test_usd_keeps_restitution(tmp_path):
    scene = ball(e=0.35)
    scene.collider("/other", Sphere(0.5), at=(3.0, 0, 0), static_friction=0.0, dynamic_friction=0.0)
    save(scene, tmp_path / "ball.usda")
    text = (tmp_path / "ball.usda").read_text()
    assert text.count("float physics:restitution = 0.35") == 1
    assert [c.restitution for c in load(tmp_path / "ball.usda").colliders] == [0.35, 0.0]
    assert load(tmp_path / "ball.usda") == scene
    (tmp_path / "wrong.usda").write_text(text.replace("restitution = 0.35", "restitution = 1.5"))
    with pytest.raises(SceneError, match="physics:restitution is 1.5; allowed is 0 to 1"):
        load(tmp_path / "wrong.usda")
