"""What tests/physics/motion/fused/test_kernel_fusion.py shares with other tests: CLOTH, SCENES, blown, cube, everything,
jelly, many, mesh, moved, sheet, staged."""

import numpy as np

from wsim import Bulk
from wsim.scene import Motion, Plane, Scene, Sphere, Surface, shapes
from wsim.scene.fabric import Fabric

CLOTH = Fabric(stretch=300.0, shear=100.0, bend=1e-3, thickness=2e-3, damping=1e-4)


def sheet(material=CLOTH, **more) -> Scene:
    """A small sheet, held at two corners, one of which moves."""
    scene = Scene(solver="explicit")
    points, counts, indices = shapes.sheet(0.4, 0.4, 6, 6, horizontal=True)
    cloth = scene.cloth("/cloth", points, counts, indices, material=material, **more)
    scene.pin("/a", cloth, [0])
    scene.pin("/b", cloth, [6], motion=Motion([0.0, 1.0], [np.eye(4), moved(0.0, 0.3, 0.0)]))
    return scene


def moved(*by) -> np.ndarray:
    M = np.eye(4)
    M[:3, 3] = by
    return M


def blown() -> Scene:
    scene = sheet(drag=1.0, lift=0.5)
    scene.wind = (0.0, 2.0, 1.0)
    return scene


def everything() -> Scene:
    """All that cloth has: strain limits, tethers, wind, a soft pin, colliders of which one moves."""
    scene = sheet(Fabric(**{**CLOTH.__dict__, "strain_limit": 0.05}), tethers=True, drag=1.0, lift=0.5)
    scene.wind = (0.0, 2.0, 1.0)
    scene.pin("/soft", "/cloth", [48], stiffness=50.0, damping=0.1)
    scene.collider("/ball", Sphere(0.1), motion=Motion([0.0, 1.0], [moved(0.0, -0.12, 0.0), moved(0.0, 0.2, 0.0)]))
    scene.collider("/floor", Plane(), at=(0.0, -0.2, 0.0))
    return scene


def many() -> Scene:
    """A sheet that falls on 90 balls, which a tree finds."""
    scene = Scene(solver="explicit")
    points, counts, indices = shapes.sheet(0.4, 0.4, 16, 16, horizontal=True)
    scene.cloth("/cloth", points + [0.0, 0.005, 0.0], counts, indices, material=CLOTH)
    for k in range(90):
        scene.collider(f"/ball{k}", Sphere(0.02), at=(0.05 * (k % 10) - 0.225, -0.02, 0.05 * (k // 10) - 0.2))
    return scene


def cube() -> Scene:
    scene = Scene(solver="explicit")
    points, tets = shapes.block((0.2, 0.2, 0.2), 2, at=(0.0, 0.1005, 0.0))
    scene.soft("/cube", points, tets)
    scene.collider("/floor", Plane())
    return scene


def mesh() -> Scene:
    """A sheet that a turning block, a mesh, is drawn through."""
    scene = sheet()
    turned = np.eye(4)
    turned[:3, :3] = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]
    points = np.array([(x, y, z) for x in (-0.1, 0.1) for y in (-0.04, 0.04) for z in (-0.1, 0.1)])
    quads = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
    scene.collider("/block", Surface(points, [4] * 6, quads),
                   motion=Motion([0.0, 1.0], [moved(0.0, -0.045, 0.0), turned @ moved(0.05, 0.4, 0.0)]))
    return scene


def jelly() -> Scene:
    """Damped Neo-Hookean tets that a pin drags over a ball which moves."""
    scene = Scene(solver="explicit")
    points, tets = shapes.block((0.3, 0.1, 0.1), (6, 2, 2))
    body = scene.soft("/jelly", points, tets, material=Bulk(3e4, 0.4, 1e3, "neo_hookean", damping=1e-3))
    scene.pin("/hand", body, np.flatnonzero(points[:, 0] < -0.149),
              motion=Motion([0.0, 1.0], [np.eye(4), moved(0.0, 0.4, 0.0)]))
    scene.collider("/ball", Sphere(0.1), motion=Motion([0.0, 1.0], [moved(0.1, -0.16, 0.0), moved(0.1, 0.2, 0.0)]))
    return scene


def staged() -> Scene:
    """Stages of Runge-Kutta, wind, and a pin on a smooth path, whose velocity damping sees."""
    scene = blown()
    scene.integrator, scene.substeps = "rk4", 24
    scene.pins[1].motion = Motion.through(np.arange(4.0) / 10.0, [[0.0, 0, 0], [0, 0.05, 0], [0, 0.02, 0.05], [0, 0, 0]])
    return scene


def sail() -> Scene:
    """As many triangles as points: threads of a triangle and of a point are of one number, and yet wait for each other."""
    scene = Scene(solver="explicit", wind=(3.0, 1.0, 0.0))
    points = 0.2 * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    scene.cloth("/sail", points, [3] * 4, [0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2], material=CLOTH, drag=1.0, lift=0.5)
    return scene


SCENES = {"staged": staged, "sail": sail, "sheet": sheet, "blown": blown, "everything": everything, "cube": cube,
          "jelly": jelly, "mesh": mesh}
