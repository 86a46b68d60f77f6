"""Which colliders do not touch each other, by groups, by pairs and by joints. NumPy only.

    groups    two groups do not touch where one of them filters the other; an inverted one filters all but those it names.
              Groups of one `merge` are one group. What is in no group touches all.
    pairs     what a prim names, and all that is below it, does not touch what is at or below that prim; groups count as their
              members, and bodies as themselves, without the bodies within them
    joints    the bodies of a joint do not touch each other, unless it says so (`Joint.collides`). If a joint connects a body to
              a prim that is no body, the body does not touch colliders at or below that prim. If that prim is an ancestor of
              the body, it stands for the world, and the body touches all colliders
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from wsim.scene import Problem, Scene
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.check.objects import object_warning


@dataclass(eq=False)
class Group(ArrayDataclass):
    """A collision group.

    path       prim path
    members    prim paths of colliders, or of prims above them
    filtered   prim paths of groups that it does not touch
    merge      name that makes several groups one; "": none
    inverted   True: `filtered` are those that alone it does touch
    """

    path: str
    members: list[str] = field(default_factory=list)
    filtered: list[str] = field(default_factory=list)
    merge: str = ""
    inverted: bool = False


@dataclass(eq=False)
class FilteredPairs(ArrayDataclass):
    """A body, collider or group that does not touch others (USD: PhysicsFilteredPairsAPI).

    path       its prim path
    others     prim paths of bodies, colliders or groups
    """

    shares_path: ClassVar = True            # it is said on the prim of another object

    path: str
    others: list[str] = field(default_factory=list)


def check_collision_filters(thing: Group | FilteredPairs, scene: Scene) -> Iterator[Problem]:
    if isinstance(thing, FilteredPairs):
        known = {*_colliding_prim_paths(scene), *(group.path for group in scene.things("Group"))}
        lost = [p for p in thing.others if not any(k == p or k.startswith(p + "/") for k in known)]
        if lost:
            yield object_warning(thing.path, f"is filtered from {', '.join(lost)}, where nothing collides",
                                 "bodies, colliders or groups", "name others, or take it out")
        return
    groups = {group.path for group in scene.things("Group")} if thing.filtered else set()
    lost = [p for p in thing.filtered if p not in groups]
    if lost:
        yield object_warning(thing.path, f"filters {', '.join(lost)}, which is no collision group", "groups of the scene",
                             "name others, or take it out")


def _colliding_prim_paths(scene: Scene) -> list[str]:
    return [c.path for c in scene.colliders] + [c.path for body in scene.things("Body") for c in body.colliders]


def at_or_below(path: str, above: str) -> bool:
    return path == above or path.startswith(above + "/")


def _path_and_ancestors(path: str) -> list[str]:
    steps = path.split("/")
    return ["/".join(steps[:n]) for n in range(2, len(steps) + 1)]


def filtered_group_table(scene: Scene) -> np.ndarray:
    """Symmetric table (groups, groups): those that do not touch each other; merged ones are alike."""
    groups: list[Group] = scene.things("Group")
    name = {g.path: g.merge or g.path for g in groups}
    merged = sorted(set(name.values()))
    place = {m: k for k, m in enumerate(merged)}
    found = np.zeros((len(merged), len(merged)), bool)
    inverted = np.zeros(len(merged), bool)
    for g in groups:
        k = place[name[g.path]]
        found[k, [place[name[p]] for p in g.filtered if p in name]] = True
        inverted[k] |= g.inverted
    found ^= inverted[:, None]
    found |= found.T
    rows = [place[name[g.path]] for g in groups]
    return found[np.ix_(rows, rows)]


@dataclass
class CollisionFilters:
    """kind: of each shape, (shapes,); table: kinds that do not touch, (kinds, kinds); first, parted: shapes that a shape does
    not touch besides, as lists behind each other."""

    kind: np.ndarray
    table: np.ndarray
    first: np.ndarray
    parted: np.ndarray

    def parts_pairs(self, rows: np.ndarray) -> np.ndarray:
        """Symmetric table of those shapes: True where two of them do not touch."""
        found = self.table[np.ix_(self.kind[rows], self.kind[rows])].copy()
        for k, row in enumerate(rows.tolist()):
            found[k] |= np.isin(rows, self.parted[self.first[row]:self.first[row + 1]])
        return found

    @property
    def tables(self) -> dict[str, np.ndarray]:
        """Tables as kernels/rigid/lists/pairs.py has them."""
        found = {"group": self.kind, "apart": self.table, "first": self.first, "parted": self.parted}
        return {name: value.astype(np.int32) for name, value in found.items()}


def contact_filters(scene: Scene, owned: list[tuple[str, int, str]]) -> CollisionFilters | None:
    """Filters of shapes of bodies (path of the body, world, path of the collider), then of the colliders that stand."""
    from wsim.physics.rigid.solids import scene_contact_colliders
    still = [(c.path, -1) for c in scene_contact_colliders(scene.colliders)]
    return collision_filters(scene, [(path, world) for _, world, path in owned] + still,
                             [body for body, *_ in owned] + [""] * len(still))


def collision_filters(scene: Scene, shapes: list[tuple[str, int]], frames: list[str]) -> CollisionFilters | None:
    """Filters of shapes (path of the collider, world or -1) and the path of the body of each, "" for none. None where all
    touch."""
    kind, table = _filter_kinds(scene, [path for path, _ in shapes])
    pairs = {(i, j) for i, j in _filtered_shape_pairs(scene, shapes, frames) if i != j}
    pairs |= {(j, i) for i, j in pairs}
    if not table.any() and not pairs:
        return None
    listed = np.array(sorted(pairs), int).reshape(-1, 2)
    first = np.searchsorted(listed[:, 0], np.arange(len(shapes) + 1))
    return CollisionFilters(kind, table, first, listed[:, 1])


def _filter_kinds(scene: Scene, paths: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Shapes that are in the same groups are of a kind."""
    groups: list[Group] = scene.things("Group")
    between = filtered_group_table(scene)
    holding: dict[str, set[int]] = {}
    for k, group in enumerate(groups):
        for member in group.members:
            holding.setdefault(member, set()).add(k)
    of = {p: frozenset().union(*(holding.get(each, ()) for each in _path_and_ancestors(p))) for p in set(paths)}
    kinds = sorted(set(of.values()), key=sorted)
    place = {kind: k for k, kind in enumerate(kinds)}
    within = np.zeros((len(kinds), len(groups)), np.float32)
    for kind, k in place.items():
        within[k, list(kind)] = 1.0
    table = within @ between.astype(np.float32) @ within.T > 0.0
    return np.array([place[of[p]] for p in paths], int), table


def _filtered_shape_pairs(scene: Scene, shapes: list[tuple[str, int]], frames: list[str]) -> Iterator[tuple[int, int]]:
    members = {g.path: g.members for g in scene.things("Group")}
    at: dict[str, list[int]] = {}
    for k, (path, _) in enumerate(shapes):
        for each in _path_and_ancestors(path):
            at.setdefault(each, []).append(k)
    body: dict[str, list[int]] = {}
    for k, frame in enumerate(frames):
        body.setdefault(frame, []).append(k)

    def shapes_below(path: str) -> list[int]:
        return [k for each in members.get(path, [path]) for k in body.get(each, at.get(each, []))]
    wanted = [(shapes_below(p.path), shapes_below(other)) for p in scene.things("FilteredPairs") for other in p.others]
    for joint in scene.things("Joint"):
        if joint.enabled and not joint.collides:
            fixed = [] if at_or_below(joint.body0 or joint.body1, joint.still) else \
                [k for k in shapes_below(joint.still) if not frames[k]]
            sides = [body.get(b, []) if b else fixed for b in (joint.body0, joint.body1)]
            wanted.append((sides[0], sides[1]))
    for one, other in wanted:
        of: dict[int, list[int]] = {}
        for j in other:
            of.setdefault(shapes[j][1], []).append(j)
        for i in one:
            world = shapes[i][1]
            yield from ((i, j) for j in (other if world < 0 else of.get(world, []) + of.get(-1, [])))
