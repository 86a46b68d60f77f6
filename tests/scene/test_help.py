"""What `help()` shows of public names: a docstring each, and a line for every field of a dataclass, with its unit."""

import ast
import inspect
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

import wsim
from wsim.scene import scene as scenes
from wsim.scene.methods import METHODS

NUMBERS = re.compile(r"\b(float|ndarray|Curve)\b")         # what is measured in something
COUNTED = {"counts", "indices", "edges", "tets", "triangles", "others", "muscles", "which", "Pin.points", "Tie.points",
           "Load.points", "Track.points"}                                   # numbers of points and elements
UNIT = re.compile(r"\[[^\[\]]+\]")


def owned() -> list[type]:
    """Dataclasses of methods that have no list in a scene."""
    return [getattr(row.role("objects"), name) for row in METHODS for name in row.owns]


PUBLIC = {name: getattr(wsim, name) for name in wsim.__all__}
CLASSES = {c.__name__: c for c in (*PUBLIC.values(), *(getattr(scenes, n) for n in scenes.__all__), *owned())
           if inspect.isclass(c) and is_dataclass(c)}


def explained(cls: type) -> dict[str, str]:
    """{field: what the docstring says of it} in a table of two columns; a line may have several: "a, b   text; c: text"."""
    found, last = {}, ()
    for line in inspect.getdoc(cls).splitlines()[1:]:
        if match := re.match(r"(\w+(?:, \w+)*) {2,}(\S.*)", line):
            last = match[1].split(", ")
            found |= dict.fromkeys(last, match[2])
        elif last and line.startswith("   "):
            found |= {name: f"{found[name]} {line.strip()}" for name in last}
        else:
            last = ()
    names = {field.name for field in fields(cls)}
    return found | {match[1]: match[2] for text in found.values() for match in re.finditer(r"; (\w+): ([^;]+)", text)
                    if match[1] in names - set(found)}


def test_every_public_name_has_a_docstring():
    assert len(wsim.__all__) <= 43                    # 40 until inverse kinematics and actuators came
    assert [name for name, value in PUBLIC.items() if not inspect.getdoc(value)] == []


def test_every_public_method_has_a_docstring():
    bare = [f"{name}.{attribute}" for name, value in PUBLIC.items() if inspect.isclass(value)
            for attribute, each in vars(value).items() if not attribute.startswith("_")
            and (inspect.isfunction(each) or isinstance(each, (property, staticmethod))) and not inspect.getdoc(each)]
    assert bare == []


def example(value) -> str:
    """The code behind "as in" in a docstring."""
    found = re.search(r"[Aa]s in `([^`]+)`", re.sub(r"\s+", " ", inspect.getdoc(value)))
    return found[1] if found else ""


@pytest.mark.parametrize("name", sorted(set(PUBLIC) - {"shapes", "fit"}))
def test_every_public_name_has_an_example_that_runs(name, tmp_path, monkeypatch):
    """Of `fit`, whose run takes seconds, and `shapes`, a module, the README's and the scenes' are run elsewhere."""
    monkeypatch.chdir(tmp_path)
    scene = wsim.Scene(frames=2, solver="xpbd", substeps=4)
    flag = scene.cloth("/flag", *wsim.shapes.sheet(1.0, 1.0, 8, 8))
    wsim.save(scene, "flag.usda")
    given = {"np": np, "scene": scene, "flag": flag, "seen": np.zeros((2, 81, 3))}
    if name in ("Tie", "Skin"):
        given["jelly"] = scene.soft("/jelly", *wsim.shapes.block((0.2, 0.2, 0.2), 2, at=(3.0, 0.0, 0.0)))
    if name == "JointTree":
        scene.joint("revolute", "/hinge", None, scene.body("/hand", wsim.Box((0.5, 0.1, 0.1))), axis=(0, 0, 1))
    if name == "Recording":
        given["simulation"] = wsim.Simulation(scene, device="cpu", gradients=True)
    assert (code := example(PUBLIC[name])), f"help({name}) has no example: ... as in `CODE`"
    if name == "SceneError":
        with pytest.raises(wsim.SceneError):
            exec(code, PUBLIC | given)
    else:
        exec(code, PUBLIC | given)


LEANS = ("What", "Of", "By", "As", "Whether", "Where", "From", "For", "How", "Why", "Which", "Everything", "With", "After",
         "Before", "Behind", "Until", "Through", "Those", "That", "Its")
ROOT = Path(wsim.__file__).resolve().parent


def leaning(path: Path) -> list[str]:
    """Public functions, classes and methods of a file whose docstring begins without a subject."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = [n for n in ast.walk(tree) if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and not n.name.startswith("_")]
    return [f"{path.name}:{n.lineno}: {n.name}" for n in nodes
            if (ast.get_docstring(n) or "The").split()[0].strip("`(:,;") in LEANS]


@pytest.mark.parametrize("room", ["fitting", "simulation", "show", "geometry", "cli", "bench", "physics/cloth", "physics/soft",
                                  "physics/solver"])
def test_docstrings_begin_with_what_they_are_of(room):
    assert [line for path in sorted((ROOT / room).rglob("*.py")) for line in leaning(path)] == []


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_every_field_is_explained_with_its_unit(name):
    cls = CLASSES[name]
    said = explained(cls)
    for field in fields(cls):
        assert field.name in said, f"help({name}) does not explain {field.name}"
        if NUMBERS.search(str(field.type)) and not {field.name, f"{name}.{field.name}"} & COUNTED:
            text = said[field.name]
            assert UNIT.search(text) or "unit" in text, f"{name}.{field.name} has no unit: {text}"


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_nothing_is_explained_that_is_not_there(name):
    assert set(explained(CLASSES[name])) <= {f.name for f in fields(CLASSES[name])}


@pytest.mark.parametrize("up, normal", [("Y", (0, 1, 0)), ("Z", (0, 0, 1))])
def test_a_plane_is_a_floor_and_gravity_acts_against_up(up, normal):
    scene = wsim.Scene(up=up)
    floor = scene.collider("/floor", wsim.Plane(), at=(0.0, 0.0, 0.0))
    assert np.array_equal(floor.motion.at(0.0)[:3, 2], normal) and floor.shape == wsim.Plane()
    assert np.linalg.det(floor.motion.at(0.0)) == pytest.approx(1.0)
    assert np.array_equal(scene.gravity, -9.81 * np.array(normal))


@pytest.mark.parametrize("axis, normal", [("X", (1, 0, 0)), ("Y", (0, 1, 0)), ("Z", (0, 0, 1))])
def test_a_plane_faces_its_axis(axis, normal):
    wall = wsim.Scene().collider("/wall", wsim.Plane(axis), at=(1.0, 2.0, 3.0))
    assert np.array_equal(wall.motion.at(0.0)[:3, 2], normal) and np.array_equal(wall.motion.at(0.0)[:3, 3], (1.0, 2.0, 3.0))


@pytest.mark.parametrize(("axis", "up"), [(None, "Y"), (None, "Z"), ("X", "Y")])
def test_a_plane_of_a_source_or_sink_faces_where_that_of_a_collider_does(axis, up):
    """A drain under all, or a liquid up to a height, took the half space of its own z, whatever was up."""
    scene, at = wsim.Scene(up=up), (1.0, 2.0, 3.0)
    floor = scene.collider("/floor", wsim.Plane(axis), at=at)
    air, tank = (make("/box", (0, 0, 0), (1, 1, 1), cell=0.5) for make in (scene.smoke, scene.liquid))
    for thing in (scene.sink("/drain", wsim.Plane(axis), at=at), scene.smoke_source("/fire", air, wsim.Plane(axis), at=at),
                  scene.liquid_source("/tap", tank, wsim.Plane(axis), at=at)):
        assert thing.shape == wsim.Plane() and np.array_equal(thing.motion.at(0.0), floor.motion.at(0.0))
    assert np.array_equal(floor.motion.at(0.0)[:3, 2], np.eye(3)["XYZ".index(axis or up)])


def test_an_axis_that_is_none_is_refused():
    with pytest.raises(ValueError, match="axis is 'y'; allowed is 'X', 'Y', 'Z'"):
        wsim.Plane("y")


def test_presets_of_fabrics_are_public():
    assert wsim.fabric("denim").density > 0.0
    with pytest.raises(ValueError, match="allowed is one of silk, cotton, denim"):
        wsim.fabric("tweed")
