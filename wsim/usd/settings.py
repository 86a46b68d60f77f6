"""The PhysicsScene prim <-> gravity, air and solver settings of a `Scene`.

Gravity as UsdPhysics has it: direction (0, 0, 0) is minus the up axis, a negative magnitude is 9.81 m/s^2. The first
PhysicsScene counts. newton:gravityEnabled = false is no gravity. newton:timeStepsPerSecond is a hint for the substeps where
wsim:substeps is not authored.
"""

import math

import numpy as np
from pxr import Gf, Usd

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.bodies import DefaultCount
from wsim.usd.attributes import EXACT, author_attribute, read_attribute, shortest_decimal
from wsim.usd.load_varying import note_varying_values, value_attributes_of_prim
from wsim.usd.names import GRAVITY, PHYSICS_SCENE, STEPS_HINT, WSIM_SCENE, attribute_entry, schema_fields
from wsim.usd.stage import StageReading, StageUnits, open_stage

GRAVITY_SWITCH = "newton:gravityEnabled"
MEDIUM = ("mjc:option:density", "mjc:option:viscosity")       # of the air or water around MuJoCo's bodies
LEAST = 1e-12          # of a unit, in metres, kilograms and seconds: powers of it are numbers too
LATEST = 1e9           # a time code: a millionth of a frame is still told from the next one
LONG = 100_000         # frames of a stage (an hour at 24 a second): beyond, --frames says how many are meant
FIELDS = ("substeps", "iterations", "solver", "integrator", "coordinates", "contact_model", *schema_fields("Scene"))


def refuse_units(reading: StageReading) -> None:
    """Raises SceneError if no length, mass or time can be told from the root metadata."""
    file = reading.stage.GetRootLayer().realPath
    start = reading.units.start
    if not abs(start) <= LATEST:
        raise SceneError(Problem(file, f"startTimeCode is {start:g}; allowed is a number from {-LATEST:g} to {LATEST:g}, "
                                 "beyond which time codes are rounded: correct the root layer's metadata"))
    units = {"metersPerUnit": reading.units.metres, "kilogramsPerUnit": reading.units.kilograms,
             "timeCodesPerSecond": reading.units.fps}
    wrong = [Problem(file, f"{name} is {value:g}; allowed is a finite number > 0, {LEAST:g} to {1.0 / LEAST:g}: "
                     "correct the root layer's metadata")
             for name, value in units.items() if not LEAST <= value <= 1.0 / LEAST]
    if wrong:
        raise SceneError(wrong)


def authored_frame_count(reading: StageReading, asked: int | None = None) -> int:
    """Frames from startTimeCode (0 where it is not authored) to endTimeCode; the default of `Scene` where no endTimeCode is.
    asked: frames that somebody names, and that a stage of too many or of endless ones needs."""
    stage, layer = reading.stage, reading.stage.GetRootLayer()
    if not stage.HasAuthoredMetadata("endTimeCode"):
        return Scene().frames if asked is None else asked
    end, length = stage.GetEndTimeCode(), stage.GetEndTimeCode() - reading.units.start
    if not length <= LONG and asked is None:
        reading.fail(layer.realPath or layer.identifier, f"endTimeCode is {end:g}: {length:g} frames; allowed is a number up "
                     f"to {LONG} after startTimeCode; give --frames, or author another endTimeCode")
        return Scene().frames
    if length < 0:
        reading.warn(layer.realPath, f"endTimeCode {end:g} comes before startTimeCode {reading.units.start:g}; "
                     f"{Scene().frames} frames are simulated: author endTimeCode")
        return Scene().frames
    return round(length) if length <= LONG else asked or 0


def warn_missing_time_range(reading: StageReading) -> None:
    """Warns where nobody said how long the scene is."""
    layer = reading.stage.GetRootLayer()
    if not reading.stage.HasAuthoredMetadata("endTimeCode"):
        lacks = "endTimeCode" if reading.stage.HasAuthoredMetadata("startTimeCode") else "startTimeCode and endTimeCode"
        reading.warn(layer.realPath or layer.identifier, f"has no {lacks}: {Scene().frames} frames are simulated, "
                     f"{reading.units.fps:g} a second; author both and timeCodesPerSecond, or give --frames")


def warn_missing_frame_rate(path) -> list[Problem]:
    """A warning where a stage says when it ends and not how fast it plays, which USD takes for 24 a second."""
    stage = open_stage(str(path))
    said = any(stage.HasAuthoredMetadata(name) for name in ("timeCodesPerSecond", "framesPerSecond"))
    return [] if said or not stage.HasAuthoredMetadata("endTimeCode") else [Problem(
        str(path), f"has no frame rate: {stage.GetTimeCodesPerSecond():g} frames are a second, as USD has it; author "
        "timeCodesPerSecond", fatal=False)]


def load_settings(reading: StageReading, prims: list[Usd.Prim]) -> Scene:
    """An empty Scene with the settings of the first PhysicsScene."""
    units = reading.units
    x, y, z = _down_direction(units)
    scene = Scene(gravity=(GRAVITY * x, GRAVITY * y, GRAVITY * z), up=units.up, fps=units.fps, start=units.start,
                  frames=reading.frames)
    if len(prims) > 1:
        reading.warn(prims[1].GetPath(), f"is one of {len(prims)} PhysicsScene prims; the first, {prims[0].GetPath()}, "
                     "counts for every object")
    if not prims:
        return scene
    prim = prims[0]
    for name, value in _read_scene_settings(reading, prim).items():
        setattr(scene, name, value)
    note_varying_values(reading, "/", Scene, value_attributes_of_prim(prim), lambda at: _read_scene_settings(at, prim))
    for name in MEDIUM:
        if (attribute := prim.GetAttribute(name)) and attribute.Get(reading.start):
            reading.warn(prim.GetPath(), f"{name} = {attribute.Get(reading.start):g} is left out: wsim has no drag of a medium "
                         "on bodies; author wsim:drag of WsimRigidBodyAPI for one that is linear")
    hint = prim.GetAttribute(STEPS_HINT)
    if read_attribute(prim, "Scene", "substeps", units) is None and hint and hint.HasAuthoredValue():
        _substeps_from_hint(reading, prim, scene, hint.Get(reading.start))
    return scene


def _substeps_from_hint(reading: StageReading, prim: Usd.Prim, scene: Scene, steps) -> None:
    """Substeps from steps a second, as Newton has them."""
    name = attribute_entry("Scene", "substeps").attribute
    if isinstance(steps, bool) or not isinstance(steps, (int, float)) or not 0 < steps < math.inf:
        reading.warn(prim.GetPath(), f"{STEPS_HINT} is {steps}, and no number of steps > 0: it is left out; author {name}")
        return
    scene.substeps = max(1, round(steps / reading.units.fps))
    reading.warn(prim.GetPath(), f"{STEPS_HINT} = {steps} is taken as {scene.substeps} substeps a frame; author {name} to say "
                 "otherwise")


def _read_scene_settings(reading: StageReading, prim: Usd.Prim) -> dict:
    """Gravity and what else the prim says, by field of a `Scene`; else the field's default."""
    found = {name: read_attribute(prim, "Scene", name, reading.units) for name in FIELDS}
    return {"gravity": _read_gravity(reading, prim)} | {name: getattr(Scene(), name) if value is None else value
                                                        for name, value in found.items()}


def _down_direction(units: StageUnits) -> tuple[float, float, float]:
    return (0.0, 0.0, -1.0) if units.up == "Z" else (0.0, -1.0, 0.0)


def _read_gravity(reading: StageReading, prim: Usd.Prim) -> tuple[float, float, float]:
    """As `_gravity_vector`, where direction and magnitude are numbers; what is none is reported."""
    units, switch = reading.units, prim.GetAttribute(GRAVITY_SWITCH)
    if switch and switch.Get(reading.start) is False:
        return 0.0, 0.0, 0.0
    direction, magnitude = (read_attribute(prim, "Scene", name, units) for name in ("direction", "magnitude"))
    if direction is not None and not all(map(math.isfinite, direction)):
        found = ", ".join(f"{v:g}" for v in direction)
        reading.fail(prim.GetPath(),
                     f"{attribute_entry('Scene', 'direction').attribute} is ({found}); allowed are three finite numbers, "
                     "(0, 0, 0) for downwards")
    elif magnitude is not None and not magnitude < math.inf:
        reading.fail(prim.GetPath(),
                     f"{attribute_entry('Scene', 'magnitude').attribute} is {magnitude:g}; allowed is a finite number, or "
                     "a negative one (-inf) for Earth's gravity")
    else:
        return _gravity_vector(prim, units)
    x, y, z = _down_direction(units)
    return GRAVITY * x, GRAVITY * y, GRAVITY * z


def _gravity_vector(prim: Usd.Prim, units: StageUnits) -> tuple[float, float, float]:
    """[m/s^2], world space. A gravity noted exactly counts while direction and magnitude are its rounding."""
    direction = read_attribute(prim, "Scene", "direction", units) or (0.0, 0.0, 0.0)
    magnitude = read_attribute(prim, "Scene", "magnitude", units)
    if magnitude is None or magnitude < 0:
        magnitude = GRAVITY
    length = math.sqrt(sum(v * v for v in direction))
    x, y, z = (v / length for v in direction) if length > 0 else _down_direction(units)
    noted = prim.GetAttribute(attribute_entry("Scene", "magnitude").attribute).GetCustomDataByKey(EXACT)
    if isinstance(noted, Gf.Vec3d) and math.isfinite(magnitude):
        exact = float(noted[0]), float(noted[1]), float(noted[2])
        if np.allclose(exact, magnitude * np.array([x, y, z]), rtol=1e-6, atol=1e-6 * magnitude):
            return exact
    return magnitude * x, magnitude * y, magnitude * z


def author_solver_settings(stage: Usd.Stage, path: str, scene: Scene, units: StageUnits) -> Usd.Prim:
    """Writes a PhysicsScene with gravity, air and solver settings."""
    prim = stage.DefinePrim(path, PHYSICS_SCENE)
    prim.AddAppliedSchema(WSIM_SCENE)
    author_gravity(prim, scene, units)
    for field in (f for f in FIELDS if not isinstance(getattr(scene, f), DefaultCount)):
        author_attribute(prim, "Scene", field, getattr(scene, field), units)
    return prim


def author_varying_gravity(prim: Usd.Prim, gravity, units: StageUnits, code: float) -> None:
    """Direction and magnitude [m/s^2] as samples at a time code."""
    magnitude = math.sqrt(sum(v * v for v in gravity))
    author_attribute(prim, "Scene", "direction", tuple(v / (magnitude or 1.0) for v in gravity), units, time=code)
    author_attribute(prim, "Scene", "magnitude", magnitude, units, time=code)


def author_gravity(prim: Usd.Prim, scene: Scene, units: StageUnits) -> None:
    """Direction and magnitude, and beside them the exact vector where they round it."""
    magnitude = math.sqrt(sum(v * v for v in scene.gravity))
    direction = tuple(v / magnitude for v in scene.gravity) if magnitude > 0 else _down_direction(units)
    author_attribute(prim, "Scene", "direction", direction, units)
    author_attribute(prim, "Scene", "magnitude", shortest_decimal(magnitude), units)
    if _gravity_vector(prim, units) != tuple(scene.gravity):
        attribute = prim.GetAttribute(attribute_entry("Scene", "magnitude").attribute)
        attribute.SetCustomDataByKey(EXACT, Gf.Vec3d(*map(float, scene.gravity)))
