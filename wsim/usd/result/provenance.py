"""What a result was made of and how: custom data `wsim:run` of its layer, so that a run that goes on from it can tell what is
another now.

    {"version": "0.1.0", "settings": {"precision": "float32", "solver": "xpbd", ...}, "scene": {path: {field: digest}}}

Beside it, for people (`usdcat --layerMetadata`), the dictionary `wsim`: version, command, scene, sceneHash and the settings.

A digest is of a value as it decides the motion: names, what is only seen and where a run begins are left out. The scene itself
stands at "/". Each body, collider, pin, tie and load has its own row, so that a change is told by path and field.
"""

import hashlib
import json
import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

import numpy as np

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.methods import each_method_object

KEY, SHOWN = "wsim:run", "wsim"                                   # for a run that goes on, for people
START = {"velocities", "start", "frames"}                         # where a run begins and ends
SEEN = {"path", "skins", "target", "up", "error", "source", "notes", "variants"}                          # no motion follows
SETTINGS = {"solver", "integrator", "substeps", "iterations"}     # as a scene names them; what ran is told by `settings`
LISTS = ("colliders", "pins", "ties", "loads")


def content_digest(value) -> str:
    """Sixteen hexadecimal digits of a value: numbers, text, arrays (with type and shape), dataclasses and lists of such."""
    state = hashlib.blake2b(digest_size=8)
    for part in _digest_parts(value):
        state.update(part)
    return state.hexdigest()


def _digest_parts(value) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif is_dataclass(value):
        for f in fields(value):
            if f.name not in SEEN - {"path"}:
                yield f.name.encode()
                # what is only kept is as if new
                yield from _digest_parts(getattr(value, f.name) if f.compare else _dataclass_default(f))
    elif isinstance(value, (list, tuple)):
        yield f"[{len(value)}".encode()
        for each in value:
            yield from _digest_parts(each)
    else:
        yield repr(value.item() if hasattr(value, "item") else value).encode() + b";"


def _dataclass_default(f: Field) -> Any:
    """Of a field that has one; MISSING of others."""
    return f.default if f.default_factory is MISSING else f.default_factory()


def _things_with_digests(scene: Scene) -> list:
    attached = [thing for name in LISTS for thing in getattr(scene, name)]
    return [*scene.bodies(), *attached, *(thing for _, thing in each_method_object(scene))]


def scene_digests(scene: Scene) -> dict[str, dict[str, str]]:
    """Digests of the fields that decide the motion, by path; the scene's own at "/"."""
    left = SEEN | START | SETTINGS | {*LISTS, "objects"}
    found = {"/": {f.name: content_digest(getattr(scene, f.name)) for f in fields(scene) if f.name not in left}}
    for thing in _things_with_digests(scene):
        skipped = SEEN | START | ({"points"} if getattr(thing, "rest_points", None) is not None else set())
        found[thing.path] = {f.name: content_digest(getattr(thing, f.name)) for f in fields(thing) if f.name not in skipped}
    return found


def write_provenance(layer, scene: Scene, settings: Mapping) -> None:
    """Writes the provenance into a result layer. settings: of the simulation, by name, numbers and text."""
    from wsim import __version__
    digests = scene_digests(scene)
    made = {"version": __version__, "settings": dict(settings), "scene": digests}
    told = {"version": __version__, "command": command_line(), "scene": os.path.basename(scene.source or ""),
            "sceneHash": hashlib.blake2b(json.dumps(digests, sort_keys=True).encode(), digest_size=16).hexdigest()}
    layer.customLayerData = {**layer.customLayerData, KEY: json.dumps(made), SHOWN: told | dict(settings)}


def command_line() -> str:
    """The command line of this process, its program by name alone."""
    program = os.path.basename(sys.argv[0] or "python")
    if program == "__main__.py":
        program = "wsim"
    return shlex.join([program, *sys.argv[1:]])


def read_provenance(layer) -> dict:
    """Provenance that `write_provenance` left in a layer; {} where that is nothing, or not to be read."""
    try:
        made = json.loads(layer.customLayerData.get(KEY, "{}"))
        whole = all(isinstance(made.get(name, {}), dict) for name in ("settings", "scene"))
        return made if isinstance(made, dict) and whole else {}
    except (ValueError, TypeError, AttributeError):
        return {}


def warn_of_scene_changes(path: str, made: Mapping, scene: Scene) -> list[Problem]:
    """Warnings of what of a scene is another than when the result `path` was made.

    Raises SceneError where the points of a body are not those of the result: another mesh, another weld.
    """
    if not made.get("scene"):
        return [Problem(path, "does not say of which scene and with which settings it was made (by an earlier version, or by "
                        "another program); whether they are those of this run can't be known", fatal=False)]
    then, now = made["scene"], scene_digests(scene)
    bodies = {b.path: b.mesh_fields for b in scene.bodies()}
    things = {"/": scene} | {t.path: t for t in _things_with_digests(scene)}
    # of new fields
    before = {at: {f.name: content_digest(_dataclass_default(f)) for f in fields(things[at])} | then.get(at, {}) for at in now}
    changed = {at: [name for name in now[at] if before[at][name] != now[at][name]] for at in now}
    others = {at: [n for n in names if n in changed[at]] for at, names in bodies.items() if at in then}
    meshes = [Problem(at, f"has another mesh than in {path} ({', '.join(names)}); go on with the scene that the result was "
                      "made from, or start anew") for at, names in others.items() if names]
    if meshes:
        raise SceneError(meshes)
    found = [f"{at}: {', '.join(names)}" for at, names in changed.items() if names and at in then]
    found += [f"{at}: was not there" for at in now if at not in then] + [f"{at}: is gone" for at in then if at not in now]
    if not found:
        return []
    return [Problem(path, f"was made from another scene; from here on the run follows the present one ({'; '.join(found[:8])}"
                    f"{f'; and {len(found) - 8} more' * (len(found) > 8)})", fatal=False)]


def changed_settings(made: Mapping, settings: Mapping) -> list[str]:
    """Text of what of the settings, or of wsim, is another now; of a result that does not say, nothing."""
    from wsim import __version__
    then = made.get("settings", {}) | ({"wsim": made["version"]} if "version" in made else {})
    here = {**settings, "wsim": __version__}
    return [f"{name} {then[name]} then, {now} now" for name, now in here.items() if then.get(name, now) != now]
