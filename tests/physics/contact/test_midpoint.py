"""Colliders by the implicit midpoint: blows, friction, what surfaces carry, and the work that contacts do.

A mass is one end of a spring of 1e-9 N/m whose other end is far away: it moves as a free point."""

import numpy as np
import pytest

from tests.physics.contact.test_restitution import ball, bounced, run
from tests.physics.selfcontact.rig import THIN, crossed, layers, said
from wsim.scene import Box, Plane, Scene, SceneError, Sphere
from wsim.scene import shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

G = 9.81
MIDPOINT = dict(solver="implicit", integrator="implicit_midpoint", substeps=10, iterations=6)
CLOTH = Fabric(stretch=500.0, shear=100.0, bend=1e-5, thickness=2e-3, density=150.0)
UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])       # a plane's z is +y


def draped(shape, side: int = 16, friction: float = 0.4, **more) -> Scene:
    """A sheet of 0.4 m that falls from 2 cm above a body."""
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, **MIDPOINT | more)
    points, counts, indices = shapes.sheet(0.4, 0.4, side - 1, side - 1, horizontal=True)
    points = np.array(points, np.float64)
    scene.cloth("/cloth", points - points.mean(axis=0), counts, indices, material=CLOTH, static_friction=friction,
                dynamic_friction=friction)
    scene.collider("/body", shape, at=(0.0, -0.12, 0.0), static_friction=friction, dynamic_friction=friction)
    return scene


def fallen(count: int = 3, side: int = 8, **more) -> Scene:
    """Layers 4 mm apart that fall on a floor by 1 cm, turned against each other."""
    scene = layers(count, side, 4e-3, size=0.15, **MIDPOINT | more)
    scene.gravity = (0.0, -G, 0.0)
    for k, cloth in enumerate(scene.cloths):
        c, s = np.cos(0.3 * k), np.sin(0.3 * k)
        cloth.points[:] = cloth.points @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + (0.0, 0.01, 0.0)
    scene.collider("/floor", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    return scene


def mass(x, v=(0.0, 0.0, 0.0), shape=None, motion=None, friction: float = 0.0, **more) -> Scene:
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, **MIDPOINT | more)
    scene.net("/mass", [x, np.add(x, 50.0)], [[0, 1]], [1e-9], [1.0, 1.0], velocities=[v, v], static_friction=friction,
              dynamic_friction=friction)
    scene.collider("/body", shape or Plane(), motion=motion or Motion.still(UP), thickness=0.0, static_friction=friction,
                   dynamic_friction=friction)
    return scene


@pytest.mark.parametrize("solver", ["implicit", "xpbd"])
def test_three_bounces_follow_the_parabolas_to_rounding(solver):
    sim, found = run(ball(v=(0.3, 0.25, 0.0), solver=solver, integrator="implicit_midpoint", iterations=2), 118)
    exact = np.array([bounced((k + 1) / 60, 1.0, 0.25, 0.8) for k in range(118)])
    assert exact[-1, 2] == 3 and sim.plan.integrator == "implicit_midpoint"
    np.testing.assert_allclose(found, exact[:, :2], atol=1e-12)


@pytest.mark.parametrize("solver", ["implicit", "xpbd"])
def test_a_blow_without_restitution_leaves_no_speed_at_once(solver):
    _, found = run(ball(e=0.0, v=(0.3, 0.25, 0.0), solver=solver, integrator="implicit_midpoint", iterations=2), 60)
    hit = int(np.argmax(found[:, 0] < 1e-12))
    assert 25 < hit < 35 and found[hit - 1, 1] < -4.0
    np.testing.assert_allclose(found[hit:], 0.0, atol=1e-12)
