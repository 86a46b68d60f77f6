"""What can be wrong with a wheel."""

from collections.abc import Iterator
from math import inf

from tests.make.wheels.objects import Wheel
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import number


def check(wheel: Wheel, scene: Scene) -> Iterator[Problem]:
    for name, least in (("angle", -inf), ("rate", -inf), ("drag", 0.0)):
        yield from number(wheel.path, name, getattr(wheel, name), least)
