"""PhysicsAttachment, point to xform <-> `Pin`; point to point <-> `Tie`: indices0 of src0 and indices1 of src1 are the same
particles, one by one. Points to points or faces of a mesh that a skeleton moves are a pin that follows it.

src0 is the simulation geometry, indices0 its points; src1 is an Xform, still or animated, and coords1 are the places
in its space (none: where the points are at the start). An attachment without src1 hangs on the world; one to a rigid body that
forces move, or to an Xform within one, is a `Tie` without points of the other. Other kinds are left out with
a note. Weights that are painted on a mesh are pins without a prim
(`wsim.usd.prims.painted`).
"""


from typing import TYPE_CHECKING, cast

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.scene import Motion, Pin, Tie
from wsim.scene.bodies import Deformable, PointObject
from wsim.scene.methods import method_file
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.prims.painted import LEVELS, read_vertex_map
from wsim.usd.prims.springs import particles_of_vertices, vertices_of_particles
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement, split_placement

if TYPE_CHECKING:
    pass

FRAME = "frame"                    # child of a pin that it hangs on where it names no target
DERIVED = "wsim:derived"           # custom data of coords1 that follow from the points


def load_pin(reading: StageReading, prim: Usd.Prim, bodies: dict[str, PointObject]) -> Pin | Tie | None:
    """The pin of an attachment, or the tie of one to a rigid body; None if it is switched off, of another kind (noted), or
    broken (reported).

    bodies      by path of the simulation geometry; also by the path of the body above it
    """
    path, units = prim.GetPath(), reading.units
    if read_attribute(prim, "Pin", "enabled") is False:
        return None
    kinds = read_attribute(prim, "Pin", "type0") or "point", read_attribute(prim, "Pin", "type1") or "xform"
    source, target = _forwarded_target(prim, names.SRC0), _forwarded_target(prim, names.SRC1)
    follows = is_followed(reading, prim)
    if kinds != ("point", "xform") and not follows:
        reading.warn(path, f"attaches {kinds[0]} to {kinds[1]} and is left out: only points are, to an xform or a mesh that a "
                     "skeleton moves")
        return None
    body = bodies.get(source)
    if body is None:
        reading.warn(path, f"attaches {source or 'nothing'}, which is not simulated as a cloth, spring net, soft "
                     f"body, rods or material points"
                     f" ({', '.join(dict.fromkeys(b.path for b in bodies.values())) or 'there is none'}); it is left out"
                     ) if not _is_missing_prim(reading, source) else reading.fail(
                     path, f"{names.SRC0} names {source or 'nothing'}, which does not exist; name a simulation mesh")
        return None
    points = read_attribute(prim, "Pin", "points")
    if points is None or len(points) == 0:
        reading.warn(path, "has no physics:indices0: it holds no point and is left out")
        return None
    if target and target == source:
        reading.fail(path, f"{names.SRC1} names {target}, the body that it holds; name an Xform, or leave it empty (world)")
        return None
    if not follows and target and (carrier := _carrying_rigid_body(reading, reading.stage.GetPrimAtPath(target))):
        return _load_body_tie(reading, prim, body, points, target, carrier)
    pin = Pin(str(path), body.path, points)
    if not follows and not _set_pin_target(reading, prim, pin, target):
        return None
    points = particles_of_vertices(reading, prim, body, points, "physics:indices0")
    if points is None:
        return None
    pin.points = points
    if follows and not _follow_mesh(reading, prim, pin, body, kinds[1]):
        return None
    for field in ("stiffness", "damping"):
        value = read_attribute(prim, "Pin", field, units)
        if value is not None:
            setattr(pin, field, value)
    if not follows and _coords_are_derived(prim, pin, body, units):
        pin.places = None
    return pin


def is_followed(reading: StageReading, prim: Usd.Prim) -> bool:
    """True if an attachment holds points to points or faces of a mesh that a skeleton moves."""
    kind = read_attribute(prim, "Pin", "type1"), read_attribute(prim, "Pin", "type0") or "point"
    return kind in (("point", "point"), ("face", "point")) and Sdf.Path(_forwarded_target(prim, names.SRC1)) in reading.skinned


def _follow_mesh(reading: StageReading, prim: Usd.Prim, pin: Pin, body: PointObject, kind: str) -> bool:
    """Sets the places on a skinned mesh that the pin holds points at; False if they are broken (reported)."""
    if ((pin.points < 0) | (pin.points >= body.point_count)).any():
        reading.fail(prim.GetPath(), f"physics:indices0 holds numbers outside of 0 to {body.point_count - 1}; name points of "
                     f"{body.path}")
        return False
    pin.target = _forwarded_target(prim, names.SRC1)
    x = body.placed_points()[pin.points]
    pin.follows = method_file("Skeleton", "usd").hang(reading, prim, reading.stage.GetPrimAtPath(pin.target), kind, x)
    return pin.follows is not None


def _forwarded_target(prim: Usd.Prim, name: str) -> str:
    relationship = prim.GetRelationship(name)
    targets = relationship.GetForwardedTargets() if relationship else []
    return str(targets[0]) if targets else ""


def _is_missing_prim(reading: StageReading, path: str) -> bool:
    return not path or not reading.stage.GetPrimAtPath(path)


def _set_pin_target(reading: StageReading, prim: Usd.Prim, pin: Pin, target: str) -> bool:
    """Sets the pin's target, motion and places; False if the target is broken (reported)."""
    pin.places = read_attribute(prim, "Pin", "places", reading.units)
    if not target:
        return True
    xform = reading.stage.GetPrimAtPath(target)
    if not xform:
        reading.fail(prim.GetPath(), f"{names.SRC1} names {target}, which does not exist; name an Xform or nothing "
                                     "(world)")
        return False
    pin.target = "" if target == f"{pin.path}/{FRAME}" else target
    place = read_placement(reading, xform)
    try:
        frames, S = split_placement(place)
    except ValueError as error:
        reading.fail(target, str(error))
        return False
    if np.abs(S - S[0]).max() > 1e-6 * np.abs(S).max():
        reading.warn(target, "its scale is animated and points are pinned to it; the scale at its first key is held")
    if pin.places is not None and not np.array_equal(S[0], np.eye(3)):
        pin.places = pin.places @ S[0].T
    pin.motion = place.follow(frames)
    return True


def _load_body_tie(reading: StageReading, prim: Usd.Prim, body: PointObject, points: np.ndarray, target: str,
                   carrier: str) -> Tie | None:
    """The tie of points to a rigid body. target: it, or an Xform within it."""
    numbers = particles_of_vertices(reading, prim, body, points, "physics:indices0")
    if numbers is None:
        return None
    places = read_attribute(prim, "Pin", "places", reading.units)
    if places is not None and not prim.GetAttribute("physics:coords1").GetCustomDataByKey(DERIVED):
        M, own = (read_placement(reading, reading.stage.GetPrimAtPath(p)) for p in (target, carrier))
        world, back = places @ M.linear[0].T + M.frame[0][:3, 3], own.frame[0]
        places = (world - back[:3, 3]) @ back[:3, :3]
    else:
        places = None
    if np.isfinite(value := read_attribute(prim, "Pin", "stiffness", reading.units) or np.inf):
        reading.warn(prim.GetPath(), f"has a stiffness of {value:g} N/m and holds points to the rigid body {carrier}: it is "
                     "hard here")
    return Tie(str(prim.GetPath()), body.path, numbers, carrier, places=places)


def _carrying_rigid_body(reading: StageReading, xform: Usd.Prim) -> str:
    """Path of the rigid body that moves by forces which an Xform is, or lies in; "" where there is none."""
    each = xform
    while each and not each.IsPseudoRoot():
        if names.RIGID_BODY in applied_schemas(each):
            body = method_file("Body", "joints.moving").body_of(reading, xform)
            return str(body.GetPath()) if body else ""
        each = each.GetParent()
    return ""


def _pin_local_positions(pin: Pin, body: PointObject) -> np.ndarray:
    """Where the held points are at the start, in the target's frame [m], (k, 3)."""
    world = body.placed_points()[pin.points]
    M = pin.motion.at(0.0)
    return (world - M[:3, 3]) @ np.linalg.inv(M[:3, :3]).T


def _coords_are_derived(prim: Usd.Prim, pin: Pin, body: PointObject, units: StageUnits) -> bool:
    """True if coords1 were written only for other readers and still agree with the points."""
    attribute = prim.GetAttribute("physics:coords1")
    inside = np.all((pin.points >= 0) & (pin.points < body.point_count))
    if pin.places is None or not attribute.GetCustomDataByKey(DERIVED) or not inside:
        return False
    if len(pin.places) != len(pin.points) or not np.isfinite(body.motion.values).all():
        return False                                           # reported by wsim.scene.check.scene
    return np.allclose(pin.places, _pin_local_positions(pin, body).astype(np.float32), rtol=1e-6, atol=1e-6)


def load_painted(reading: StageReading, mesh: Usd.Prim, body: Deformable) -> list[Pin]:
    """Pins of the weights that are painted on a mesh: PATH/painted of 1, PATH/painted_K of K / LEVELS."""
    found = read_vertex_map(reading, mesh, "pin", "1", {"point": len(body.points)})
    if found is None:
        return []
    weights = found[1]
    if weights.max(initial=0.0) > 1.0:
        k = int(np.argmax(weights > 1.0))
        reading.fail(mesh.GetPath(), f"primvars:wsim:pin[{k}] is {weights[k]:g}; allowed is 0 (free) to 1 (held): paint it "
                     "again there")
        return []
    level = np.where((weights > 0.0) & (weights < 1.0), np.clip(np.rint(weights * LEVELS), 1, LEVELS - 1),
                     LEVELS * weights).astype(int)
    pins = []
    for k in (int(k) for k in np.unique(level) if k):
        pin = Pin(f"{body.path}/painted" + (f"_{k}" if k < LEVELS else ""), body.path, np.flatnonzero(level == k))
        if k < LEVELS:
            pin.stiffness = k / (LEVELS - k) * body.stiffness_at_point()
        if _set_pin_target(reading, mesh, pin, body.path):
            pins.append(pin)
    return pins


def author_pin(stage: Usd.Stage, pin: Pin, body: PointObject, units: StageUnits, frames: int) -> None:
    """Defines the attachment of a pin and, where it has no target of its own, the Xform that it hangs on."""
    prim = stage.DefinePrim(pin.path, names.ATTACHMENT)
    target = pin.target or f"{pin.path}/{FRAME}"
    if pin.follows is None and (not stage.GetPrimAtPath(target) or not pin.target):
        author_motion(UsdGeom.Xform.Define(stage, target).GetPrim(), pin.motion, units, frames)
    prim.CreateRelationship(names.SRC0, False).SetTargets([Sdf.Path(pin.body)])
    prim.CreateRelationship(names.SRC1, False).SetTargets([Sdf.Path(target)])
    author_attribute(prim, "Pin", "enabled", True)
    author_attribute(prim, "Pin", "type0", "point")
    author_attribute(prim, "Pin", "type1", "xform")
    author_attribute(prim, "Pin", "points", vertices_of_particles(pin.points, body))
    if pin.follows is not None:
        method_file("Skeleton", "write").attach(prim, target, pin.follows, units)
    else:
        places = author_attribute(prim, "Pin", "places", _pin_local_positions(pin, body) if pin.places is None else pin.places,
                                  units)
        if pin.places is None:
            places.SetCustomDataByKey(DERIVED, True)
    author_attribute(prim, "Pin", "stiffness", pin.stiffness, units)
    author_attribute(prim, "Pin", "damping", pin.damping, units)


def is_tie(prim: Usd.Prim) -> bool:
    return read_attribute(prim, "Pin", "type0") == read_attribute(prim, "Pin", "type1") == "point"


def load_tie(reading: StageReading, prim: Usd.Prim, bodies: dict[str, PointObject]) -> Tie | None:
    """The tie of an attachment; None if it is switched off, or between bodies that cannot share points (noted).

    bodies      by path of the simulation geometry; also by the path of the body above it
    """
    path = prim.GetPath()
    if read_attribute(prim, "Pin", "enabled") is False:
        return None
    ends = [(_forwarded_target(prim, source), read_attribute(prim, "Tie", field))
            for source, field in ((names.SRC0, "points"), (names.SRC1, "others"))]
    found = [(bodies.get(source), indices) for source, indices in ends]
    for (source, _), (body, _) in zip(ends, found, strict=True):
        if body is None:
            reading.warn(path, f"attaches {source or 'nothing'}, which is no simulated cloth or soft body; it is left out")
            return None
    (mine, points), (other, others) = [(cast(PointObject, body), rows) for body, rows in found]
    soft = other.is_solid or other.is_cluster and not mine.is_solid
    if not soft:
        (mine, points), (other, others) = (other, others), (mine, points)
    if not ((other.is_solid and mine.has_surface) or other.is_cluster):
        reading.warn(path, f"attaches points of {ends[0][0]} to points of {ends[1][0]} and is left out: a cloth or a soft body "
                     "shares points with a soft body")
        return None
    if points is None or others is None:
        reading.warn(path, "has no physics:indices0 or no physics:indices1: it holds no point and is left out")
        return None
    return Tie(str(path), mine.path, points, other.path, others)


def author_tie(stage: Usd.Stage, tie: Tie, body: PointObject, carrier: Motion | None, units: StageUnits) -> None:
    """Defines the attachment of a tie. body: whose points it names; carrier: motion of its rigid body, or None."""
    prim = stage.DefinePrim(tie.path, names.ATTACHMENT)
    prim.CreateRelationship(names.SRC0, False).SetTargets([Sdf.Path(tie.body)])
    prim.CreateRelationship(names.SRC1, False).SetTargets([Sdf.Path(tie.other)])
    if carrier is not None:
        pin = Pin(tie.path, tie.body, tie.points, motion=carrier)
        for field, value in (("enabled", True), ("type0", "point"), ("type1", "xform"),
                             ("points", vertices_of_particles(tie.points, body))):
            author_attribute(prim, "Pin", field, value)
        places = author_attribute(prim, "Pin", "places", _pin_local_positions(pin, body) if tie.places is None else tie.places,
                                  units)
        if tie.places is None:
            places.SetCustomDataByKey(DERIVED, True)
        return
    for field, value in (("enabled", True), ("type0", "point"), ("type1", "point")):
        author_attribute(prim, "Pin", field, value)
    author_attribute(prim, "Tie", "points", tie.points)
    author_attribute(prim, "Tie", "others", tie.others)
