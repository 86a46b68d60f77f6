"""Gradients of rigid bodies through contacts that are solved to a residual, float64: against differences of order 8 of runs,
and closed forms of sliding, rolling, bouncing."""

import tracemalloc
from functools import cache

import numpy as np
import pytest

from tests.make.gradient.rigid.contacts import LAST, SCENES, G, body, ground
from wsim.gradient.checkpoints import host_bytes
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.scene import Box, Scene, SceneError, Sphere
from wsim.simulation.simulation import Simulation

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])      # Fornberg 1988, table 1


NAMES = ("/a:velocity", "/a:spin", "/a:mass", "/a:inertia", "/a:force", "/a:torque", "/a:dynamic_friction", "gravity")


def recording(scene: Scene, frames: int = LAST, **more) -> Recording:
    return Recording(Simulation(scene, **{"device": "cpu", "precision": "float64", "gradients": True} | more), frames)


@cache
def recorded(kind: str) -> Recording:
    return recording(SCENES[kind]())


def paths(r: Recording) -> list[str]:
    return [each.path for each in r.sim.scene.things("Body")]


def seeds(r: Recording) -> tuple[dict, dict]:
    rng = np.random.default_rng(7)
    return ({LAST: {p: rng.normal(size=(4, 4)) for p in paths(r)}},
            {f: {p: 0.1 * rng.normal(size=(2, 3)) for p in paths(r)} for f in (LAST - 2, LAST)})


def loss(r: Recording) -> float:
    r.run()
    poses, twists = seeds(r)
    return float(sum((r.poses(f, p) * M).sum() for f, by in poses.items() for p, M in by.items())
                 + sum((r.twists(f, p) * M).sum() for f, by in twists.items() for p, M in by.items()))


def slopes(r: Recording, gradient, name: str, step: float) -> tuple[float, float]:
    value = inputs_by_name(r, [name])[name]
    base = value.read_value()
    found = value.gradient(gradient, 0, base.shape)
    way, losses = np.random.default_rng(3).normal(size=base.shape) if base.ndim else np.ones(()), []
    step *= float(np.abs(base).max()) or 1.0
    for k in (1, 2, 3, 4):
        for sign in (1.0, -1.0):
            value.write_value(base + sign * k * step * way)
            losses.append(loss(r))
    value.write_value(base)
    r.run()
    return float((found * way).sum()), float(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in SCENES if kind != "stack"])
def test_every_contact_has_the_slope_of_differences(kind):
    """Residuals of 1e-12 m/s (1e-9 where many points stick), by steps of 2e-5, or 1e-3: what differences tell. The box that
    tumbles lands on one more corner if it is turned by 2e-5, a jump of the loss by 1e-8: steps of 2e-6."""
    r = recorded(kind)
    r.run()
    poses, twists = seeds(r)
    gradient = r.backward(poses=poses, twists=twists)
    sticks, step = kind == "box on box", {"box on box": 2e-3, "tumbling box": 2e-6}.get(kind, 2e-5)
    assert r.bodies.left < (5e-9 if sticks else 1e-11)
    for name in NAMES if kind != "tumbling box" else [name for name in NAMES if "friction" not in name]:
        name = name.replace("/a", "/b") if sticks else name                     # the one that slides
        found, expected = slopes(r, gradient, name, step)
        size = max(abs(expected), 1.0 if name == "gravity" else 0.01)
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-7 * size), name


@pytest.mark.slow
def test_a_stack_at_rest_has_the_slope_of_differences():
    """What is pushed a little stays where it is: a slope of places by a velocity, of 4e-6 s, is what sticking gives way by.
    Residuals of 5e-10 m/s and steps of 1e-3 m/s tell that to 5e-9 s."""
    r = recorded("stack")
    r.run()
    by = {LAST: {p: np.outer([0.3, -0.5, 0.8, 0.0], (0.0, 0.0, 0.0, 1.0)) for p in paths(r)}}
    gradient = r.backward(poses=by)
    for name in ("/box1:velocity", "/box2:force", "gravity"):
        value = inputs_by_name(r, [name])[name]
        base, way, losses = value.read_value(), np.array([0.2, -0.6, 0.4]), []
        found, step = value.gradient(gradient, 0, base.shape), 1e-3
        for sign in (1.0, -1.0):
            value.write_value(base + sign * step * way)
            r.run()
            losses.append(sum((r.poses(LAST, p) * M).sum() for p, M in by[LAST].items()))
        value.write_value(base)
        r.run()
        assert float(found @ way) == pytest.approx((losses[0] - losses[1]) / (2.0 * step), rel=1e-5, abs=5e-9), name


def test_a_box_slides_by_its_friction():
    """v = v0 - mu g t: the speed at t has -g t by mu, which is the mean of both, and 1 by v0."""
    r = recorded("sliding box")
    r.run()
    t, way = LAST / 60.0, np.array([3.0, 0.4, 0.0]) / np.hypot(3.0, 0.4)
    found = r.backward(twists={LAST: {"/a": [way, np.zeros(3)]}})
    assert found.value("/a", "dynamic_friction") == pytest.approx(-0.5 * G * t, rel=1e-9)
    assert found.value("/floor", "dynamic_friction") == pytest.approx(-0.5 * G * t, rel=1e-9)
    assert found.value("/a", "velocity") @ way == pytest.approx(1.0, rel=1e-9)
    assert found.value("/a", "mass") == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_a_box_that_has_come_to_rest_has_slid_as_far_as_it_was_fast():
    """x = v0^2 / 2 mu g of a small box, and v0 / mu g by v0: the step ends it within h v0."""
    mu, v0, frames = 0.3, 0.5, 15
    tile = body("/a", Box((0.02, 0.02, 0.005)), (0.0, 0.0, 0.005 - 1e-9), velocity=(v0, 0.0, 0.0))
    r = recording(ground(tile, substeps=16), frames)
    r.run()
    assert abs(r.twists(frames, "/a")[0, 0]) < 1e-9
    found = r.backward(poses={frames: {"/a": np.outer((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))}})
    late = 1.0 / 960.0 / (v0 / (mu * G))
    assert found.value("/a", "velocity")[0] == pytest.approx(v0 / (mu * G), rel=2.0 * late)
    both = found.value("/a", "dynamic_friction") + found.value("/floor", "dynamic_friction")
    assert both == pytest.approx(-v0**2 / (2.0 * mu**2 * G), rel=4.0 * late)


@pytest.mark.parametrize("height", [0.2, *(pytest.param(height, marks=pytest.mark.slow) for height in (0.237, 0.251))])
def test_a_ball_bounces_when_it_comes(height):
    """z = e u (T - t) - g (T - t)^2 / 2 with u = sqrt(2 g H), t = u / g: by H, by e and by g, whatever the step."""
    e, T = 0.6, 20 / 60.0
    r = recording(ground(body("/a", Sphere(0.1), (0.0, 0.0, 0.1 + height), bounce=e)), 20)
    r.run()
    by = np.outer((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    found = r.backward(poses={20: {"/a": by}})
    u, t = np.sqrt(2.0 * G * height), np.sqrt(2.0 * height / G)
    s = T - t
    assert r.poses(20, "/a")[2, 3] - 0.1 == pytest.approx(e * u * s - 0.5 * G * s * s, rel=1e-10)
    assert found.value("/a", "restitution") == pytest.approx(u * s, rel=1e-9)
    by_t, by_u = G * s - e * u, e * s
    assert -found.gravity()[2] == pytest.approx(by_u * u / (2.0 * G) - by_t * t / (2.0 * G) - 0.5 * s * s, rel=1e-9)
    # a speed down at the start is a height: v^2 / 2 g more, and earlier by v / g
    assert found.value("/a", "velocity")[2] == pytest.approx(by_t * (1.0 / G), rel=1e-9)


def test_bytes_hold_what_the_host_keeps_for_the_adjoint():
    """NumPy tells tracemalloc what memory arrays own; heads of arrays and the containers of both come on top of that."""
    scene = ground(body("/a", Sphere(0.1), (0.0, 0.0, 0.3), bounce=0.6))
    recording(scene, 1).run()
    tracemalloc.start()
    try:
        r = recording(scene, 20)
        r.run()
        every, arrays = tracemalloc.take_snapshot(), tracemalloc.DomainFilter(True, np.lib.tracemalloc_domain)
    finally:
        tracemalloc.stop()
    held = sum(trace.size for trace in every.filter_traces([arrays]).traces)
    host = sum(host_bytes(stretch.tape.host, set()) for stretch in r.stretches.values())
    assert 1e4 < held < host < sum(trace.size for trace in every.traces)
    assert r.slots.bytes + host < r.bytes == pytest.approx(r.cost.full - r.cost.fixed, rel=0.03)


@pytest.mark.slow
def test_a_ball_rolls_down_by_five_sevenths():
    slope, t = 0.1, LAST / 60.0
    r = recording(ground(body("/a", Sphere(0.1), (0.0, 0.0, 0.1 - 1e-9)), slope=slope))
    r.run()
    found = r.backward(twists={LAST: {"/a": [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0)]}})
    assert found.gravity()[0] == pytest.approx(5.0 / 7.0 * t, rel=1e-6)
    assert found.value("/a", "dynamic_friction") == 0.0                       # it sticks


@pytest.mark.slow
def test_a_recording_goes_where_a_simulation_does_to_the_bit():
    for kind in ("bouncing ball", "box on box"):
        sim, r = Simulation(SCENES[kind](), device="cpu", precision="float64"), recording(SCENES[kind]())
        sim.run(LAST)
        r.run()
        for name in ("x", "e", "q", "o", "p", "L"):
            assert np.array_equal(*(s.plan.method("rigid").part.arrays[name].numpy() for s in (sim, r.sim)))


def test_what_has_no_derivative_is_refused_with_a_mend():
    ball = body("/a", Sphere(0.1), (0.0, 0.0, 0.3))
    for more, words in (({"contact_tolerance": 0.0}, "/a: can meet /floor.*contact_tolerance"),
                        ({"sleep_speed": 0.05}, "/a: may fall asleep.*sleep_speed")):
        with pytest.raises(SceneError, match=words):
            recording(ground(ball, **more))


def test_checkpoints_are_refused():
    with pytest.raises(SceneError, match="found 'checkpoints'"):
        Recording(Simulation(SCENES["rolling ball"](), device="cpu", precision="float64", gradients=True), 3, "checkpoints")


@pytest.mark.slow
def test_a_residual_that_is_left_is_warned_of():
    r = recording(ground(*SCENES["box on box"]().things("Body"), contact_tolerance=1e-3))
    r.backward(twists={LAST: {"/b": np.ones((2, 3))}})
    assert any("contacts and joints of bodies were solved to" in w for w in r.sim.warnings)
