"""What trees hang from, where that moves (kernels/rigid/joint/tree/substep/bases.py): tables, state."""

from typing import Any

import numpy as np
import warp as wp

from wsim.model.state import StateField, StatePart
from wsim.physics.rigid.joints.joint import DISTANCE
from wsim.physics.rigid.joints.trees.strings import is_distance

TWISTS = (StateField("base_v", "m/s", True, "velocity of what a link hangs from", "vec3d"),
          StateField("base_w", "rad/s", True, "its spin", "vec3d"))


def some_base_moves(joints: list) -> bool:
    """Whether a joint hangs from what moves by itself."""
    return any(joint.motion.moves for joint in joints)


def base_tables(trees) -> tuple[dict[str, Any], list[StatePart]]:
    """(fields of Trees, parts of the state). trees: `DeviceTrees`, with links."""
    links, worlds, device = trees.links, trees.model.worlds, trees.device
    n = len(links.body)
    if not some_base_moves(trees.joints):
        none = wp.zeros(1, dtype=wp.vec3d, device=device)
        return {"moves": 0, "hang": none, "base_v": none, "base_w": none}, []
    part = StatePart.allocate("tree bases", TWISTS, n * worlds, trees.model.real, device)
    path = trees.method.bodies[0][0].written
    part.rows = {(path, world): np.arange(n) + world * n for world in range(worlds)}
    hang = np.zeros((n, 3))
    roots = trees.root_of()
    for link, j in enumerate(links.joint):
        if j >= 0 and links.parent[link] < 0:
            hang[link] = trees.anchor[j] - trees.method.origin[links.body[roots[link]]]
    return {"moves": 1, "hang": trees.model.upload(np.tile(hang, (worlds, 1)), wp.vec3d), **part.arrays}, [part]


def unsupported_base(joints: list, pairs: np.ndarray, own: list[int], cut: list[int]) -> str:
    """Reason why an island whose base moves has no reduced coordinates, "" if it has. cut: joints that close loops."""
    cut_off = [j for j in own if is_distance(joints[j]) and not joints[j].locked(DISTANCE)]
    hung = [j for j in own if min(pairs[j]) < 0 and j not in cut_off]
    moved = [j for j in hung if joints[j].motion.moves]
    if spans := [j for j in moved if is_distance(joints[j])]:
        return f"{joints[spans[0]].path}: what it hangs from moves, and it keeps one distance from that"
    if moved and cut and len(hung) > 1:
        return f"{joints[moved[0]].path}: what it hangs from moves, and a loop closes to what may move otherwise"
    return ""
