"""Opening a stage, its units, and what a load gathers on the way.

Root metadata decides the units; what is not authored falls back as USD has it: 0.01 m, 1 kg, Y up, 24 time codes a
second. Physics schemas of the deformable proposal are not registered, so API names are read from the prim's type.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Plug, Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdUtils

from wsim.scene import Problem, SceneError
from wsim.usd.names import UNITS
from wsim.usd.result import crate

SUFFIXES = (".usda", ".usdc", ".usd")
_WITHIN, _SESSION = re.compile(r"In <([^>]*)>: "), re.compile(r",@anon:[^@]*@")
_COMPOSING = re.compile(r" \([^()]*stage on stage .*\)$")       # addresses in memory say nothing to a reader

# Before the first stage: a schema registered later is silently unknown to USD.
if not Plug.Registry().GetPluginWithName("wsim"):
    Plug.Registry().RegisterPlugins(str(Path(__file__).parent / "schema"))


@dataclass(frozen=True)
class StageUnits:
    """metres [m] and kilograms [kg] of a stage unit; up axis; frames (time codes) a second; time code of time 0."""

    metres: float = 1.0
    kilograms: float = 1.0
    up: str = "Y"
    fps: float = 24.0
    start: float = 0.0

    @staticmethod
    def of(stage: Usd.Stage) -> "StageUnits":
        return StageUnits(UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage),
                          UsdGeom.GetStageUpAxis(stage), stage.GetTimeCodesPerSecond(), stage.GetStartTimeCode())

    def factor(self, unit: str) -> float:
        """SI value of one stage unit of `unit`, a key of `names.UNITS`."""
        length, mass = UNITS[unit]
        return self.metres**length * self.kilograms**mass

    def code(self, time):
        """Time codes of times [s]."""
        return self.start + time * self.fps

    def time(self, code):
        """Times [s] of time codes."""
        return (code - self.start) / self.fps


@dataclass
class StageReading:
    """A stage while it is read: units, frames to simulate, what was found wrong, and caches by time code."""

    stage: Usd.Stage
    units: StageUnits
    frames: int = 0
    points: bool = False                                 # cloth, springs or soft bodies are there
    problems: list[Problem] = field(default_factory=list)
    xforms: dict = field(default_factory=dict)
    materials: dict = field(default_factory=dict)
    sampled: list = field(default_factory=list)          # paths of attributes that may differ from time to time
    followed: set = field(default_factory=set)           # those of them that became curves
    skinned: dict = field(default_factory=dict)          # what a skeleton moves: {path: wsim.usd.prims.skeletons.SkinnedMesh}
    bones: dict = field(default_factory=dict)            # skeletons that something follows: {path: Skeleton, None: broken}
    placed: set = field(default_factory=set)             # paths of prims whose transforms were checked
    held: dict | None = None                             # what holds rigid bodies without mass, by path; None: not known yet
    stacks: dict | None = None                           # joints that act one behind the other, by path; None: not known yet
    filterable: bool | None = None                       # whether there are bodies that filters are for; None: not known yet
    colliding: tuple[dict, list] | None = None           # places by path of what collides, and sorted paths; None: not yet
    varying: list = field(default_factory=list)          # (where it was found, `wsim.scene.Varying`)

    @property
    def start(self) -> Usd.TimeCode:
        return Usd.TimeCode(self.units.start)

    def fail(self, path, text: str) -> None:
        self.problems.append(Problem(str(path), text))

    def warn(self, path, text: str) -> None:
        problem = Problem(str(path), text, fatal=False)
        if problem not in self.problems:
            self.problems.append(problem)


def applied_schemas(prim: Usd.Prim) -> list[str]:
    """Names of the API schemas of a prim, those that USD does not know included."""
    return list(prim.GetPrimTypeInfo().GetAppliedAPISchemas())


def open_stage(path, variants: dict | None = None, notes: list | None = None) -> Usd.Stage:
    """The stage of a file with every payload loaded.

    variants    {prim path: {variant set: variant}}, chosen in the session layer: the file is not touched
    notes       receives a warning for each reference, payload or asset that cannot be resolved

    What a run writes or left unfinished is read as it was saved last (`wsim.usd.result.crate.read_crate_layer`). Raises
    SceneError if the file is missing, is no USD, or cannot be read, or if a variant does not exist.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise SceneError(Problem("scene", f"is a {type(path).__name__}; give a wsim.Scene, the path of a USD file or a "
                                 "Usd.Stage"))
    path, found = os.fspath(path), [] if notes is None else notes
    if not os.path.exists(path):
        raise SceneError(Problem(path, "there is no such file; give the path of a .usda, .usdc, .usd or .usdz file"))
    if os.path.isdir(path):
        raise SceneError(Problem(path, "is a folder; give the path of a .usda, .usdc, .usd or .usdz file"))
    with collect_warnings(found):
        try:
            stage = Usd.Stage.Open(read_unfinished_layer(path) or path)
            _reload_changed_layers(stage)
        except Tf.ErrorException as error:
            raise SceneError(Problem(path,
                                     f"is not a readable USD file: {usd_error_text(error)}{describe_import(path)}")) from None
        except OSError as error:
            raise SceneError(Problem(path, f"cannot be read: {error}")) from None
        if variants:
            _select_variants(stage, variants)
    found.extend(_unresolved_assets(stage))
    return stage


def describe_import(path: str) -> str:
    """Text that says how a file of another format becomes a stage; "" of one that should be one."""
    ending = os.path.splitext(path)[1].lower()
    if ending == ".obj":
        return f"; `wsim new cloth {path} -o SCENE` makes a scene of it (or softbody, fluid, liquid)"
    if ending in (".urdf", ".xml"):
        return f"; `wsim new robot {path} -o SCENE` makes a scene of it"
    return "" if ending in (*SUFFIXES, ".usdz") else "; export it to USD or OBJ from the program that made it"


def stage_source_file(stage: Usd.Stage, notes: list[Problem], variants: dict | None = None) -> str | None:
    """The file of an open stage, where it says what the stage says. None, with a warning in `notes`, of a stage in memory or
    with edits that are not saved. Raises SceneError where variants are asked for."""
    root, session = stage.GetRootLayer(), stage.GetSessionLayer()
    if variants:
        raise SceneError(Problem(root.identifier, "variants of an open stage are chosen on it: "
                                 "prim.GetVariantSet(name).SetVariantSelection(value)"))
    edited = [layer for layer in stage.GetUsedLayers() if layer.dirty and not (layer == session and layer.empty)]
    if root.realPath and not edited:
        return root.realPath
    name = (edited[0] if root.realPath else root).identifier
    notes.append(Problem(name, "is not saved: a result lies over a copy of what is simulated, without materials that are only "
                         "seen; save the stage first to keep them", fatal=False))
    return None


def read_unfinished_layer(path: str) -> Sdf.Layer | None:
    """The layer of a file that a run writes or left unfinished, apart from that run; None for all other files."""
    real = os.path.realpath(path)
    if not (real.endswith(crate.PARTIAL) or crate.is_being_written(real)):
        return None
    layer = crate.read_crate_layer(real)
    return layer if crate.is_wsim_result(layer) else None


@contextmanager
def collect_warnings(notes: list[Problem], stage: Usd.Stage | None = None) -> Iterator[None]:
    """Takes USD's own warnings into notes, which keeps them from standard error."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        for item in delegate.TakeUncoalescedDiagnostics():
            text = _SESSION.sub("", " ".join(_COMPOSING.sub("", item.commentary).split())).rstrip(".")
            where = _WITHIN.match(text)                           # a prim
            file = where[1] if where else stage.GetRootLayer().realPath if stage is not None else "USD"
            if where:                                             # which names its own place again
                text = re.sub(rf" introduced by @[^@]*@<{re.escape(where[1])}>", "", text[where.end():])
            text = f"{text}; add what is missing, or remove it from the stage"
            problem = Problem(file, f"{text} (the run continues without it)", fatal=False)
            if problem not in notes:
                notes.append(problem)


def _reload_changed_layers(stage: Usd.Stage) -> None:
    """Reads again what changed on disk since this process first opened it; unsaved edits are left alone."""
    for layer in stage.GetUsedLayers():
        if not (layer.dirty or layer.anonymous):
            with suppress(Tf.ErrorException):
                layer.Reload()


def usd_error_text(error: Exception) -> str:
    """Message of USD, less its function names, files and line numbers; other errors in one line."""
    parts = [line.split(" : ", 1)[-1].strip().strip("'") for line in str(error).splitlines() if line.strip()]
    return parts[0] if parts else "no reason given"


def _select_variants(stage: Usd.Stage, variants: dict) -> None:
    """Sets variants, outer prims first: an inner prim may come with a variant. Raises SceneError naming what exists."""
    problems = []
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path in sorted(variants):
            prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
            if not prim:
                problems.append(Problem(path, "a variant is asked for, and there is no such prim"))
                continue
            for name, variant in variants[path].items():
                sets = prim.GetVariantSets()
                if name not in sets.GetNames():
                    problems.append(Problem(path, f"has no variant set {name!r}; it has: {_list_or_none(sets.GetNames())}"))
                elif variant not in sets.GetVariantSet(name).GetVariantNames():
                    known = sets.GetVariantSet(name).GetVariantNames()
                    problems.append(Problem(path, f"variant set {name!r} has no {variant!r}; it has: {_list_or_none(known)}"))
                else:
                    sets.SetSelection(name, variant)
    if problems:
        raise SceneError(problems)


def _list_or_none(names) -> str:
    return ", ".join(names) or "none"


def _unresolved_assets(stage: Usd.Stage) -> list[Problem]:
    """Warnings for assets that are named and not found."""
    notes = []
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetTypeName() == Sdf.ValueTypeNames.Asset:
                asset = attribute.Get()
                if asset and asset.path and not asset.resolvedPath and "<" not in asset.path:
                    notes.append(Problem(str(attribute.GetPath()), f"asset @{asset.path}@ is not found (goes on "
                                         "without it: the simulation does not need it)", fatal=False))
    return notes
