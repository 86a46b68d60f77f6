"""Gradients of free rigid bodies, float64: against differences of order 8 of runs, and against closed forms."""

import numpy as np
import pytest

from tests.make.gradient.bodies import LAST, VALUES, G, bodies, both, placed, recorded, seeds
from wsim.geometry import rotation
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Plane, Scene, SceneError, Sphere
from wsim.simulation.simulation import Simulation

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])      # Fornberg 1988, table 1
STEPS = {"mass": 0.05, "inertia": 0.004}        # moments keep their order


def loss(r: Recording, poses: dict, twists: dict) -> float:
    r.run()
    seen = [(r.poses(f, path), each) for f, by in poses.items() for path, each in by.items()]
    seen += [(r.twists(f, path), each) for f, by in twists.items() for path, each in by.items()]
    return float(sum((M * by).sum() for M, by in seen))


def slope(r: Recording, name: str, way: np.ndarray, poses: dict, twists: dict, step: float) -> float:
    value = inputs_by_name(r, [name])[name]
    base, losses = value.read_value(), []
    for k in (1, 2, 3, 4):
        for sign in (1.0, -1.0):
            value.write_value(base + sign * k * step * way)
            losses.append(loss(r, poses, twists))
    value.write_value(base)
    r.run()
    return float(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step)


@pytest.mark.parametrize("path, name", [(path, name) for path in ("/given", "/boxed") for name in VALUES
                                        if path == "/given" or "drag" not in name])        # below 0 there is no drag
def test_every_value_of_a_body_has_the_slope_of_differences(path, name):
    r, (poses, twists) = both(), seeds(path)
    found = np.asarray(r.backward(poses=poses, twists=twists).value(path, name))
    way = np.random.default_rng(3).normal(size=found.shape) if found.ndim else np.ones(())
    expected = slope(r, f"{path}:{name}", way, poses, twists, STEPS.get(name, 0.02))
    assert float((found * way).sum()) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("which", [0, 1])
def test_what_is_seen_of_a_body_has_the_slope_of_differences(which):
    """Poses alone, then twists alone, at one frame of several, the start among them."""
    r, rng = both(), np.random.default_rng(11)
    for frame in (0, 4):
        given = ({frame: {"/given": rng.normal(size=(4, 4))}}, {}) if which == 0 else ({}, {frame: {
            "/given": rng.normal(size=(2, 3))}})
        found = r.backward(poses=given[0], twists=given[1])
        for name in ("spin", "mass") if which or frame else ():
            by, way = np.asarray(found.value("/given", name)), np.array([0.3, -0.5, 0.8]) if name == "spin" else np.ones(())
            expected = slope(r, f"/given:{name}", way, *given, 0.02)
            assert float((by * way).sum()) == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_gravity_pulls_every_body_and_worlds_apart():
    r = recorded(bodies(), worlds=2)
    found = r.backward(twists={LAST: {("/given", 1): [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]}})
    k, t = 0.3, LAST / 60.0
    assert np.allclose(found.gravity(1), (0.0, 0.0, (1.0 - np.exp(-k * t)) / k), rtol=1e-12) and not found.gravity(0).any()
    assert not np.any(found.value("/given", "velocity", 0)) and np.any(found.value("/given", "velocity", 1))


def test_a_projectile_with_drag_by_its_closed_form():
    """v' = g + F/m - k v: v(t) = v0 e + (g + F/m) (1 - e) / k, e = exp(-k t). Kicks are exact but for (k h / 2)^3 / 24, places
    of second order."""
    m, k, t, F, v0 = 2.0, 0.8, LAST / 60.0, np.array([1.0, 0.0, 4.0]), np.array([3.0, -1.0, 5.0])
    series = (k / 480.0)**3 / 20.0
    r = recorded([Body("/ball", mass=m, center=np.zeros(3), inertia=(1.0, 1.0, 1.0), velocity=v0, force=F, drag=k)])
    way = np.array([0.2, -0.6, 0.9])
    found = r.backward(twists={LAST: {"/ball": [way, np.zeros(3)]}})
    e = np.exp(-k * t)
    value = lambda name: found.value("/ball", name)                                    # noqa: E731
    assert np.allclose(value("velocity"), e * way, rtol=1e-12)
    assert np.allclose(value("force"), (1.0 - e) / k / m * way, rtol=series)
    assert value("mass") == pytest.approx(-(1.0 - e) / k / m**2 * (F @ way), rel=series)
    by_drag = -t * e * v0 + (G + F / m) * (t * e / k - (1.0 - e) / k**2)
    assert value("drag") == pytest.approx(by_drag @ way, rel=1e-6)                     # kicks of a small k h are a series
    place = r.backward(poses={LAST: {"/ball": np.outer([*way, 0.0], (0.0, 0.0, 0.0, 1.0))}})
    exact = (1.0 - e) / k
    assert np.allclose(place.value("/ball", "velocity"), exact * way, rtol=(k / 240.0)**2)


def test_a_spin_that_is_damped_turns_by_its_closed_form():
    """About a principal axis: w = w0 e + T (1 - e) / k I. The angle is the integral."""
    k, moment, t = 0.7, 2.0, LAST / 60.0
    series = (k / 480.0)**3 / 20.0
    r = recorded([Body("/top", mass=1.0, center=np.zeros(3), inertia=(1.0, 1.0, moment), spin=(0.0, 0.0, 3.0),
                       torque=(0.0, 0.0, 0.5), spin_drag=k)])
    e, unit = np.exp(-k * t), np.array([0.0, 0.0, 1.0])
    found = r.backward(twists={LAST: {"/top": [np.zeros(3), unit]}})
    assert found.value("/top", "spin")[2] == pytest.approx(e, rel=1e-12)
    assert found.value("/top", "torque")[2] == pytest.approx((1.0 - e) / k / moment, rel=series)
    assert found.value("/top", "inertia")[2] == pytest.approx(-0.5 * (1.0 - e) / k / moment**2, rel=series)
    M = r.poses(LAST, "/top")
    cross = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    by = np.zeros((4, 4))
    by[:3, :3] = 0.5 * cross @ M[:3, :3]                                                # of the angle
    found = r.backward(poses={LAST: {"/top": by}})
    assert found.value("/top", "spin")[2] == pytest.approx((1.0 - e) / k, rel=(k / 240.0)**2)


def test_a_free_symmetric_top_by_its_closed_form():
    """q(t) = exp(L t / I_1) q exp(-(1/I_1 - 1/I_3) M_3 t e_3): the scheme is exact, and so are derivatives of what is seen:
    those of the formula, by differences of order 8."""
    I1, I3, t, axis = 1.0, 1.8, LAST / 60.0, np.array([0.0, 0.0, 1.0])
    rng, spin = np.random.default_rng(2), np.array([1.0, 2.0, 5.0])
    by, by_spin = rng.normal(size=(4, 4)), rng.normal(size=3)
    by[:, 3] = 0.0

    def seen(w) -> float:
        L = np.array([I1, I1, I3]) * w
        q = rotation.quat_product(rotation.quaternion_exponential(L * t / I1),
                                  rotation.quaternion_exponential((1.0 / I3 - 1.0 / I1) * L[2] * t * axis))
        R = rotation.quaternion_to_matrix(q)
        return float((R * by[:3, :3]).sum() + (R @ ((R.T @ L) / (I1, I1, I3))) @ by_spin)
    r = recorded([Body("/top", mass=1.0, center=np.zeros(3), inertia=(I1, I1, I3), spin=spin)], gravity=(0.0, 0.0, 0.0))
    found = r.backward(poses={LAST: {"/top": by}}, twists={LAST: {"/top": [np.zeros(3), by_spin]}}).value("/top", "spin")
    for k in range(3):
        unit = np.eye(3)[k]
        losses = [seen(spin + sign * j * 0.02 * unit) for j in range(1, 5) for sign in (1, -1)]
        assert found[k] == pytest.approx(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / 0.02, rel=1e-8)


def test_checkpoints_give_the_same_gradient_to_the_bit():
    poses, twists = seeds("/given")
    kept, again = (recorded(bodies(), keep=keep).backward(poses=poses, twists=twists) for keep in ("all", "checkpoints"))
    assert all(np.array_equal(kept.value("/given", name), again.value("/given", name)) for name in VALUES)


def test_float32_has_the_gradient_of_float64():
    """Of half the squares of velocity and spin: sums of 48 steps, four roundings each. Two parts of spin^2 cancel
    with respect to inertia."""
    single, double = (r.backward(twists={LAST: {"/given": r.twists(LAST, "/given")}})
                      for r in (recorded(bodies(), precision=p) for p in ("float32", "float64")))
    for name in VALUES:
        exact = np.asarray(double.value("/given", name))
        size = 4.0**2 if name == "inertia" else np.abs(exact).max()
        assert np.abs(np.asarray(single.value("/given", name)) - exact).max() < 4 * 48 * 2.0**-24 * size


def test_a_recording_goes_where_a_simulation_does():
    scene = Scene(gravity=tuple(G), fps=60.0, substeps=4)
    for body in bodies():
        scene.add(body)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(LAST)
    for k, path in enumerate(("/given", "/boxed")):
        assert np.abs(sim.plan.method("rigid").poses()[k] - both().poses(LAST, path)).max() < 1e-13


def test_mass_and_inertia_are_live_and_leave_the_motion_as_it_is():
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=4)
    for body in bodies():
        scene.add(body)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(2)
    method = sim.plan.method("rigid")
    before = method.poses(), method.velocities(), method.spins()
    sim.set("/given", "inertia", (3.0, 0.5, 2.6))
    sim.set("/given", "mass", 7.0)
    sim.set("/boxed", "mass", 6.0)
    for was, now in zip(before, (method.poses(), method.velocities(), method.spins()), strict=True):
        assert np.abs(was - now).max() < 1e-12
    assert np.allclose(method.masses[0].moments, (0.5, 2.6, 3.0)) and method.masses[0].mass == 7.0
    assert np.allclose(method.masses[1].moments, 2.0 * np.sort([0.25 + 0.81, 0.09 + 0.81, 0.09 + 0.25]))
    with pytest.raises(SceneError, match="inertia is -1"):
        sim.set("/given", "inertia", (1.0, -1.0, 1.0))


def test_a_throw_is_found_from_poses_by_its_gradient():
    """Velocity and spin of a tumbling body from four poses of it, from a start that is 30 % off."""
    minimize = pytest.importorskip("scipy.optimize").minimize
    r = recorded([Body("/thrown", mass=1.0, center=np.zeros(3), inertia=(0.5, 1.0, 1.4), velocity=(2.0, 0.0, 4.0),
                       spin=(1.0, 6.0, 0.5))])
    true = np.array([2.0, 0.0, 4.0, 1.0, 6.0, 0.5])
    frames = (3, 6, 9, 12)
    seen = {f: r.poses(f, "/thrown") for f in frames}
    both = inputs_by_name(r, ["/thrown:velocity", "/thrown:spin"])

    def misfit(theta):
        for value, part in zip(both.values(), (theta[:3], theta[3:]), strict=True):
            value.write_value(part)
        r.run()
        off = {f: r.poses(f, "/thrown") - seen[f] for f in frames}
        g = r.backward(poses={f: {"/thrown": each} for f, each in off.items()})
        return 0.5 * sum((each**2).sum() for each in off.values()), np.concatenate([g.value("/thrown", "velocity"),
                                                                                   g.value("/thrown", "spin")])
    found = minimize(misfit, 0.7 * true, jac=True, method="BFGS", options={"gtol": 1e-10})
    assert np.abs(found.x - true).max() < 1e-7


def test_bodies_that_can_touch_are_refused_with_what_is_allowed():
    scene = Scene()
    scene.collider("/ground", Plane())
    scene.add(Body("/ball", [Collider("/ball/shape", Sphere(0.5))], placed(at=(0.0, 0.0, 3.0))))
    with pytest.raises(SceneError) as said:
        Simulation(scene, device="cpu", gradients=True)
    (problem,) = said.value.problems
    assert problem.path == "/ball" and "/ground" in problem.text and "collisionEnabled" in problem.text


def test_what_is_no_derivative_of_a_body_is_refused():
    for given in ({"poses": {3: {"/given": np.zeros((3, 3))}}}, {"twists": {99: {"/given": np.zeros((2, 3))}}},
                  {"poses": {3: {"/other": np.zeros((4, 4))}}}):
        with pytest.raises(SceneError):
            both().backward(**given)
    with pytest.raises(SceneError, match="take mass"):
        inputs_by_name(both(), ["/given:density"])


def test_a_body_beside_a_cloth_that_it_can_meet_is_refused():
    from wsim.scene import shapes
    scene = Scene()
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 3, 3, horizontal=True))
    scene.add(Body("/ball", [Collider("/ball/shape", Sphere(0.1))], placed(at=(0.0, 0.3, 0.0))))
    with pytest.raises(SceneError, match="/ball: can meet /cloth"):
        Simulation(scene, device="cpu", gradients=True)
