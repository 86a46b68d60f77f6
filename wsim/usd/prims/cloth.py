"""Surface deformables <-> `Cloth`.

A body is a prim with PhysicsDeformableBodyAPI; its simulation mesh is the prim itself or its one direct child with
PhysicsSurfaceDeformableSimAPI, and is what a `Cloth` names. Mass: masses of the mesh before the body's mass, before
the body's density, before the material's. The rest shape is restShapePoints, else the default value of points; the
initial state is the value of points and velocities at startTimeCode.
"""

import numpy as np
from pxr import Usd, UsdGeom

from wsim.scene import Cloth
from wsim.usd import names
from wsim.usd.attributes import DEFAULT, author_attribute, read_attribute
from wsim.usd.load_varying import check_topology, note_varying_values, value_attributes_of_prim
from wsim.usd.names import attribute_entry
from wsim.usd.prims.fabric import (
    author_fabric,
    bind_physics_material,
    bound_physics_material,
    load_fabric,
    note_density,
    warn_subset_materials,
)
from wsim.usd.prims.masses import body_density, body_mass, element_type, fill_massless_points, sum_shares_at_points
from wsim.usd.prims.painted import author_maps, load_stiffness, load_thickness
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion, read_placement

OWN = ("model", "weld", "tethers", "drag", "lift", "self_collision")            # of WsimClothAPI
UNREAD = {"physics:restTriVertexIndices": "the triangles of the mesh count",
          "physics:restAdjTriPairs": "rest angles are flat or those of the rest shape",
          "physics:restBendAngles": "rest angles are flat or those of the rest shape"}


def load_body(reading: StageReading, mesh: Usd.Prim, body: Usd.Prim) -> Cloth | None:
    """The cloth of a simulation mesh; None if it has no geometry (which is reported)."""
    units, path = reading.units, str(mesh.GetPath())
    if not mesh.IsA(UsdGeom.Mesh):
        reading.fail(path, f"has {names.SURFACE_SIM} and is a {mesh.GetTypeName() or 'typeless prim'}; it must be a "
                           "Mesh")
        return None
    if not check_topology(reading, mesh, "faceVertexCounts", "faceVertexIndices"):
        return None
    points, rest = load_points(reading, mesh, "Cloth")
    counts, indices = (read_attribute(mesh, "Cloth", field, units, reading.start) for field in ("counts", "indices"))
    if points is None or counts is None or indices is None:
        missing = [n for n, v in (("points", points), ("faceVertexCounts", counts), ("faceVertexIndices", indices))
                   if v is None]
        reading.fail(path, f"has no {', '.join(missing)}; a cloth needs all three (is a payload or reference missing?)")
        return None
    warn_subset_materials(reading, mesh)
    for name, counts_instead in UNREAD.items():
        if mesh.HasAttribute(name) and mesh.GetAttribute(name).HasAuthoredValue():
            reading.warn(path, f"{name} is not read: {counts_instead}")
    if holes := UsdGeom.Mesh(mesh).GetHoleIndicesAttr().Get(reading.start):
        reading.warn(path, f"holeIndices are only seen: {len(holes)} faces, such as {holes[0]}, are simulated; take faces "
                     "where the cloth has a hole out of faceVertexCounts and faceVertexIndices")
    cloth = Cloth(path, points, counts, indices, motion=read_placement(reading, mesh).motion,
                  velocities=read_attribute(mesh, "Cloth", "velocities", units, reading.start),
                  rest_points=_read_cloth_rest_points(reading, mesh, rest), flat=_read_rest_angle_type(reading, mesh))
    cloth.thicknesses, constant = load_thickness(reading, mesh, cloth) or _read_cloth_thickness(reading, mesh, cloth)
    cloth.masses, cloth.mass = _read_cloth_masses(reading, mesh, body, cloth)
    density = body_density(reading, body)
    if density is None and cloth.masses is None and cloth.mass is None:
        note_density(reading, mesh)
    cloth.material = load_fabric(reading, mesh, density, constant)
    note_varying_values(reading, path, Cloth, value_attributes_of_prim(bound_physics_material(reading, mesh)),
                        lambda at: vars(load_fabric(at, mesh, density, constant)))
    load_stiffness(reading, mesh, cloth)
    for field in OWN:
        value = read_attribute(mesh, "Cloth", field, units)
        if value is not None:
            setattr(cloth, field, value)
    return cloth


def load_points(reading: StageReading, prim: Usd.Prim, owner: str) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Points at the start, and the default points where those differ (then they are the rest shape)."""
    start = read_attribute(prim, owner, "points", reading.units, reading.start)
    default = read_attribute(prim, owner, "points", reading.units, DEFAULT)
    if start is None:
        return default, None
    if prim.GetAttribute(attribute_entry(owner, "points").attribute).GetNumTimeSamples():
        reading.warn(prim.GetPath(), "points are animated and will be simulated: their value at startTimeCode is the "
                     "initial state")
        if default is not None and not np.array_equal(default, start):
            return start, default
    return start, None


def _read_cloth_rest_points(reading: StageReading, mesh: Usd.Prim, default: np.ndarray | None) -> np.ndarray | None:
    authored = read_attribute(mesh, "Cloth", "rest_points", reading.units)
    return default if authored is None else authored


def _read_rest_angle_type(reading: StageReading, mesh: Usd.Prim) -> bool:
    kind = read_attribute(mesh, "Elements", "rest_angles", reading.units) or "flat"
    if kind not in ("flat", "restShape"):
        reading.fail(mesh.GetPath(),
                     f"{attribute_entry('Elements', 'rest_angles').attribute} is {kind!r}; allowed is 'flat' or " "'restShape'")
    return kind != "restShape"


def _cloth_element_type(reading: StageReading, mesh: Usd.Prim, field: str, values: np.ndarray, cloth: Cloth) -> str:
    """constant, face or point; "" if the values fit none of them (reported)."""
    sizes = {"point": len(cloth.points), "face": len(cloth.counts), "constant": 1}
    kind = read_attribute(mesh, "Elements", field, reading.units)
    return element_type(reading, mesh, attribute_entry("Cloth", field).attribute, kind, values, sizes)


def _read_cloth_thickness(reading: StageReading, mesh: Usd.Prim, cloth: Cloth) -> tuple[np.ndarray | None, float | None]:
    """(thickness of each point [m] or None, one thickness of the whole [m] or None)."""
    values = read_attribute(mesh, "Cloth", "thicknesses", reading.units)
    if values is None or len(values) == 0:
        return None, None
    kind = _cloth_element_type(reading, mesh, "thicknesses", values, cloth)
    if kind == "constant":
        return None, _read_exact_thickness(reading, mesh, values)
    if kind == "face":
        total, faces = _sum_faces_at_points(cloth, values), _sum_faces_at_points(cloth, np.ones(len(values)))
        mean = float(np.mean(values))
        return np.where(faces > 0, total / np.maximum(faces, 1), mean), mean
    if kind == "point":
        own = read_attribute(mesh, "Fabric", "thickness", reading.units)
        return values, own or float(np.mean(values.astype(np.float64)))
    return None, None


def _read_exact_thickness(reading: StageReading, mesh: Usd.Prim, values: np.ndarray) -> float:
    """A constant thickness [m]: the double beside it (`author_cloth`), if that still rounds to it; else its decimal."""
    exact = read_attribute(mesh, "Fabric", "thickness", reading.units)
    if exact and np.float32(exact) == np.float32(values[0]):
        return exact
    return float(str(np.float32(values[0])))


def _sum_faces_at_points(cloth: Cloth, of_faces: np.ndarray) -> np.ndarray:
    """Sum over the faces at each point, (n,); ones where counts and indices disagree, which wsim.scene.check.scene reports."""
    if cloth.counts.min(initial=0) < 0 or cloth.counts.sum() != len(cloth.indices):
        return np.ones(len(cloth.points))
    return sum_shares_at_points(cloth.indices, np.repeat(np.asarray(of_faces, np.float64), cloth.counts), len(cloth.points))


def _read_cloth_masses(reading: StageReading, mesh: Usd.Prim, body: Usd.Prim,
                       cloth: Cloth) -> tuple[np.ndarray | None, float | None]:
    """(mass of each point [kg] or None, mass of the whole [kg] or None)."""
    mass = body_mass(reading, body)
    values = read_attribute(mesh, "Cloth", "masses", reading.units)
    if values is None or len(values) == 0:
        return None, mass
    kind = _cloth_element_type(reading, mesh, "masses", values, cloth)
    if kind == "constant":
        return None, float(str(values[0]))
    if kind == "face":
        return fill_massless_points(_sum_faces_at_points(cloth, values / np.maximum(cloth.counts, 1))), mass
    return (values if kind == "point" else None), mass


def apply_cloth(mesh: Usd.Prim, cloth: Cloth, units: StageUnits) -> None:
    """Writes on a mesh what makes it a cloth: schemas, masses, thicknesses, rest shape, wsim's own settings."""
    for schema in (names.BODY, names.SURFACE_SIM, names.COLLISION, names.WSIM_CLOTH):
        mesh.AddAppliedSchema(schema)
    thickness = [cloth.material.thickness] if cloth.thicknesses is None else cloth.thicknesses
    author_attribute(mesh, "Cloth", "thicknesses", thickness, units)
    author_attribute(mesh, "Elements", "thicknesses", "constant" if cloth.thicknesses is None else "point")
    author_attribute(mesh, "Fabric", "thickness", cloth.material.thickness, units)
    if cloth.masses is not None:
        author_attribute(mesh, "Cloth", "masses", cloth.masses, units)
        author_attribute(mesh, "Elements", "masses", "point")
    if cloth.mass is not None:
        author_attribute(mesh, "Body", "mass", cloth.mass, units)
    if cloth.rest_points is not None:
        author_attribute(mesh, "Cloth", "rest_points", cloth.rest_points, units)
    author_attribute(mesh, "Elements", "rest_angles", "flat" if cloth.flat else "restShape")
    author_maps(mesh, cloth, units)
    for field in OWN:
        if getattr(cloth, field) is not None:                  # drag: that of the material counts
            author_attribute(mesh, "Cloth", field, getattr(cloth, field), units)


def author_cloth_prim(stage: Usd.Stage, cloth: Cloth, material: str, units: StageUnits, frames: int) -> None:
    """Defines the Mesh of a cloth with everything that a load reads; its Material is at path `material`."""
    mesh = UsdGeom.Mesh.Define(stage, cloth.path)
    prim = mesh.GetPrim()
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    for field in ("points", "counts", "indices", "velocities"):
        if getattr(cloth, field) is not None:
            author_attribute(prim, "Cloth", field, getattr(cloth, field), units)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    author_motion(prim, cloth.motion, units, frames)
    apply_cloth(prim, cloth, units)
    existing = stage.GetPrimAtPath(material)
    bind_physics_material(prim, existing if existing else author_fabric(stage, material, cloth.material, units))
