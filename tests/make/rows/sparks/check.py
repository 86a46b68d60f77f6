"""What can be wrong with sparks."""

from collections.abc import Iterator

from tests.make.rows.sparks.objects import Sparks
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import check_number


def check(sparks: Sparks, scene: Scene) -> Iterator[Problem]:
    yield from check_number(sparks.path, "count", sparks.count, 1.0)
