"""Spring nets: linear BasisCurves <-> `Springs`.

Each segment of a curve is a spring. Curves do not share points, so a particle that several curves meet has a vertex
in each, and wsim:particles says which particle a vertex is; a curve (i, i) places a particle that no spring holds.
"""

from __future__ import annotations

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
    load_friction,
)
from wsim.usd.stage import StageReading, StageUnits
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
    return _read_spring_net(reading, prim, vertices, particles, segments)


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
