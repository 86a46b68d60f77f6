"""What tests/physics/rigid/test_contact.py shares with other tests: G, Seen, UP, ball, box, free, tilted, world."""

import numpy as np

from tests.physics.rigid.pairs import WHERE
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Plane, Scene, Sphere
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

G = 9.81
UP = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])       # own z to y


def thing(path: str, shape, at, rest: float = 0.0, rub: float = 0.5, **more) -> Body:
    """Colliders take the mean friction and the larger restitution."""
    own = Collider(path + "/shape", shape, restitution=rest, static_friction=rub, dynamic_friction=rub)
    return Body(path, [own], Motion.at_place(at), **more)


def ball(path: str, at, radius: float = 0.5, **more) -> Body:
    return thing(path, Sphere(radius), at, **more)


def box(path: str, at, half=(0.5, 0.5, 0.5), **more) -> Body:
    return thing(path, Box(half), at, **more)


def world(*bodies: Body, gravity=(0.0, -G, 0.0), rub: float = 0.5, fps: float = 60.0, substeps: int = 8, **more) -> Simulation:
    """Over the plane y = 0; far away a ball that may bounce and a box, for kernels that all tests share."""
    scene = Scene(gravity=gravity, fps=fps, substeps=substeps)
    scene.collider("/ground", Plane(), motion=Motion.still(UP), static_friction=rub, dynamic_friction=rub)
    scene.collider("/post", Sphere(0.5), at=(1.0, 0.0, 200.0), static_friction=0.0, dynamic_friction=0.0)
    for body in (*bodies, ball("/far/ball", (90.0, 0.5, 0.0), rest=0.5), box("/far/box", (90.0, 0.5, 5.0))):
        scene.add(body)
    return Simulation(scene, **WHERE | {"precision": "float64"} | more)


class Seen:
    """Places, velocities and angular velocities of bodies by path, now."""

    def __init__(self, sim: Simulation):
        method = sim.plan.method("rigid")
        self.row = {body.path: k for k, (body, _) in enumerate(method.bodies)}
        self.poses, self.v, self.w = method.poses(), method.velocities(), method.spins()

    def at(self, path: str) -> np.ndarray:
        return self.poses[self.row[path]][:3, 3]

    def speed(self, path: str) -> np.ndarray:
        return self.v[self.row[path]]

    def spin(self, path: str) -> np.ndarray:
        return self.w[self.row[path]]


def free(body: Body) -> Body:
    """Without weight."""
    from wsim.physics.rigid.mass import body_inertia
    body.force = np.array([0.0, body_inertia(body).mass * G, 0.0])
    return body


def tilted(degrees: float) -> tuple[float, float, float]:
    return (G * np.sin(np.radians(degrees)), -G * np.cos(np.radians(degrees)), 0.0)
