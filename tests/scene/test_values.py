"""A value of one row and one file (tests/make/rows/brake) goes through all that those of wsim go through; the table
says what is."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from tests.make.rows.brake import ROW, VALUE
from tests.make.rows.brake.objects import Brake
from wsim import Bulk, Cloth, Collider, Fabric, Simulation, Soft, Springs
from wsim.fitting import Settings, Track, fit, parameter
from wsim.fitting.fields import field
from wsim.fitting.parameter import parameters_of_names
from wsim.gradient.inputs.by_name import KINDS, inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.animation.objects import Skeleton
from wsim.physics.fluid.liquid.objects import Liquid
from wsim.physics.fluid.objects import Fluid, Source
from wsim.physics.mpm.objects import Granular, Jelly, MaterialPoints, Snow, Water
from wsim.physics.rigid.joints.actuators.actuator import Actuator
from wsim.physics.rigid.joints.joint import Joint
from wsim.physics.rigid.objects import Body
from wsim.physics.soft.clusters.objects import Clusters
from wsim.scene import Load, Pin, Scene, SceneError, Varying, methods
from wsim.scene.check.scene import check_scene
from wsim.scene.check.varying import NEEDS
from wsim.scene.curve import Curve
from wsim.scene.values import table
from wsim.scene.values.value import ValueRange, value_holder
from wsim.usd import load, names, save
from wsim.usd.result.fitted import save_fitted

FRAMES, STEPS, FPS, GRIP = 6, 4, 24.0, 3.0
SPEED = np.array([1.0, 2.0, 0.5])          # [m/s]


@pytest.fixture
def row(monkeypatch):
    monkeypatch.setattr(methods, "METHODS", [*methods.METHODS, ROW])
    for module in ("wsim.simulation.plan", "wsim.simulation.methods"):
        monkeypatch.setattr(f"{module}.METHODS", methods.METHODS)
    monkeypatch.setattr(table, "VALUES", [*table.VALUES, VALUE])


def braked(grip: float = GRIP, *varying: Varying) -> Scene:
    """A net that flies without weight, all its points alike, so that its springs never pull."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=FPS, frames=FRAMES, substeps=STEPS, iterations=1, solver="xpbd",
                  integrator="backward_euler")
    scene.net("/net", [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]], [[0, 1], [1, 2]], [50.0], [0.1],
              velocities=np.tile(SPEED, (3, 1)))
    scene.add(Brake("/brake", "/net", grip))
    scene.varying += varying
    return scene


def away(grips) -> np.ndarray:
    """How far it has flown after frames of these grips [m]: v h (1 + q + q^2 ...), q = exp(-grip h) after each substep."""
    h = 1.0 / FPS / STEPS
    q = np.cumprod(np.repeat(np.exp(-np.asarray(grips) * h), STEPS))
    return SPEED * h * (1.0 + q[:-1].sum())


def flown(sim: Simulation, world: int = 0) -> np.ndarray:
    return sim.positions("/net", world)[0]


def simulation(scene: Scene, **how) -> Simulation:
    return Simulation(scene, device="cpu", precision="float64", **how)


def test_a_toy_value_is_live_and_refused_out_of_its_bounds(row):
    sim = simulation(braked(), worlds=2)
    sim.set("/brake", "grip", 1.0, world=1)
    sim.run(FRAMES)
    for world, grip in enumerate((GRIP, 1.0)):
        assert np.abs(flown(sim, world) - away([grip] * FRAMES)).max() < 1e-13
    for value, words in ((-1.0, "grip is -1; allowed is >= 0 and < 50"), (50.0, "grip is 50; allowed"), (np.nan, "grip is nan"),
                         ([1.0, 2.0], "allowed is one number"), ("much", "are numbers")):
        with pytest.raises(SceneError, match=f"/brake: .*{words}"):
            sim.set("/brake", "grip", value)
    with pytest.raises(SceneError, match="/brake: has no live parameter 'grp'; there are grip"):
        sim.set("/brake", "grp", 1.0)
    with pytest.raises(SceneError, match="/nowhere: is no object of this scene; there are /, .*/brake"):
        sim.set("/nowhere", "grp", 1.0)


def test_a_scene_is_judged_by_the_same_bounds(row):
    (problem,) = [p for p in check_scene(braked(-1.0)) if p.fatal]
    assert str(problem) == "error: /brake: grip is -1; allowed: >= 0 and < 50; fix: author another toy:grip"


def test_a_toy_value_varies_in_time_and_is_saved_so(row, tmp_path):
    curve = Curve([0.0, 0.25], np.array([4.0, 1.0]))
    scene = braked(4.0, Varying("/brake", "grip", curve))
    sim = simulation(scene)
    sim.run(FRAMES)
    assert np.abs(flown(sim) - away([curve.at((f + 0.5) / FPS) for f in range(FRAMES)])).max() < 1e-13
    save(scene, tmp_path / "s.usda")
    (again,) = load(tmp_path / "s.usda").varying
    assert (again.path, again.name) == ("/brake", "grip") and again.curve.values.tolist() == [4.0, 1.0]
    for thing, words in ((Curve([0.0, 1.0], np.array([1.0, 60.0])), "grip is 60; allowed is >= 0 and < 50"),
                         (Curve([0.0, 1.0], np.ones((2, 3))), "keys of shape")):
        (problem,) = [p for p in check_scene(braked(4.0, Varying("/brake", "grip", thing))) if p.fatal]
        assert problem.path == "/brake" and words in problem.text
    (problem,) = [p for p in check_scene(braked(0.0, Varying("/brake", "grip", curve))) if p.fatal]
    assert "it is 0 at the start" in problem.text


def test_a_toy_value_is_fitted_and_its_layer_holds_it(row, tmp_path):
    seen = Track("/net", np.arange(1, FRAMES + 1), np.array([[away([GRIP] * f) + [0.1 * k, 0.0, 0.0] for k in range(3)]
                                                             for f in range(1, FRAMES + 1)]))
    save(braked(1.0), tmp_path / "s.usda")
    scene = load(tmp_path / "s.usda")
    found = fit(scene, [seen], "grip", settings=Settings(device="cpu"))
    assert found.converged and found.values["grip"] == pytest.approx(GRIP, rel=1e-5)
    assert scene.things("Brake")[0].grip == 1.0 and found.scene.things("Brake")[0].grip == found.values["grip"]
    save_fitted(scene, found.scene, tmp_path / "fitted.usda")
    assert load(tmp_path / "fitted.usda").things("Brake")[0].grip == found.values["grip"]
    with pytest.raises(SceneError, match="/brake: grip is 0 at the start, so that nothing of it runs"):
        parameters_of_names("grip", [braked(0.0)])
    with pytest.raises(SceneError, match="elasticity: is no parameter; allowed are stretch, .*, grip"):
        parameters_of_names("elasticity", [braked()])


def test_a_toy_value_is_refused_for_gradients_by_its_row(row):
    """Those of others go through it."""
    recording = Recording(simulation(braked(), gradients=True), FRAMES)
    for name, words in (("grip", "has no derivative with respect to grip: a toy has none"), ("grp", "has no 'grp'")):
        with pytest.raises(SceneError, match=f"/brake: {words}"):
            inputs_by_name(recording, [f"/brake:{name}"])
    found = recording.backward({FRAMES: {"/net": np.full((3, 3), 1.0 / 3.0)}}).velocities("/net").sum(axis=0)
    assert found == pytest.approx(away([GRIP] * FRAMES) / SPEED, rel=1e-12)


# the table itself

OWNERS = {"Cloth": (Cloth, Fabric), "Springs": (Springs,), "Soft": (Soft, Bulk), "Clusters": (Clusters,),
          "Collider": (Collider,), "Pin": (Pin,),
          "Load": (Load,), "Scene": (Scene,), "Body": (Body,), "Joint": (Joint,),
          "Actuator": (Actuator,), "Fluid": (Fluid,), "Source": (Source,),
          "Liquid": (Liquid,), "Skeleton": (Skeleton,), "MaterialPoints": (MaterialPoints, Jelly, Snow, Granular, Water)}
HELD = {"surface": "motion", "turns": "motion", "place": "motion",
        "mass": "masses", "force": "curve", "traction": "curve", "shift": "motion", "targets": "motion", "points": "shape",
        **dict.fromkeys(("keys", "tangents", "handles"), "motion"),
        "positions": "points", "velocities": "velocity", "rest_shape": "points", "static_friction": "colliders",
        "dynamic_friction": "colliders", "restitution": "colliders",
        "stiffness": "drives", "damping": "drives", "target": "drives", "speed": "drives"}


@pytest.mark.parametrize("value", table.VALUES, ids=lambda v: f"{v.owner}.{v.name}")
def test_a_row_names_what_there_is(value):
    """A field of its owner, a known unit, needs and input, and a reason where there is no derivative."""
    of = {f.name for kind in OWNERS[value.owner] for f in fields(kind)}
    assert value.name in of or HELD[value.name] in of
    assert value.unit in names.UNITS and set(value.needs) <= set(NEEDS)
    assert value.gradient in KINDS or value.why
    assert table.find_value_row(value.owner, value.name) == value


def test_rows_are_of_one_owner_and_name():
    assert len({(v.owner, v.name) for v in table.VALUES}) == len(table.VALUES)


@pytest.mark.parametrize("bounds, good, bad, words", [
    (ValueRange(), (0.0, 1e300), (-1e-9, np.inf, np.nan), "a finite number >= 0"),
    (ValueRange(strict=True), (1e-300,), (0.0, -1.0, np.inf, np.nan), "a finite number > 0"),
    (ValueRange(-1.0, True, 0.5), (0.0, 0.499), (-1.0, 0.5, np.nan), "> -1 and < 0.5"),
    (ValueRange(high=1.0, closed=True), (0.0, 1.0), (1.0001, -0.1, np.nan), "0 to 1"),
    (ValueRange(-np.inf), (-1e300, 0.0), (np.inf, -np.inf, np.nan), "a finite number")])
def test_bounds_hold_numbers_and_arrays(bounds, good, bad, words):
    assert all(bounds.holds(v) for v in good) and not any(bounds.holds(v) for v in bad) and bounds.words == words
    assert bounds.holds(np.array([*good, *bad])).tolist() == [True] * len(good) + [False] * len(bad)
    assert bounds.wrong("it", bad[0]) and not bounds.wrong("it", good[0])


def test_a_material_refuses_by_the_bounds_of_the_table():
    for make, owner, name, value in ((Fabric, "Cloth", "stretch", -5.0), (Bulk, "Soft", "poisson", 0.5)):
        with pytest.raises(ValueError) as said:
            make(**{name: value})
        bounds = table.values_of_class(owner)[name].range
        assert str(said.value) == bounds.wrong(name, value) == f"{name} is {value:g}; allowed is {bounds.words}"
    assert value_holder(Cloth("/c", [], [], []), "stretch") == Fabric()


def test_documents_name_every_value():
    """What is live in the words of `Simulation.set`, what is fitted in the page about fits."""
    said, page = str(Simulation.set.__doc__), (Path(__file__).resolve().parents[2] / "wsim/docs/fits.md").read_text(
        encoding="utf-8")
    assert [name for name in table.live_value_names("") if not re.search(rf"\b{name}\b", said)] == []
    assert [name for name in (*parameter.parameter_names(), *(f"{kind.name}[]" for kind in field.field_kinds()))
            if name not in page] == []
