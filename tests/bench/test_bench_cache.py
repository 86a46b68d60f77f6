"""The reports of benches that are kept: which scene a report counts for, and what becomes of files that are none."""

import os
import sys
from dataclasses import fields, replace
from math import inf

import numpy as np
import pytest

from tests.conftest import grid
from tests.make.bench.bench import report, row
from wsim.bench import cache
from wsim.scene import Cloth, Collider, Load, Pin, Scene, Skin, Soft, Springs, Surface, Tie, Varying, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The cache in a folder of this test."""
    monkeypatch.setattr(cache, "report_cache_folder", lambda: tmp_path / "kept")
    return tmp_path / "kept"


def full() -> Scene:
    """A scene in which every kind of thing occurs."""
    scene = Scene(frames=4)
    cloth = scene.cloth("/cloth", *grid(), velocities=np.ones((16, 3)), rest_points=grid()[0], masses=np.ones(16),
                        thicknesses=np.ones(16))
    net = scene.net("/net", np.eye(3), [[0, 1], [1, 2]], [9.0], [1.0], lengths=[1.0, 1.0], velocities=np.ones((3, 3)))
    points, tets = shapes.block((1.0, 1.0, 1.0), 1)
    cube = scene.soft("/cube", points, tets, others=[Bulk(2e6)], which=[0, 1, 0, 0, 0], velocities=np.ones((8, 3)),
                      rest_points=points, masses=np.ones(8), filled=np.ones(5))
    scene.tie("/tie", cloth, [3], cube, [1])
    scene.pin("/pin", cloth, [0], places=[[0.0, 0.0, 0.0]])
    scene.pin("/soft", net, [0], stiffness=5.0)
    scene.collider("/ball", Surface(*grid(), poses=Curve([0.0, 1.0], np.zeros((2, 16, 3)))))
    scene.force("/pull", net, [1, 2], Curve([0.0, 1.0], np.ones((2, 3))), weights=[0.5, 1.0])
    scene.varying = [Varying("/cloth", "damping", Curve([0.0, 1.0], np.ones(2)))]
    return scene


def name(scene) -> str:
    return cache.report_cache_key(scene, "cpu", {"wsim": "1", "warp": "2"})


def other(value):
    """A value that differs in the least way."""
    if isinstance(value, np.ndarray):
        changed = value.copy()
        changed.flat[-1] = 0 if value.flat[-1] else 1
        return changed
    if isinstance(value, Motion):
        return Motion.at_place((1e-9, 0.0, 0.0))
    if isinstance(value, Curve):
        return Curve(value.times, other(value.values))
    if isinstance(value, Fabric):
        return replace(value, bend=2e-5)
    if isinstance(value, Bulk):
        return replace(value, poisson=0.31)
    if isinstance(value, dict):
        return value | {"Wheel": [Bulk()]}
    if isinstance(value, list):
        return [*map(other, value[:-1]), other(value[-1])]
    if isinstance(value, Surface):
        return replace(value, points=other(value.points))
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return {"membrane": "springs", "/cloth": "/net", "/net": "/cloth", "/cube": "/net"}.get(value, "explicit")
    if isinstance(value, tuple):
        return (*value[:-1], value[-1] + 1)
    return 1.0 if value is None or value == inf else value - 1


def places(kinds, ignored):
    return [(kind, f.name) for kind in kinds for f in fields(kind) if (f.name in cache.NAMES) == ignored]


THINGS = {Scene: "", Cloth: "cloths", Springs: "springs", Soft: "softs", Pin: "pins", Tie: "ties", Collider: "colliders",
          Load: "loads", Varying: "varying"}


def changed(kind, field) -> Scene:
    scene = full()
    thing = scene if kind is Scene else getattr(scene, THINGS[kind])[0]
    if kind is Pin and field == "body":
        thing.points = thing.points                                         # point 0 is there in both bodies
    setattr(thing, field, other(getattr(thing, field)))
    return scene


@pytest.mark.parametrize(("kind", "field"), [p for p in places(THINGS, False) if p[1] not in THINGS.values()])
def test_the_key_changes_with_every_field_that_matters(kind, field):
    assert name(changed(kind, field)) != name(full())


@pytest.mark.parametrize("field", [f for f in THINGS.values() if f])
def test_the_key_changes_with_every_thing(field):
    scene = full()
    getattr(scene, field).pop()
    paths = {b.path for b in scene.bodies()}
    scene.pins, scene.ties, scene.loads = ([t for t in things if {t.body, getattr(t, "other", t.body)} <= paths]
                                           for things in (scene.pins, scene.ties, scene.loads))
    scene.varying = [t for t in scene.varying if t.path in paths]
    assert name(scene) != name(full())


def test_the_key_changes_with_the_thing_of_which_a_value_varies():
    keys = set()
    for path in ("/", "/cloth", "/net", "/cube", "/ball"):
        scene = full()
        scene.varying[0].path = path
        keys.add(name(scene))
    assert len(keys) == 5


def test_the_key_does_not_change_with_names_notes_and_later_frames():
    scene = full()
    scene.cloths[0].path = scene.pins[0].body = scene.ties[0].body = scene.varying[0].path = "/Other"
    scene.springs[0].path = scene.loads[0].body = scene.pins[1].body = "/Net"
    scene.loads[0].path = "/l"
    scene.pins[0].path, scene.pins[0].target, scene.colliders[0].path = "/a", "/b", "/c"
    scene.softs[0].skins.append(Skin("/cube/skin", np.eye(3), np.array([3]), np.arange(3)))     # follows, and moves nothing
    scene.source, scene.notes, scene.variants, scene.start = "b.usda", ["odd"], {"/a": {"b": "c"}}, 7.0
    assert name(scene) == name(full())
    assert name(Scene(frames=96)) == name(Scene(frames=50)) != name(Scene(frames=5))


def test_the_key_changes_with_hardware_and_versions():
    keys = {cache.report_cache_key(full(), device, {"wsim": w}) for device in ("a", "b") for w in ("1", "2")}
    assert len(keys) == 4


@pytest.mark.parametrize("error", [1e-3, inf])
def test_a_report_reads_back_as_it_was_written(kept, error):
    made = report([row(1, 0.1), row(2, None, drift=-0.1, note="x", own=True)], error=error, refused="why")
    cache.cache_report("a", made)
    back, strange = cache.read_cached_report("a")
    assert back == made and not strange


def test_there_is_no_report_and_no_warning_where_there_is_no_file(kept):
    assert cache.read_cached_report("a") == (None, "")


@pytest.mark.parametrize("text", ["", "[]", "{", '{"format": 1}', '{"format": 1, "key": "b", "report": {}}',
                                  '{"format": 1, "key": "a", "report": {"rows": 3}}', "\x00\xff"])
def test_a_foreign_file_is_ignored_with_a_warning(kept, text):
    kept.mkdir()
    (kept / "a.json").write_text(text, encoding="utf-8")
    found, strange = cache.read_cached_report("a")
    assert found is None and "is ignored" in strange


def test_a_write_that_fails_leaves_the_earlier_file_whole(kept, monkeypatch):
    place = cache.cache_report("a", report([row(1, 0.1)]))
    before = place.read_text()

    def full_disk(*paths):
        raise OSError(28, "No space left on device")
    monkeypatch.setattr(os, "replace", full_disk)
    with pytest.raises(OSError):
        cache.cache_report("a", report([row(2, 0.2)]))
    assert place.read_text() == before and os.listdir(kept) == ["a.json"]


@pytest.mark.parametrize(("platform", "variable"), [("linux", "XDG_CACHE_HOME"), ("win32", "LOCALAPPDATA")])
def test_the_cache_is_where_the_system_keeps_such(platform, variable, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setenv(variable, str(tmp_path))
    assert cache.report_cache_folder() == tmp_path / "wsim" / "bench"
