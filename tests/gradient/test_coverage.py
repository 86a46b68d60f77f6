"""The table of what has gradients is true: rows that are covered name tests, values that have a derivative have that of
differences, and what is refused raises, with the prim path."""

import ast
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.make.gradient.gradients import net, sheet
from tests.make.gradient.value import flat, recording_of
from tests.make.physics.animation.dressed import clothed
from tests.make.physics.animation.gradients import UNFOLLOWED, changed
from tests.make.rows.wheels import ROW
from tests.make.rows.wheels.objects import Wheel
from wsim import Box, Plane, Simulation, Sphere
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.fluid.objects import Fluid
from wsim.physics.rigid.joints.joint import Drive, revolute_joint, spherical_joint
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Pin, Scene, SceneError, Surface, Varying, methods, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.values import table
from wsim.scene.values.coverage import BY, COVERED, REFUSED, coverage_text, differentiable_row, table_rows

TESTS = Path(__file__).resolve().parent.parent
PATHS = {"Cloth": "/cloth", "Springs": "/net", "Soft": "/bar", "Collider": "/floor", "Pin": "/pin", "Scene": "",
         "Body": "/thrown", "Joint": "/hinge"}


@cache
def functions(path: str) -> set[str]:
    tree = ast.parse((TESTS / path).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("covered", COVERED, ids=lambda c: f"{c.kind} {c.what}")
def test_what_is_covered_names_tests_that_there_are(covered):
    assert covered.tests
    for test in covered.tests.values():
        path, _, name = test.partition("::")
        assert name in functions(path), test


def test_values_with_a_derivative_are_those_of_the_rows():
    rows = [name for covered in COVERED for name in covered.names()]
    assert len(rows) == len(set(rows)) and set(rows) == {(v.owner, v.name) for v in table.VALUES if v.gradient}


def test_the_documents_are_made_of_the_rows():
    import wsim.gradient
    page = (TESTS.parent / "wsim/docs/gradients.md").read_text(encoding="utf-8").splitlines()
    assert [row for row in table_rows() if row not in page] == []
    assert coverage_text() in (wsim.gradient.__doc__ or "") and all(covered.what.split()[-1] in coverage_text()
                                                                    for covered in COVERED)


@cache
def everything() -> Recording:
    """Of everything by explicit steps, after a run."""
    recording = recording_of("explicit")
    recording.run()
    return recording


def recordable(value) -> bool:
    """Whether there are recordings of scenes that hold its owner; of others the scene is refused."""
    row = methods.owning_method(value.owner)
    return value.owner in PATHS and (row is None or row.gradients)


@pytest.mark.parametrize("value", [v for v in table.VALUES if not v.gradient and recordable(v)],
                         ids=lambda v: f"{v.owner}.{v.name}")
def test_a_value_without_a_derivative_is_refused_with_its_reason(value):
    path = PATHS[value.owner] or "/"
    recording = pressed() if value.owner == "Joint" else everything()
    with pytest.raises(SceneError) as said:
        inputs_by_name(recording, [f"{path}:{value.name}"])
    (problem,) = said.value.problems
    assert problem.path == path and value.why in problem.text and value.name in problem.text


def recorded(scene: Scene, frames: int = 1) -> Recording:
    return Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), frames)


def gradient(scene: Scene):
    recording = recorded(scene)
    body = scene.bodies()[0]
    return recording.backward({1: {body.path: np.ones((len(body.points), 3))}})


def of(material: dict, **more) -> Scene:
    scene = sheet("membrane", **more)
    scene.cloths[0].material = replace(scene.cloths[0].material, **material)
    return scene


def folding() -> Scene:
    scene = sheet("membrane")
    scene.cloths[0].self_collision = True
    return scene


def heavy() -> Scene:
    scene = sheet("springs")
    scene.cloths[0].masses = np.full(25, 1e-3)
    return scene


def tethered() -> Scene:
    scene = sheet("springs", solver="xpbd", integrator="bdf2", substeps=8, iterations=4)
    scene.cloths[0].tethers = True
    return scene


def alone() -> Scene:
    scene = Scene()
    scene.add(Body("/thrown", mass=1.0, center=np.zeros(3), inertia=np.ones(3)))
    return scene


def still() -> Scene:
    scene = Scene()
    scene.add(Fluid("/air", np.zeros(3), (0.4, 0.4, 0.1), 0.1, steps=1))
    return scene


def resting(joint=False, mesh=False, cloth=False, sleep=0.0, tolerance=0.0) -> Scene:
    scene = Scene(sleep_speed=sleep, contact_tolerance=tolerance or 1e-9 * mesh)
    scene.collider("/floor", Plane(), motion=flat())
    ball = Body("/ball", [Collider("/ball/shape", Sphere(0.1))], Motion.at_place((0.0, 0.1, 0.0)))
    scene.add(ball)
    if joint:
        scene.add(spherical_joint("/hinge", None, ball))
    if mesh:
        points, quads = np.array([[x, -0.5 * x * z, z] for x in (-1.0, 1.0) for z in (-1.0, 1.0)]), [[0, 1, 3], [0, 3, 2]]
        scene.collider("/rock", Surface(points, np.array([3, 3]), np.ravel(quads)))
    if cloth:
        scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 2, 2, horizontal=True))
    return scene


def pressed() -> Recording:
    """A drive that holds a hinge against its limit."""
    scene = alone()
    hinge = revolute_joint("/hinge", None, scene.things("Body")[0], low=-0.01, high=0.01, at=(0.3, 0.0, 0.0),
                           axis=(0.0, 0.0, 1.0), drives={"rotX": Drive(1000.0, 1.0, 1.0)})
    scene.add(hinge)
    return recorded(scene, 2)


def motored() -> Scene:
    scene = alone()
    scene.add(revolute_joint("/hinge", None, scene.things("Body")[0], at=(0.3, 0.0, 0.0), axis=(0.0, 0.0, 1.0)))
    scene.actuator("motor", "/motor", "/hinge")
    return scene


def flush() -> Recording:
    """A box on another of its size, edge on edge: what is a corner, and what is cut off, is a matter of rounding."""
    scene = Scene(contact_tolerance=1e-9)
    for k, path in enumerate(("/lower", "/upper")):
        scene.add(Body(path, [Collider(f"{path}/box", Box((0.5, 0.5, 0.5)))], Motion.at_place((0.0, k * 0.9999, 0.0))))
    return recorded(scene)


def turned() -> Scene:
    scene = Scene(solver="xpbd")
    scene.add(Wheel("/wheel"))
    return scene


def layered(**more) -> Scene:
    scene = Scene(frames=1)
    more = more or {"layers": True}
    scene.add(Fluid("/air", (0, 0, 0), (1, 1, 0.125), 0.125, slip=False, viscosity=0.1, **more))
    return scene


def draped() -> Scene:
    """A cloth in air."""
    scene = layered(margin=0.0)
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 2, 2, at=(0.5, 0.5, 0.0625)))
    return scene


def grown():
    """A mesh whose points move, in air: by a loss of the air."""
    scene, (x, counts, indices) = layered(margin=0.0), shapes.sheet(0.5, 0.5, 2, 2, at=(0.5, 0.5, 0.0625))
    poses = Curve(np.array([0.0, 1.0]), np.stack([x, 1.1 * x]))
    scene.collider("/ball", Surface(x, counts, indices, poses))
    return recorded(scene, 1).backward(fluids={1: {"/air": {"velocity": np.ones((8, 8, 1, 3))}}})


def poured(other=None, **more) -> Scene:
    """A little sand above a floor, and another collider."""
    scene = Scene(frames=1)
    scene.collider("/floor", Plane(), motion=flat())
    if other:
        scene.collider("/ball", other)
    x = 0.025 * np.stack(np.meshgrid(*[[0, 1]] * 3), -1).reshape(-1, 3) + [0.0, 0.1, 0.0]
    scene.mpm("/heap", points=x, volumes=0.025**3, cell=0.05, material="sand", **more)
    return scene


def moving():
    motion = Motion(np.arange(2) / 60.0, np.stack([np.eye(4), np.eye(4) + np.eye(4, k=3) * 0.01]))
    scene = net(integrator="leapfrog", pins=[Pin("/pin", "/chain", np.array([0]), motion=motion)])
    return recorded(scene).backward(reactions={1: {"/pin": np.ones((1, 3))}})


VARIES = Varying("/chain", "stiffness", Curve([0.0, 1.0], np.array([40.0, 50.0])))
def landing() -> Scene:
    scene = net(solver="implicit", integrator="implicit_midpoint")
    scene.collider("/floor", Plane())
    return scene


CASES = {
    "method": ("/wheel", lambda: Simulation(turned(), device="cpu", gradients=True)),
    "surfaces": ("/cloth", lambda: Simulation(folding(), device="cpu", gradients=True)),
    "varying": ("/chain", lambda: recorded(net(varying=[VARIES]))),
    "limits": ("/cloth", lambda: recorded(tethered()).reactions(1)),
    "moved": ("/pin", lambda: moving().targets("/pin")),
    "weft": ("/cloth", lambda: gradient(of({"weft": 0.0})).material("weft")),
    "shear": ("/cloth", lambda: gradient(of({"shear": 0.0})).material("shear")),
    "density": ("/cloth", lambda: gradient(heavy()).density()),
    "mass": ("/cloth", lambda: gradient(sheet("springs")).mass()),
    "lengths": ("/cloth", lambda: gradient(sheet("springs")).lengths()),
    "air": ("/cloth", lambda: gradient(sheet("springs")).air_coefficient("drag")),
    "wind": ("wind", lambda: inputs_by_name(recorded(net()), ["wind"])),
    "restitution": ("/dull", lambda: everything().backward({2: {"/net": np.ones((5, 3))}})
                    .restitution("/dull")),
    "impulses": ("/ball", lambda: Simulation(resting(), device="cpu", gradients=True)),
    "held": ("/ball", lambda: Simulation(resting(joint=True), device="cpu", gradients=True)),
    "meshes": ("/rock", lambda: Simulation(resting(mesh=True), device="cpu", gradients=True)),
    "points": ("/ball", lambda: Simulation(resting(cloth=True), device="cpu", gradients=True)),
    "sleep": ("/ball", lambda: Simulation(resting(sleep=0.05, tolerance=1e-9), device="cpu", gradients=True)),
    "actuators": ("/motor", lambda: Simulation(motored(), device="cpu", gradients=True)),
    "driven": ("/hinge", lambda: pressed().backward(twists={2: {"/thrown": np.ones((2, 3))}})),
    "features": ("/lower", lambda: flush().backward(twists={1: {"/upper": np.ones((2, 3))}})),
    "idle": ("air_drag", lambda: inputs_by_name(recorded(alone()), ["air_drag"])),
    "surface": ("/floor", lambda: inputs_by_name(everything(), ["/floor:surface"])),
    "walls": ("/air", lambda: recorded(draped())),
    "forming": ("/ball", lambda: grown().value("/ball", "surface")),
    "layers": ("/air", lambda: recorded(layered())),
    "margin": ("/air", lambda: recorded(layered(margin=0.5))),
    "conserve": ("/air", lambda: recorded(layered(conserve=True, sides=("closed",) * 6))),
    "still": ("/air", lambda: inputs_by_name(recorded(still()), ["/air:viscosity"])),
    "ends": ("/floor", lambda: Simulation(landing(), device="cpu", gradients=True)),
    "touched": ("/floor", lambda: gradient(net()).thickness("/floor")),
    "actuation": ("/chain", lambda: inputs_by_name(recorded(net()), ["/chain:actuation"])),
    "law": ("/heap", lambda: inputs_by_name(recorded(poured()), ["/heap:hardening"])),
    "mixed": ("/heap", lambda: inputs_by_name(recorded(poured(further=("jelly",), which=np.arange(8) % 2)), ["/heap:young"])),
    "grown": ("/heap", lambda: recorded(poured(integrator="implicit"))),
    "curved": ("/ball", lambda: recorded(poured(Sphere(0.1)))),
    "poured": ("/floor", lambda: recorded(poured()).backward(positions={1: {"/heap": np.ones((8, 3))}}).friction("/floor")),
    "load": ("loads", lambda: gradient(net()).load()),
    "pin": ("/pin", lambda: gradient(net()).pin("/pin", "stiffness")),
    "material": ("/chain", lambda: gradient(net()).material("stretch")),
    **{key: (path, lambda change=change, name=name: inputs_by_name(recorded(changed(change)), [f"/man/bones:{name}"]))
       for key, (path, change, name) in UNFOLLOWED.items()},
    "dressed": ("/man/bones", lambda: Simulation(clothed(), device="cpu", gradients=True)),
    "value": ("/pin", lambda: differentiable_row(net(), "/pin", "stiffness")),
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_is_refused_raises_with_its_words_and_path(key, monkeypatch):
    if key == "method":
        monkeypatch.setattr(methods, "METHODS", [*methods.METHODS, ROW])
        for module in ("wsim.simulation.plan", "wsim.simulation.methods"):
            monkeypatch.setattr(f"{module}.METHODS", methods.METHODS)
    path, call = CASES[key]
    with pytest.raises(SceneError) as said:
        call()
    (problem,) = said.value.problems
    start, end = (part.strip() for part in (REFUSED[key].text.partition("{")[0], REFUSED[key].text.rpartition("}")[2]))
    assert problem.path == path and problem.text.startswith(start) and problem.text.endswith(end)


def test_rows_with_respect_to_values_name_values():
    assert all(table.values_of_class(owner)[name].gradient for row in COVERED if row.kind == BY for owner, name in row.names())
