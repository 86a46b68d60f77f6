"""Scenes that a choice of solver is judged by: nets, membranes, membranes that bend, soft bodies, each of some sizes and
stiffnesses, and cloths and soft bodies above, on and far from a collider. Frames of 1/24 s, 10 x 4 as a scene has by default.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wsim.scene import Plane, Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk

FLOOR = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])    # z is up
DENSITY, THICK = 200.0, 1e-3                 # of cloths [kg/m^3], [m]
QUICK = {"net": (16, 32), "membrane": (12, 24), "hinges": (12, 24), "soft": (2, 3), "on a ball": (16,), "above a floor": (2,),
         "on a floor": (3,)}
WHOLE = {"net": (16, 32, 64, 128, 320), "membrane": (16, 48, 128), "hinges": (16, 48), "soft": (2, 4, 8), "on a ball": (24, 64),
         "above a floor": (2, 4), "on a floor": (3, 6)}
STIFF = {"net": (1e3, 1e5), "membrane": (50.0, 5e3), "hinges": (50.0, 5e3), "on a ball": (50.0, 5e3),
         "soft": (1e5, 1e7), "above a floor": (1e6,), "on a floor": (1e5, 1e7)}


@dataclass(frozen=True)
class Case:
    """One scene: what it is, points a side of a sheet or cells across a soft body, N/m of a sheet or Pa."""

    kind: str
    size: int
    stiffness: float

    def __str__(self) -> str:
        return f"{self.kind}, {self.size}, {self.stiffness:g}"

    @property
    def part(self) -> float:
        """Of the time of a fall that is looked at."""
        return 0.5 if self.kind == "on a ball" else 1.0

    @property
    def scene(self) -> Scene:
        return (_soft if self.kind in ("soft", "above a floor", "on a floor") else _net if self.kind == "net" else _cloth)(self)


@dataclass(frozen=True)
class Authored:
    """An example scene, which no constant was fitted to."""

    kind: str
    part: float = 1.0

    def __str__(self) -> str:
        return self.kind

    @property
    def scene(self) -> Scene:
        from wsim.usd import load
        return load(str(Path(__file__).resolve().parents[3] / "scenes" / f"{self.kind}.usda"))


def cases(quick: bool) -> Iterator[Case]:
    """Every one of the grid."""
    for kind, sizes in (QUICK if quick else WHOLE).items():
        for size in sizes:
            for stiffness in STIFF[kind]:
                yield Case(kind, size, stiffness)


def _net(case: Case) -> Scene:
    scene = Scene()
    net = scene.net("/net", *shapes.spring_sheet(1.0, case.size, stretch=case.stiffness))
    scene.pin("/pins", net, range(case.size))
    return scene


def _cloth(case: Case) -> Scene:
    """A horizontal square metre, held by an edge, or free 2 cm above a ball."""
    scene, n, ball = Scene(), case.size - 1, case.kind == "on a ball"
    fabric = Fabric(stretch=case.stiffness, shear=0.3 * case.stiffness, bend=1e-4 if case.kind != "membrane" else 0.0,
                    density=DENSITY, thickness=THICK)
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, n, n, horizontal=True, at=(0.0, 0.32 if ball else 0.0, 0.0)),
                        material=fabric)
    if ball:
        scene.collider("/ball", Sphere(0.3))
    else:
        scene.pin("/pins", cloth, range(case.size))
    return scene


def _soft(case: Case) -> Scene:
    """A bar of 40 x 10 x 10 cm held by an end, a floor far below it or none; or a cube of 30 cm that falls by 5 cm on one."""
    scene, k, rubber = Scene(), case.size, Bulk(case.stiffness, 0.3, 1000.0)
    if case.kind == "on a floor":
        scene.soft("/cube", *shapes.block((0.3, 0.3, 0.3), (k, k, k), at=(0.0, 0.2, 0.0)), material=rubber)
        scene.collider("/floor", Plane(), motion=Motion.still(FLOOR))
        return scene
    bar = scene.soft("/bar", *shapes.block((0.4, 0.1, 0.1), (4 * k, k, k)), material=rubber)
    scene.pin("/wall", bar, np.flatnonzero(bar.points[:, 0] < bar.points[:, 0].min() + 1e-6))
    if case.kind == "above a floor":
        below = FLOOR.copy()
        below[:3, 3] = 0.0, -3.0, 0.0
        scene.collider("/floor", Plane(), motion=Motion.still(below))
    return scene
