"""Mass of a deformable body: masses of its simulation geometry before the body's mass, before the body's density, before the
material's. Masses are given to the whole ("constant"), to elements (faces, tetrahedra), which share theirs among their points,
or to points.
"""

import numpy as np
from pxr import Usd

from wsim.usd.attributes import read_attribute
from wsim.usd.stage import StageReading


def element_type(reading: StageReading, mesh: Usd.Prim, name: str, kind: str | None, values: np.ndarray,
                 sizes: dict[str, int]) -> str:
    """Kind of elements that the values of attribute `name` are given to: `kind`, as authored, else by their number. "" if they
    do not fit, or are not all finite and > 0 (reported). sizes: {elementType: how many}."""
    kind = kind or next((k for k, n in sizes.items() if n == len(values)), "")
    if kind not in sizes or len(values) != sizes[kind]:
        reading.fail(mesh.GetPath(), f"{name} has {len(values)} values of elementType {kind!r}; allowed is "
                     + ", ".join(f"{n} for {k!r}" for k, n in sizes.items()))
        return ""
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if len(bad):
        reading.fail(mesh.GetPath(), f"{name}[{bad[0]}] is {values[bad[0]]:g} (in SI units); allowed is a finite number > 0")
        return ""
    return kind


def sum_shares_at_points(corners: np.ndarray, of_corners: np.ndarray, n: int) -> np.ndarray:
    """Sum at each of n points, (n,), over corners that name it. Corners out of range are left out: reported elsewhere."""
    inside = (corners >= 0) & (corners < n)
    return np.bincount(corners[inside], of_corners[inside], n)


def fill_massless_points(masses: np.ndarray) -> np.ndarray:
    """Masses [kg] in which points of no element have that of the lightest other, (n,)."""
    lightest = masses[masses > 0].min(initial=np.inf)
    return np.where(masses > 0, masses, lightest)


def body_mass(reading: StageReading, body: Usd.Prim) -> float | None:
    """Mass of the whole [kg]; None where it is not authored, or 0."""
    return _read_body_quantity(reading, body, "mass")


def body_density(reading: StageReading, body: Usd.Prim) -> float | None:
    """Density [kg/m^3] that overrules the material's; None where it is not authored, or 0."""
    return _read_body_quantity(reading, body, "density")


def _read_body_quantity(reading: StageReading, body: Usd.Prim, field: str) -> float | None:
    value = read_attribute(body, "Body", field, reading.units)
    if value is not None and not (np.isfinite(value) and value >= 0):
        reading.fail(body.GetPath(), f"physics:{field} is {value:g}; allowed is a finite number > 0, or 0 for none")
        return None
    return value or None
