"""Prims of type PhysicsCollisionGroup <-> `Group`, and PhysicsFilteredPairsAPI of any prim <-> `FilteredPairs`."""

from bisect import bisect_left

from pxr import Sdf, Usd, UsdPhysics

from wsim.physics.rigid.joints.filters.groups import FilteredPairs, Group
from wsim.physics.rigid.joints.moving import moves_by_forces
from wsim.usd import names
from wsim.usd.stage import StageReading, StageUnits, applied_schemas

COLLIDERS = "colliders"


def filters_matter(reading: StageReading) -> bool:
    """True if there are bodies that filters are for."""
    if reading.filterable is None:
        prims = Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        reading.filterable = any(names.RIGID_BODY in applied_schemas(p) and moves_by_forces(reading, p) for p in prims)
    return reading.filterable


def collection_members(reading: StageReading, query) -> list[str]:
    """Prim paths of colliders in a collection. Without an expression, only those at or below what it names are tried."""
    if reading.colliding is None:
        prims = Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        found = [str(p.GetPath()) for p in prims if names.COLLISION in applied_schemas(p)]
        reading.colliding = {path: k for k, path in enumerate(found)}, sorted(found)
    place, ordered = reading.colliding
    asked = set(ordered)
    if query.UsesPathExpansionRuleMap():
        asked = set()
        for named in map(str, query.GetAsPathExpansionRuleMap()):
            under = named.rstrip("/") + "/"
            asked |= {named} & place.keys()
            asked |= set(ordered[bisect_left(ordered, under):bisect_left(ordered, under[:-1] + "0")])       # "0" follows "/"
    return [p for p in sorted(asked, key=place.__getitem__) if query.IsPathIncluded(Sdf.Path(p))]


def load_group(reading: StageReading, prim: Usd.Prim) -> Group | None:
    path, group = str(prim.GetPath()), UsdPhysics.CollisionGroup(prim)
    if not filters_matter(reading):
        reading.warn(path, f"{names.COLLISION_GROUP} is not used yet: every collider acts on every body")
        return None
    query = Usd.CollectionAPI(prim, COLLIDERS).ComputeMembershipQuery()
    return Group(path, collection_members(reading, query), [str(p) for p in group.GetFilteredGroupsRel().GetTargets()],
                 str(group.GetMergeGroupNameAttr().Get(reading.start) or ""),
                 bool(group.GetInvertFilteredGroupsAttr().Get(reading.start)))


def load_pairs(reading: StageReading, prim: Usd.Prim) -> FilteredPairs | None:
    targets = prim.GetRelationship(names.FILTERED).GetTargets()
    if not targets:
        return None
    if not filters_matter(reading):
        reading.warn(prim.GetPath(), f"{names.FILTERED} is not used yet: every collider acts on every body")
        return None
    return FilteredPairs(str(prim.GetPath()), [str(p) for p in targets])


def author(stage: Usd.Stage, thing: Group | FilteredPairs, units: StageUnits) -> None:
    if isinstance(thing, FilteredPairs):
        prim = stage.GetPrimAtPath(thing.path) or stage.DefinePrim(thing.path, "Scope")
        api = UsdPhysics.FilteredPairsAPI.Apply(prim)
        api.CreateFilteredPairsRel().SetTargets([Sdf.Path(p) for p in thing.others])
        return
    group = UsdPhysics.CollisionGroup.Define(stage, thing.path)
    Usd.CollectionAPI.Apply(group.GetPrim(), COLLIDERS).CreateIncludesRel().SetTargets([Sdf.Path(p) for p in thing.members])
    group.CreateFilteredGroupsRel().SetTargets([Sdf.Path(p) for p in thing.filtered])
    if thing.merge:
        group.CreateMergeGroupNameAttr(thing.merge)
    if thing.inverted:
        group.CreateInvertFilteredGroupsAttr(True)
