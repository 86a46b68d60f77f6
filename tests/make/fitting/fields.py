"""What tests/fitting/test_fields.py shares with other tests: CPU, QUICK, bar, halves, net, seen, sheet."""

import numpy as np

from wsim import Bulk, Fabric, Scene, Simulation
from wsim.fitting import Settings, Track
from wsim.scene import shapes

CPU = Settings(device="cpu")
FAST = {"fps": 10.0, "frames": 8, "solver": "implicit", "integrator": "backward_euler", "substeps": 1, "air_drag": 5.0}
QUICK = {"fps": 60.0, "frames": 3, "solver": "explicit", "integrator": "leapfrog", "substeps": 40}


def bar(cells=(6, 2, 2), **more) -> Scene:
    """Held at one end, comes to rest bent by its weight."""
    scene = Scene(**FAST | more)
    points, tets = shapes.block((0.6, 0.2, 0.2), cells)
    body = scene.soft("/bar", points, tets, material=Bulk(1e5, 0.3, 1e3))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def net(**more) -> Scene:
    """A square net of springs hung at two corners."""
    scene = Scene(**{"fps": 60.0, "frames": 6, "solver": "explicit", "substeps": 20} | more)
    points, edges, stiffness, masses = shapes.spring_sheet(1.0, 5, stretch=50.0, diagonal=30.0, cross=5.0)
    scene.pin("/pin", scene.net("/net", points, edges, stiffness, masses), [0, 4])
    return scene


def sheet(model="springs", weft=0.0, **more) -> Scene:
    scene = Scene(**{"fps": 60.0, "frames": 6, "solver": "explicit", "substeps": 40} | more)
    cloth = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 3, 3, horizontal=True), model=model,
                        material=Fabric(stretch=50.0, shear=30.0, bend=1e-2, density=200.0, weft=weft))
    scene.pin("/pin", cloth, [0, 3])
    return scene


def seen(scene: Scene, frames, noise=0.0, sigma=None, seed=0, sets=()) -> list[Track]:
    """Of the first body, after some values were set."""
    sim, path, found = Simulation(scene, device="cpu", precision="float64"), scene.bodies()[0].path, []
    for name, values in sets:
        sim.set(path, name, values)
    sim.run(max(frames), lambda s: found.append(s.positions(path)))
    x = np.array(found)[np.array(frames) - 1]
    return [Track(path, frames, x + noise * np.random.default_rng(seed).normal(size=x.shape), sigma=sigma)]


def halves(scene: Scene) -> np.ndarray:
    """Young's moduli of a bar, 50 kPa where it is held, 200 kPa beyond."""
    soft = scene.softs[0]
    x = soft.points[soft.tets].mean(axis=1)[:, 0]
    return np.where(x < x.mean(), 5e4, 2e5)
