"""Reports of benches, kept for each user, so that `wsim run --error` need not measure again.

A report counts for one scene on one device in one version of wsim and Warp: the name of its file is a hash of these. Of the
scene counts all that changes the motion or what a bench looks at. Not counted are the names of things (a pin, a load or a value
that varies knows by number whose it is), meshes that only follow a soft body, where it was loaded from, what was warned of, and
the frames after those looked at.
"""

import hashlib
import json
import os
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from wsim.bench.report import Report
from wsim.scene import Scene, Varying
from wsim.scene.curve import Curve
from wsim.usd.result.as_json import as_json
from wsim.usd.result.atomic import replace_text

FORMAT = 1
NAMES = {"path", "skins", "source", "notes", "variants", "target", "start", "up"}       # change no motion, or say so otherwise


def report_cache_folder() -> Path:
    """Folder of this user's reports: the system's place for caches. Raises OSError where there is no home folder."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    try:
        home = Path.home()
    except RuntimeError:
        if not os.path.isabs(named) or sys.platform in ("win32", "darwin"):
            raise FileNotFoundError("there is no home folder to keep reports of benches in") from None
        home = Path(named)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(named) if os.path.isabs(named) else home / ".cache"          # a relative one is to be ignored
    return base / "wsim" / "bench"


def plain_scene_value(value, scene: Scene):
    """A value of a scene as nested lists of what JSON knows, without the names of things; arrays by hash."""
    if isinstance(value, np.ndarray):
        whole = np.ascontiguousarray(value)
        return [str(whole.dtype), list(whole.shape), hashlib.sha256(whole.tobytes()).hexdigest()]
    if isinstance(value, Curve):
        more = [] if value.plain else [[value.kind, plain_scene_value(vars(value).get("inner"), scene)],
                                       *(plain_scene_value(v, scene) for v in (value.before, value.after, value.how))]
        return [type(value).__name__, plain_scene_value(value.times, scene), plain_scene_value(value.values, scene), *more]
    if is_dataclass(value):
        return [type(value).__name__,
                *([f.name, plain_scene_value(_plain_field_value(value, f.name, scene), scene)] for f in fields(value)
                                        if f.name not in NAMES or isinstance(value, Varying))]
    if isinstance(value, dict):
        return [[name, plain_scene_value(each, scene)] for name, each in sorted(value.items())]
    if isinstance(value, (list, tuple)):
        return [plain_scene_value(v, scene) for v in value]
    return repr(value.item() if hasattr(value, "item") else value)


def _plain_field_value(thing, name: str, scene: Scene):
    """A field; for what a pin, tie, load or value that varies names its number, for frames those that a bench looks at."""
    from wsim.bench.study import default_bench_frames
    value = getattr(thing, name)
    if name in ("body", "other"):
        return [body.path for body in scene.bodies()].index(value)
    if isinstance(thing, Varying) and name == "path":
        return ["/", *(b.path for b in scene.bodies()), *(c.path for c in scene.colliders)].index(value)
    return default_bench_frames(scene) if name == "frames" and thing is scene else value


def report_cache_key(scene: Scene, hardware: str, versions: dict[str, str]) -> str:
    """Name of the report of this scene on that hardware with those versions."""
    return hashlib.sha256(json.dumps([FORMAT, plain_scene_value(scene, scene), hardware,
                                      sorted(versions.items())]).encode()).hexdigest()


def cache_report(name: str, report: Report) -> Path:
    """Keeps a report: the file is there whole or not at all. Raises OSError where it cannot be written."""
    place = report_cache_folder() / f"{name}.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    replace_text(place, as_json({"format": FORMAT, "key": name, "report": report.as_dict()}))
    return place


def read_cached_report(name: str) -> tuple[Report | None, str]:
    """The report of that name, or None; and what to warn of where a file is there that is no report."""
    place = Path(f"{name}.json")
    try:
        place = report_cache_folder() / place
        data = json.loads(place.read_text(encoding="utf-8"))
        if data["format"] != FORMAT or data["key"] != name:
            raise ValueError("it is of another scene or version")
        return Report.from_dict(data["report"]), ""
    except FileNotFoundError:
        return None, ""
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return None, f"{place} is ignored and made anew: it holds no report ({type(error).__name__}: {error})"
