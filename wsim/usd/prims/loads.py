"""WsimLoadAPI on any prim <-> `Load`: a force on points, or a traction on triangles, of the body that `wsim:load:body` names.

Of a traction `wsim:load:points` stands for the triangles between those points; without points and triangles it acts on all of
the surface. Samples of the force or traction are keys of its curve (`wsim.usd.transforms.curves`).
"""

from pxr import Sdf, Usd

from wsim.scene import Load
from wsim.scene.bodies import Deformable, PointObject
from wsim.scene.curve import Curve
from wsim.scene.nodal.loads import surface_triangles_among
from wsim.usd import names
from wsim.usd.attributes import author_attribute, define_attribute, is_authored, read_attribute
from wsim.usd.prims.springs import particles_of_vertices, vertices_of_particles
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms.curves import author_curve, read_curve


def load_applied_force(reading: StageReading, prim: Usd.Prim, bodies: dict[str, PointObject]) -> Load | None:
    """The load of a prim; None if something of it is broken (reported).

    bodies      by path of the simulation geometry; also by the path of the body above it
    """
    path, units = prim.GetPath(), reading.units
    relationship = prim.GetRelationship(names.LOADED)
    targets = [str(target) for target in relationship.GetForwardedTargets()] if relationship else []
    body = bodies.get(targets[0]) if len(targets) == 1 else None
    if body is None:
        there = ", ".join(dict.fromkeys(b.path for b in bodies.values())) or "there is none"
        reading.fail(path, f"{names.LOADED} names {', '.join(targets) or 'nothing'}; allowed is one cloth, spring net, soft "
                     f"body, BasisCurves of rods or material points that are simulated ({there})")
        return None
    kinds = [name for name in ("force", "traction") if is_authored(prim, "Load", name)]
    if len(kinds) != 1:
        reading.fail(path, f"has {' and '.join(kinds) or 'no force and no traction'}; author one of wsim:load:force and "
                     "wsim:load:traction")
        return None
    points, triangles, weights = (read_attribute(prim, "Load", name, units) for name in ("points", "triangles", "weights"))
    if kinds == ["force"]:
        if points is None or triangles is not None:
            reading.fail(path, f"has a force and {'no points' if triangles is None else 'triangles'}; a force acts on "
                         "wsim:load:points, a traction on wsim:load:triangles")
            return None
        points = particles_of_vertices(reading, prim, body, points, names.attribute_entry("Load", "points").attribute)
        return None if points is None else Load(str(path), body.path, _read_load_curve(prim, "force", units), points, weights)
    if not isinstance(body, Deformable) or not body.has_surface or weights is not None:
        reading.fail(path, "has weights, which a force on points has; remove them" if weights is not None else
                     f"has a traction, and {body.path} has no triangles; author a force on points")
        return None
    if triangles is None:
        triangles = surface_triangles_among(body, points)
        if not len(triangles):
            reading.fail(path, f"has a traction on points between which {body.path} has no triangle; name all three of each")
            return None
    return Load(str(path), body.path, _read_load_curve(prim, "traction", units), triangles=triangles)


def _read_load_curve(prim: Usd.Prim, name: str, units: StageUnits) -> Curve:
    """Keys at the samples; of one that is not sampled a single one."""
    attribute = prim.GetAttribute(names.attribute_entry("Load", name).attribute)
    return read_curve(attribute, units, lambda code: read_attribute(prim, "Load", name, units, code))


def author_load(stage: Usd.Stage, load: Load, body: PointObject, units: StageUnits) -> None:
    """Defines the prim of a load."""
    prim = stage.DefinePrim(load.path, "Scope")
    prim.AddAppliedSchema(names.WSIM_LOAD)
    prim.CreateRelationship(names.LOADED, False).SetTargets([Sdf.Path(load.body)])
    if load.points is not None:
        author_attribute(prim, "Load", "points", vertices_of_particles(load.points, body))
    for name in ("weights", "triangles"):
        if (value := getattr(load, name)) is not None:
            author_attribute(prim, "Load", name, value, units)
    author_load_curve(prim, load, units)


def author_load_curve(prim: Usd.Prim, load: Load, units: StageUnits) -> None:
    """The force or traction: samples at its keys, or one value."""
    attribute, curve = define_attribute(prim, names.attribute_entry("Load", load.name)), load.curve
    author_curve(attribute, curve, units, lambda value,
                 code: author_attribute(prim, "Load", load.name, value, units, time=code))
