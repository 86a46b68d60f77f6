"""The energy that a smoothed contact stores, and how stiff it is: from the scene, never from the substep. NumPy only.

A point of mass m that is by s nearer to a collider than both keep, 0 < s < w = `Scene.contact_width`, has the potential
(kernels/contact/project.py)

    U = m E (s / w)^3,    force 3 m E s^2 / w^3,    stiffness at most 6 m E / w^2,    at rest s = w sqrt(|g| w / (3 E))

    E = MARGIN (v^2 / 2 + min(|g| H, (|g| T)^2 / 2))   [m^2/s^2]

with v the fastest speeds of points and of colliders at first, H the way from any point to the furthest collider, T the scene's
length: what falls from where the scene starts is stopped before s = w. What is faster meets the hard contact there.
Where bodies that give way are met as well, all contacts are hard: what pushes a body must be an impulse that it takes.
"""

from math import isinf

import numpy as np

from wsim.scene import Scene, Surface
from wsim.scene.check import signed_distance
from wsim.scene.methods import method_colliders
from wsim.scene.solids import shape_row

MARGIN = 1.5
LEAST = 5e-3           # [m^2/s^2] where nothing falls or moves at first: 0.1 m/s


def barrier_width(scene: Scene) -> float:
    """Distance over which contacts of a scene are soft [m]; 0: they are hard."""
    return 0.0 if method_colliders(scene) else scene.contact_width


def contact_energy_scale(scene: Scene) -> float:
    """E [m^2/s^2]."""
    g, H, v = float(np.linalg.norm(scene.gravity)), 0.0, 0.0
    for body in scene.bodies():
        points = body.motion.points(body.points)
        for collider in scene.colliders:
            if not isinstance(collider.shape, Surface) and isinf(shape_row(collider.shape).ball(collider.shape)):
                away = np.abs(signed_distance.collider_signed_distance(collider, points, 0.0))
            else:
                M, own = collider.motion.at(0.0), np.zeros(3)
                if isinstance(collider.shape, Surface):
                    own = collider.shape.points.mean(axis=0)
                away = np.linalg.norm(points - (M[:3, :3] @ own + M[:3, 3]), axis=1)
            H = max(H, float(away.max(initial=0.0)))
        if body.velocities is not None:
            v = max(v, float(np.linalg.norm(body.velocities, axis=1).max(initial=0.0)))
    fallen = min(g * H, 0.5 * (g * max(scene.frames, 1) / scene.fps)**2)
    return max(MARGIN * (0.5 * (v + _fastest_collider_speed(scene))**2 + fallen), LEAST)


def _fastest_collider_speed(scene: Scene) -> float:
    """Fastest speed of a collider's origin [m/s]."""
    fastest = 0.0
    for collider in scene.colliders:
        motion = collider.motion
        if len(motion.times) > 1:
            way = np.linalg.norm(np.diff(motion.values[:, :3, 3], axis=0), axis=1)
            fastest = max(fastest, float((way / np.diff(motion.times)).max()))
    return fastest


def barrier_stiffness(scene: Scene) -> float:
    """Stiffness of a point over its mass [1/s^2], of two colliders at once where there are as many; 0 where contacts are
    hard."""
    if not (scene.colliders and barrier_width(scene) > 0.0):
        return 0.0
    return min(len(scene.colliders), 2) * 6.0 * contact_energy_scale(scene) / scene.contact_width**2
