"""Armature, dry friction, mimics and hinges behind each other of joints in USD: NewtonJointAPI, NewtonMimicAPI, MjcJointAPI,
PhysxMimicJointAPI, WsimJointAPI.

Armature (a mass, or mass length^2) and friction (a force or torque) count for all free coordinates of a joint.
A mimic is g = c_0 + c_1 g_leader, in degrees or lengths (Newton); MuJoCo adds powers up to 4, in radians. PhysX says
g + gearing g_leader + offset = 0.
"""

from math import pi

import numpy as np
from pxr import Sdf, Usd

from wsim.physics.rigid.joints.joint import SHIFTS, TURNS, Joint, Mimic
from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.stage import StageReading, StageUnits, applied_schemas

DEGREE = pi / 180.0
JOINT_API, MIMIC_API, PHYSX_MIMIC = "NewtonJointAPI", "NewtonMimicAPI", "PhysxMimicJointAPI"
KEYS = {"armature": ("newton:armature", "mjc:armature", "physxJoint:armature"),
        "friction": ("newton:friction", "mjc:frictionloss")}
UNITS = {"armature": ("kg", "kg m^2"), "friction": ("N", "N m")}           # of shifts, of turns


def read_passive_terms(reading: StageReading, prim: Usd.Prim, limits: dict) -> dict:
    """Fields armature, friction, mimics and hinges of the `Joint` of a prim with these limits."""
    free, found = Joint("", limits=limits).free(), {}
    for field, keys in KEYS.items():
        value = next((v for key in keys if (v := _authored_number(reading, prim, key)) is not None), 0.0)
        found[field] = {name: value * reading.units.factor(UNITS[field][name in TURNS]) for name in free} if value else {}
    if len(free) > 1 and _authored_number(reading, prim, "newton:damping"):
        reading.warn(prim.GetPath(), f"newton:damping is ignored: it has {len(free)} free coordinates; author PhysicsDriveAPI "
                     "of each with a damping")
    return found | {"mimics": _read_mimics(reading, prim, free), "hinges": _read_hinges(reading, prim, free)}


def _read_hinges(reading: StageReading, prim: Usd.Prim, free: list[str]) -> dict[str, tuple[float, ...]]:
    points = read_attribute(prim, "Joint", "hinges", reading.units)
    if points is None:
        return {}
    if len(points) != len(TURNS) or not np.isfinite(points).all():
        reading.fail(prim.GetPath(), f"wsim:hinges has {len(points)} points; allowed: three of finite numbers, of rotX, rotY "
                     "and rotZ; fix: author three, or take it away")
        return {}
    return {name: tuple(point) for name, point in zip(TURNS, points.tolist(), strict=True) if name in free}


def _authored_number(reading: StageReading, prim: Usd.Prim, key: str) -> float | None:
    attribute = prim.GetAttribute(key)
    return float(attribute.Get(reading.start) or 0.0) if attribute and attribute.HasAuthoredValue() else None


def _read_mimics(reading: StageReading, prim: Usd.Prim, free: list[str]) -> dict[str, Mimic]:
    found = {}
    for api in applied_schemas(prim):
        if api == MIMIC_API and _authored_number(reading, prim, "newton:mimicEnabled") != 0.0:
            name = free[0] if len(free) == 1 else ""
            numbers = [_authored_number(reading, prim, f"newton:mimicCoef{k}") for k in (0, 1)]
            powers = [_authored_number(reading, prim, f"mjc:coef{k}") or 0.0 for k in (2, 3, 4)]
            given = [numbers[0] or 0.0, 1.0 if numbers[1] is None else numbers[1]], powers, "newton:mimicJoint"
        elif api.startswith(f"{PHYSX_MIMIC}:"):
            axis = api.partition(":")[2]
            key = f"physxMimicJoint:{axis}"
            name = free[0] if len(free) == 1 else axis if axis in free else ""
            offset, gearing = (_authored_number(reading, prim, f"{key}:{each}") or 0.0 for each in ("offset", "gearing"))
            given = [-offset, -gearing], [], f"{key}:referenceJoint"
        else:
            continue
        leaders = prim.GetRelationship(given[2]).GetTargets() if prim.HasRelationship(given[2]) else []
        if not name or len(leaders) > 1:
            what = f"{given[2]} names {len(leaders)} joints" if name else f"it has {len(free)} free coordinates"
            reading.fail(prim.GetPath(), f"has {api}, and {what}; allowed: one free coordinate that follows one joint; fix: "
                         f"remove {api}, or put a body between the axes of this joint")
            continue
        found[name] = Mimic(str(leaders[0]) if leaders else "", _si_coefficients(reading.units, name, *given[:2]))
    return found


def _si_coefficients(units: StageUnits, name: str, linear: list[float], powers: list[float]) -> tuple[float, ...]:
    shift = name in SHIFTS
    offset = linear[0] * (units.metres if shift else DEGREE)
    more = [value * (units.metres**(1 - k) if shift else 1.0) for k, value in enumerate(powers, 2)]
    while more and more[-1] == 0.0:
        more.pop()
    return offset, linear[1], *more


def author_passive_terms(prim: Usd.Prim, joint: Joint, units: StageUnits) -> None:
    """Writes armature, friction, mimics and hinges of a joint. Raises SceneError where a prim cannot say them."""
    if joint.hinges:
        prim.AddAppliedSchema(names.WSIM_JOINT)
        author_attribute(prim, "Joint", "hinges", np.array([joint.hinges.get(name, (0.0, 0.0, 0.0)) for name in TURNS]), units)
    for field, keys in KEYS.items():
        values = getattr(joint, field)
        if not any(values.values()):
            continue
        each = {values.get(name, 0.0) / units.factor(UNITS[field][name in TURNS]) for name in joint.free()}
        if len(each) > 1:
            raise SceneError(Problem(joint.path, f"{field} differs between its coordinates ({values}); in USD it is one "
                                     "number; fix: put a body between the axes of this joint"))
        _author_number(prim, JOINT_API, keys[0], each.pop())
    for name, mimic in joint.mimics.items():
        if len(joint.free()) > 1 or len(mimic.coefficients) > 5:
            raise SceneError(Problem(joint.path, f"{name} mimics {mimic.leader}, which USD can say of joints with one free "
                                     "coordinate and five coefficients; fix: put a body between its axes"))
        shift = name in SHIFTS
        offset, ratio, *powers = (*mimic.coefficients, 0.0, 0.0)[:max(2, len(mimic.coefficients))]
        _author_number(prim, MIMIC_API, "newton:mimicCoef0", offset / (units.metres if shift else DEGREE))
        _author_number(prim, MIMIC_API, "newton:mimicCoef1", ratio)
        for k, value in enumerate(powers, 2):
            _author_number(prim, "MjcEqualityJointAPI", f"mjc:coef{k}", value / (units.metres**(1 - k) if shift else 1.0))
        if mimic.leader:
            prim.CreateRelationship("newton:mimicJoint", False).SetTargets([Sdf.Path(mimic.leader)])


def _author_number(prim: Usd.Prim, api: str, key: str, value: float) -> None:
    if api not in applied_schemas(prim):
        prim.AddAppliedSchema(api)
    kind = Sdf.ValueTypeNames.Float if key.startswith("newton:") else Sdf.ValueTypeNames.Double
    prim.CreateAttribute(key, kind, False).Set(float(value))
