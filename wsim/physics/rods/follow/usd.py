"""BasisCurves with WsimRodsAPI and wsim:guides <-> `Followers`. Curves of any type; their points are carried."""

from pxr import Sdf, Usd, UsdGeom

from wsim.physics.rods.follow.objects import Followers
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write
from wsim.usd.attributes import read_attribute
from wsim.usd.prims.cloth import load_points
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement


def load(reading: StageReading, prim: Usd.Prim) -> Followers | None:
    """The strands of a prim that names guides; None of rods, and of what cannot be read (which is reported)."""
    path, simulated = prim.GetPath(), names.CURVES_SIM in applied_schemas(prim)
    relationship = prim.GetRelationship(names.GUIDES)
    targets = [str(target) for target in relationship.GetForwardedTargets()] if relationship else []
    if simulated or not targets:
        if targets:
            reading.fail(path, f"is simulated ({names.CURVES_SIM}) and follows {', '.join(targets)} ({names.GUIDES}); allowed "
                         "is one of the two: remove the API, or the relationship")
        elif not simulated:
            reading.warn(path, f"has {names.WSIM_RODS}, neither {names.CURVES_SIM} nor {names.GUIDES}, and does nothing")
        return None
    if len(targets) > 1:
        reading.fail(path, f"{names.GUIDES} names {', '.join(targets)}; allowed is one prim: give each its own followers")
        return None
    curves = UsdGeom.BasisCurves(prim)
    if not curves:
        reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {names.GUIDES}; allowed is BasisCurves")
        return None
    points, _ = load_points(reading, prim, "Followers")
    counts = read_attribute(prim, "Followers", "counts", reading.units, reading.start)
    if points is None or counts is None:
        reading.fail(path, "has no points or no curveVertexCounts; author both")
        return None
    cubic = curves.GetTypeAttr().Get() == UsdGeom.Tokens.cubic
    return Followers(str(path), points, counts, targets[0], str(curves.GetBasisAttr().Get()) if cubic else "linear",
                     read_placement(reading, prim).motion)


def author(stage: Usd.Stage, followers: Followers, units: StageUnits) -> None:
    """Defines the BasisCurves of followers."""
    curves = UsdGeom.BasisCurves.Define(stage, followers.path)
    prim = curves.GetPrim()
    linear = followers.kind == "linear"
    curves.CreateTypeAttr(UsdGeom.Tokens.linear if linear else UsdGeom.Tokens.cubic)
    if not linear:
        curves.CreateBasisAttr(followers.kind)
    prim.AddAppliedSchema(names.WSIM_RODS)
    prim.CreateRelationship(names.GUIDES, False).SetTargets([Sdf.Path(followers.guides)])
    for field in ("points", "counts"):
        write(prim, "Followers", field, getattr(followers, field), units)
    curves.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(curves.GetPointsAttr().Get()))
    author_motion(prim, followers.motion, units, 0)
