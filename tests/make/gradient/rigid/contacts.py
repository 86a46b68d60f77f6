"""What tests/gradient/rigid/test_contacts.py shares with other tests: SCENES."""

import numpy as np

from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Capsule, Collider, Plane, Scene, Sphere
from wsim.scene.curve import Motion

G, LAST = 9.81, 10
RUBS = {"static_friction": 0.4, "dynamic_friction": 0.3}
SMOOTH = {"static_friction": 0.0, "dynamic_friction": 0.0}


def body(path: str, shape, at, rubs=RUBS, **more) -> Body:
    surface = {**rubs, "restitution": more.pop("bounce", 0.0)}
    return Body(path, [Collider(f"{path}/shape", shape, **surface)], Motion.at_place(at), **more)


def ground(*bodies: Body, slope: float = 0.0, rubs=RUBS, **more) -> Scene:
    """Over the plane z = 0; slope: of gravity [rad]."""
    scene = Scene(**{"gravity": (G * np.sin(slope), 0.0, -G * np.cos(slope)), "up": "Z", "fps": 60.0, "substeps": 4,
                     "contact_tolerance": 1e-12} | more)
    scene.collider("/floor", Plane("Z"), **rubs)
    for each in bodies:
        scene.add(each)
    return scene


def stack(speed: float) -> Scene:
    """Three boxes, each smaller than the one below it."""
    size = (0.5, 0.44, 0.38)
    return ground(*(body(f"/box{k}", Box((s, s, 0.25)), (0.01 * k, 0.02 * k, 0.25 + 0.5 * k - 1e-6 * (k + 1)), density=10.0,
                         velocity=(speed * (k == 1), 0.0, 0.0)) for k, s in enumerate(size)), substeps=8)


SCENES = {
    "sliding box": lambda: ground(body("/a", Box((0.5, 0.4, 0.3)), (0.0, 0.0, 0.2999), velocity=(3.0, 0.4, 0.0))),
    "rolling ball": lambda: ground(body("/a", Sphere(0.1), (0.0, 0.0, 0.0999), velocity=(1.0, 0.4, 0.0), spin=(1.0, 2.0, 3.0))),
    "bouncing ball": lambda: ground(body("/a", Sphere(0.1), (0.0, 0.0, 0.25), velocity=(1.0, 0.4, -2.0), spin=(1.0, 2.0, 3.0),
                                         bounce=0.5)),
    "rod on its end": lambda: ground(body("/a", Capsule(0.05, 0.5), (0.0, 0.0, 0.45), velocity=(0.2, 0.0, -2.0), bounce=0.6,
                                          spin=(0.3, 2.0, 0.1))),
    "tumbling box": lambda: ground(body("/a", Box((0.2, 0.15, 0.1)), (0.0, 0.0, 0.26), SMOOTH, velocity=(0.4, 0.1, -1.0),
                                        spin=(2.0, -1.5, 0.5)), rubs=SMOOTH),
    "colliding balls": lambda: ground(body("/a", Sphere(0.1), (0.0, 0.0, 0.5), velocity=(2.0, 0.1, 0.0), bounce=0.7),
                                      body("/b", Sphere(0.15), (0.4, 0.05, 0.5), spin=(0.0, 3.0, 1.0))),
    "box on box": lambda: ground(body("/a", Box((0.4, 0.4, 0.2)), (0.0, 0.0, 0.2 - 1e-5)),
                                 body("/b", Box((0.2, 0.15, 0.1)), (0.05, 0.02, 0.5 - 2e-5), velocity=(1.0, 0.3, 0.0))),
    "stack": lambda: stack(0.0),
}
