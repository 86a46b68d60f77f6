"""Rows of the table of colliders (kernels/collider/colliders.py), as every method fills them: points and bodies that they touch
(`wsim.physics.contact.contacts`), strands (`wsim.physics.rods.colliders`), fluids and methods from outside
(`wsim.physics.collider.table`)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.collider.colliders import colliders
from wsim.kernels.contact.collide import code
from wsim.kernels.math.real import types
from wsim.model.structs import filled


def fill(real: Any, device: Any, kinds: list[str], *, moments: int = 1, **columns: Any) -> Any:
    """The struct with a row for each name of a kind of shape. columns: by the names of the struct; arrays of the device are
    shared, others uploaded, missing ones 0 and owner -1. Poses are the identity, and rows go nowhere."""
    t, n = types(real), len(kinds)
    columns = {"owner": np.full(n, -1), "kind": [code(k) for k in kinds]} | columns

    def column(name: str, dtype: Any) -> wp.array:
        given: Any = columns.get(name)
        if given is None:
            return wp.zeros(n, dtype=dtype, device=device)
        if isinstance(given, wp.array):
            return given
        width = wp.types.type_size(dtype)
        return wp.array(np.reshape(given, (-1, width) if width > 1 else -1), dtype=dtype, device=device)
    types_of = {"kind": int, "size": t.vec3, "mesh": wp.uint64, "thick": real, "friction": t.vec2, "restitution": real,
                "owner": int}
    found = filled(colliders(real), **{name: column(name, dtype) for name, dtype in types_of.items()})
    still = t.transform(t.vec3(), t.quat(0.0, 0.0, 0.0, 1.0))
    found.pose = wp.full((moments, n), still, dtype=t.transform, device=device)
    return found
