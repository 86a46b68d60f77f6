"""The abuse of smoke and liquids, one row each: a scene, the schemes that it runs with, and how much energy it can give.

A force f does at most |f| sqrt(2 E m) of work a second, so that sqrt(E) grows by at most |f| / m sqrt(m / 2) a second:
`pushed`. What moves at U gives air or water at most 1/2 m (GAIN U)^2: it streams round a ball at 1.5 U, between a wall and what
comes near it faster; what is kept at U likewise. Gravity is in a liquid's own energy.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from wsim.physics.fluid.liquid.objects import TRANSFERS, Liquid, LiquidSource
from wsim.physics.fluid.objects import ADVECTION, Fluid, Source
from wsim.scene import Motion, Scene
from wsim.scene.solids import Box, Sphere

GAIN = 4.0
AIR, WATER, G = 1.2, 1000.0, 9.81                  # [kg/m^3], [kg/m^3], [m/s^2]
FALLS = (0.0, -G, 0.0)


@dataclass(frozen=True)
class Row:
    name: str
    what: str
    scene: Callable[..., Scene]                    # scene(scheme)
    schemes: tuple[str, ...]
    gives: float = 0.0                             # [J] over that of the start, of energy that is not gravity's
    smoke: float = np.inf                          # the most that was put in


def pushed(density: float, volume: float, acceleration: float, seconds: float) -> float:
    """Most kinetic energy [J] that a force gives within a time, from rest."""
    return 0.5 * density * volume * (acceleration * seconds) ** 2


def moved(density: float, volume: float, speed: float) -> float:
    """Most kinetic energy [J] that what moves at a speed gives."""
    return 0.5 * density * volume * (GAIN * speed) ** 2


def way(begin, end, seconds: float) -> Motion:
    M = np.tile(np.eye(4), (2, 1, 1))
    M[:, :3, 3] = begin, end
    return Motion(np.array([0.0, seconds]), M)


# smoke in a box of 1 m

def air(scheme: str, n: tuple[int, ...], frames: int = 10, dt: float = 0.02, gravity=(0.0, 0.0, 0.0), **more) -> Scene:
    """scheme: how velocity is carried and how pressure is found, "cubic/multigrid"."""
    advection, _, pressure = scheme.partition("/")
    scene = Scene(fps=1.0 / dt, frames=frames, gravity=gravity)
    more = {"steps": 1, "scalar_advection": "cubic" if advection == "reflection" else advection} | more
    shape = np.array([*n, 1, 1][:3])
    scene.add(Fluid("/air", np.zeros(3), shape / n[0], 1.0 / n[0], advection=advection, pressure=pressure, **more))
    return scene


def whirls(scheme: str, cfl: float, n: tuple[int, ...], ball: bool = False, **more) -> Scene:
    """Vortices of 1 m/s that cross so many cells a step, half of them full of smoke."""
    scene = air(scheme, n, dt=cfl / n[0], **more)
    (fluid,) = scene.things("Fluid")
    x = fluid.centers() * 2.0 * np.pi
    u, v = np.sin(x[..., 0]) * np.cos(x[..., 1]), -np.cos(x[..., 0]) * np.sin(x[..., 1])
    fluid.velocity, fluid.smoke = np.stack([u, v, 0.0 * u], axis=-1), (np.sin(x[..., 0]) > 0.0).astype(float)
    if ball:
        scene.collider("/ball", Sphere(0.2), at=(0.5, 0.5, 0.5))
    return scene


def shot(scheme: str, cells: float, half: tuple[float, float], n: tuple[int, ...] = (64, 64), **more) -> Scene:
    """A box goes so many cells a step, for 4 of them, into smoke that is 1 everywhere."""
    scene = air(scheme, n, frames=8, **more)
    (fluid,) = scene.things("Fluid")
    fluid.smoke = np.ones(fluid.shape)
    begin = np.array([-0.3, 0.5, 0.0])
    scene.collider("/bullet", Box((*half, 2.0)), motion=way(begin, begin + (4.0 * cells / n[0], 0.0, 0.0), 0.08))
    return scene


def fed(scheme: str, dt: float, sides: str = "open", **more) -> Scene:
    scene = air(scheme, (16, 16, 16), frames=4, dt=dt, gravity=FALLS, sides=(sides,) * 6, **more)
    place = Motion.at_place((0.5, 0.3, 0.5))
    scene.add(Source("/hot", Sphere(0.15), smoke=1e6, temperature=1e6, motion=place))
    return scene


def jet(scheme: str, sides: str, **more) -> Scene:
    scene = air(scheme, (16, 16, 16), frames=4, sides=(sides,) * 6)
    scene.add(Source("/jet", Sphere(0.15), motion=Motion.at_place((0.5, 0.3, 0.5)), **more))
    return scene


SCHEMES = tuple(f"{name}/{way}" for name in ADVECTION for way in ("direct", "multigrid"))
AMONG = tuple(f"{name}/multigrid" for name in ADVECTION)                    # obstacles: no direct solve
FLAT, DEEP = ("periodic",) * 6, ("closed",) * 6
FIFTY, THIN = 50.0 / 64.0 / 0.02, 1.0 / 64.0                                # [m/s], [m] depth of a flat box


def _smoke() -> list[Row]:
    steps = [Row(f"heat of 1e6 K/s, dt {dt:g}", "a source of 1e6 of smoke and heat, four steps", partial(fed, dt=dt), SCHEMES,
                 pushed(AIR, 1.0, G * 4e6 * dt / 293.0, 4.0 * dt), 4e6 * dt) for dt in (1e-4, 1e-2, 1.0)]
    return [
        Row("smoke at CFL 20", "flat vortices that cross 20 cells a step", partial(whirls, cfl=20.0, n=(32, 32), sides=FLAT),
            SCHEMES, smoke=1.0),
        Row("smoke at CFL 20, a ball", "deep vortices round a ball", partial(whirls, cfl=20.0, n=(16, 16, 16), ball=True,
                                                                           sides=DEEP), AMONG, smoke=1.0),
        Row("smoke at CFL 20, viscous", "and a viscosity of 1e3 m^2/s", partial(
            whirls, cfl=20.0, n=(32, 32), sides=DEEP, viscosity=1e3, slip=False), SCHEMES, smoke=1.0),
        Row("bullet of 50 cells a step", "a box of 6 cells", partial(shot, cells=50.0, half=(0.1, 0.15)), AMONG,
            moved(AIR, THIN, FIFTY), 1.0),
        Row("plate of 50 cells a step", "a plate of a tenth of a cell", partial(shot, cells=50.0, half=(0.0008, 0.3)), AMONG,
            moved(AIR, THIN, FIFTY), 1.0),
        Row("piston without outlet", "a wall that sweeps all of a closed box", partial(
            shot, cells=20.0, half=(0.2, 2.0), sides=DEEP), AMONG, moved(AIR, THIN, FIFTY), 1.0),
        Row("an obstacle that fills the box", "and goes on", partial(shot, cells=50.0, half=(1.0, 2.0)), AMONG,
            moved(AIR, THIN, FIFTY), 1.0),
        *steps,
        Row("air of 1e3 m/s", "kept in a ball of an open box", partial(jet, sides="open", velocity=(0.0, 1e3, 0.0)), AMONG,
            moved(AIR, 1.0, 1e3)),
        Row("air out of nothing, closed", "1e3 volumes a second into a closed box", partial(jet, sides="closed", expansion=1e3),
            AMONG, moved(AIR, 1.0, 1e3 * 0.15 / 3.0)),
        Row("swirl of 1e3", "vorticity confinement, which is energy out of nothing: finite is what is held", partial(
            whirls, cfl=1.0, n=(32, 32), sides=FLAT, vorticity=1e3), SCHEMES, np.inf, 1.0),
        Row("a margin that is outrun", "smoke of which the surroundings alone are solved, CFL 20", partial(
            whirls, cfl=20.0, n=(32, 32), sides=("open",) * 6, margin=0.5), AMONG, 0.25 * AIR / 32.0, 1.0),
    ]


# liquid in a tank of 24 x 16 cells (x 8)

CELL = 1.0 / 24.0


def tank(scheme: str, n: tuple[int, ...] = (24, 16), fill=((0.0, 0.0), (0.4, 0.5)), *, frames: int = 12, dt: float = 1.0 / 24.0,
         velocity=None, **more) -> Scene:
    scene = Scene(fps=1.0 / dt, frames=frames, gravity=FALLS)
    size = CELL * np.array([*n, 1, 1][:3])
    scene.add(Liquid("/tank", np.zeros(3), size, CELL, transfer=scheme, **more))
    low, high = (np.array([*corner, *end][:3]) for corner, end in zip(fill, ((0.0,), (size[2],)), strict=True))
    scene.add(LiquidSource("/water", Box(tuple(0.5 * (high - low))), Motion.at_place(tuple(0.5 * (low + high))),
                           velocity=velocity))
    return scene


def twice(scheme: str) -> Scene:
    """Two sources of the same place."""
    scene = tank(scheme)
    (water,) = scene.things("LiquidSource")
    scene.add(LiquidSource("/again", water.shape, water.motion))
    return scene


def stirred(scheme: str, cells: float, half: tuple[float, float], n: tuple[int, ...] = (24, 16), **more) -> Scene:
    scene = tank(scheme, n, ((0.0, 0.0), (1.0, 0.3)), **more)
    far, begin = 4.0 * cells * CELL, np.array([-0.3 if cells < 20.0 else 0.5 - cells * CELL, 0.2, 0.0])
    scene.collider("/paddle", Box((*half, 2.0)), motion=way(begin, begin + (far, 0.0, 0.0), 4.0 / 24.0))
    return scene


def poured(scheme: str, speed: float, **more) -> Scene:
    scene = tank(scheme, frames=12, **more)
    scene.add(LiquidSource("/tap", Sphere(0.1), Motion.at_place((0.7, 0.5, 0.5 * CELL)), role="source",
                           velocity=(0.0, -speed, 0.0)))
    return scene


def _liquid() -> list[Row]:
    flat, deep = 1.0 * 16 * CELL * CELL, 1.0 * 16 * CELL * 8 * CELL                # [m^3] of the tanks
    return [
        *(Row(f"dam, dt {dt:g}", "a column that falls, one step a frame", partial(tank, dt=dt, steps=1), TRANSFERS,
              pushed(WATER, 0.2 * CELL, G, dt)) for dt in (1e-4, 0.04, 1.0)),
        Row("dam, deep, CFL 20", "of three dimensions", partial(tank, n=(24, 16, 8), cfl=20.0), TRANSFERS),
        Row("water thrown at 100 m/s", "at a wall", partial(tank, velocity=(100.0, 0.0, 0.0)), TRANSFERS),
        Row("two starts of one place", "two sources that fill the same shape", twice, TRANSFERS),
        Row("paddle of 50 cells a step", "through a pool", partial(stirred, cells=50.0, half=(0.05, 0.15), steps=1), TRANSFERS,
            moved(WATER, flat, 50.0)),
        Row("paddle of 50 cells a step, deep", "of three dimensions", partial(
            stirred, cells=50.0, half=(0.05, 0.15), n=(24, 16, 8), steps=1), TRANSFERS, moved(WATER, deep, 50.0)),
        Row("press without outlet", "a wall that leaves less room than there is water", partial(
            stirred, cells=4.0, half=(0.5, 2.0)), TRANSFERS, moved(WATER, flat, 4.0 * 24.0 * CELL) + WATER * flat * G),
        Row("tap of 1e3 m/s, closed", "water without end into a closed tank", partial(poured, speed=1e3), TRANSFERS,
            moved(WATER, flat, 1e3)),
    ]


ROWS: list[Row] = [*_smoke(), *_liquid()]
