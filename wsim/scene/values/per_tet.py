"""A value for each tet of a soft body, as materials: one for each value that differs. NumPy only."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from wsim.scene import Soft


def material_per_tet(soft: "Soft", name: str, values: np.ndarray) -> "Soft":
    """`soft` with values (t,) of young, poisson or another field of its materials; its first material has their median, which
    no tet need have."""
    which = np.zeros(len(soft.tets), np.int64) if soft.which is None else soft.which
    each, number = np.unique(np.stack([which, values]), axis=1, return_inverse=True)
    others = [replace(soft.materials[int(k)], **material_fields_with(name, v)) for k, v in each.T]
    middle = replace(soft.material, **material_fields_with(name, np.median(values)))
    return replace(soft, material=middle, others=others, which=1 + number.reshape(-1))


def material_fields_with(name: str, value) -> dict[str, Any]:
    return {name: float(value)}
