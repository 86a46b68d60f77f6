"""Mass, centre, inertia and axes of a rigid body from PhysicsMassAPI of its prim, of its colliders, and their materials.

    mass       of the body; else the sum of its colliders
    colliders  mass of the collider's own prim; else density of that prim, else of the body's, else of the material bound for
               physics, else 1000 kg/m^3, times the volume (wsim/physics/rigid/mass.py)
    center     of the body; else that of the colliders
    inertia    diagonalInertia along principalAxes, which are the prim's own where none are authored; else of the colliders,
               scaled to the mass of the body and moved to its centre

The precedence is that of `UsdPhysics.RigidBodyAPI.ComputeMassProperties` of usd-core, which computes in float32: it replaces
the inertia of light bodies by that of a ball, and leaves axes unset where mass and inertia are authored.
"""

from typing import NamedTuple

import numpy as np
from pxr import Usd, UsdPhysics, UsdShade

from wsim.geometry import rotation
from wsim.physics.rigid.mass import MassVolume, collider_volume, principal_axes
from wsim.physics.rigid.objects import DENSITY
from wsim.scene import Collider
from wsim.usd import names
from wsim.usd.stage import StageReading, applied_schemas


class AuthoredMass(NamedTuple):
    """What PhysicsMassAPI of a prim says, in SI units; None where it says nothing."""

    mass: float | None = None
    density: float | None = None
    center: np.ndarray | None = None
    inertia: np.ndarray | None = None
    axes: np.ndarray | None = None


def mass_properties(reading: StageReading, prim: Usd.Prim, colliders: list[Collider]) -> dict:
    """mass [kg], center (3,) [m], inertia (3,) [kg m^2] and axes (x, y, z, w) of a `Body`; unknown values are left out."""
    if not _authored_mass_is_valid(reading, [prim]):
        return {}
    own = _read_authored_mass(reading, prim)
    parts_count = own.mass is None or own.inertia is None                # else nothing follows from colliders
    if parts_count and not _authored_mass_is_valid(reading, [reading.stage.GetPrimAtPath(c.path) for c in colliders]):
        return {}
    parts = [_collider_mass_part(reading, prim, c, own.density) for c in colliders]
    parts = [part for part in parts if part.volume > 0.0]
    if own.inertia is None and not parts:
        return {} if own.mass is None else {"mass": own.mass}           # nothing that an inertia could follow from
    whole = sum(part.volume for part in parts)                          # masses, not volumes
    mass = whole if own.mass is None else own.mass
    middle = sum((part.volume * part.center for part in parts), np.zeros(3)) / whole if parts else np.zeros(3)
    center = middle if own.center is None else own.center
    if own.inertia is not None:
        axes = np.array([0.0, 0.0, 0.0, 1.0]) if own.axes is None else own.axes
        return {"mass": mass, "center": center, "inertia": own.inertia, "axes": axes}
    inertia = sum((mass / whole * (part.inertia + part.volume * _parallel_axis_inertia(part.center - center))
                   for part in parts),
                  np.zeros((3, 3)))
    if not np.isfinite([*inertia.ravel(), *center, mass]).all():
        reading.fail(prim.GetPath(), f"the mass ({mass:g} kg), inertia or centre of its colliders is not finite; allowed: "
                     "finite numbers; fix: check metersPerUnit and the sizes of its colliders")
        return {}
    moments, axes = principal_axes(inertia)
    return {"mass": mass, "center": center, "inertia": moments, "axes": axes}


def _parallel_axis_inertia(d: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) of a unit mass at d (3,)."""
    return d @ d * np.eye(3) - np.outer(d, d)


def _collider_mass_part(reading: StageReading, body: Usd.Prim, collider: Collider, density: float | None) -> MassVolume:
    """Mass [kg] (as `volume`), center [m] and inertia [kg m^2] of a collider in the body's frame."""
    prim, V = reading.stage.GetPrimAtPath(collider.path), collider_volume(collider)
    own = _read_authored_mass(reading, prim) if prim != body else AuthoredMass()
    mass = own.mass
    if mass is None:
        mass = V.volume * (own.density or density or _material_density(reading, prim) or DENSITY)
    M = collider.motion.at(0.0)
    center = V.center if own.center is None else M[:3, :3] @ own.center + M[:3, 3]
    inertia = V.inertia * (mass / V.volume) if V.volume > 0.0 else np.zeros((3, 3))
    if own.inertia is not None:
        R = M[:3, :3] if own.axes is None else M[:3, :3] @ rotation.quaternion_to_matrix(own.axes)
        inertia = R @ np.diag(own.inertia) @ R.T
    elif own.center is not None:
        inertia = inertia + mass * _parallel_axis_inertia(center - V.center)
    return MassVolume(mass, center, inertia)


def _read_authored_mass(reading: StageReading, prim: Usd.Prim) -> AuthoredMass:
    if names.MASS not in applied_schemas(prim):
        return AuthoredMass()
    api, start, units = UsdPhysics.MassAPI(prim), reading.start, reading.units
    mass, density, center, inertia, axes = (a.Get(start) for a in (
        api.GetMassAttr(), api.GetDensityAttr(), api.GetCenterOfMassAttr(), api.GetDiagonalInertiaAttr(),
        api.GetPrincipalAxesAttr()))
    q = np.array([*axes.GetImaginary(), axes.GetReal()], np.float64)
    return AuthoredMass(mass * units.kilograms if mass else None, density * units.factor("kg/m^3") if density else None,
                        np.array(center, np.float64) * units.metres if np.isfinite(center).all() else None,
                        np.array(inertia, np.float64) * units.factor("kg m^2") if any(inertia) else None,
                        q if q.any() else None)


def _material_density(reading: StageReading, prim: Usd.Prim) -> float | None:
    """Density [kg/m^3] of the material bound for physics, else for all purposes; None where it says nothing."""
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0].GetPrim()
    if not material or names.MATERIAL not in applied_schemas(material):
        return None
    density = UsdPhysics.MaterialAPI(material).GetDensityAttr().Get(reading.start) or 0.0
    if not 0.0 <= density < np.inf:
        reading.fail(material.GetPath(), f"physics:density is {density:g}; allowed: a finite number > 0, or 0 for none; fix: "
                     "author another density")
        return None
    return density * reading.units.factor("kg/m^3") or None


def _authored_mass_is_valid(reading: StageReading, prims: list[Usd.Prim]) -> bool:
    """True if authored masses, densities and centres are valid. USD ignores invalid ones silently."""
    found = True
    for prim in dict.fromkeys(prims):
        for name in ("mass", "density"):
            attribute = prim.GetAttribute(f"physics:{name}")
            value = attribute.Get(reading.start) if attribute and attribute.HasAuthoredValue() else None
            if value is not None and not 0.0 <= value < np.inf:
                reading.fail(prim.GetPath(), f"physics:{name} is {value:g}; allowed: a finite number > 0, or 0 for none; fix: "
                             f"author another {name}" + ("; to hold a body still, make it kinematic" if name == "mass" else ""))
                found = False
            elif value == 0.0 and name == "mass":
                reading.warn(prim.GetPath(), "physics:mass is 0, which USD takes as none: densities decide; fix: author a "
                             "mass > 0, or physics:kinematicEnabled to hold a body still")
        center = prim.GetAttribute("physics:centerOfMass")
        place = np.array(center.Get(reading.start), np.float64) if center and center.HasAuthoredValue() else np.zeros(3)
        if not np.isfinite(place).all() and not np.isneginf(place).all():             # -inf: none
            reading.fail(prim.GetPath(), f"physics:centerOfMass is {tuple(place.tolist())}; allowed: finite numbers; fix: "
                         "author another, or take it away")
            found = False
    return found
