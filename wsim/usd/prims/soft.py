"""Volume deformables: TetMesh <-> `Soft`.

A body is a prim with PhysicsDeformableBodyAPI; its simulation mesh is the prim itself or its one direct child with
PhysicsVolumeDeformableSimAPI, and is what a `Soft` names. Mass, rest shape and initial state as for a cloth; meshes of the body
besides are skins (skins.py). A `Soft` has tets of positive volume in the world, so those of a left-handed TetMesh are turned,
and those under a mirroring transform; what is wound against its own orientation is turned with a warning.
"""

import numpy as np
from pxr import Usd, UsdGeom

from wsim.geometry.tetra.repair import repair_tets
from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.scene import Soft
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.load_varying import check_topology, note_varying_values, value_attributes_of_prim
from wsim.usd.names import attribute_entry
from wsim.usd.prims.cloth import load_points
from wsim.usd.prims.fabric import bind_physics_material, bound_physics_material, note_density
from wsim.usd.prims.masses import body_density, body_mass, element_type, fill_massless_points, sum_shares_at_points
from wsim.usd.prims.skins import author_bind_pose, author_skin, deformable_body_path, is_mirrored_frame, load_skins
from wsim.usd.prims.solid import author_bulk, author_tet_materials, load_bulk, load_tet_materials
from wsim.usd.result.fields import load_fields
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion, read_placement

OWN = ("pressure", "quadratic", "filled", "self_collision")                    # of WsimSoftAPI
TURNED = [0, 1, 3, 2]                                         # corners of a tet of the opposite winding


def load_body(reading: StageReading, mesh: Usd.Prim, body: Usd.Prim) -> Soft | None:
    """The soft body of a simulation mesh; None if it has no geometry (which is reported)."""
    units, path = reading.units, str(mesh.GetPath())
    if not mesh.IsA(UsdGeom.TetMesh):
        reading.fail(path, f"has {names.VOLUME_SIM} and is a {mesh.GetTypeName() or 'typeless prim'}; it must be a TetMesh "
                           "(`wsim new softbody` makes one of a Mesh)")
        return None
    if not check_topology(reading, mesh, "tetVertexIndices"):
        return None
    points, default = load_points(reading, mesh, "Soft")
    tets = read_attribute(mesh, "Soft", "tets", units, reading.start)
    if points is None or tets is None:
        missing = [n for n, v in (("points", points), ("tetVertexIndices", tets)) if v is None]
        reading.fail(path, f"has no {', '.join(missing)}; a soft body needs both (is a payload or reference missing?)")
        return None
    soft = Soft(path, points, tets, motion=read_placement(reading, mesh).motion,
                velocities=read_attribute(mesh, "Soft", "velocities", units, reading.start))
    soft.rest_points = _read_soft_rest_points(reading, mesh, soft, default)
    soft.masses, soft.mass = _read_soft_masses(reading, mesh, body, soft)
    density = body_density(reading, body)
    if density is None and soft.masses is None and soft.mass is None:
        note_density(reading, mesh)
    soft.material = load_bulk(reading, mesh, density)
    note_varying_values(reading, path, Soft, value_attributes_of_prim(bound_physics_material(reading, mesh)),
                        lambda at: vars(load_bulk(at, mesh, density)))
    pressure = mesh.GetAttribute(attribute_entry("Soft", "pressure").attribute)
    note_varying_values(reading, path, Soft, [pressure],
                        lambda at: {"pressure": read_attribute(mesh, "Soft", "pressure", at.units)})
    soft.others, soft.which = load_tet_materials(reading, mesh, len(tets), density)
    for field in OWN:
        value = read_attribute(mesh, "Soft", field, units)
        if value is not None:
            setattr(soft, field, value)
    soft.tets = _orient_tets_positive(reading, mesh, soft)
    soft.skins = load_skins(reading, mesh, body, soft)
    return load_fields(reading, mesh, soft)


def _read_soft_rest_points(reading: StageReading, mesh: Usd.Prim, soft: Soft, default: np.ndarray | None) -> np.ndarray | None:
    """Rest points, (n, 3) [m]; rest tets are followed as long as each point has one place in them."""
    points = read_attribute(mesh, "Soft", "rest_points", reading.units)
    rows = read_attribute(mesh, "Soft", "rest_tets")
    points = default if points is None else points
    if rows is None or np.array_equal(rows, soft.tets):
        return points
    places, name = soft.points if points is None else points, attribute_entry("Soft", "rest_tets").attribute
    outside = ((rows < 0) | (rows >= len(places))).any(axis=1)
    if len(rows) != len(soft.tets) or outside.any():
        found = (f"has {len(rows)} rows; allowed is {len(soft.tets)}" if len(rows) != len(soft.tets) else
                 f"[{np.argmax(outside)}] is {rows[np.argmax(outside)].tolist()}; allowed is 0 to {len(places) - 1}")
        reading.fail(mesh.GetPath(), f"{name} {found}, in the order of tetVertexIndices")
        return None
    n = len(soft.points)
    if soft.tets.min() < 0 or soft.tets.max() >= n:
        return default                                         # reported by wsim.physics.soft.check
    place = np.full(n, -1)
    place[soft.tets] = rows
    apart = (place[soft.tets] != rows).any(axis=1)
    if apart.any():
        reading.warn(mesh.GetPath(), f"{name} cuts its tets from each other (first: tet {np.argmax(apart)}), which is not "
                     f"simulated; the rest shape is {'points' if default is None else 'the default value of points'}: author "
                     "restShapePoints in the order of points")
        return default
    rest = soft.points.copy()
    rest[place >= 0] = places[place[place >= 0]]
    return rest


def _read_soft_masses(reading: StageReading, mesh: Usd.Prim, body: Usd.Prim,
                      soft: Soft) -> tuple[np.ndarray | None, float | None]:
    """(mass of each point [kg] or None, mass of the whole [kg] or None)."""
    mass = body_mass(reading, body)
    values = read_attribute(mesh, "Soft", "masses", reading.units)
    if values is None:
        return None, mass
    sizes = {"point": len(soft.points), "tetrahedron": len(soft.tets), "constant": 1}
    kind = element_type(reading, mesh, attribute_entry("Soft", "masses").attribute, read_attribute(mesh, "Soft", "masses_of"),
                        values, sizes)
    if kind == "constant":
        return None, float(str(values[0]))
    if kind == "tetrahedron":
        quarters = np.repeat(values.astype(np.float64) / 4.0, 4)
        return fill_massless_points(sum_shares_at_points(soft.tets.ravel(), quarters, len(soft.points))), mass
    return (values if kind == "point" else None), mass


def _orient_tets_positive(reading: StageReading, mesh: Usd.Prim, soft: Soft) -> np.ndarray:
    """Tets of positive volume at rest in the world, where they have any."""
    orientation = read_attribute(mesh, "Soft", "orientation") or UsdGeom.Tokens.rightHanded
    tets = soft.tets[:, TURNED] if (orientation == UsdGeom.Tokens.leftHanded) != is_mirrored_frame(soft) else soft.tets
    rest = soft.points if soft.rest_points is None else soft.rest_points
    if len(rest) != len(soft.points) or not np.isfinite(soft.motion.values).all():
        return tets                                            # reported by wsim.physics.soft.check
    with np.errstate(invalid="ignore"):                        # points that are not finite: reported by wsim.physics.soft.check
        mended, wrong, _ = repair_tets(soft.motion.points(rest), tets)
    if len(wrong):
        reading.warn(mesh.GetPath(), f"{len(wrong)} of its {len(tets)} tets are wound against its orientation {orientation} "
                     f"(first: tet {wrong[0]}); they are turned: swap two corners of each, or correct orientation")
    return mended


def author_soft(stage: Usd.Stage, soft: Soft, materials: list[str], parts: list[str], units: StageUnits, frames: int) -> None:
    """Defines the TetMesh of a soft body, its subsets and skins, with everything that a load reads.

    materials   path of the Material of each of soft.materials
    parts       path of the subset of each of soft.others
    """
    mesh = UsdGeom.TetMesh.Define(stage, soft.path)
    prim, body = mesh.GetPrim(), stage.GetPrimAtPath(deformable_body_path(soft))
    body.AddAppliedSchema(names.BODY)
    if soft.mass is not None:
        author_attribute(body, "Body", "mass", soft.mass, units)
    for schema in (names.VOLUME_SIM, names.COLLISION, names.WSIM_SOFT):
        prim.AddAppliedSchema(schema)
    for field in ("points", "tets", "velocities", "rest_points", "masses", *OWN):
        if getattr(soft, field) is not None:
            author_attribute(prim, "Soft", field, getattr(soft, field), units)
    if soft.masses is not None:
        author_attribute(prim, "Soft", "masses_of", "point")
    author_attribute(prim, "Soft", "orientation",
                     UsdGeom.Tokens.leftHanded if is_mirrored_frame(soft) else UsdGeom.Tokens.rightHanded)
    author_attribute(prim, "Soft", "surface", tet_surface_triangles(soft.tets))
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    author_motion(prim, soft.motion, units, frames)
    bulks = [author_bulk(stage, path, bulk, units) for path, bulk in zip(materials, soft.materials, strict=True)]
    bind_physics_material(prim, bulks[0])
    author_tet_materials(mesh, soft.which, list(zip(parts, bulks[1:], strict=True)))
    author_bind_pose(prim, soft, units)
    for skin in soft.skins:
        author_skin(stage, soft, skin, units, frames)
