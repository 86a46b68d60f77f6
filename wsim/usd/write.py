"""`Scene` -> a stage in metres and kilograms, written under a temporary name and then renamed: no half file is left."""

import os
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics

from wsim.scene import Cloth, Collider, Deformable, Load, Pin, Problem, Scene, SceneError, Soft, Springs, Tie, Varying
from wsim.scene.check.scene import check_scene
from wsim.scene.fabric import Fabric
from wsim.scene.methods import each_method_object, method_file, owning_method, point_objects, scene_skins
from wsim.scene.solid import Bulk
from wsim.scene.values import table
from wsim.usd import names
from wsim.usd.attributes import author_attribute
from wsim.usd.names import HOLDERS
from wsim.usd.prims.cloth import author_cloth_prim
from wsim.usd.prims.colliders import author_collider, surface_values
from wsim.usd.prims.fabric import bound_physics_material, plane_stress_conversion
from wsim.usd.prims.pins import FRAME, author_pin, author_tie
from wsim.usd.prims.springs import author_springs
from wsim.usd.result.atomic import replace_file_atomically
from wsim.usd.result.crate import PARTIAL
from wsim.usd.settings import author_solver_settings, author_varying_gravity
from wsim.usd.stage import SUFFIXES, StageReading, StageUnits, usd_error_text
from wsim.usd.transforms.splines import replace_samples


def save(scene: Scene, path) -> None:
    """Writes a scene as a stage (.usda, .usdc, .usd) that `load` reads back equal, as in `save(scene, "flag.usda")`.

    Raises SceneError if the scene has fatal problems, or if the file cannot be written.
    """
    problems = [*(p for p in check_scene(scene) if p.fatal), *_path_problems(scene)]
    if problems:
        raise SceneError(problems)
    with new_stage(path) as stage:
        units = StageUnits(1.0, 1.0, scene.up, scene.fps, scene.start)
        author_units(stage, units, scene.frames)
        _author_scene(stage, scene, units)


def _author_scene(stage: Usd.Stage, scene: Scene, units: StageUnits) -> None:
    objects: list[Any] = [*scene.bodies(), *scene.colliders, *scene.pins, *scene.ties, *scene.loads]
    taken = {thing.path for thing in [*objects, *scene_skins(scene), *(thing for _, thing in each_method_object(scene))]}
    settings = author_solver_settings(stage, _unused_path("/physicsScene", taken), scene, units)
    materials = _MaterialPaths(_unused_path("/materials", taken), scene)
    by_path = {thing.path: thing for thing in point_objects(scene)}
    carriers = {body.path: body.motion for body in scene.things("Body")}
    for thing in sorted(objects, key=lambda thing: (isinstance(thing, (Pin, Tie, Load)), thing.path.count("/"))):
        _define_parent_prims(stage, thing.path)
        if isinstance(thing, Cloth):
            author_cloth_prim(stage, thing, materials.of(thing), units, scene.frames)
        elif isinstance(thing, Springs):
            author_springs(stage, thing, materials.of(thing), units, scene.frames)
        elif isinstance(thing, Soft):
            _author_soft(stage, thing, materials, taken, units, scene.frames)
        elif getattr(thing, "is_cluster", False):
            method_file("Clusters", "usd").author_clusters(stage, thing, materials.of(thing), units, scene.frames)
        elif (owner := owning_method(type(thing).__name__)) and owner.deforms and owner.role("usd"):
            owner.role("usd").author(stage, thing, units, scene.frames)
        elif isinstance(thing, Tie):
            author_tie(stage, thing, by_path[thing.body], carriers.get(thing.other) if thing.others is None else None, units)
        elif isinstance(thing, Load):
            from wsim.usd.prims.loads import author_load
            author_load(stage, thing, by_path[thing.body], units)
        elif isinstance(thing, Collider):
            author_collider(stage, thing, materials.of(thing), units, scene.frames)
        else:
            if thing.target:
                _define_parent_prims(stage, thing.target)
            author_pin(stage, thing, by_path[thing.body], units, scene.frames)
    for row, thing in each_method_object(scene):
        _define_parent_prims(stage, thing.path)
        usd = row.role("usd")
        if usd is None:
            raise SceneError(Problem(thing.path, f"a {type(thing).__name__} cannot be written into a stage: {row.folder} has "
                                     "no usd.py; give it one with author(stage, thing, units)"))
        usd.author(stage, thing, units)
    if scene.varying:
        author_varying(stage, scene, settings, units)
    settings.CreateRelationship(names.ORDER, False).SetTargets(
        [Sdf.Path(thing.path) for thing in [*objects, *scene_skins(scene)]])
    stage.SetDefaultPrim(stage.GetPrimAtPath(Sdf.Path(objects[0].path).GetPrefixes()[0]) if objects else settings)


def _author_soft(stage: Usd.Stage, soft: Soft, materials: "_MaterialPaths", taken: set[str], units: StageUnits,
                 frames: int) -> None:
    from wsim.usd.prims.soft import author_soft
    for skin in soft.skins:
        _define_parent_prims(stage, skin.path)
    paths = [materials.of_value(bulk, soft.path) for bulk in soft.materials]
    parts: list[str] = []
    for _ in soft.others:
        parts.append(_unused_path(f"{soft.path}/part", taken | set(parts)))
    author_soft(stage, soft, paths, parts, units, frames)


class _MaterialPaths:
    """Paths of materials: one for each different fabric, solid or friction, named after the first object that has it. An object
    of which something varies in time has its own."""

    def __init__(self, scope: str, scene: Scene):
        self.scope, self.varying = scope, {v.path for v in scene.varying}
        self.paths: dict[tuple, str] = {}

    def of(self, thing: Deformable | Collider) -> str:
        if isinstance(thing, Collider):
            return self.of_value(surface_values(thing), thing.path)
        return self.of_value(thing.materials[0] if thing.materials else thing.friction, thing.path)

    def of_value(self, what: Fabric | Bulk | tuple[float, ...], owner: str) -> str:
        """Value of an object by its path."""
        key = what, owner if owner in self.varying else ""
        if key not in self.paths:
            self.paths[key] = _unused_path(f"{self.scope}/{Sdf.Path(owner).name}", set(self.paths.values()))
        return self.paths[key]


def _unused_path(path: str, taken: set[str]) -> str:
    """path, or path_1, path_2 ... until nothing taken is there or below."""
    candidate, i = path, 0
    while any(t == candidate or t.startswith(candidate + "/") for t in taken):
        i += 1
        candidate = f"{path}_{i}"
    return candidate


def _define_parent_prims(stage: Usd.Stage, path: str) -> None:
    for parent in Sdf.Path(path).GetParentPath().GetPrefixes():
        if not stage.GetPrimAtPath(parent):
            UsdGeom.Xform.Define(stage, parent)


def _path_problems(scene: Scene) -> list[Problem]:
    """Paths that a stage cannot hold."""
    solid: list[Any] = [*scene.bodies(), *scene_skins(scene), *scene.colliders]
    problems: list[Problem] = []
    geometry = [thing.path for thing in solid]
    if scene_skins(scene):
        from wsim.usd.prims.skins import skin_problems
        problems += skin_problems(scene)
    moving = {thing.path: thing.motion for thing in scene.colliders}
    for thing in [*solid, *scene.pins, *scene.ties, *scene.loads, *(thing for _, thing in each_method_object(scene))]:
        good = Sdf.Path.IsValidPathString(thing.path) and Sdf.Path(thing.path).IsAbsoluteRootOrPrimPath()
        if not good or thing.path == "/":
            problems.append(Problem(thing.path, "is not a prim path; allowed is like /World/flag (letters, digits, _)"))
        above = [other for other in geometry if thing.path.startswith(other + "/") and thing.path != other]
        if above and not isinstance(thing, (Pin, Tie, Load)):
            problems.append(Problem(thing.path, f"lies below {above[0]}, which is geometry; give it a place of its "
                                                "own"))
    for pin in scene.pins:
        if pin.target in {thing.path for thing in [*scene.bodies(), *scene_skins(scene)]}:
            problems.append(Problem(pin.path, f"hangs on {pin.target}, which is simulated; name an Xform or a "
                                              "collider"))
        if pin.follows is None and pin.target and pin.target in moving and moving[pin.target] != pin.motion:
            problems.append(Problem(pin.path, f"hangs on {pin.target}, whose motion is another than the pin's; give "
                                    "both the same motion"))
        if pin.target:
            moving.setdefault(pin.target, pin.motion)
        if pin.target == f"{pin.path}/{FRAME}":
            problems.append(Problem(pin.path, f"names {pin.target} as its target, which is kept for pins without one; "
                                    "leave target empty"))
    return problems


def author_units(stage: Usd.Stage, units: StageUnits, frames: int) -> None:
    """Root metadata; nothing is left to USD's fallbacks."""
    UsdGeom.SetStageMetersPerUnit(stage, units.metres)
    UsdPhysics.SetStageKilogramsPerUnit(stage, units.kilograms)
    UsdGeom.SetStageUpAxis(stage, units.up)
    stage.SetTimeCodesPerSecond(units.fps)
    stage.SetFramesPerSecond(units.fps)
    stage.SetStartTimeCode(units.start)
    stage.SetEndTimeCode(units.start + frames)


@contextmanager
def new_stage(path):
    """A new stage under a temporary name beside `path`, which it takes when all went well.

    Raises SceneError if the suffix is none of USD's, or if the file cannot be written.
    """
    target = Path(os.fspath(path))
    if target.suffix not in SUFFIXES:
        raise SceneError(Problem(str(target), f"ends in {target.suffix or 'nothing'!r}; allowed is "
                                              f"{', '.join(SUFFIXES)}"))
    if not target.parent.is_dir():
        raise SceneError(Problem(str(target), f"the folder {target.parent} does not exist; make it first"))
    if target.name.endswith(PARTIAL):
        raise SceneError(Problem(str(target), f"names in {PARTIAL} are kept for results that are not whole; choose another"))
    try:
        with replace_file_atomically(target) as temporary:
            stage = Usd.Stage.CreateNew(str(temporary))
            yield stage
            stage.GetRootLayer().Save()
            del stage
    except (Tf.ErrorException, OSError) as error:
        raise SceneError(Problem(str(target), f"cannot be written ({_save_failure_reason(error, target)}); name a place that "
                                              "can")) from None
    layer = Sdf.Layer.Find(str(target))
    if layer is not None:
        layer.Reload(True)


def _save_failure_reason(error: Exception, target: Path) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return "no permission" if not os.access(target.parent, os.W_OK) else usd_error_text(error)


# What varies in time, in the attributes that a load makes curves of: a number whose curve is a spline's as that spline, all
# else as samples at the keys and, of what is not linear, at the middles of frames, whose values frames have. Attributes of type
# float keep seven digits.

def author_varying(stage: Usd.Stage, scene: Scene, settings: Usd.Prim, units: StageUnits) -> None:
    """Splines and samples of every curve; the prims and their materials are there."""
    things = {thing.path: thing
              for thing in (*scene.bodies(), *scene.colliders, *(thing for _, thing in each_method_object(scene)))
              if not getattr(thing, "shares_path", False)}
    for varying in scene.varying:
        times = varying.curve.times
        if varying.name == "stretch":                          # what is written follows Poisson's ratio too
            times = np.unique(np.concatenate([times, *(v.curve.times for v in _varying_poisson(scene, varying.path))]))
        if not varying.curve.plain:
            times = np.unique(np.concatenate([times, (np.arange(scene.frames) + 0.5) / scene.fps]))
        wrote: list = []
        for time in times.tolist():
            code, value = units.code(time), varying.curve.at(time)
            if varying.path != "/":
                wrote = _author_varying_value(StageReading(stage, units), scene, things[varying.path], varying, value, time)
            elif varying.name == "gravity":
                author_varying_gravity(settings, value, units, code)
            else:
                wrote = [author_attribute(settings, "Scene", varying.name, value, units, time=code)]
        if not varying.curve.plain and len(wrote) == 1:
            replace_samples(wrote[0], varying.curve, units)


def _varying_poisson(scene: Scene, path: str) -> list[Varying]:
    return [v for v in scene.varying if (v.path, v.name) == (path, "poisson")]


def _author_varying_value(reading: StageReading, scene: Scene, thing, varying: Varying, value,
                          time: float) -> list[Usd.Attribute]:
    """Writes a value at a time [s]; the attributes that have it."""
    prim, units, kind, name = reading.stage.GetPrimAtPath(thing.path), reading.units, type(thing), varying.name
    row = table.values_of_class(kind.__name__)[name]
    if row.usd is None and (own := owning_method(kind.__name__)) and hasattr(own.role("usd"), "author_at"):
        return own.role("usd").author_at(prim, thing, name, value, units, units.code(time))
    if row.usd is None or row.usd.schema not in table.MATERIALS:
        return [author_attribute(prim, kind.__name__, name, value, units, time=units.code(time))]
    through = None
    if getattr(thing, "is_sheet", False) and name == "stretch":
        nu = [float(v.curve.at(time)) for v in _varying_poisson(scene, thing.path)]
        through = plane_stress_conversion(nu[0] if nu else thing.material.poisson)
    return [author_attribute(bound_physics_material(reading, prim), HOLDERS[kind.__name__], name, value, units, through,
                             units.code(time))]
