"""Rows of the joints that close loops and of mimics, for kernels/rigid/joint/tree/loops. NumPy only."""

from dataclasses import dataclass, field
from math import asin

import numpy as np

from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import AXES, DISTANCE, SHIFTS, TURNS, Joint

SHIFT, TURN, MIMIC, SPAN = 0, 1, 2, 3
X, Y, Z = np.eye(3)
PAIRS = {("rotY",): ((Z, X),), ("rotZ",): ((Y, X),), ("rotY", "rotZ"): ((Y, X), (Z, X)),             # u on a, s on b
         TURNS: ((Y, X), (Z, X), (Z, Y)), (): ()}


@dataclass
class LoopRows:
    """Rows of the trees of one world. joint: that closes the loop, -1 of mimics; a, b: links, -1 the world, of mimics dofs."""

    first_row: list[int] = field(default_factory=lambda: [0])
    kind: list[int] = field(default_factory=list)
    joint: list[int] = field(default_factory=list)
    a: list[int] = field(default_factory=list)
    b: list[int] = field(default_factory=list)
    c_a: list[int] = field(default_factory=list)
    c_b: list[int] = field(default_factory=list)
    u: list[np.ndarray] = field(default_factory=list)               # in the joint's frames
    s: list[np.ndarray] = field(default_factory=list)
    coefficients: list[tuple[float, ...]] = field(default_factory=list)
    first_value: list[int] = field(default_factory=list)
    first_square: list[int] = field(default_factory=list)
    values: int = 0
    squares: int = 0

    def add_row(self, kind: int, joint: int, ends: tuple[int, int], axes=(X, X), coordinates=(-1, -1), coefficients=()) -> None:
        for column, value in (("kind", kind), ("joint", joint), ("a", ends[0]), ("b", ends[1]), ("c_a", coordinates[0]),
                              ("c_b", coordinates[1]), ("u", axes[0]), ("s", axes[1]),
                              ("coefficients", (*coefficients, *[0.0] * 5)[:5])):
            getattr(self, column).append(value)

    def add_joint(self, j: int, joint: Joint, ends: tuple[int, int]) -> None:
        if DISTANCE in joint.limits:                                # it is locked at a length, of 0 as a ball is
            length = joint.limits[DISTANCE][0]
            axes = [X] if length > 0.0 else [X, Y, Z]
            for axis in axes:
                self.add_row(SPAN if length > 0.0 else SHIFT, j, ends, (axis, X), coefficients=(length,))
            return
        for name in SHIFTS:
            if joint.locked(name):
                self.add_row(SHIFT, j, ends, (np.eye(3)[SHIFTS.index(name)], X))
        for pair in PAIRS[tuple(name for name in TURNS if joint.locked(name))]:
            self.add_row(TURN, j, ends, pair)

    def end_tree(self, dofs: int) -> None:
        """Ends a tree with so many dofs."""
        rows = len(self.kind) - self.first_row[-1]
        self.first_value += [self.values + dofs * k for k in range(rows)]
        self.values += rows * dofs
        self.first_square.append(self.squares)
        self.squares += rows * rows
        self.first_row.append(len(self.kind))


def spanning_joints(joints: list[Joint], pairs: np.ndarray, own: list[int],
                    acted: frozenset[str]) -> tuple[list[int], list[int]]:
    """(joints of a tree of the island, those that close loops): least freedom first (Kruskal 1956), with drives, limits,
    friction, mimics and actuators before all."""
    root: dict[int, int] = {}

    def end_of(k: int) -> int:
        while root.setdefault(k, k) != k:
            k = root[k]
        return k
    kept, cut = [], []
    for j in sorted(own, key=lambda j: (closing_joint(joints[j], acted) == "", len(joints[j].free()), j)):
        a, b = (end_of(int(k)) for k in pairs[j])
        (kept if a != b else cut).append(j)
        root[max(a, b)] = min(a, b)
    return sorted(kept), sorted(cut)


def closing_joint(joint: Joint, acted: frozenset[str]) -> str:
    """Reason why a joint cannot close a loop, "" if it can. acted: paths of joints that actuators act on."""
    if joint.path in acted:
        return "an actuator"
    for name, what in (("drives", "a drive"), ("mimics", "a mimic"), ("armature", "armature"), ("friction", "dry friction")):
        if getattr(joint, name):
            return what
    if joint.cone is not None or any(not joint.locked(name) for name in joint.limits):
        return "limits"
    return ""


def loop_frames(rows: LoopRows, sides: list, world_side) -> dict[str, np.ndarray]:
    """Arrays at_a, at_b, e_a, e_b, (rows, 3). sides: frames (place, quaternion) of joints in principal axes of bodies, a, b;
    world_side: (row) -> that frame of a side that is the world."""
    found: dict[str, list] = {"at_a": [], "at_b": [], "e_a": [], "e_b": []}
    for r, j in enumerate(rows.joint):
        for k, (side, axis) in enumerate((("a", rows.u[r]), ("b", rows.s[r]))):
            at, turn = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
            if j >= 0:
                at, turn = sides[2 * j + k] if (rows.a, rows.b)[k][r] >= 0 else world_side(r)
            found[f"at_{side}"].append(at)
            found[f"e_{side}"].append(rotation.quat_rotate(rotation.unit_quat(turn), axis))
    return {name: np.array(values).reshape(-1, 3) for name, values in found.items()}


def start_violations(rows: LoopRows, frames: dict[str, np.ndarray], q: np.ndarray, places: np.ndarray,
                     turns: np.ndarray) -> np.ndarray:
    """C of all rows (rows,), see kernels/rigid/joint/tree/loops/equations.py. frames: of `loop_frames`; q: coordinates; places,
    turns: centres of mass [m] and principal axes of links, (links, 3) and (links, 4)."""
    found = []
    for r, kind in enumerate(rows.kind):
        if kind == MIMIC:
            leader = q[rows.c_b[r]] if rows.c_b[r] >= 0 else 0.0
            found.append(q[rows.c_a[r]] - sum(c * leader**k for k, c in enumerate(rows.coefficients[r])))
            continue
        ends = []
        for side, link in (("a", rows.a[r]), ("b", rows.b[r])):
            at, e = frames[f"at_{side}"][r], frames[f"e_{side}"][r]
            ends.append((at, e) if link < 0 else (places[link] + rotation.quat_rotate(turns[link], at),
                                                  rotation.quat_rotate(turns[link], e)))
        (p_a, u), (p_b, s) = ends
        if kind == SPAN:
            found.append(float(np.linalg.norm(p_b - p_a)) - rows.coefficients[r][0])
        else:
            found.append(u @ (p_b - p_a) if kind == SHIFT else u @ s)
    return np.array(found)


def loop_gaps(rows: LoopRows, C: np.ndarray) -> tuple[float, float]:
    """Largest gap of joints that close loops, [m] and [rad], of what their equations leave, (rows,)."""
    of = np.tile(np.array(rows.kind, int), len(C) // max(1, len(rows.kind)))
    turned = float(np.abs(C[of == TURN]).max(initial=0.0))
    return float(np.abs(C[(of == SHIFT) | (of == SPAN)]).max(initial=0.0)), asin(min(1.0, turned))


def mimic_rows(rows: LoopRows, joints: list[Joint], own: list[int], link_of: dict[int, int], links) -> str:
    """Adds the mimics of an island. Returns a reason why one cannot be."""
    by_path = {joints[j].path: j for j in own if j in link_of}
    for j in own:
        for name, mimic in joints[j].mimics.items():
            leader = by_path.get(mimic.leader, -1)
            if mimic.leader and leader < 0:
                return f"{joints[j].path}: it mimics {mimic.leader}, which is not in its tree of joints"
            link = link_of[j]
            if links.ball[link] and AXES.index(name) > 2:
                return f"{joints[j].path}: a turn of a ball mimics another joint"
            k = links.row[links.first_dof[link]:links.first_dof[link + 1]].index(AXES.index(name))
            other = link_of[leader] if leader >= 0 else -1
            if other >= 0 and links.first_dof[other + 1] - links.first_dof[other] != 1:
                return f"{joints[j].path}: it mimics {mimic.leader}, which has several coordinates"
            coordinates = links.first_coordinate[link] + k, links.first_coordinate[other] if other >= 0 else -1
            rows.add_row(MIMIC, -1, (links.first_dof[link] + k, links.first_dof[other] if other >= 0 else -1),
                         coordinates=coordinates, coefficients=mimic.coefficients)
    return ""
