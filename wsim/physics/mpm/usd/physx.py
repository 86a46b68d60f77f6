"""Points with PhysxParticleSetAPI -> `MaterialPoints`: fluids as water, others as sand. Every attribute of the set, its
PhysxParticleSystem and its PhysxPBDMaterialAPI is read, or named in a warning.

    physxParticle:fluid                 water, else sand                      physxParticle:particleSystem   the system
    physxParticle:simulationPoints      places, before points                 physxParticle:particleEnabled  off: left out
    fluidRestOffset, solidRestOffset r  particles rest 2 r apart: the volume of one is (2 r)^3, and cells are 4 r
    particleContactOffset c             where r is not authored: r = 0.594 c of fluids, 0.99 c of others, as PhysX has it
    physxPBDMaterial:density            the same                              :friction, :particleFrictionScale   tan of slopes

Of physics:mass and physics:density on the set the mass counts, then the density. PhysX moves particles by their positions, with
as much stiffness as its iterations give; here water has a bulk modulus and sand a Young's modulus, those of their classes.
"""

from dataclasses import replace
from math import atan
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from wsim.physics.mpm.objects import Granular, MaterialPoints, Water
from wsim.physics.mpm.usd.points import read_point_places
from wsim.physics.particles.usd.bindings import authored_names, bound_physics_material, warn_unread
from wsim.physics.particles.usd.physx import (
    MATERIAL,
    QUIET,
    SET,
    find_particle_system,
    flag_is_off,
    read_flag,
    read_own_number,
    read_radius,
    read_weight,
)
from wsim.usd import names
from wsim.usd.stage import StageReading
from wsim.usd.transforms import read_placement

ON_GRID = "they set PhysX's solver of positions; here particles meet on a grid, and never pass a collider"


def load_particle_set(reading: StageReading, prim: Usd.Prim) -> MaterialPoints | None:
    """The body of a prim; None if it is broken, or left out (reported)."""
    path = str(prim.GetPath())
    if not prim.IsA(UsdGeom.Points):
        reading.warn(path, f"is a {prim.GetTypeName()} with {names.PHYSX_SET}; particles are read of Points: it is left out")
        return None
    system = find_particle_system(reading, prim, ON_GRID)
    off = [p.GetPath() for p, name in ((prim, f"{SET}particleEnabled"), (system, "particleSystemEnabled"))
           if p and read_flag(reading, p, name, True) is False]
    if off:
        reading.warn(off[0], f"is switched off: {path} is left out")
        return None
    fluid, found = read_flag(reading, prim, f"{SET}fluid", True), read_point_places(reading, prim)
    places = prim.GetAttribute(f"{SET}simulationPoints").Get(reading.start)
    if places is not None and np.ndim(places) != 2:
        kind = prim.GetAttribute(f"{SET}simulationPoints").GetTypeName()
        reading.fail(f"{path}.{SET}simulationPoints", f"is of type {kind}; allowed is point3f[]: author it again with "
                     "that type")
    elif places is not None and len(places) != len(found["points"]):
        reading.warn(path, f"has {len(places)} {SET}simulationPoints and {len(found['points'])} points: the points count; "
                     "author as many")
    elif places is not None:
        place = read_placement(reading, prim)
        found["points"] = place.frame[0][:3, 3] + np.array(places, np.float64) * reading.units.metres @ place.linear[0].T
    radius = read_radius(reading, system, fluid)
    volume = (2.0 * radius) ** 3
    material = _read_material(reading, system, prim, fluid)
    mass, density = (read_weight(reading, prim, name, unit) for name, unit in (("mass", "kg"), ("density", "kg/m^3")))
    if mass or density:
        material = replace(material, density=mass / (volume * max(len(found["points"]), 1)) if mass else density)              # type: ignore[arg-type]
    read = {f"{SET}{each}" for each in ("fluid", "particleSystem", "simulationPoints", "particleEnabled", "particleGroup")}
    warn_unread(reading, prim, [each for each in authored_names(prim, SET) if each not in read and flag_is_off(prim, each)],
                "all particles meet each other on one grid")
    return MaterialPoints(path, cell=4.0 * radius, volumes=np.array([volume]), material=material, **found)


def _read_material(reading: StageReading, system: Usd.Prim | None, prim: Usd.Prim, fluid: bool) -> Any:
    """Water or sand with what the material that is bound to the system, else to the set, says of it."""
    bound = next((found for each in (system, prim) if each and (found := bound_physics_material(each))), None)
    value = {} if bound is None else {
        name: read_own_number(reading, bound, MATERIAL + name, "kg/m^3" if name == "density" else "1")
        for name in (each.removeprefix(MATERIAL) for each in authored_names(bound, MATERIAL))}
    own = read_own_number(reading, bound, "physics:density", "kg/m^3") if bound else None
    density = value.pop("density", None) or own or 1000.0
    known = [] if fluid else ["friction", "particleFrictionScale"]
    if bound:
        warn_unread(reading, bound, [MATERIAL + name for name, number in value.items()
                                     if name not in known and number is not None and number != QUIET.get(name, 0.0)],
                    "they are numbers of PhysX's solver of positions; author WsimMaterialPointsAPI on the Points for viscosity "
                    "[Pa s] and the like")
    if fluid:
        return Water(density=density)
    mu = (value.get("friction") or 0.2) * (value.get("particleFrictionScale") or 1.0)
    return Granular(density=density, friction_angle=atan(mu))
