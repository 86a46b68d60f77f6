"""Vertex maps that an artist paints on a simulation mesh: primvars, read at startTimeCode.

    primvars:wsim:stretch      of a cloth: E t along the warp, force per length; shear and weft keep their ratio to it
    primvars:wsim:bend         of a cloth: bending stiffness, force times length
    primvars:wsim:thickness    of a cloth: as physics:thicknesses (mass, and what colliders keep), before which it counts
    primvars:wsim:pin          of a cloth or soft body: 1 holds a point where it is, 0 does not, w in between pulls it there by
                               a spring of w / (1 - w) times the body's own stiffness: stretch of a cloth, Young's modulus
                               times the mean edge of a soft body. What is held moves with the mesh's own Xform.

Values are in stage units and replace what the material says; float[] or double[], a value for each point (interpolation vertex
or varying), for each face (uniform; not pin) or one for all (constant; not pin). Stretch and bend are those of faces in the
scene: of points, the mean of a face's. A weight between 0 and 1 is taken to the nearest 1 / LEVELS, so that a painted seam is a
few pins. Young's modulus and Poisson's ratio of each tet of a soft body: `wsim.usd.result.fields`.
"""

from dataclasses import replace

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from wsim.scene import Cloth
from wsim.usd.prims.masses import sum_shares_at_points
from wsim.usd.stage import StageReading, StageUnits

MAPS = {"stretch": "N/m", "bend": "N m", "thickness": "m"}       # of a cloth, with their units
PLACED = {"vertex": "point", "varying": "point", "uniform": "face", "constant": "whole"}
ELEMENTS = "wsim:elements"     # custom data of a field that a fit has written, of elements: kept, and not read
LEVELS = 32                    # of weights of soft pins: `wsim.usd.prims.pins`


def read_vertex_map(reading: StageReading, mesh: Usd.Prim, name: str, unit: str, sizes: dict[str, int],
                    low: float = 0.0) -> tuple[str, np.ndarray] | None:
    """("point", "face" or "whole", values [SI]) of primvars:wsim:`name`; None where there is none, or a wrong one (reported).

    sizes    how many values it has of each kind that is allowed      low    the least value; what is lower is reported
    """
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(f"wsim:{name}")
    if not (primvar and primvar.HasAuthoredValue()) or primvar.GetAttr().GetCustomDataByKey(ELEMENTS):
        return None
    values, where = np.array(primvar.ComputeFlattened(reading.start)), primvar.GetName()
    if values.dtype.kind not in "fiu" or values.ndim > 1:
        reading.fail(mesh.GetPath(), f"{where} is of type {primvar.GetTypeName()}; allowed is float[]: author it again as that")
        return None
    values = np.atleast_1d(values).astype(np.float64) * reading.units.factor(unit)
    kind = PLACED.get(str(primvar.GetInterpolation()), "")
    allowed = ", or ".join(f"{n} with {word}" for place, n in sizes.items() for word, p in PLACED.items() if p == place)
    if len(values) != sizes.get(kind):
        reading.fail(mesh.GetPath(), f"{where} has {len(values)} values with interpolation '{primvar.GetInterpolation()}'; "
                     f"allowed is {allowed}: paint it again, or correct its interpolation")
        return None
    bad = np.flatnonzero(~(np.isfinite(values) & (values >= low)))
    if len(bad):
        reading.fail(mesh.GetPath(), f"{where}[{bad[0]}] is {values[bad[0]]:g} (in SI units); allowed is a finite number >= "
                     f"{low:g}: paint it again there")
        return None
    return kind, values


def _primvar_sizes(cloth: Cloth) -> dict[str, int]:
    return {"point": len(cloth.points), "face": len(cloth.counts), "whole": 1}


def load_thickness(reading: StageReading, mesh: Usd.Prim, cloth: Cloth) -> tuple[np.ndarray | None, float | None] | None:
    """(thickness of each point [m] or None, one for the whole [m]) as painted; None where it is not painted."""
    found = read_vertex_map(reading, mesh, "thickness", MAPS["thickness"], _primvar_sizes(cloth), 1e-9)
    if found is None:
        return None
    kind, values = found
    mean = float(values.mean())
    if kind == "face":
        corners = np.repeat(np.arange(len(cloth.counts)), np.maximum(cloth.counts, 0))
        if len(corners) != len(cloth.indices):                       # reported by wsim.scene.check.mesh
            return None
        total, faces = (sum_shares_at_points(cloth.indices, v[corners], len(cloth.points))
                        for v in (values, np.ones(len(values))))
        values = np.where(faces > 0, total / np.maximum(faces, 1), mean)
    return (None, mean) if kind == "whole" else (values, mean)


def load_stiffness(reading: StageReading, mesh: Usd.Prim, cloth: Cloth) -> None:
    """Gives a cloth, which has its material, the stretch and bend that are painted. Its material then has their means."""
    for name, field, low in (("stretch", "stretches", 1e-12), ("bend", "bends", 0.0)):
        found = read_vertex_map(reading, mesh, name, MAPS[name], _primvar_sizes(cloth), low)
        if found is None:
            continue
        values = _map_to_faces(cloth, *found)
        if values is None:                                           # reported by wsim.scene.check.mesh
            continue
        material, mean = cloth.material, float(values.mean())
        changed = {"bend": mean}
        if name == "stretch":
            times = mean / material.stretch
            changed = {"stretch": mean, "shear": material.shear * times, "weft": material.weft * times}
        cloth.material = replace(material, **changed)
        if found[0] != "whole":
            setattr(cloth, field, values)


def _map_to_faces(cloth: Cloth, kind: str, values: np.ndarray) -> np.ndarray | None:
    """Values of points, faces or the whole as those of each face, (faces,); None for faces of no points or of points out of
    range."""
    counts = cloth.counts
    if kind == "whole":
        return np.full(len(counts), values[0])
    if kind == "face":
        return values
    if counts.min(initial=1) < 1 or counts.sum() != len(cloth.indices) or not len(counts):
        return None
    if cloth.indices.min() < 0 or cloth.indices.max() >= len(values):
        return None
    return np.add.reduceat(values[cloth.indices], np.cumsum(counts) - counts) / counts


def author_maps(mesh: Usd.Prim, cloth: Cloth, units: StageUnits) -> None:
    """Writes the stiffnesses that faces of a cloth have, where they differ."""
    for name, values in (("stretch", cloth.stretches), ("bend", cloth.bends)):
        if values is not None:
            primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(f"wsim:{name}", Sdf.ValueTypeNames.DoubleArray,
                                                              UsdGeom.Tokens.uniform)
            primvar.Set(Vt.DoubleArray.FromNumpy(np.asarray(values, np.float64) / units.factor(MAPS[name])))
