"""Tables of joints of trees that may break (kernels/rigid/joint/tree/substep/breaks.py)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.joint.tree.tables import break_struct
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.joint import AXES
from wsim.physics.rigid.joints.trees.links import may_break

PLACES = ("x", "o", "p", "L", "bear_f", "bear_t")


def some_joint_breaks(trees) -> bool:
    """Whether a joint may break. trees: `DeviceTrees`, with links."""
    return any(trees.links.breaks) or any(may_break(trees.joints[j]) for j in trees.links.strings.joint)


def dof_values(trees, name: str) -> np.ndarray:
    """Armature or friction of the dofs of a world, (dofs,): where a joint may break, armature 1 of those that it locks."""
    links = trees.links
    tables = [getattr(trees.joints[j], name) if j >= 0 else {} for j in np.repeat(links.joint, np.diff(links.first_dof))]
    return np.array([float(name == "armature") if held else table.get(AXES[row], 0.0)
                     for table, row, held in zip(tables, links.row, links.held, strict=True)])


def break_tables(trees, t) -> Any:
    """The struct, with copies of what breaking changes of the table t."""
    breaks, device = some_joint_breaks(trees), trees.device
    found = {name: wp.clone(getattr(t, name)) if breaks else wp.zeros(1, dtype=getattr(t, name).dtype, device=device)
             for name in ("ball", "axis", "armature", "friction")}
    n = len(trees.links.body) * trees.model.worlds if breaks else 1
    found |= {name: wp.zeros(n, dtype=wp.vec3d, device=device) for name in PLACES}
    may = np.tile(trees.links.breaks, trees.model.worlds) if breaks else np.zeros(1)
    return fill_struct(break_struct(), some=int(breaks), may=trees._to_device(may, int), broken=trees.linked.broken, **found)
