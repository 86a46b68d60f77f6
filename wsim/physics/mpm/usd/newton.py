"""Points with NewtonPointsDeformableSimAPI -> `MaterialPoints`, their materials by NewtonMPMMaterialAPI and the cells by
NewtonMPMSceneAPI (newton-usd-schemas 0.6). Every attribute of these is read, or named in a warning.

    newton:mpm:                                        here
    voxelSize                                          edge of a cell
    youngsModulus, poissonsRatio                       the same
    internalFriction mu: sqrt(J2) <= mu p              sand whose slope stands at atan(mu)
    yieldStress                                        cohesion of sand
    friction and yield stress 0                        water of the bulk modulus E / (3 (1 - 2 nu)), of the plastic viscosity
    yieldStress that is not reached (>= E)             jelly
    viscosity, elasticDamping d                        viscosity of sand and water; d / (2 (1 + nu)) that of jelly

A particle of width w has the volume w^3, as Newton has it, and the mass of its masses, else of the body's mass, else of a
density: the body's, the material's, 1000 kg/m^3.
"""

from dataclasses import replace
from math import atan, inf, isfinite
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from wsim.physics.mpm.objects import Granular, Jelly, MaterialPoints, Water
from wsim.physics.mpm.usd.points import (
    LIKE,
    read_material_subsets,
    read_point_places,
)
from wsim.physics.particles.usd.bindings import authored_names, bound_physics_material, warn_unread
from wsim.usd import names
from wsim.usd.attributes import read_attribute, read_table_attribute
from wsim.usd.names import AttributeEntry
from wsim.usd.prims.masses import body_density, body_mass
from wsim.usd.stage import StageReading, applied_schemas

MPM = "newton:mpm:"
NUMBERS = {"youngsModulus": ("Pa", -inf), "poissonsRatio": ("1", 0.3), "elasticDamping": ("Pa s", 0.0),
           "internalFriction": ("1", 0.5), "yieldPressure": ("Pa", -inf), "tensileYieldRatio": ("1", 0.0),
           "yieldStress": ("Pa", 0.0), "viscosity": ("Pa s", 0.0), "hardening": ("1", 0.0), "hardeningRate": ("1", 1.0),
           "softeningRate": ("1", 1.0), "dilatancy": ("1", 0.0), "initialPlasticVolumeStrain": ("1", 1.0)}
HARDENED = ("hardeningRate", "softeningRate", "initialPlasticVolumeStrain")      # they act where there is hardening
MOST = 16                # densities of one prim
STIFF = 1.0e5            # [Pa] Young's modulus where none is authored; Newton has rigid grains there


def load_newton_points(reading: StageReading, prim: Usd.Prim) -> MaterialPoints | None:
    """The body of a prim; None if it is broken, left out or kinematic (reported)."""
    path, body = str(prim.GetPath()), _governing_body(prim)
    if not prim.IsA(UsdGeom.Points):
        reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {names.NEWTON_POINTS}; author that on "
                     "Points")
        return None
    for field, text in (("enabled", "physics:bodyEnabled is off"),
                        ("kinematic", "physics:kinematicEnabled is on, and particles that are animated push nothing yet")):
        if read_attribute(body, "Body", field) is (field == "kinematic"):
            reading.warn(body.GetPath(), f"{text}: {path} is left out")
            return None
    found = read_point_places(reading, prim)
    count, widths = len(found["points"]), found.get("widths")
    if not count:
        reading.fail(path, "it has no points; author point3f[] points, one or more")
        return None
    if any(problem.fatal and problem.path == path for problem in reading.problems):
        return None
    if widths is None or not (np.isfinite(widths).all() and (widths > 0.0).all()):
        reading.fail(path, "its points have no volume: widths are missing, or not above 0; author float[] widths, the edge of "
                     "the cube that a particle stands for")
        return None
    found["volumes"] = widths**3
    chosen = read_material_subsets(reading, prim, count, lambda of: _material_of(reading, prim, of))
    if not chosen:
        return None
    cell = _read_cell(reading, prim, body) or 2.0 * float(np.median(widths))
    return _weigh(reading, prim, body, MaterialPoints(path, cell=cell, **found, **chosen))


def _governing_body(prim: Usd.Prim) -> Usd.Prim:
    """The prim with the deformable body: itself, or the one above."""
    above = prim.GetParent()
    return above if names.BODY not in applied_schemas(prim) and names.BODY in applied_schemas(above) else prim


def _material_of(reading: StageReading, points: Usd.Prim, prim: Usd.Prim) -> Any:
    """The material of the points, or of a subset of them; of a subset None where nothing is bound to it."""
    bound = bound_physics_material(prim, own=prim != points)
    if bound is None:
        return Granular(density=1000.0, friction_angle=atan(0.5), young=STIFF) if prim == points else None
    return read_newton_material(reading, bound)


def read_newton_material(reading: StageReading, material: Usd.Prim) -> Any:
    """A material of the attributes of a Material. What is not read is named once."""
    value = {name: _number(reading, material, MPM + name, unit, plain) for name, (unit, plain) in NUMBERS.items()}
    for name in ("youngsModulus", "poissonsRatio"):
        if not material.HasAttribute(MPM + name) or value[name] == -inf:
            other = _number(reading, material, f"physics:{name}", NUMBERS[name][0], -inf)
            value[name] = value[name] if other == -inf else other
    young, poisson, mu, stress = (value[name] for name in ("youngsModulus", "poissonsRatio", "internalFriction", "yieldStress"))
    young = STIFF if young == -inf else young
    density = _number(reading, material, "physics:density", "kg/m^3", 0.0) or 1000.0
    read = [name for name in ("hardening", "dilatancy", "tensileYieldRatio") if value[name] != 0.0]
    read += [name for name in HARDENED if value["hardening"] != 0.0 and value[name] != NUMBERS[name][1]]
    if not stress < young:
        found: Any = Jelly(young, poisson, density, viscosity=value["elasticDamping"] / (2.0 * (1.0 + poisson)))
        read += ["viscosity"] * (value["viscosity"] != 0.0)
    elif mu == 0.0 and stress == 0.0:
        found = Water(bulk=young / max(3.0 * (1.0 - 2.0 * poisson), 0.03), density=density, viscosity=value["viscosity"])
    else:
        found = Granular(young, poisson, density, atan(mu), stress, viscosity=value["viscosity"])
    if not isinstance(found, Jelly):
        read += ["elasticDamping"] * (value["elasticDamping"] != 0.0)
        read += ["yieldPressure"] * (0.0 <= value["yieldPressure"] < young)
    warn_unread(reading, material, [MPM + name for name in sorted(set(read))],
                f"{type(found).__name__} of wsim has no such property (docs: material points)")
    return found


def _number(reading: StageReading, prim: Usd.Prim, name: str, unit: str, plain: float) -> float:
    """An authored number [SI], finite; `plain` where there is none, or minus infinity, which stands for a default."""
    found = read_table_attribute(prim, AttributeEntry("", "", "", name, "float", unit), reading.units)
    if found is None or found == -inf:
        return plain
    if not isfinite(found) or found < 0.0 and not name.endswith("poissonsRatio"):
        reading.fail(prim.GetPath(), f"{name} is {found:g}; allowed is a finite number of 0 or more; author another")
        return plain
    return found


def _read_cell(reading: StageReading, prim: Usd.Prim, body: Usd.Prim) -> float | None:
    """Edge of a cell [m] that the simulation owner says, which else is the first PhysicsScene; None: none is authored."""
    relationship = body.GetRelationship("physics:simulationOwner")
    targets = relationship.GetForwardedTargets() if relationship else []
    owners = [reading.stage.GetPrimAtPath(path) for path in targets] or [
        p for p in reading.stage.Traverse() if p.GetTypeName() == names.PHYSICS_SCENE]
    owner = owners[0] if owners else None
    if not owner or names.NEWTON_MPM_SCENE not in applied_schemas(owner):
        return None
    cell = _number(reading, owner, MPM + "voxelSize", "m", -inf)
    if cell == 0.0:
        reading.fail(owner.GetPath(), f"{MPM}voxelSize is 0; allowed is a length above 0; author another, or none")
    unread = [name for name in authored_names(owner, MPM) if name != MPM + "voxelSize" and not _is_usual(owner, name)]
    unread += authored_names(owner, "newton:maxSolverIterations")
    warn_unread(reading, owner, unread, "they set Newton's implicit solver; wsim takes explicit steps, with APIC transfers and "
                "quadratic splines on a sparse grid")
    return None if cell == -inf else cell


def _is_usual(owner: Usd.Prim, name: str) -> bool:
    """Whether an attribute says what wsim does anyway."""
    return (name.removeprefix(MPM), owner.GetAttribute(name).Get()) in (
        ("transferScheme", "apic"), ("gridType", "sparse"), ("criticalFraction", 0.0), ("airDrag", -inf), ("airDrag", 0.0),
        ("maxActiveCellCount", -1))


def _weigh(reading: StageReading, prim: Usd.Prim, body: Usd.Prim, thing: MaterialPoints) -> MaterialPoints | None:
    """The body with the densities that its masses say."""
    volumes = np.broadcast_to(np.asarray(thing.volumes), len(thing.points))        # type: ignore[arg-type]
    which = np.zeros(len(volumes), np.int64) if thing.which is None else thing.which
    density = np.array([m.density for m in thing.materials])[which]
    entry = AttributeEntry("", "", "", "physics:masses", "float[]", "kg")
    masses = read_table_attribute(prim, entry, reading.units)
    whole, given = body_mass(reading, body), body_density(reading, body)
    if masses is not None and (len(masses) != len(volumes) or not (np.isfinite(masses).all() and (masses > 0.0).all())):
        reading.fail(thing.path, f"physics:masses has {len(masses)} values, or some are not above 0; author {len(volumes)}")
        return None
    if masses is not None:
        density = np.asarray(masses, np.float64) / volumes
    elif given is not None:
        density = np.full(len(volumes), given)
    if masses is None and whole is not None:
        density = density * (whole / float(density @ volumes))
    scale = np.round(np.log(density) / LIKE).astype(np.int64)
    kinds, place = np.unique(np.stack([which, scale], axis=1), axis=0, return_inverse=True)
    if len(kinds) > MOST:
        reading.fail(thing.path, f"its particles have {len(kinds)} densities; allowed are {MOST}: author masses that follow "
                     "the cubes of the widths")
        return None
    place = place.reshape(-1)
    found = [replace(thing.materials[k], density=float(np.median(density[place == n]))) for n, (k, _) in enumerate(kinds)]
    thing.material, thing.further = found[0], tuple(found[1:])
    thing.which = place if len(found) > 1 else None
    return thing
