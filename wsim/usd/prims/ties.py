"""PhysicsAttachment, point to point <-> `Tie`: indices0 of src0 and indices1 of src1 are the same particles, one by one."""

from pxr import Sdf, Usd

from wsim.scene import Cloth, Soft, Springs, Tie
from wsim.usd import names
from wsim.usd.attributes import author, read
from wsim.usd.stage import Reading


def is_tie(prim: Usd.Prim) -> bool:
    return read(prim, "Pin", "type0") == read(prim, "Pin", "type1") == "point"


def load_tie(reading: Reading, prim: Usd.Prim, bodies: dict[str, Cloth | Springs | Soft]) -> Tie | None:
    """The tie of an attachment; None if it is switched off, or between bodies that cannot share points (noted).

    bodies      by path of the simulation geometry; also by the path of the body above it
    """
    path = prim.GetPath()
    if read(prim, "Pin", "enabled") is False:
        return None
    ends = [(_source(prim, source), read(prim, "Tie", field))
            for source, field in ((names.SRC0, "points"), (names.SRC1, "others"))]
    found = [(bodies.get(source), indices) for source, indices in ends]
    for (source, _), (body, _) in zip(ends, found, strict=True):
        if body is None:
            reading.warn(path, f"attaches {source or 'nothing'}, which is no simulated cloth or soft body; it is left out")
            return None
    (mine, points), (other, others) = found if isinstance(found[1][0], Soft) else found[::-1]
    if not isinstance(other, Soft) or isinstance(mine, Springs):
        reading.warn(path, f"attaches points of {ends[0][0]} to points of {ends[1][0]} and is left out: a cloth or a soft body "
                     "shares points with a soft body")
        return None
    if points is None or others is None:
        reading.warn(path, "has no physics:indices0 or no physics:indices1: it holds no point and is left out")
        return None
    assert mine is not None
    return Tie(str(path), mine.path, points, other.path, others)


def _source(prim: Usd.Prim, name: str) -> str:
    relationship = prim.GetRelationship(name)
    targets = relationship.GetForwardedTargets() if relationship else []
    return str(targets[0]) if targets else ""


def author_tie(stage: Usd.Stage, tie: Tie) -> None:
    """Defines the attachment of a tie."""
    prim = stage.DefinePrim(tie.path, names.ATTACHMENT)
    prim.CreateRelationship(names.SRC0, False).SetTargets([Sdf.Path(tie.body)])
    prim.CreateRelationship(names.SRC1, False).SetTargets([Sdf.Path(tie.other)])
    for field, value in (("enabled", True), ("type0", "point"), ("type1", "point")):
        author(prim, "Pin", field, value)
    author(prim, "Tie", "points", tie.points)
    author(prim, "Tie", "others", tie.others)
