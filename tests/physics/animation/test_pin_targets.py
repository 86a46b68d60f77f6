"""Targets, greatest speeds and velocities of pins by the device's kernels: those of the host, at any moments of a frame."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from tests.make.scene.curve.motion import KINDS, OUTSIDE, made
from tests.physics.animation.make import bones, lump, skin
from wsim.geometry import rotation
from wsim.physics.animation.objects import DUAL, LINEAR, Follow
from wsim.physics.animation.pin_targets import PinTargets, PinVelocities
from wsim.scene import Motion, Pin, Scene, shapes
from wsim.scene.curve import Curve, Part, Stack
from wsim.scene.curve.stack import ELEMENTS, SCALE, SHIFT, TURN
from wsim.simulation.measure.checks.reasons import speed_of_pin
from wsim.simulation.simulation import Simulation

DT = 0.04
UNEVEN = DT * np.array([0.0, 0.05, 0.31, 0.5, 0.77, 1.0])


def turning(seed: int) -> Motion:
    random = np.random.default_rng(seed)
    q = rotation.unit_quat(random.normal(size=(4, 4)))
    return Motion.through(np.array([0.0, 0.05, 0.1, 0.3]), random.normal(size=(4, 3)), q, "linear")


def stacked() -> Stack:
    swing = Curve([0.0, 0.1, 0.3], [0.0, 1.0, -0.5], "eased", easing=["bounce-out", (0.3, -0.5, 0.6, 1.4)])
    return Stack([Part(SHIFT, swing, 1), turning(5).values[1], Part(TURN, swing, 2), made("catmull_rom", "repeat", 4)])


def pinned() -> list:
    """Pins of two bodies, a kilometre apart: by linear keys, one that stays, on a spline, in a stack, on two skinned meshes."""
    scene, rng = Scene(), np.random.default_rng(3)
    for body, x in (("/a", 0.0), ("/b", 1000.0)):
        points, counts, indices = shapes.sheet(0.4, 0.3, 5, 4)
        scene.cloth(body, points + [x, 0.0, 0.0], counts, indices)
    motions = [turning(0), Motion.at_place((0.1, 0.0, 0.0)), turning(1), made("catmull_rom"), stacked()]
    for k, motion in enumerate(motions):
        scene.pin(f"/pin{k}", "/a" if k < 2 else "/b", range(4 * k, 4 * k + 3), motion=motion)
    mesh, counts, indices = shapes.sphere(0.3, 8)
    for k, method in enumerate((LINEAR, DUAL)):
        skeleton = scene.add(bones(rng, scaled=bool(k), path=f"/man{k}/bones"))
        skeleton.motion = turning(7 + k)
        skinned = skin(rng, skeleton, mesh, method=method, blends=[lump(rng)] * (1 - k))
        places = np.column_stack([rng.uniform(0.1, 0.4, (3, 2)), [0.0, 0.02, -0.01]])
        scene.pins.append(Pin(f"/hung{k}", "/b", range(3 * k, 3 * k + 3), follows=Follow(
            skinned, np.array([[0, 1, 4], [4, 5, 1], [5, 6, 7]]), places)))
    return Simulation(scene, device="cpu").plan.ports.pins.groups["hard"]


@pytest.mark.parametrize("real, most", [(wp.float32, 2e-7), (wp.float64, 1e-12)])
def test_the_device_puts_pins_where_the_host_does_at_any_moments(real, most):
    """Within the rounding of targets that are up to a kilometre from the origin of their body; speeds in float64."""
    group = pinned()
    own = [p.evaluated_on_device for p in group]
    assert own == [p.pin.path != "/pin1" for p in group] and len(own) == 7
    found, speed = PinTargets(wp.get_device("cpu"), real), wp.zeros(7, dtype=wp.float64, device="cpu")
    mine = np.repeat(own, [len(p.places) for p in group])
    target = wp.zeros((len(UNEVEN), len(mine)), dtype=wp.vec3f if real is wp.float32 else wp.vec3d, device="cpu")
    found.take(group, own, UNEVEN, DT, target, speed)
    for time in (0.0, 0.07, 0.29):
        speed.zero_()
        found.launch(time)
        want = np.concatenate([p.table(time + UNEVEN) for p in group], axis=1)
        off = np.abs(target.numpy() - want) / np.maximum(np.abs(want).max(axis=(0, 2)), 1.0)[:, None]
        assert off[:, mine].max() < most and not target.numpy()[:, ~mine].any()
        expected = [speed_of_pin(p, time, DT) if p.evaluated_on_device else 0.0 for p in group]
        np.testing.assert_allclose(speed.numpy(), expected, rtol=1e-10, atol=1e-9)


def rates(motions: list, time: float) -> np.ndarray:
    """Velocities of three points of a pin by each motion, by the device."""
    local = np.array([[0.1, 0.2, 0.3], [-0.3, 0.0, 0.5], [1.0, -1.0, 0.0]])
    pins = [SimpleNamespace(motion=motion, places=range(3), locals=local, body=SimpleNamespace(origin=np.zeros(3)))
            for motion in motions]
    out = wp.zeros(3 * len(pins), dtype=wp.vec3d, device="cpu")
    PinVelocities(pins, DT, out, wp.float64).launch(time - DT)
    rate = [motion.rate(time - DT + DT)[0] for motion in motions]
    want = np.concatenate([local @ M[:3, :3].T + M[:3, 3] for M in rate])
    np.testing.assert_allclose(out.numpy(), want, rtol=1e-10, atol=1e-10, err_msg=f"at {time}")
    return want


def test_velocities_of_curves_are_those_of_the_host_at_keys_too():
    motions = [stacked(), made("catmull_rom", "repeat"), made("eased", "oscillate"), made("monotone", "linear")]
    keys = [float(motions[1].times[1]), float(motions[1].times[-1])]
    found = [rates(motions, time) for time in (-0.3, 0.02, 0.1, *keys, 9.0)]
    assert all(np.abs(each).max() > 0.1 for each in found)


@pytest.mark.slow
def test_velocities_of_every_kind_of_curve_are_those_of_the_host():
    motions = [made(kind, outside, seed) for kind in KINDS for seed, outside in enumerate(OUTSIDE)]
    values = np.random.default_rng(0).normal(size=(3, 4, 4))
    values[:, 3] = 0.0, 0.0, 0.0, 1.0
    scale = Part(SCALE, Curve([0.0, 2.0], [1.0, 0.5]), 2)
    motions += [Stack([Part(ELEMENTS, Curve([0.0, 0.5, 2.0], values)), scale, made("hold")])]
    for time in (-7.0, -1.9, 0.0, 0.37, *map(float, motions[0].times), 3.7, 11.0):
        rates(motions, time)


def test_a_pin_that_is_set_goes_where_it_is_told_from_the_next_frame_on():
    """Still poses, another curve, and a still pose again, beside a pin that goes on: hard pins are at their targets exactly."""
    scene = Scene(substeps=4, iterations=2, solver="xpbd", integrator="backward_euler")
    scene.cloth("/cloth", *shapes.sheet(0.4, 0.3, 4, 4))
    for name, points in (("/set", [0, 1]), ("/other", [12, 13])):
        scene.pin(name, "/cloth", points, motion=turning(0))
    sim = Simulation(scene, device="cpu")
    pins = sim.plan.ports.pins.groups["hard"]
    for motion in (None, Motion.at_place((0.0, 0.1, 0.0)), np.eye(4), turning(2), Motion.at_place((0.2, 0.0, 0.0)), None):
        if motion is not None:
            sim.set("/set", "motion", motion)
        sim.step()
        for p in pins:
            want = p.targets(sim.time) + p.body.origin
            np.testing.assert_allclose(sim.positions("/cloth")[p.pin.points], want, atol=2e-7)
