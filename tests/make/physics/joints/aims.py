"""What tests/physics/joints/test_aims.py shares with other tests: slider."""

from tests.physics.joints.make import rod, scene
from wsim.physics.rigid.joints.joint import Drive, prismatic_joint
from wsim.scene import Varying
from wsim.scene.curve import Curve

WAY = Curve([0.0, 0.25, 0.5], [0.0, 0.2, 0.1], "catmull_rom")


def slider(name: str = "target", curve: Curve = WAY, **more):
    """A body on a rail, drawn by a spring and damper; no gravity."""
    body = rod("/b", (0.0, 0.0, 0.0))
    made = scene(body, prismatic_joint("/rail", None, body, drives={"transX": Drive(4e4, 4e2)}), gravity=(0.0, 0.0, 0.0),
                 **more)
    made.varying.append(Varying("/rail", name, curve))
    return made
