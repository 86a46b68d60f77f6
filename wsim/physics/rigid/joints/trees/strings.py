"""Distances of joints that stay within a range, in trees (kernels/rigid/joint/tree/loops/strings.py): rows, tables."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.joint.tree.tables import string_struct
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.joint import DISTANCE, Joint

ROWS = {"drawn": wp.vec3d, "n": wp.vec3d, **dict.fromkeys(("response", "length", "base", "bend", "push", "sum"), wp.float64),
        "taut": int}


@dataclass
class StringRows:
    """Rows of the trees of one world. joint: whose distance it is; a, b: links, -1 the world."""

    first_row: list[int] = field(default_factory=lambda: [0])
    joint: list[int] = field(default_factory=list)
    a: list[int] = field(default_factory=list)
    b: list[int] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    first_value: list[int] = field(default_factory=list)
    values: int = 0

    def add_string(self, j: int, joint: Joint, ends: tuple[int, int]) -> None:
        low, high = joint.limits[DISTANCE]
        for column, value in (("joint", j), ("a", ends[0]), ("b", ends[1]), ("low", low), ("high", high)):
            getattr(self, column).append(value)

    def end_tree(self, dofs: int) -> None:
        """Ends a tree with so many dofs."""
        rows = len(self.joint) - self.first_row[-1]
        self.first_value += [self.values + dofs * k for k in range(rows)]
        self.values += rows * dofs
        self.first_row.append(len(self.joint))


def is_distance(joint: Joint) -> bool:
    """Whether a joint of the device keeps a distance, and nothing else."""
    return DISTANCE in joint.limits or DISTANCE in joint.drives


def some_distance_ranges(trees) -> bool:
    """Whether trees keep a distance within a range. trees: `DeviceTrees`, with links."""
    return bool(trees.links.strings.joint)


def string_frames(trees) -> dict[str, np.ndarray]:
    """at_a, at_b of a world, (strings, 3): ends in principal axes of a link, or from where its tree began."""
    rows, roots, sides = trees.links.strings, trees.links.first_link, trees.side_frames(trees.method.masses)
    found: dict[str, list] = {"at_a": [], "at_b": []}
    for s, j in enumerate(rows.joint):
        tree = int(np.searchsorted(rows.first_row, s, side="right")) - 1
        for k, (name, link) in enumerate((("at_a", rows.a[s]), ("at_b", rows.b[s]))):
            found[name].append(sides[2 * j + k][0] if link >= 0 else trees.world_frame(j, k == 1, roots[tree])[0])
    return {name: np.array(values).reshape(-1, 3) for name, values in found.items()}


def string_tables(trees, sizes: dict[str, int]) -> Any:
    """The struct of all worlds. trees: `DeviceTrees`; sizes: numbers of links and joints of a world."""
    rows, worlds, device = trees.links.strings, trees.model.worlds, trees.device
    n, each = len(rows.joint), range(worlds)

    def upload(values, dtype):
        values = np.ascontiguousarray(values, np.int32 if dtype is int else np.float64)
        return trees.model.upload(values, dtype) if values.size else wp.zeros(1, dtype=dtype, device=device)

    def numbers(name: str, size: int):
        own = np.array(getattr(rows, name), np.int64)
        return np.concatenate([np.where(own < 0, -1, own + size * w) for w in each])
    first = np.array(rows.first_row, np.int64)
    table = {"first_row": upload(np.concatenate([first[:-1] + n * w for w in each] + [[n * worlds]]), int)}
    table |= {name: upload(numbers(name, size), int) for name, size in (
        ("joint", sizes["joints"]), ("a", sizes["links"]), ("b", sizes["links"]), ("first_value", rows.values))}
    table |= {name: upload(np.tile(getattr(rows, name), worlds), wp.float64) for name in ("low", "high")}
    table |= {name: upload(np.tile(values, (worlds, 1)), wp.vec3d) for name, values in string_frames(trees).items()}
    roots = trees.root_of()[[max(a, b) for a, b in zip(rows.a, rows.b, strict=True)]] if n else []
    hang = [trees.anchor[j] - trees.method.origin[trees.links.body[r]] for j, r in zip(rows.joint, roots, strict=True)]
    table["hang"] = upload(np.tile(np.reshape(hang, (-1, 3)), (worlds, 1)), wp.vec3d)
    work = {name: wp.zeros(max(1, n * worlds), dtype=dtype, device=device) for name, dtype in ROWS.items()}
    work["Z"] = wp.zeros(max(1, rows.values * worlds), dtype=wp.float64, device=device)
    return fill_struct(string_struct(), **table, **work)
