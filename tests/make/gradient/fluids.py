"""What tests/gradient/test_fluids.py shares with other tests: compared, one, stirred."""

from functools import cache

import numpy as np
import pytest

from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene import Box, Scene, Sphere
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

FRAMES, CELL = 3, 0.1
KEYS = np.array([0.0, 0.07, 0.2])


def fields(n: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Smooth ones, nowhere constant along an axis: there what is kept within the rows around has two derivatives; nor has it a
    crest halfway between two rows, which are the same one then."""
    x, y, z = np.moveaxis((np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), -1) + 0.5) * CELL, -1, 0)
    deep = n[2] > 1
    velocity = [0.3 * np.sin(2.0 * y + 1.0 + 0.7 * x + z), 0.4 * np.cos(3.0 * x - 0.6 * y + 0.13),
                0.2 * deep * np.sin(x + 2.0 * y)]
    return {"velocity": np.stack(velocity, -1), "smoke": 1.0 + 0.5 * np.sin(3.0 * x + 1.0 + z) * np.cos(2.0 * y),
            "temperature": 5.0 + 3.0 * np.cos(2.1 * x - 1.3 * y + 0.2 * y * y + 0.9 + 0.5 * z)}


def swept(n: tuple[int, ...]) -> np.ndarray:
    """An acceleration [m/s^2] that is none of a potential."""
    x, y, z = np.moveaxis((np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), -1) + 0.5) * CELL, -1, 0)
    return np.stack([0.4 * np.cos(2.0 * y), 0.3 * np.sin(3.0 * x + z), 0.2 * np.sin(2.0 * x * y)], axis=-1)


def air(n=(12, 10, 1), frames: int = FRAMES, **more) -> Scene:
    """Air with smoke and heat, two sources, and walls that move along themselves."""
    walls = np.zeros((6, 3))
    walls[2], walls[4] = (0.3, 0.05, -0.2), (0.1, -0.07, 0.03)       # those at -y and -z, through which some air comes
    scene = Scene(fps=24.0, frames=frames, gravity=(0.3, -9.81, 0.2), wind=more.pop("wind", (0.2, 0.1, 0.05)))
    scene.add(Fluid("/air", np.zeros(3), CELL * np.array(n), CELL, **fields(n) | {
        "sides": ("wind", "open", "closed", "open", "closed", "open"), "side_velocities": walls, "slip": False, "steps": 2,
        "tolerance": 1e-13, "lift": 1.0 / 293.0, "weight": 0.1, "vorticity": 0.2, "viscosity": 0.01, "smoke_decay": 0.3,
        "cooling": 0.2, "acceleration": swept(n)} | more))
    z = 0.5 * CELL * n[2]
    scene.add(Source("/fire", Sphere(0.17), Motion.at_place((0.53, 0.37, 1.03 * z)), smoke=3.0, temperature=40.0, expansion=0.8,
                     velocity=(0.13, 0.52, 0.07), strength=Curve(KEYS, np.array([1.0, 0.6, 0.9]))))
    scene.add(Source("/held", Box((0.12, 0.16, 0.33)), Motion.at_place((0.637, 0.324, 1.07 * z)), temperature=30.0, hold=True))
    return scene


def stirred(**more) -> Scene:
    """The same round a sphere."""
    scene = air(**more)
    scene.collider("/ball", Sphere(0.15), at=(0.6, 0.75, 0.05))
    return scene


def recorded(scene: Scene, frames: int = FRAMES, keep: str = "auto", worlds: int = 1) -> Recording:
    return Recording(Simulation(scene, device="cpu", precision="float64", worlds=worlds, gradients=True), frames, keep)


@cache
def weights(r: Recording, frames: tuple[int, ...]) -> dict:
    """Derivatives of a loss by all fields after some frames."""
    rng = np.random.default_rng(1)
    return {f: {"/air": {name: rng.normal(size=v.shape) for name, v in r.fluid(f, "/air").items()}} for f in frames}


def loss(r: Recording, by: dict) -> float:
    r.run()
    return float(sum((r.fluid(f, path)[name] * w).sum() for f, each in by.items() for path, fields_ in each.items()
                     for name, w in fields_.items()))


def slope(r: Recording, name: str, way: np.ndarray, by: dict, size: float) -> tuple[float, float]:
    """By central differences, and its rounding, of a step within twice of which no row is kept within other ones and no air
    comes in that did not: there the difference over twice the step is the same, to 5e-9; of the largest to 1e-9, or the one of
    which it is so best."""
    value = inputs_by_name(r, [name])[name]
    base, found = value.read_value(), []
    for step in size * 10.0 ** np.array([-4.0, -4.5, -5.0, -5.5, -6.0, -6.5]):
        losses = []
        for k in (-2, -1, 1, 2):
            value.write_value(base + k * step * way)
            losses.append(loss(r, by))
        value.write_value(base)
        r.run()
        near, far = (losses[2] - losses[1]) / (2.0 * step), (losses[3] - losses[0]) / (4.0 * step)
        noise = 4e-16 * sum(map(abs, losses)) / step
        apart = abs(near - far)
        if apart < 5e-9 * abs(near) + noise:
            found.append((apart + noise, near, noise))
            if apart + noise < 1e-9 * abs(near):
                break
    assert found, f"{name}: no step is without a kink"
    return min(found)[1:]


@cache
def one(scene, **more) -> tuple[Recording, dict]:
    r = recorded(scene(**more))
    return r, weights(r, (2, FRAMES))


def compared(r: Recording, by: dict, name: str, rel: float = 1e-8) -> None:
    path, _, what = name.rpartition(":")
    found = np.asarray(r.backward(fluids=by).value(path or "/", what))
    seed = 4 if what in ("acceleration", "place") else 3   # along 3 slopes are sums that cancel, and noisy
    way = np.random.default_rng(seed).normal(size=found.shape) if found.ndim else np.ones(())
    if what in ("velocity", "gravity", "wind", "place", "acceleration") and r.fluids.method.layouts[0].dim == 2:
        way[..., 2] = 0.0
    expected, noise = slope(r, name, way, by, 20.0 * inputs_by_name(r, [name])[name].difference_scale())
    assert abs(expected) > 1e3 * noise or abs(expected) > 1e-5
    assert float((found * way).sum()) == pytest.approx(expected, rel=rel, abs=noise)


def deep(**more) -> Scene:
    scene = air(n=(9, 8, 7), frames=2, **more)
    scene.collider("/ball", Sphere(0.15), at=(0.6, 0.55, 0.33))
    return scene
