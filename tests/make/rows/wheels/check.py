"""What can be wrong with a wheel besides its numbers, whose bounds stand in the table of values."""

from collections.abc import Iterator

from tests.make.rows.wheels.objects import Wheel
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import object_warning

FAST = 1e6         # [rad/s]


def check(wheel: Wheel, scene: Scene) -> Iterator[Problem]:
    if abs(wheel.rate) > FAST:
        yield object_warning(wheel.path, f"it turns at {wheel.rate:g} rad/s", f"up to {FAST:g} rad/s", "give another rate")
