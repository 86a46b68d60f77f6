"""`Gradient.value` of every entry of the table of what has gradients (`wsim.scene.values.coverage`), value by value and solver
by solver, against differences of runs in float64."""

import numpy as np
import pytest

from tests.gradient import test_fluids
from tests.make.gradient import fluids
from tests.make.gradient.value import KINDS, everything, recording_of, swept
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.scene.values.coverage import BY, COVERED

PATHS = {"Cloth": "/cloth", "Springs": "/net", "Soft": "/bar", "Collider": "/floor", "Pin": "/pin", "Scene": "/",
         "Body": "/given", "Joint": "/first", "Fluid": "/air", "Source": "/fire"}
IDLE = ("static_friction",)                  # what slides does not know it


SCENES = {"explicit": everything, "xpbd": swept}


def scene_of(column: str, owner: str, name: str) -> tuple[str, str]:
    """Key of the scene that holds a value, and the path of its owner there."""
    if column == "fluid":
        return "turning" if name == "surface" else "air", PATHS[owner] if owner != "Collider" else "/ball"
    if owner in ("Pin", "Collider") and name in KINDS:
        return f"{owner}-{column}-{name}", "/pin" if owner == "Pin" else "/ball"
    if owner == "Skeleton":
        return f"Skeleton-{column}", "/man/bones"
    if owner == "Load":
        return column, {"force": "/push", "traction": "/drag"}[name]
    if owner == "Body" and name in ("dynamic_friction", "restitution"):
        return name, "/a"
    if (owner, name) == ("Springs", "rest_shape"):
        return f"shaped-{column}", PATHS[owner]
    return {"Body": "free", "Joint": "driven"}.get(owner, column), PATHS[owner]


def seen(r: Recording) -> dict[str, dict]:
    """All that a loss can be of, by the keyword of `Recording.backward` and the path, after the last frame."""
    F, scene = r.frames, r.sim.scene
    found: dict[str, dict] = {"positions": {}, "velocities": {}, "poses": {}, "twists": {}}
    for body in scene.bodies():
        found["positions"][body.path] = r.positions(F, body.path)
        found["velocities"][body.path] = r.velocities(F, body.path)
    for body in scene.things("Body"):
        found["poses"][body.path], found["twists"][body.path] = r.poses(F, body.path), r.twists(F, body.path)
    return {what: each for what, each in found.items() if each}


def weights(r: Recording) -> dict[str, dict]:
    rng, size = np.random.default_rng(5), {"velocities": 0.01, "twists": 0.1}
    return {what: {path: size.get(what, 1.0) * rng.normal(size=v.shape) for path, v in each.items()}
            for what, each in seen(r).items()}


def loss(r: Recording, by: dict[str, dict]) -> float:
    r.run()
    now = seen(r)
    return float(sum((now[what][path] * w).sum() for what, each in by.items() for path, w in each.items()))


def step_of(value, key: str) -> float:
    """Largest change of a value: a thousandth of what may change, less where that changes which points touch."""
    if key.startswith(("Pin", "Collider", "Skeleton")):
        return 2e-7 if key.startswith("Collider-explicit") else 2e-6
    near = key in ("free", "driven", "dynamic_friction", "restitution") or key == "implicit" and value.what == "positions"
    return 1e-3 * value.difference_scale() * (0.1 if near else 1.0)


def rows() -> list:
    """(column, owner, name) of every entry; by default those whose scenes are cheap, with the others slow."""
    cheap = {("xpbd", "Pin", "handles"), ("xpbd", "Skeleton", "turns"), ("xpbd", "Skeleton", "weights"),
             ("rigid", "Body", "velocity"), ("rigid", "Body", "inertia"), ("rigid", "Joint", "damping")}
    found = []
    for column, owner, name in [(column, *pair) for row in COVERED if row.kind == BY for pair in row.names()
                                for column in row.tests if column != "mpm"]:           # of tests of its own
        plain = column in ("explicit", "xpbd") and name not in {*KINDS, "weights", "rest_shape"}
        marks = () if plain or (column, owner, name) in cheap else pytest.mark.slow
        found.append(pytest.param(column, owner, name, id=f"{column}-{owner}.{name}", marks=marks))
    return found


@pytest.mark.parametrize("column, owner, name", rows())
def test_every_value_has_the_slope_of_differences(column, owner, name):
    """Of order 4; losses have a few units of rounding, and by Newton's method what its residuals leave. Fluids have kinks,
    which their own differences look for."""
    key, path = scene_of(column, owner, name)
    if key == "air":
        return fluids.compared(*fluids.one(fluids.stirred), f"{path}:{name}")
    if key == "turning":
        return test_fluids.test_by_the_turning_of_an_obstacle()
    r = recording_of(key)
    r.run()
    by = weights(r)
    found = np.asarray(r.backward(**{what: {r.frames: each} for what, each in by.items()}).value(path, name))
    name_ = f"{path}:{name}".removeprefix("/:")
    value = inputs_by_name(r, [name_])[name_]
    base, losses = value.read_value(), {}
    way = np.random.default_rng(8).normal(size=base.shape) if base.ndim else np.ones(())
    step = step_of(value, key) / float(np.abs(way).max())
    for k in (-2, -1, 1, 2):
        value.write_value(base + k * step * way)
        losses[k] = loss(r, by)
    value.write_value(base)
    expected = (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step)
    assert abs(expected) > 0.0 or name in IDLE
    rel = 5e-8 if key in ("explicit", "xpbd") else 5e-6 if key == "implicit" else 1e-6
    assert float((found.reshape(base.shape) * way).sum()) == pytest.approx(expected, rel=rel, abs=4e-15 * abs(losses[1]) / step)
