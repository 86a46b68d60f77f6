"""Scalar, vector and matrix types of one precision, so that one source serves float32 and float64; numbers of substeps."""

from functools import cache
from types import SimpleNamespace

import warp as wp

ADJOINT = "_adjoint"          # end of the names of modules whose kernels are compiled with their adjoints
_NAMES = ("vec2", "vec3", "vec4", "mat22", "mat33", "mat44", "quat", "transform")


@cache
def types(real) -> SimpleNamespace:
    """Types of `real` (wp.float32 or wp.float64): scalar, vec2 .. vec4, mat22 .. mat44, quat (x, y, z, w), transform.

    `name` is "f32" or "f64", for the names of kernels. Raises ValueError for any other type.
    """
    if real not in (wp.float32, wp.float64):
        raise ValueError(f"real is {real}; allowed are wp.float32 and wp.float64")
    letter = "f" if real is wp.float32 else "d"
    members = {name: getattr(wp, name + letter) for name in _NAMES}
    return SimpleNamespace(scalar=real, name="f32" if real is wp.float32 else "f64", **members)


def has_adjoint(module) -> bool:
    """Whether a module has the adjoints of its kernels, which double the time to compile it: its name says so."""
    return str(module).endswith(ADJOINT)


@wp.func
def substep_number(k: int, now: wp.array(dtype=int)):
    """Number of a substep: k, and what the device has counted, `now`, which is empty (None) where the host counts."""
    number = int(k)
    if now:
        number += now[0]
    return number
