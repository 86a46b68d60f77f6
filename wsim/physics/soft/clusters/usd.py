"""Clusters in USD: a Mesh or Points with WsimShapeMatchingAPI <-> `Clusters`."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from wsim.physics.soft.clusters.objects import Clusters
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.load_varying import check_topology, note_varying_values, value_attributes_of_prim
from wsim.usd.prims.cloth import load_points
from wsim.usd.prims.fabric import (
    author_friction,
    bind_physics_material,
    bound_physics_material,
    friction_by_name,
    load_friction,
)
from wsim.usd.prims.masses import body_mass
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion, read_placement

NUMBERS = ("stiffness", "damping", "spacing", "overlap", "yield_strain", "creep", "max_strain", "radius", "self_collision")
ARRAYS = ("masses", "sizes", "members")
LIVE = ("stiffness", "damping")
FACES = ("counts", "indices")


def load_body(reading: StageReading, prim: Usd.Prim, body: Usd.Prim) -> Clusters | None:
    """The clusters of a prim; None where it cannot be read (which is reported). body: the prim with physics:mass."""
    path, units = str(prim.GetPath()), reading.units
    if not (prim.IsA(UsdGeom.Mesh) or prim.IsA(UsdGeom.Points)):
        reading.fail(path, f"has {names.WSIM_SHAPES} and is a {prim.GetTypeName() or 'typeless prim'}; it must be a Mesh or "
                     "Points")
        return None
    points, default = load_points(reading, prim, "Clusters")
    if points is None:
        reading.fail(path, "has no points; shape matching needs three or more (is a payload or reference missing?)")
        return None
    faces = {}
    if prim.IsA(UsdGeom.Mesh) and check_topology(reading, prim, "faceVertexCounts", "faceVertexIndices"):
        faces = {name: read_attribute(prim, "Clusters", name, units, reading.start) for name in FACES}
    rest = read_attribute(prim, "Clusters", "rest_points", units)
    given = {name: read_attribute(prim, "Clusters", name, units) for name in (*NUMBERS, *ARRAYS)} | faces
    found = Clusters(path, points, motion=read_placement(reading, prim).motion, mass=body_mass(reading, body),
                     rest_points=default if rest is None else rest,
                     velocities=read_attribute(prim, "Clusters", "velocities", units, reading.start),
                     **{name: value for name, value in given.items() if value is not None})
    found.static_friction, found.dynamic_friction = load_friction(reading, prim)
    live = [prim.GetAttribute(names.attribute_entry("Clusters", name).attribute) for name in LIVE]
    note_varying_values(reading, path, Clusters, live,
                        lambda at: {n: v for n in LIVE if (v := read_attribute(prim, "Clusters", n, at.units)) is not None})
    note_varying_values(reading, path, Clusters, value_attributes_of_prim(bound_physics_material(reading, prim)),
                        lambda at: friction_by_name(at, prim))
    return found


def author_clusters(stage: Usd.Stage, thing: Clusters, material: str, units: StageUnits, frames: int) -> None:
    """Defines the Mesh of a body of clusters, Points where it has no surface, with everything that a load reads."""
    cloud = not len(thing.counts)
    shape = (UsdGeom.Points if cloud else UsdGeom.Mesh).Define(stage, thing.path)
    prim = shape.GetPrim()
    for schema in (names.BODY, names.WSIM_SHAPES):
        prim.AddAppliedSchema(schema)
    if thing.mass is not None:
        author_attribute(prim, "Body", "mass", thing.mass, units)
    for name in ("points", *FACES, "velocities", "rest_points", *ARRAYS, *NUMBERS):
        value = getattr(thing, name)
        if value is not None and not (name in FACES and cloud):
            author_attribute(prim, "Clusters", name, value, units)
    if cloud:
        shape.CreateWidthsAttr([2.0 * (thing.radius or 0.25 * point_distance(thing.points)) / units.metres])
        shape.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    else:
        shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    shape.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(shape.GetPointsAttr().Get()))
    author_motion(prim, thing.motion, units, frames)
    existing = stage.GetPrimAtPath(material)
    friction = (thing.static_friction, thing.dynamic_friction)
    bind_physics_material(prim, existing if existing else author_friction(stage, material, friction, units))


def point_distance(points: np.ndarray) -> float:
    """Distance [m] that points of even density in their box have."""
    sides = np.ptp(points, axis=0)
    return float(np.cbrt(max(np.prod(np.maximum(sides, 1e-3 * sides.max())), 1e-12) / len(points)))
