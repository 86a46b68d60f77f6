"""Rows of the table of colliders (kernels/contact/collider/colliders.py), as every method fills them: points and bodies that
they touch (`wsim.physics.contact.contacts`), strands (`wsim.physics.rods.colliders`), fluids and methods from outside
(`wsim.physics.contact.collider.table`)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.contact.collide import collider_kind_code
from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct


def fill_collider_table(real: Any, device: Any, kinds: list[str], *, moments: int = 1, **columns: Any) -> Any:
    """The struct with a row for each name of a kind of shape. columns: by the names of the struct; arrays of the device are
    shared, others uploaded, missing ones 0 and owner -1. Poses are the identity, and rows go nowhere."""
    t, n = types(real), len(kinds)
    columns = {"owner": np.full(n, -1), "kind": [collider_kind_code(k) for k in kinds]} | columns

    def collider_table_column(name: str, dtype: Any) -> wp.array:
        given: Any = columns.get(name)
        if given is None:
            return wp.zeros(n, dtype=dtype, device=device)
        if isinstance(given, wp.array):
            return given
        width = wp.types.type_size(dtype)
        return wp.array(np.reshape(given, (-1, width) if width > 1 else -1), dtype=dtype, device=device)
    types_of = {"kind": int, "size": t.vec3, "mesh": wp.uint64, "thick": real, "friction": t.vec2, "restitution": real,
                "owner": int}
    found = fill_struct(collider_type(real), **{name: collider_table_column(name, dtype) for name, dtype in types_of.items()})
    still = t.transform(t.vec3(), t.quat(0.0, 0.0, 0.0, 1.0))
    found.pose = wp.full((moments, n), still, dtype=t.transform, device=device)
    return found


def foot_of_planes(away: np.ndarray, R: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Places of rows from an origin [m], (..., rows, 3), with planes at the foot of the perpendicular from it: as good as any
    other point of a plane that stays where it is, and a pose 1 km away would round what is near by 6e-5 m in float32.
    R: rotations, whose third column is the normal, (..., rows, 3, 3); flat: which rows are planes at rest, (rows,)."""
    n = R[..., :, 2]
    return np.where(flat[:, None], n * np.sum(n * away, axis=-1, keepdims=True), away)
