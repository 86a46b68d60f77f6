"""Tables of loops and mimics on the device (kernels/rigid/joint/tree/tables.py, TreeLoops)."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.joint.tree.tables import loop_struct, vec5d
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.trees.loops import MIMIC, loop_frames

LOOP_WORK = {"J": "values", "Q": "values", "R": "squares", "left": "rows", "size": "rows", "C": "rows", "z": "rows",
             "x": "dofs", "like": "dofs"}
SIZES = {"first_row": "rows", "kind": "", "c_a": "coordinates", "c_b": "coordinates", "first_value": "values",
         "first_square": "squares"}


def loop_tables(trees, sizes: dict[str, int]) -> Callable[[], Any]:
    """Maker of tables with work of their own. trees: `DeviceTrees`; sizes: numbers of links, dofs, coordinates of a world."""
    rows, worlds, device = trees.links.loops, trees.model.worlds, trees.device
    sizes = sizes | {"rows": len(rows.kind), "values": rows.values, "squares": rows.squares, "": 0}

    def upload(values, dtype):
        values = np.ascontiguousarray(values, np.int32 if dtype is int else np.float64)
        return trees.model.upload(values, dtype) if values.size else wp.zeros(1, dtype=dtype, device=device)

    def numbers(name: str):
        own, first, size = np.array(getattr(rows, name), np.int64), name == "first_row", sizes[SIZES[name]]
        each = [np.where(own < 0, -1, own + size * w)[:len(own) - first] for w in range(worlds)]
        return upload(np.concatenate(each + [own[-1:] + size * (worlds - 1)] * first), int)
    step = np.where(np.array(rows.kind, int) == MIMIC, sizes["dofs"], sizes["links"])
    table = {name: numbers(name) for name in SIZES}
    for name in ("a", "b"):
        own = np.array(getattr(rows, name), int)
        table[name] = upload(np.concatenate([np.where(own < 0, -1, own + w * step) for w in range(worlds)]), int)
    table |= {name: upload(np.tile(values, (worlds, 1)), wp.vec3d) for name, values in tree_loop_frames(trees).items()}
    table["coefficients"] = upload(np.tile(np.reshape(rows.coefficients, (-1, 5)), (worlds, 1)), vec5d)

    def make():
        def zeros(size: int, dtype):
            return wp.zeros(max(1, size * worlds), dtype=dtype, device=device)
        work = {name: zeros(sizes[size], wp.float64) for name, size in LOOP_WORK.items()}
        return fill_struct(loop_struct(), **table, **work, order=zeros(sizes["rows"], int),
                           rank=zeros(len(trees.links.first_link) - 1, int))
    return make


def tree_loop_frames(trees) -> dict[str, np.ndarray]:
    """Places and axes of rows (`loop_frames`) of one world."""
    rows, roots = trees.links.loops, trees.links.first_link

    def world_side(r: int):
        tree = int(np.searchsorted(rows.first_row, r, side="right")) - 1
        return trees.world_frame(rows.joint[r], rows.a[r] >= 0, roots[tree])
    return loop_frames(rows, trees.side_frames(trees.method.masses), world_side)
