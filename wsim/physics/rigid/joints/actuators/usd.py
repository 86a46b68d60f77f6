"""Prims of the types MjcActuator and NewtonActuator <-> `Actuator`. wsim writes MjcActuator.

MjcActuator has the fields of `mjModel` (mujoco-usd-converter): gear, gains and ranges of SI units, angles in radians. What
`wsim:control` of WsimActuatorAPI says is the control, which may be sampled in time; `wsim:axis` names a coordinate where the
joint has several. NewtonActuator is a position servo by NewtonPDControlAPI, its effort limited by NewtonMaxEffortClampingAPI.
"""

from dataclasses import replace
from math import inf, isfinite
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdPhysics

from wsim.geometry import rotation
from wsim.physics.rigid.joints.actuators.actuator import Actuator
from wsim.physics.rigid.joints.joint import AXES, SHIFTS
from wsim.physics.rigid.joints.stacked import REFERENCE, mujoco_reference_value, stacked_joints
from wsim.physics.rigid.joints.usd import load as load_joint
from wsim.physics.rigid.joints.usd import read_single_joint
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.load_varying import note_varying_values
from wsim.usd.stage import StageReading, StageUnits, applied_schemas

SLIDE = "PhysicsPrismaticJoint"
TYPE, NEWTON = "MjcActuator", "NewtonActuator"
TARGETS = {TYPE: "mjc:target", NEWTON: "newton:targets"}
CONTROLLER, CLAMP = "NewtonPDControlAPI", "NewtonMaxEffortClampingAPI"
LAWS = {"mjc:dynType": ("none",), "mjc:gainType": ("fixed",), "mjc:biasType": ("none", "affine")}      # that wsim has
PRMS = 10                       # numbers of mjc:gainPrm and mjc:biasPrm


def load(reading: StageReading, prim: Usd.Prim) -> Actuator | None:
    """The actuator of a prim; None, with a warning, where wsim does not have its law."""
    path, kind = str(prim.GetPath()), str(prim.GetTypeName())
    joint = _joint_of_target(reading, prim, TARGETS[kind])
    if joint is None:
        return None
    target, axis, sign = find_merged_axis(reading, joint)
    named = read_attribute(prim, "Actuator", "axis", reading.units) or axis
    shift = named in SHIFTS or joint.GetTypeName() == SLIDE
    found = (_read_mujoco_law if kind == TYPE else _read_newton_law)(reading, prim, shift)
    if found is None:
        return None
    zero = mujoco_reference_value(reading, joint, SHIFTS[0] if shift else AXES[3], REFERENCE)      # l counts from there
    bias = (found.bias[0] + found.bias[1] * found.gear * zero, *found.bias[1:])
    found = replace(found, path=path, joint=target, gear=sign * found.gear, axis=named, bias=bias)
    control = read_attribute(prim, "Actuator", "control", reading.units)
    attributes = [prim.GetAttribute(names.attribute_entry("Actuator", "control").attribute)]
    note_varying_values(reading, path, Actuator, [a for a in attributes if a],
                        lambda at: {"control": read_attribute(prim, "Actuator", "control", at.units)})
    return found if control is None else replace(found, control=control)


def _joint_of_target(reading: StageReading, prim: Usd.Prim, name: str) -> Usd.Prim | None:
    """The joint that an actuator acts on; None, with a warning or an error, where it is none."""
    targets = prim.GetRelationship(name).GetTargets() if prim.HasRelationship(name) else []
    if len(targets) != 1:
        reading.fail(prim.GetPath(), f"{name} names {len(targets)} prims, so that it acts on nothing; allowed: one joint; fix: "
                     "name a joint, or remove the actuator")
        return None
    found = reading.stage.GetPrimAtPath(targets[0])
    if not found:
        reading.fail(prim.GetPath(), f"{name} names {targets[0]}, which is no prim; allowed: a joint; fix: name a joint")
    elif not found.IsA(UsdPhysics.Joint):
        reading.warn(prim.GetPath(), f"{name} names a {found.GetTypeName() or 'prim without a type'}, and is left out: "
                     "actuators act on joints here, not on tendons, sites or bodies")
    else:
        return found
    return None


def _numbers(reading: StageReading, prim: Usd.Prim, name: str, count: int, fallback: float) -> list[float]:
    """The first numbers of an array, 0 where it has fewer; not authored: the fallback, then 0."""
    attribute = prim.GetAttribute(name)
    authored = attribute and attribute.HasAuthoredValue()
    values = [float(v) for v in attribute.Get(reading.start) or ()] if authored else [fallback]
    return (values + [0.0] * count)[:count]


def _number_or_zero(reading: StageReading, prim: Usd.Prim, name: str) -> float:
    attribute = prim.GetAttribute(name)
    return float(attribute.Get(reading.start) or 0.0) if attribute else 0.0


def _read_mujoco_law(reading: StageReading, prim: Usd.Prim, shift: bool) -> Actuator | None:
    words = {name: prim.GetAttribute(name).Get(reading.start) for name in LAWS if prim.GetAttribute(name)}
    for name, word in words.items():
        if word not in (None, *LAWS[name]):
            reading.warn(prim.GetPath(), f"{name} is {word!r}, and the actuator is left out; wsim has "
                         f"{' and '.join(LAWS[name])}")
            return None
    gear = _numbers(reading, prim, "mjc:gear", 6, 1.0)
    if any(gear[1:]):
        reading.warn(prim.GetPath(), f"mjc:gear is {gear}, of which wsim uses the first number")
    unit = reading.units.factor("N" if shift else "N m")
    per = unit / reading.units.metres if shift else unit
    bias = _numbers(reading, prim, "mjc:biasPrm", 3, 0.0) if words.get("mjc:biasType") == "affine" else [0.0] * 3
    gain = _numbers(reading, prim, "mjc:gainPrm", 1, 1.0)[0]
    ranges: dict[str, Any] = {}
    for field, name, size in (("control_range", "ctrl", 1.0), ("force_range", "force", unit)):
        low, high = (_number_or_zero(reading, prim, f"mjc:{name}Range:{side}") for side in ("min", "max"))
        limited = prim.GetAttribute(f"mjc:{name}Limited")
        word = str(limited.Get(reading.start)) if limited else "auto"
        ranges[field] = (low * size, high * size) if word == "true" or word == "auto" and low != high else (-inf, inf)
    return Actuator("", "", gear=gear[0], gain=unit * gain, bias=(unit * bias[0], per * bias[1], per * bias[2]), **ranges)


def _read_newton_law(reading: StageReading, prim: Usd.Prim, shift: bool) -> Actuator | None:
    apis = set(applied_schemas(prim))
    if CONTROLLER not in apis or apis - {CONTROLLER, CLAMP, names.WSIM_ACTUATOR}:
        reading.warn(prim.GetPath(), f"has {', '.join(sorted(apis)) or 'no control API'}, and is left out; wsim has "
                     f"{CONTROLLER} and {CLAMP}")
        return None
    unit = reading.units.factor("N" if shift else "N m")
    per = unit / reading.units.metres if shift else unit
    k, c, f, most = (_number_or_zero(reading, prim, f"newton:{name}") for name in ("kp", "kd", "constEffort", "maxEffort"))
    limit = (-most * unit, most * unit) if CLAMP in apis and isfinite(most) else (-inf, inf)
    return Actuator("", "", gain=per * k, bias=(unit * f, -per * k, -per * c), force_range=limit)


def author(stage: Usd.Stage, actuator: Actuator, units: StageUnits) -> None:
    """Writes an actuator. Its joint must have been written."""
    prim = stage.DefinePrim(actuator.path, TYPE)
    prim.AddAppliedSchema(names.WSIM_ACTUATOR)
    prim.CreateRelationship(TARGETS[TYPE], False).SetTargets([Sdf.Path(actuator.joint)])
    shift = actuator.axis in SHIFTS or stage.GetPrimAtPath(actuator.joint).GetTypeName() == SLIDE
    unit = units.factor("N" if shift else "N m")
    per = unit / units.metres if shift else unit

    def put(name: str, kind: Sdf.ValueTypeName, value) -> None:
        prim.CreateAttribute(f"mjc:{name}", kind, False).Set(value)
    kinds = Sdf.ValueTypeNames
    put("gear", kinds.DoubleArray, [actuator.gear, *[0.0] * 5])
    put("gainPrm", kinds.DoubleArray, [actuator.gain / unit, *[0.0] * (PRMS - 1)])
    if any(actuator.bias):
        put("biasType", kinds.Token, "affine")
        bias = np.array(actuator.bias) / (unit, per, per)
        put("biasPrm", kinds.DoubleArray, [*bias.tolist(), *[0.0] * (PRMS - 3)])
    for field, name, size in (("control_range", "ctrl", 1.0), ("force_range", "force", unit)):
        low, high = getattr(actuator, field)
        if (low, high) != (-inf, inf):
            put(f"{name}Limited", kinds.Token, "true")
            put(f"{name}Range:min", kinds.Double, low / size)
            put(f"{name}Range:max", kinds.Double, high / size)
    author_attribute(prim, "Actuator", "control", actuator.control, units)
    if actuator.axis:
        author_attribute(prim, "Actuator", "axis", actuator.axis, units)


def find_merged_axis(reading: StageReading, prim: Usd.Prim) -> tuple[str, str, float]:
    """(path, coordinate, sign) of the `Joint` that a joint's prim is part of; "": its own coordinate."""
    group = stacked_joints(reading, prim)
    if len(group) == 1:
        return str(prim.GetPath()), "", 1.0
    apart = replace(reading, problems=[], varying=[], sampled=[], followed=set())
    own, merged = read_single_joint(apart, prim), load_joint(apart, group[0])
    if own is None or merged is None:                                # which is said where the joint is read
        return str(group[0].GetPath()), "", 1.0
    x = rotation.quat_rotate(own.turn1, np.array([1.0, 0.0, 0.0]))
    along = rotation.quat_rotate(rotation.quat_conjugate(merged.turn1), x)
    k = int(np.argmax(np.abs(along)))
    return merged.path, (SHIFTS if prim.GetTypeName() == SLIDE else AXES[3:])[k], float(np.sign(along[k]))
