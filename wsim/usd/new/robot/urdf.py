"""What a URDF file says of a robot that its converter leaves out: transmissions, and links that have no mass or inertia.

A simple transmission with an effort interface becomes a motor: the joint feels reduction * torque of the motor, and no more
than the effort of its limit. Interfaces of positions and velocities become none, since URDF has no gains. Moments of inertia
that are not positive, such as those of links that are points, become those of a ball of RADIUS.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from math import inf, isfinite, nan

import numpy as np
from pxr import Gf, Sdf, Usd, UsdPhysics

from wsim.scene import Problem, SceneError
from wsim.scene.methods import method_file
from wsim.usd import names
from wsim.usd.stage import StageUnits, applied_schemas

RADIUS = 1e-3                   # [m]; lighter inertia would turn frames of sensors at any contact
SIDES = (("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2))
MOVING = ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint")


@dataclass
class UrdfRobot:
    """transmissions: (name, joint, reduction, interface); effort: of joints [N], [N m]; massless: links without a mass; hollow:
    those of them that have an inertia; moments: positive principal ones [kg m^2] of links whose own are not."""

    transmissions: list[tuple[str, str, float, str]] = field(default_factory=list)
    effort: dict[str, float] = field(default_factory=dict)
    massless: set[str] = field(default_factory=set)
    hollow: list[str] = field(default_factory=list)
    moments: dict[str, np.ndarray] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def read_urdf(file: str) -> UrdfRobot:
    """Raises SceneError where a file is no XML, or a number in it is not finite."""
    try:
        root = ElementTree.parse(file).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise SceneError(Problem(file, f"is no XML: {error}; fix: expand xacro files, and correct that line")) from None
    found = UrdfRobot()
    for link in root.iter("link"):
        _read_link(file, link, found)
    for joint in root.iter("joint"):
        limit = joint.find("limit")
        if limit is not None and limit.get("effort") != "inf" and (effort := _number(file, limit, "effort", 0.0)) > 0.0:
            found.effort[joint.get("name", "")] = effort
    for each in root.iter("transmission"):
        _read_transmission(file, each, found)
    return found


def _read_link(file: str, link: ElementTree.Element, found: UrdfRobot) -> None:
    name, mass, inertia = link.get("name", ""), link.find("inertial/mass"), link.find("inertial/inertia")
    tensor = np.zeros((3, 3))
    for side, i, k in SIDES:
        tensor[i, k] = tensor[k, i] = 0.0 if inertia is None else _number(file, inertia, f"i{side}", 0.0)
    kg = 0.0 if mass is None else _number(file, mass, "value", 0.0)
    moments, least = np.linalg.eigvalsh(tensor), 0.4 * kg * RADIUS**2
    if kg == 0.0:
        found.massless.add(name)
        found.hollow += [name] * bool(tensor.any())
    elif moments[0] <= 0.0:
        found.moments[name] = np.maximum(moments, least)


def _read_transmission(file: str, each: ElementTree.Element, found: UrdfRobot) -> None:
    name, joints = each.get("name", ""), [joint.get("name", "") for joint in each.iter("joint")]
    kind = each.findtext("type") or each.get("type") or ""
    if len(joints) != 1 or "Simple" not in kind:
        found.left_out.append(name)
        return
    text = next((r.text for r in each.iter("mechanicalReduction") if r.text), "1")
    interface = next((i.text or "" for i in each.iter("hardwareInterface")), "Effort")
    found.transmissions.append((name, joints[0], _finite(file, f"mechanicalReduction of transmission {name}", text), interface))


def _number(file: str, element: ElementTree.Element, name: str, fallback: float) -> float:
    text = element.get(name)
    return fallback if text is None else _finite(file, f"{name} of <{element.tag}>", text)


def _finite(file: str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not isfinite(value):
        raise SceneError(Problem(file, f"{what} is {text!r}; allowed: a finite number; fix: write one, or expand xacro files"))
    return value


def author_urdf(stage: Usd.Stage, file: str, robot: UrdfRobot, units: StageUnits, notes: list[Problem]) -> None:
    """Motors of transmissions, and colliders of links without mass as parts of the links that they are fixed to."""
    named: dict[str, Usd.Prim] = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdPhysics.Joint) or names.RIGID_BODY in applied_schemas(prim):
            named.setdefault(prim.GetDisplayName() or prim.GetName(), prim)
            named.setdefault(prim.GetName(), prim)
    for name in (name for name in robot.moments if name in named):
        UsdPhysics.MassAPI.Apply(named[name]).CreateDiagonalInertiaAttr(
            Gf.Vec3f(*(robot.moments[name] / units.factor("kg m^2")).tolist()))
    _merge_massless_links(stage, [named[name].GetPath() for name in sorted(robot.massless) if name in named])
    notes += [Problem(file, text, fatal=False) for text in _link_warnings(robot)]
    limp, lost = [], list(robot.left_out)
    for name, joint, reduction, interface in robot.transmissions:
        if joint not in named or reduction == 0.0 or not _moves(named[joint]):
            lost.append(name)
        elif "Effort" not in interface:
            limp.append(name)
        else:
            _author_motor(stage, name, named[joint], reduction, robot.effort.get(joint, inf), units)
    if limp:
        notes.append(Problem(file, f"transmissions with position or velocity interfaces are left out, since URDF has no gains: "
                             f"{_listed(limp)}; fix: author MjcActuator prims, or use scene.actuator('position', ...)", False))
    if lost:
        notes.append(Problem(file, f"transmissions are left out: {_listed(lost)}; wsim takes SimpleTransmission of one joint "
                             "that moves", False))


def _link_warnings(robot: UrdfRobot) -> list[str]:
    found = []
    if robot.moments:
        found.append(f"moments of inertia of links are not positive, and become those of a ball of {RADIUS:g} m at least: "
                     f"{_listed(list(robot.moments))}; fix: give their inertia")
    if robot.hollow:
        found.append(f"links have an inertia without a mass, which is left out: {_listed(robot.hollow)}; fix: give their mass")
    return found


def _moves(joint: Usd.Prim) -> bool:
    """Whether a joint has a coordinate that is not locked by its limits."""
    low, high = (joint.GetAttribute(f"physics:{side}Limit") for side in ("lower", "upper"))
    return joint.GetTypeName() in MOVING and not (low and high and low.Get() >= high.Get())


def _listed(words: list[str]) -> str:
    return ", ".join(words[:3]) + (f" and {len(words) - 3} more" if len(words) > 3 else "")


def _merge_massless_links(stage: Usd.Stage, paths: list[Sdf.Path]) -> None:
    """Links without mass and with colliders that a fixed joint holds become part of the link that they lie in."""
    for joint in list(stage.Traverse()):
        if joint.GetTypeName() != names.FIXED_JOINT:
            continue
        api = UsdPhysics.Joint(joint)
        ends = [rel.GetTargets() for rel in (api.GetBody0Rel(), api.GetBody1Rel())]
        if not all(ends) or ends[1][0] not in paths or not ends[1][0].HasPrefix(ends[0][0]):
            continue
        prim = stage.GetPrimAtPath(ends[1][0])
        if any(names.COLLISION in applied_schemas(each) for each in Usd.PrimRange(prim)):
            prim.RemoveAPI(UsdPhysics.RigidBodyAPI)
            joint.SetActive(False)


def _author_motor(stage: Usd.Stage, name: str, joint: Usd.Prim, reduction: float, effort: float, units: StageUnits) -> None:
    actuator = method_file("Actuator", "joints.actuators.actuator").motor
    path = joint.GetPath().GetParentPath().AppendChild(Sdf.Path.IsValidIdentifier(name) and name or f"{joint.GetName()}_motor")
    if stage.GetPrimAtPath(path):
        path = path.GetParentPath().AppendChild(f"{joint.GetName()}_motor")
    most = effort / abs(reduction)
    motor = actuator(str(path), str(joint.GetPath()), gear=reduction, force_range=(-most, most))
    method_file("Actuator", "usd").author(stage, motor, units)
