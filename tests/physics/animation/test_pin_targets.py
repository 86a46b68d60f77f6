"""Targets of pins that a GPU evaluates, here by its kernels on a CPU: those of the host."""

import numpy as np
import pytest
import warp as wp

from wsim.geometry import rotation
from wsim.physics.animation import pin_targets
from wsim.scene import Motion, Scene, shapes
from wsim.simulation.simulation import Simulation

DT, ROWS = 0.04, 200


def turning(seed: int) -> Motion:
    random = np.random.default_rng(seed)
    q = rotation.normalized(random.normal(size=(4, 4)))
    return Motion.through(np.array([0.0, 0.05, 0.1, 0.3]), random.normal(size=(4, 3)), q, "linear")


def pinned() -> list:
    """Pins of two bodies: two that turn, one that stays, one on a spline."""
    scene = Scene()
    motions = {"/turns": turning(0), "/stays": Motion.at_place((0.1, 0.0, 0.0)), "/also": turning(1),
               "/spline": Motion.through(np.arange(4.0), np.random.default_rng(2).normal(size=(4, 3)))}
    for body, x in (("/a", 0.0), ("/b", 1000.0)):
        points, counts, indices = shapes.sheet(0.4, 0.3, 5, 4)
        scene.cloth(body, points + [x, 0.0, 0.0], counts, indices)
    for k, (name, motion) in enumerate(motions.items()):
        scene.pin(name, "/a" if k < 2 else "/b", range(7 * (k % 2), 7 * (k % 2) + 5), motion=motion)
    return Simulation(scene, device="cpu").plan.find("pins").groups["hard"]


@pytest.mark.parametrize("real, most", [(wp.float32, 4e-7), (wp.float64, 1e-12)])
def test_a_gpu_takes_pins_of_linear_keys_where_the_host_does(real, most):
    """Within the rounding of targets that are up to a kilometre from the origin of their body."""
    group, at = pinned(), DT * np.arange(1, ROWS + 1) / ROWS
    own = pin_targets.evaluated(group, at, DT)
    assert own == [p.pin.path in ("/turns", "/also") for p in group]
    found = pin_targets.Targets(wp.get_device("cpu"), real)
    found.take(group, own, ROWS)
    for time in (0.0, 0.07, 0.29):
        want = np.concatenate([p.table(time + at) for p in group], axis=1)
        target = wp.array(np.zeros_like(want), dtype=wp.vec3f if real is wp.float32 else wp.vec3d, device="cpu")
        found.launch(time, DT, target)
        mine = np.repeat(own, [len(p.places) for p in group])
        scale = np.abs(want).max()
        assert np.abs(target.numpy() - want)[:, mine].max() < most * scale and not target.numpy()[:, ~mine].any()


def test_the_host_takes_short_frames_and_uneven_times():
    group = pinned()
    assert not any(pin_targets.evaluated(group, DT * np.arange(1, 21) / 20, DT))
    uneven = DT * (np.repeat(np.arange(ROWS), 2) + np.tile([0.5, 1.0], ROWS)) / ROWS
    assert not any(pin_targets.evaluated(group, np.delete(uneven, 3), DT))
