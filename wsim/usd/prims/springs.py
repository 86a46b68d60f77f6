"""Spring nets: linear BasisCurves <-> `Springs`.

Each segment of a curve is a spring. Curves do not share points, so a particle that several curves meet has a vertex
in each, and wsim:particles says which particle a vertex is; a curve (i, i) places a particle that no spring holds.
Curves with PhysicsCurvesDeformableSimAPI are read as springs of stiffness E A / L (L the length of a segment, A its
cross-section); their bending and twist are not simulated.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Usd, UsdGeom

from wsim.usd import names
from wsim.usd.attributes import author_attribute, define_attribute, is_authored, read_attribute, to_usd_array
from wsim.usd.load_varying import check_topology, note_varying_values, value_attributes_of_prim
from wsim.usd.prims.cloth import load_points
from wsim.usd.prims.fabric import (
    author_friction,
    bind_physics_material,
    bound_physics_material,
    friction_by_name,
    load_curve_stretch,
    load_friction,
)
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement
from wsim.usd.transforms.curves import author_curve, read_curve

if TYPE_CHECKING:
    from wsim.scene import Springs


def load_body(reading: StageReading, prim: Usd.Prim, body: Usd.Prim) -> Springs | None:
    """The net of a BasisCurves prim; None if it cannot be read (which is reported)."""
    path, curves = prim.GetPath(), UsdGeom.BasisCurves(prim)
    if not curves:
        reading.fail(path, f"has a spring or curve simulation API and is a {prim.GetTypeName()}; it must be a "
                           "BasisCurves")
        return None
    if curves.GetTypeAttr().Get() != UsdGeom.Tokens.linear:
        reading.fail(path, f"is a {curves.GetTypeAttr().Get()} BasisCurves; only type = linear can be simulated")
        return None
    if not check_topology(reading, prim, "curveVertexCounts", names.attribute_entry("Springs", "particles").attribute):
        return None
    vertices, _ = load_points(reading, prim, "Springs")
    counts = read_attribute(prim, "Springs", "counts", reading.units, reading.start)
    if vertices is None or counts is None or counts.sum() != len(vertices) or counts.min(initial=2) < 2:
        reading.fail(path, f"has {0 if vertices is None else len(vertices)} points and curveVertexCounts that sum to "
                     f"{0 if counts is None else counts.sum()}; the two must agree, with 2 or more vertices a curve")
        return None
    particles = read_attribute(prim, "Springs", "particles", reading.units)
    particles = np.arange(len(vertices), dtype=np.int32) if particles is None else particles
    if len(particles) != len(vertices) or not np.array_equal(kinds := np.unique(particles), np.arange(len(kinds))):
        reading.fail(path, f"wsim:particles has {len(particles)} values from {particles.min()} to {particles.max()}; "
                     f"it must number the particles of the {len(vertices)} vertices from 0 without gaps")
        return None
    segments = _curve_segments(counts, curves.GetWrapAttr().Get() == UsdGeom.Tokens.periodic)
    if names.WSIM_SPRINGS in applied_schemas(prim):
        return _read_spring_net(reading, prim, vertices, particles, segments)
    return _read_curves_as_springs(reading, prim, body, vertices, particles[segments])


def _curve_segments(counts: np.ndarray, periodic: bool) -> np.ndarray:
    """Vertices of each segment, (m, 2), in the order of the curves."""
    starts = np.cumsum(counts) - counts
    pieces = []
    for start, count in zip(starts.tolist(), counts.tolist(), strict=True):
        along = np.arange(start, start + count)
        ends = np.roll(along, -1) if periodic else along[1:]
        pieces.append(np.stack([along[:len(ends)], ends], axis=1))
    return np.concatenate(pieces) if pieces else np.zeros((0, 2), np.int64)


def _read_spring_net(reading: StageReading, prim: Usd.Prim, vertices, particles, segments) -> Springs | None:
    """A net with WsimSpringsAPI."""
    from wsim.scene import Springs
    first = np.unique(particles, return_index=True)[1]
    edges = particles[segments]
    edges = edges[edges[:, 0] != edges[:, 1]]
    values = {field: read_attribute(prim, "Springs", field, reading.units) for field in
              ("stiffness", "masses", "lengths", "damping", "radius")}
    missing = [f"wsim:{field}" for field in ("stiffness", "masses") if values[field] is None]
    if missing:
        reading.fail(prim.GetPath(), f"has no {' and no '.join(missing)}; author one value for all, or one each")
        return None
    velocities = read_attribute(prim, "Springs", "velocities", reading.units, reading.start)
    if velocities is not None and len(velocities) != len(vertices):
        reading.fail(prim.GetPath(), f"has {len(velocities)} velocities and {len(vertices)} points; the two must agree")
        velocities = None
    static, dynamic = load_friction(reading, prim)
    given = {field: value for field, value in values.items() if value is not None}
    given |= load_muscles(reading, prim)
    path = str(prim.GetPath())
    live = [prim.GetAttribute(names.attribute_entry("Springs", field).attribute) for field in ("stiffness", "damping")]
    note_varying_values(reading, path, Springs, live,
                        lambda at: {field: read_attribute(prim, "Springs", field, at.units) for field in
                                                                  ("stiffness", "damping") if field in given})
    note_varying_values(reading, path, Springs, value_attributes_of_prim(bound_physics_material(reading, prim)),
                        lambda at: friction_by_name(at, prim))
    return Springs(path, vertices[first], edges, **given, motion=read_placement(reading, prim).motion,
                   velocities=None if velocities is None else velocities[first],
                   static_friction=static, dynamic_friction=dynamic)


def load_muscles(reading: StageReading, prim: Usd.Prim) -> dict:
    """Muscles and actuation of a net, by field; without what cannot be read, which is reported."""
    found, units = {}, reading.units
    if (muscles := read_attribute(prim, "Springs", "muscles", units)) is not None:
        found["muscles"] = muscles
    if not is_authored(prim, "Springs", "actuation"):
        return found
    attribute = prim.GetAttribute(names.attribute_entry("Springs", "actuation").attribute)
    values = [read_attribute(prim, "Springs", "actuation", units, code) for code in attribute.GetTimeSamples() or [None]]
    sizes = sorted({0 if v is None else len(v) for v in values})
    if len(sizes) > 1 or not sizes[0]:
        reading.fail(attribute.GetPath(), f"has {' and '.join(map(str, sizes))} values at different times; give it one value a "
                     "muscle group at each")
        return found
    return found | {"actuation": read_curve(attribute, units,
                                            lambda code: read_attribute(prim, "Springs", "actuation", units, code))}


def author_muscles(prim: Usd.Prim, springs: Springs, units: StageUnits) -> None:
    """Samples of the actuation and the groups, where there are some."""
    if springs.muscles is not None:
        author_attribute(prim, "Springs", "muscles", springs.muscles, units)
    if (curve := springs.actuation) is None:
        return
    attribute = define_attribute(prim, names.attribute_entry("Springs", "actuation"))
    author_curve(attribute, curve, units, lambda values, code: attribute.Set(to_usd_array(values, "double[]"), code))


def _read_curves_as_springs(reading: StageReading, prim: Usd.Prim, body: Usd.Prim, points: np.ndarray,
                            edges: np.ndarray) -> Springs | None:
    """A curves deformable: stiffness E A / L and mass of each segment from its rest shape."""
    from wsim.scene import Springs
    path, motion = prim.GetPath(), read_placement(reading, prim).motion
    reading.warn(path, "is simulated as springs along its segments, without bending, twist and wsim:selfCollision: it is no "
                       "BasisCurves with open ends; author wrap = nonperiodic for these")
    rest = read_attribute(prim, "Cloth", "rest_points", reading.units)
    rest = points if rest is None else rest
    if len(rest) != len(points):
        reading.fail(path, f"physics:restShapePoints has {len(rest)} values; allowed is {len(points)} (one a point)")
        return None
    ends = rest.astype(np.float64)[edges]
    L = np.linalg.norm((ends[:, 1] - ends[:, 0]) @ motion.values[0, :3, :3].T, axis=1)
    if not np.all(np.isfinite(L)) or L.min(initial=1.0) <= 0.0:
        reading.fail(path, f"segment {int(np.argmin(np.where(np.isfinite(L), L, -1)))} has no length; remove the "
                           "double point")
        return None
    h = _read_curve_diameter(reading, prim)
    area = math.pi * h * h / 4.0
    EA, density = load_curve_stretch(reading, prim, area)
    masses = _rod_masses(reading, prim, body, edges, density * area * L, len(points))
    static, dynamic = load_friction(reading, prim)
    velocities = read_attribute(prim, "Springs", "velocities", reading.units, reading.start)
    note_varying_values(reading, str(path), Springs, value_attributes_of_prim(bound_physics_material(reading, prim)),
                        lambda at: friction_by_name(at, prim) | {
        "stiffness": load_curve_stretch(at, prim, area)[0] / L, "density": load_curve_stretch(at, prim, area)[1]})
    return Springs(str(path), points, edges, EA / L, masses, lengths=L, radius=h / 2.0, motion=motion,
                   velocities=velocities, static_friction=static, dynamic_friction=dynamic)


def _read_curve_diameter(reading: StageReading, prim: Usd.Prim) -> float:
    """One thickness [m] for the curves: the mean of what is authored."""
    values = read_attribute(prim, "Cloth", "thicknesses", reading.units)
    if values is None or len(values) == 0:
        return names.THICKNESS
    if not (np.all(np.isfinite(values)) and values.min() > 0):
        reading.fail(prim.GetPath(), f"physics:thicknesses holds {values.min():g}; allowed are finite numbers > 0")
        return names.THICKNESS
    if np.ptp(values) > 0:
        reading.warn(prim.GetPath(), "physics:thicknesses varies; its mean counts")
    return float(str(values[0])) if np.ptp(values) == 0 else float(values.mean())


def _rod_masses(reading: StageReading, prim: Usd.Prim, body: Usd.Prim, edges, of_segments: np.ndarray, n: int) -> np.ndarray:
    """[kg] of each point: point or segment masses, else the body's mass or density, else the material's density."""
    values = read_attribute(prim, "Cloth", "masses", reading.units)
    if values is not None and len(values) == n:
        return values
    if values is not None and len(values) == len(edges):
        of_segments = values.astype(np.float64)
    elif values is not None and len(values) not in (0, 1):
        reading.fail(prim.GetPath(), f"physics:masses has {len(values)} values; allowed is 1, {len(edges)} (segments) "
                     f"or {n} (points)")
    else:
        total = float(values[0]) if values is not None and len(values) else read_attribute(body, "Body", "mass", reading.units)
        density = read_attribute(body, "Body", "density", reading.units)
        if total:
            of_segments = of_segments * (total / of_segments.sum())
        elif density:
            h = _read_curve_diameter(reading, prim)
            of_segments = of_segments * (density / load_curve_stretch(reading, prim, math.pi * h * h / 4.0)[1])
    return np.bincount(edges.ravel(), np.repeat(of_segments / 2.0, 2), n)


def curve_vertices(springs: Springs) -> np.ndarray:
    """Particle of each curve vertex that `author_springs` writes, (2 m + 2 k,): the springs, then k loose points."""
    held = np.zeros(len(springs.points), bool)
    held[springs.edges.ravel()] = True
    return np.concatenate([springs.edges.ravel(), np.repeat(np.flatnonzero(~held), 2)]).astype(np.int32)


def author_springs(stage: Usd.Stage, springs: Springs, material: str, units: StageUnits, frames: int) -> None:
    """Defines the BasisCurves of a net, one curve of two vertices a spring."""
    curves = UsdGeom.BasisCurves.Define(stage, springs.path)
    prim, vertices = curves.GetPrim(), curve_vertices(springs)
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    for schema in (names.BODY, names.WSIM_SPRINGS):
        prim.AddAppliedSchema(schema)
    author_attribute(prim, "Springs", "points", springs.points[vertices], units)
    author_attribute(prim, "Springs", "counts", np.full(len(vertices) // 2, 2), units)
    author_attribute(prim, "Springs", "particles", vertices)
    if springs.velocities is not None:
        author_attribute(prim, "Springs", "velocities", springs.velocities[vertices], units)
    for field in ("stiffness", "masses", "lengths", "damping", "radius"):
        if getattr(springs, field) is not None:
            author_attribute(prim, "Springs", field, getattr(springs, field), units)
    author_muscles(prim, springs, units)
    if springs.radius > 0:
        curves.CreateWidthsAttr([2.0 * springs.radius / units.metres])
        curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    curves.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(curves.GetPointsAttr().Get()))
    author_motion(prim, springs.motion, units, frames)
    existing = stage.GetPrimAtPath(material)
    friction = (springs.static_friction, springs.dynamic_friction)
    bind_physics_material(prim, existing if existing else author_friction(stage, material, friction, units))


def particles_of_vertices(reading: StageReading, prim: Usd.Prim, body: Any, points: np.ndarray,
                          name: str) -> np.ndarray | None:
    """Points of the body from vertices of its prim, which the attribute `name` holds: a net's particle has several."""
    if not body.is_net:
        return points
    numbering = read_attribute(reading.stage.GetPrimAtPath(body.path), "Springs", "particles")
    if numbering is None:
        return points
    bad = (points < 0) | (points >= len(numbering))
    if bad.any():
        reading.fail(prim.GetPath(), f"{name} holds {points[bad][0]}; allowed is 0 to {len(numbering) - 1} "
                     f"(vertices of {body.path})")
        return None
    return numbering[points]


def vertices_of_particles(points: np.ndarray, body: Any) -> np.ndarray:
    """Vertices of the body's prim: of a net, the first of each particle."""
    if not body.is_net:
        return points
    return np.unique(curve_vertices(body), return_index=True)[1][points]
