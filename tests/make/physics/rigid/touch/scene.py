"""What tests/physics/rigid/touch/test_scene.py shares with other tests: falls."""

from tests.make.physics.rigid.contact import ball
from tests.physics.rigid.touch.touching import scene
from wsim.scene import Scene


def falls(**more) -> Scene:
    return scene(ball("/ball", (0.03, 0.16, 0.02), 0.15, velocity=(0.0, -2.0, 0.3), mass=0.4, rest=0.3), pinned=True, **more)
