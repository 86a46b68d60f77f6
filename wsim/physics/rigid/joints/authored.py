"""What the prim of a joint says and cannot mean: limits the wrong way round, drives and limits of axes that it lacks."""

from collections.abc import Iterator
from math import isnan

from pxr import Usd

from wsim.physics.rigid.joints.joint import AXES, DISTANCE
from wsim.scene import Problem
from wsim.scene.check.objects import object_warning, thing_error
from wsim.usd.stage import StageReading, applied_schemas

AXIS = "physics:axis"
MOVES = {"PhysicsRevoluteJoint": ("angular", "rotX"), "PhysicsPrismaticJoint": ("linear", "transX")}
WORDS = {"PhysicsRevoluteJoint": "turns about its axis alone", "PhysicsPrismaticJoint": "slides along its axis alone",
         "PhysicsFixedJoint": "does not move", "PhysicsSphericalJoint": "turns alone",
         "PhysicsDistanceJoint": "keeps a distance"}


def authored_joint_faults(prim: Usd.Prim, start: Usd.TimeCode) -> Iterator[Problem]:
    """Errors and warnings of a joint as it is authored."""
    path, kind = str(prim.GetPath()), str(prim.GetTypeName())
    axis = prim.GetAttribute(AXIS).Get(start) if prim.HasAttribute(AXIS) else "X"
    if axis not in ("X", "Y", "Z"):
        yield thing_error(path, f"{AXIS} is {axis!r}", "X, Y or Z", "author one of them")
    if kind in MOVES:
        yield from _check_limit_order(prim, start, "lowerLimit", "upperLimit", -float("inf"),
                                      "leave one out for no limit on that side")
    elif kind == "PhysicsDistanceJoint":
        yield from _check_limit_order(prim, start, "minDistance", "maxDistance", 0.0, "author a negative one for none")
    elif kind == "PhysicsSphericalJoint":
        for name in ("coneAngle0Limit", "coneAngle1Limit"):
            value = prim.GetAttribute(f"physics:{name}").Get(start)
            if isnan(value):
                yield thing_error(path, f"physics:{name} is {value:g}", "degrees, or a negative number for none",
                                   "author it again")
    yield from _check_joint_axes(prim, path, kind)


def _check_limit_order(prim: Usd.Prim, start: Usd.TimeCode, lower: str, upper: str, least: float,
                       mend: str) -> Iterator[Problem]:
    """Two limits, of which those under `least` are none."""
    low, high = (prim.GetAttribute(f"physics:{name}").Get(start) for name in (lower, upper))
    if isnan(low) or isnan(high):
        yield thing_error(str(prim.GetPath()), f"physics:{lower} is {low:g} and physics:{upper} {high:g}", "numbers",
                           f"author them again, or {mend}")
    elif low > high >= least:
        yield thing_error(str(prim.GetPath()), f"physics:{lower} is {low:g}, above physics:{upper}, which is {high:g}",
                           "a lower limit that is not above the upper one", f"swap them, or {mend}")


def _check_joint_axes(prim: Usd.Prim, path: str, kind: str) -> Iterator[Problem]:
    """Drives and limits of coordinates that the joint does not have."""
    apis = [api.split(":", 1) for api in applied_schemas(prim) if api.startswith(("PhysicsDriveAPI:", "PhysicsLimitAPI:"))]
    for api, name in apis:
        drive, moves = api == "PhysicsDriveAPI", MOVES.get(kind, ())
        if kind in WORDS and (not drive and name not in moves[1:] or drive and name not in _allowed_drive_names(kind)):
            other = f"author {api}:{moves[0]}" if drive and moves else f"take {api}:{name} away"
            yield object_warning(path, f"has {api}:{name}, which is not used: a {kind} {WORDS[kind]}", "what the joint has",
                                 other)
        elif kind not in WORDS and name not in (*AXES, DISTANCE):
            yield object_warning(path, f"has {api}:{name}, which is not used: it is no axis", ", ".join((*AXES, DISTANCE)),
                                 "name one of them")


def _allowed_drive_names(kind: str) -> tuple[str, ...]:
    """Names of drives that a kind takes."""
    if kind in MOVES:
        return MOVES[kind]
    return {"PhysicsSphericalJoint": AXES[3:], "PhysicsDistanceJoint": (DISTANCE,)}.get(kind, ())


def warn_unapplied_joint_apis(reading: StageReading, prim: Usd.Prim) -> None:
    """Warns of limits and drives whose schema is not applied, which USD ignores."""
    given = {tuple(name.split(":")[:2]) for name in prim.GetAuthoredPropertyNames() if name.startswith(("limit:", "drive:"))}
    for what, axis in sorted(given):
        api = f"Physics{what.capitalize()}API:{axis}"
        if api not in applied_schemas(prim):
            reading.warn(prim.GetPath(), f"has {what}:{axis} without {api}, so USD ignores it; apply {api}")
