"""WsimLoadAPI on any prim <-> `Load`: a force on points, or a traction on triangles, of the body that `wsim:load:body` names.

Of a traction `wsim:load:points` stands for the triangles between those points; without points and triangles it acts on all of
the surface. Samples of the force or traction are keys of its curve (`wsim.usd.transforms.curves`).
"""

from pxr import Sdf, Usd

from wsim.scene import Cloth, Load, Soft, Springs
from wsim.scene.curve import Curve
from wsim.scene.nodal.loads import between
from wsim.usd import names
from wsim.usd.attributes import attribute_of, author, authored, read
from wsim.usd.prims.pins import particles, vertices
from wsim.usd.stage import Reading, Units
from wsim.usd.transforms.curves import author_curve, read_curve


def load_load(reading: Reading, prim: Usd.Prim, bodies: dict[str, Cloth | Springs | Soft]) -> Load | None:
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
                     f"body or BasisCurves of rods that is simulated ({there})")
        return None
    kinds = [name for name in ("force", "traction") if authored(prim, "Load", name)]
    if len(kinds) != 1:
        reading.fail(path, f"has {' and '.join(kinds) or 'no force and no traction'}; author one of wsim:load:force and "
                     "wsim:load:traction")
        return None
    points, triangles, weights = (read(prim, "Load", name, units) for name in ("points", "triangles", "weights"))
    if kinds == ["force"]:
        if points is None or triangles is not None:
            reading.fail(path, f"has a force and {'no points' if triangles is None else 'triangles'}; a force acts on "
                         "wsim:load:points, a traction on wsim:load:triangles")
            return None
        points = particles(reading, prim, body, points, names.row("Load", "points").attribute)
        return None if points is None else Load(str(path), body.path, _curve(prim, "force", units), points, weights)
    if not isinstance(body, Cloth | Soft) or weights is not None:
        reading.fail(path, "has weights, which a force on points has; remove them" if weights is not None else
                     f"has a traction, and {body.path} has no triangles; author a force on points")
        return None
    if triangles is None:
        triangles = between(body, points)
        if not len(triangles):
            reading.fail(path, f"has a traction on points between which {body.path} has no triangle; name all three of each")
            return None
    return Load(str(path), body.path, _curve(prim, "traction", units), triangles=triangles)


def _curve(prim: Usd.Prim, name: str, units: Units) -> Curve:
    """Keys at the samples; of one that is not sampled a single one."""
    attribute = prim.GetAttribute(names.row("Load", name).attribute)
    return read_curve(attribute, units, lambda code: read(prim, "Load", name, units, code))


def author_load(stage: Usd.Stage, load: Load, body: Cloth | Springs | Soft, units: Units) -> None:
    """Defines the prim of a load."""
    prim = stage.DefinePrim(load.path, "Scope")
    prim.AddAppliedSchema(names.WSIM_LOAD)
    prim.CreateRelationship(names.LOADED, False).SetTargets([Sdf.Path(load.body)])
    if load.points is not None:
        author(prim, "Load", "points", vertices(load.points, body))
    for name in ("weights", "triangles"):
        if (value := getattr(load, name)) is not None:
            author(prim, "Load", name, value, units)
    author_values(prim, load, units)


def author_values(prim: Usd.Prim, load: Load, units: Units) -> None:
    """The force or traction: samples at its keys, or one value."""
    attribute, curve = attribute_of(prim, names.row("Load", load.name)), load.curve
    author_curve(attribute, curve, units, lambda value, code: author(prim, "Load", load.name, value, units, time=code))
