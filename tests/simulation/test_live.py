"""Live parameters that a scene would refuse are refused by a simulation too, and leave nothing behind."""

import numpy as np
import pytest

from tests.conftest import grid
from wsim.scene import Scene, SceneError, Sphere
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

CPU = {"device": "cpu"}
SCALED, NAN = 2.0 * np.eye(4), np.full((4, 4), np.nan)


def things(**more) -> Scene:
    """A cloth in the wind, a net and a ball."""
    scene = Scene(**{"substeps": 2, "iterations": 2, "solver": "xpbd", "integrator": "backward_euler"} | more)
    scene.cloth("/cloth", *grid(), material=Fabric(bend=1e-4, damping=1e-3), drag=1.0, model="springs")
    scene.pin("/pin", scene.cloths[0], [0])
    scene.net("/net", [[0, 1, 0], [0.1, 1, 0], [0.2, 1, 0]], [[0, 1], [1, 2]], [50.0], [0.1], damping=1e-3)
    scene.collider("/ball", Sphere(0.2), at=(0.0, -5.0, 0.0), restitution=0.5)
    return scene




def whole(sim: Simulation) -> dict:
    """Everything that a refused value could have changed: arrays of the device by the owner, curves, the list of changes."""
    def arrays(thing, name, depth, found):
        if hasattr(thing, "numpy") and hasattr(thing, "ptr"):
            found[name] = thing.numpy().copy() if thing.dtype else None
        elif depth and hasattr(thing, "__dict__"):
            for key, value in vars(thing).items():
                arrays(value, f"{name}.{key}", depth - 1, found)
        elif depth and isinstance(thing, (list, tuple)):
            for k, value in enumerate(thing):
                arrays(value, f"{name}[{k}]", depth - 1, found)
        elif isinstance(thing, np.ndarray):
            found[name] = thing.copy()
        elif hasattr(thing, "_cls"):
            for key in thing._cls.vars:
                arrays(getattr(thing, key), f"{name}.{key}", 1, found)
    found: dict = {}
    for method in sim.plan.methods:
        arrays(method, method.name, 3, found)
    for name, array in sim.state.points.arrays.items():
        found[name] = array.numpy().copy()
    for b in sim.model.bodies:
        found[f"masses {b.number}"], found[f"rest {b.number}"] = b.masses.copy(), b.rest.copy()
    return found | {"changes": repr(sim.changes), "substeps": sim.plan.clock.substeps}


def same(a: dict, b: dict) -> None:
    assert a.keys() == b.keys() and len(a) > 30
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


REFUSED = [
    ("/", "gravity", -9.81, "three finite numbers"),
    ("/", "gravity", (0.0, np.nan, 0.0), "three finite"),
    ("/", "wind", [1.0, 2.0], "three finite"),
    ("/", "air_drag", -1.0, ">= 0"),
    ("/", "gravity", "down", "are numbers"),
    ("/cloth", "stretch", -5.0, "stretch is -5; allowed is a finite number > 0"),
    ("/cloth", "stretch", np.inf, "is inf"),
    ("/cloth", "bend", -1e-6, ">= 0"),
    ("/cloth", "damping", np.nan, "is nan"),
    ("/cloth", "density", 0.0, "> 0"),
    ("/cloth", "stretch", np.ones(5), r"shape \(5,\)"),
    ("/cloth", "shear", None, "shear is"),
    ("/cloth", "shear", 1e39, "3.4e"),
    ("/cloth", "positions", np.where(np.arange(48).reshape(16, 3) == 7, np.nan, 1.0), "must be finite"),
    ("/cloth", "positions", np.zeros((15, 3)), r"found \(15, 3\)"),
    ("/cloth", "velocities", np.full((16, 3), 1e39), "up to 3.4"),
    ("/cloth", "static_friction", -0.1, ">= 0"),
    ("/cloth", "rest_shape", "flat", "are numbers"),
    ("/net", "stiffness", -1.0, "> 0"),
    ("/net", "stiffness", 0.0, "> 0"),
    ("/net", "stiffness", [1.0, 2.0, 3.0], "2 of them"),
    ("/net", "lengths", [0.1, -0.1], "> 0"),
    ("/net", "lengths", [0.1], "> 0"),
    ("/nothing", "velocities", np.zeros((1, 3)), "bodies"),
    ("/ball", "restitution", 1.5, "0 to 1"),
    ("/ball", "thickness", np.inf, "is inf"),
    ("/ball", "dynamic_friction", "much", "much"),
    ("/ball", "motion", SCALED, "scales"),
    ("/ball", "motion", NAN, "NaN"),
    ("/ball", "motion", np.eye(3), r"\(4, 4\)"),
    ("/pin", "motion", SCALED, "scales"),
    ("/pin", "motion", NAN, "NaN"),
    ("/pin", "motion", 1.0, r"\(4, 4\)"),
    ("/pin", "motion", np.ones((4, 4)), "scales"),
    ("/net", "colour", 1.0, "no live parameter 'colour'"),
    ("/nowhere", "stretch", 1.0, "is no object of this scene; there are /, /cloth"),
]


def test_what_a_scene_would_not_take_is_refused_and_changes_nothing():
    sim = Simulation(things(), worlds=2, **CPU)
    sim.run(1)
    before = whole(sim)
    for path, name, value, words in REFUSED:
        for world in (None, 1):
            if world is None or path != "/ball" or name != "motion":
                with pytest.raises(SceneError, match=words):
                    sim.set(path, name, value, world)
    for world in (2, -1, 7):
        for name, value in (("stretch", 1.0), ("rest_shape", grid()[0]), ("positions", grid()[0]), ("density", 1.0)):
            with pytest.raises(SceneError, match=f"in world {world} of 2"):
                sim.set("/cloth", name, value, world)
    same(before, whole(sim))
    sim.set("/net", "stiffness", np.array([20.0, 30.0]))               # one for each spring
    sim.set("/net", "stiffness", np.array([40.0]), world=1)
    assert [(c[2], c[3]) for c in sim.changes][1:] == [(40.0, 1)] and len(sim.changes) == 2


@pytest.mark.parametrize("path, name, value", [
    ("/net", "stiffness", 1e20), ("/cloth", "stretch", 1e20), ("/cloth", "density", 1e-25), ("/cloth", "rest_shape", 1e-14)])
def test_what_explicit_steps_cannot_follow_is_refused_and_changes_nothing(path, name, value):
    """So many substeps that a frame would never end."""
    scene = things(solver="explicit", integrator="leapfrog", substeps=200)
    scene.colliders.clear()
    sim = Simulation(scene, **CPU)
    sim.set("/cloth", "density", 170.0)
    sim.set("/net", "stiffness", [30.0, 40.0])
    before, couplings = whole(sim), [r.coupling for r in sim.model.constraints]
    with pytest.raises(SceneError, match="allowed is up to 1000000"):
        sim.set(path, name, value * scene.cloths[0].points if name == "rest_shape" else value)
    same(before, whole(sim))
    assert any(couplings) and all(r.coupling is c for r, c in zip(sim.model.constraints, couplings, strict=True))
