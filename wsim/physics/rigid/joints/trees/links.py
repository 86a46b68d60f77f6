"""Which joints of a scene form trees, and the order of links, joints and degrees of freedom in reduced coordinates. NumPy only.

See kernels/rigid/joint/tree/tables.py for the meaning of what `TreeLinks` holds.
"""

from dataclasses import dataclass, field
from math import inf

import numpy as np

from wsim.physics.rigid.joints.joint import AXES, DISTANCE, SHIFTS, Joint
from wsim.physics.rigid.joints.trees.bases import unsupported_base
from wsim.physics.rigid.joints.trees.loops import LoopRows, closing_joint, mimic_rows, spanning_joints
from wsim.physics.rigid.joints.trees.strings import StringRows, is_distance

ORDER = ("rotY", "rotZ", "rotX")                    # turns, outermost first: swing, then twist
STACK = ("rotZ", "rotY", "rotX")                    # of joints whose turns are hinges behind each other
FITS = (1e-4, 1e-3)                                 # [m], [rad] by which bodies may stand off from what their joints allow


def joint_freedom(joint: Joint) -> tuple[list[str], list[str], bool]:
    """(slides, hinges, ball) of a joint whose twist is about its only axis that turns."""
    slides = [name for name in SHIFTS if not joint.locked(name)]
    turns = [name for name in (STACK if joint.hinges else ORDER) if not joint.locked(name)]
    ball = len(turns) == 3 and not joint.hinges
    return slides, [] if ball else turns, ball


def unsupported_joint(joint: Joint) -> str:
    """Reason why a joint has no reduced coordinates, "" if it has."""
    _, hinges, ball = joint_freedom(joint)
    if DISTANCE in joint.drives:
        return "it has a drive along a distance"
    if joint.hinges and may_break(joint):
        return "it may break, and its turns are hinges behind each other"
    if hinges == ["rotY", "rotZ"]:
        return "two swings without a twist"
    if joint.cone is not None and not ball:
        return "a cone beside a locked axis"
    if any(joint.locked(name) and joint.limits[name][0] != 0.0 for name in AXES):
        return "an axis is locked away from 0"
    return ""


def may_break(joint: Joint | None) -> bool:
    """Whether a joint has a force or torque over which it breaks; None: of a free body."""
    return joint is not None and bool(min(joint.force, joint.torque) < inf)


def reversible_joint(joint: Joint) -> bool:
    """True if the link on side 0 may be the child."""
    slides, hinges, ball = joint_freedom(joint)
    if slides and may_break(joint):                     # its torque counts about the origin on side 1
        return False
    plain = not joint.drives and joint.cone is None and not any(name in joint.limits for name in AXES[3:])
    return len(slides) + len(hinges) + 3 * ball <= 1 or (ball and not slides and plain)


@dataclass
class TreeLinks:
    """Trees of one world: links behind each other. joint: -1 for a root that is free; swapped: the child is on side 0; breaks:
    1 of links whose joint may break, with six dofs, of which those it locks have held 1 and no axis."""

    first_link: list[int] = field(default_factory=lambda: [0])
    body: list[int] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)
    joint: list[int] = field(default_factory=list)
    swapped: list[bool] = field(default_factory=list)
    slides: list[int] = field(default_factory=list)
    ball: list[int] = field(default_factory=list)
    first_dof: list[int] = field(default_factory=lambda: [0])
    first_coordinate: list[int] = field(default_factory=lambda: [0])
    breaks: list[int] = field(default_factory=list)
    axis: list[np.ndarray] = field(default_factory=list)
    point: list[np.ndarray] = field(default_factory=list)
    held: list[int] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    dof_parent: list[int] = field(default_factory=list)
    first_entry: list[int] = field(default_factory=lambda: [0])
    first_column: list[int] = field(default_factory=list)
    columns: int = 0
    first_level: list[int] = field(default_factory=lambda: [0])
    level_start: list[int] = field(default_factory=lambda: [0])
    by_level: list[int] = field(default_factory=list)
    first_child: list[int] = field(default_factory=lambda: [0])
    child: list[int] = field(default_factory=list)
    last_dof: list[int] = field(default_factory=list)
    dof_link: list[int] = field(default_factory=list)
    dof_end: list[int] = field(default_factory=list)
    entry_dof: list[int] = field(default_factory=list)
    entry_row: list[int] = field(default_factory=list)
    first_step: list[int] = field(default_factory=lambda: [0])
    step_start: list[int] = field(default_factory=lambda: [0])
    step_entry: list[int] = field(default_factory=list)
    loops: LoopRows = field(default_factory=LoopRows)
    strings: StringRows = field(default_factory=StringRows)

    def add_link(self, body: int, parent: int, joint: int, given: Joint | None, swapped: bool) -> None:
        """One more link, whose joint is `given`; None: it is free."""
        slides, hinges, ball = joint_freedom(given) if given else (list(SHIFTS), [], True)
        names = [*slides, *hinges, *(AXES[3:] if ball else ())]
        free, breaks = set(names), may_break(given)
        if breaks:
            slides, names = list(SHIFTS), [*SHIFTS, *(AXES[3:] if ball else ORDER)]
        last = self.last_dof[parent] if parent >= 0 else -1
        depth = 0 if last < 0 else self.first_entry[last + 1] - self.first_entry[last]
        for k, name in enumerate(names):
            axis = float(name in free) * np.eye(3)[AXES.index(name) % 3]
            self.held.append(int(name not in free))
            self.axis.append(-axis if swapped and not ball else axis)
            self.point.append(np.array(given.hinges.get(name, (0.0, 0.0, 0.0)) if given else (0.0, 0.0, 0.0)))
            self.row.append(AXES.index(name))
            before = last if k == 0 else len(self.dof_parent) - 1
            self.dof_parent.append(before)
            row = self.entry_dof[self.first_entry[before]:self.first_entry[before + 1]] if before >= 0 else []
            self.entry_dof += [len(self.dof_link), *row]
            self.entry_row += [len(self.dof_link)] * (1 + len(row))
            self.first_entry.append(len(self.entry_dof))
            self.dof_link.append(len(self.body))
            self.first_column.append(self.columns)
            self.columns += depth + len(names)
        self.last_dof.append(len(self.dof_link) - 1 if names else last)
        for column, value in (("body", body), ("parent", parent), ("joint", joint), ("swapped", swapped),
                              ("slides", len(slides)), ("ball", int(ball)), ("breaks", int(breaks))):
            getattr(self, column).append(value)
        self.first_dof.append(len(self.axis))
        self.first_coordinate.append(self.first_coordinate[-1] + len(names) + (ball or breaks))

    def end_tree(self) -> None:
        """All links of a tree are there: their levels, children, dofs behind each, entries of H by distance from the root."""
        first, n = self.first_link[-1], len(self.body)
        self.first_link.append(n)
        depth: dict[int, int] = {}
        children: dict[int, list[int]] = {}
        for link in range(first, n):
            depth[link] = depth.get(self.parent[link], -1) + 1
            children.setdefault(self.parent[link], []).append(link)
        for link in range(first, n):
            self.child += children.get(link, [])[::-1]
            self.first_child.append(len(self.child))
        for level in range(max(depth.values(), default=-1) + 1):
            self.by_level += [link for link in range(first, n) if depth[link] == level]
            self.level_start.append(len(self.by_level))
        self.first_level.append(len(self.level_start) - 1)
        own = range(len(self.dof_end), len(self.dof_link))
        ends = {d: d + 1 for d in own}
        for d in own[::-1]:
            if self.dof_parent[d] >= 0:
                ends[self.dof_parent[d]] = max(ends[self.dof_parent[d]], ends[d])
        self.dof_end += [ends[d] for d in own]
        rows: dict[int, list[int]] = {}
        for d in own:
            entries = range(self.first_entry[d], self.first_entry[d + 1])
            rows.setdefault(len(entries), []).extend(entries)
        for far in sorted(rows, reverse=True):
            self.step_entry += rows[far]
            self.step_start.append(len(self.step_entry))
        self.first_step.append(len(self.step_start) - 1)
        self.loops.end_tree(len(own))
        self.strings.end_tree(len(own))


def tree_links(joints: list[Joint], pairs: np.ndarray, first_joint: np.ndarray, first_body: np.ndarray,
               body: np.ndarray, lone: bool, acted: frozenset[str] = frozenset()) -> tuple[TreeLinks | None, str]:
    """(links of the islands, "") or (None, why an island has no reduced coordinates). lone: bodies without joints are links
    too. acted: paths of joints that actuators act on.
    Other arguments are those of `wsim.physics.rigid.joints.islands.EliminationOrder` for one world."""
    found = TreeLinks()
    for g in range(len(first_joint) - 1):
        own = range(first_joint[g], first_joint[g + 1])
        bodies = body[first_body[g]:first_body[g + 1]].tolist()
        for j in own:
            if why := unsupported_joint(joints[j]):
                return None, f"{joints[j].path}: {why}"
        if len(own):
            why = _add_tree(found, joints, pairs, list(own), bodies, acted)
            if why:
                return None, why
        elif lone:
            found.add_link(bodies[0], -1, -1, None, False)
        found.end_tree()
    return found, ""


def _add_tree(found: TreeLinks, joints: list[Joint], pairs: np.ndarray, own: list[int], bodies: list[int],
              acted: frozenset[str]) -> str:
    """Adds the links and loops of an island; returns why it has no reduced coordinates."""
    far = [j for j in own if is_distance(joints[j])]
    kept, cut = spanning_joints(joints, pairs, [j for j in own if j not in far], acted)
    cut += [j for j in far if joints[j].locked(DISTANCE)]
    if why := unsupported_base(joints, pairs, own, cut):
        return why
    for j in set(cut) - set(far):
        if why := closing_joint(joints[j], acted):
            return f"{joints[j].path}: it closes a loop, and all joints of that have {why} or the like"
    path = _link_order(joints, pairs, kept, bodies)
    if path is None:
        return f"{joints[own[0]].path}: its bodies would need a joint turned round"
    numbers, link_of = {-1: -1}, dict[int, int]()
    for row, parent, j, swapped in path:
        numbers[row] = link_of[j] = len(found.body)
        found.add_link(row, numbers.get(parent, -1), j, joints[j] if j >= 0 else None, swapped)
    for j in cut:
        found.loops.add_joint(j, joints[j], (numbers[int(pairs[j][0])], numbers[int(pairs[j][1])]))
    for j in set(far) - set(cut):
        found.strings.add_string(j, joints[j], (numbers[int(pairs[j][0])], numbers[int(pairs[j][1])]))
    why = mimic_rows(found.loops, joints, own, link_of, found)
    weak = [joints[j].path for j in own if may_break(joints[j])]
    if weak and len(found.loops.kind) > found.loops.first_row[-1]:
        why = why or f"{weak[0]}: it may break, in a tree of which joints close a loop or mimic others"
    return why


def _link_order(joints, pairs, own, bodies) -> list[tuple[int, int, int, bool]] | None:
    """(body, its parent, joint, whether that is turned round) from roots on, depth first: the world, and a body of each part
    that nothing joins to others; None: no root will do."""
    near: dict[int, list[int]] = {}
    for j in own:
        for row in pairs[j].tolist():
            near.setdefault(row, []).append(j)
    children = {int(pairs[j][1]) for j in own}
    found: list[tuple[int, int, int, bool]] = []
    for first in [-1] * (-1 in near) + bodies:
        done = {row for row, *_ in found}
        if first in done:
            continue
        part = {row for row, *_ in _walk_joints(joints, pairs, near, first)[0]}
        roots = [-1] if first < 0 else sorted((row for row in bodies if row in part), key=lambda row: row in children)
        for root in roots:
            order, fits = _walk_joints(joints, pairs, near, root)
            if fits:
                break
        else:
            return None
        found += order
    return found


def _walk_joints(joints, pairs, near: dict[int, list[int]], root: int) -> tuple[list[tuple[int, int, int, bool]], bool]:
    """(bodies from a root on, as `_link_order`; whether each joint may be taken that way round)."""
    order: list[tuple[int, int, int, bool]] = []
    stack, seen, fits = [(root, -1, -1, False)], set[int](), True
    while stack:
        at, parent, by, turned = stack.pop()
        if at >= 0:
            order.append((at, parent, by, turned))
        own_joints = [j for j in near.get(at, []) if j not in seen]
        seen.update(own_joints)
        for j in own_joints[::-1]:
            swapped = int(pairs[j][0]) != at
            fits = fits and (not swapped or reversible_joint(joints[j]))
            stack.append((int(pairs[j][0] if swapped else pairs[j][1]), at, j, swapped))
    return order, fits
