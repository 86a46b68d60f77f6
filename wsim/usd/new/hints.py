"""What can be made of a stage in which nothing is simulated, in words."""

import os

import numpy as np
from pxr import Usd, UsdGeom

from wsim.scene import Problem
from wsim.scene.methods import METHODS
from wsim.usd import names
from wsim.usd.stage import applied_schemas

SEEN = 8              # meshes that are looked at: a set may have thousands


def nothing_to_simulate(stage: Usd.Stage, simulated: list, meshes: list, tet_meshes: list) -> Problem:
    """The error of a stage with nothing to simulate."""
    file = stage.GetRootLayer().realPath or stage.GetRootLayer().identifier
    left_out = [str(prim.GetPath()) for prim in simulated]
    found = [api for prim in stage.Traverse() for api in (*applied_schemas(prim), str(prim.GetTypeName()))]
    missing = dict.fromkeys(names.FEATURES[api] for api in found if api in names.FEATURES)
    text = "nothing in it can be simulated"
    if missing:
        text += f": wsim does not simulate {' and '.join(missing)}"
    elif left_out:
        text += f" (left out: {', '.join(left_out[:4])}{' ...' * (len(left_out) > 4)})"
    hints = [_new_command_hint(os.path.basename(file), *kind) for kind in (
        ("meshes", "cloth", meshes), ("closed meshes", "softbody", [m for m in meshes[:SEEN] if _encloses_volume(m)]),
        ("TetMeshes", "softbody", tet_meshes)) if kind[2]]
    if not hints:
        text += "; it has no Mesh"
        hints = [f"A scene may hold {', '.join(simulatable_schemas())}: `wsim examples` lists some"] if not (left_out
                                                                                                             or missing) else []
    return Problem(file, ". ".join([text, *hints]))


def simulatable_schemas() -> list[str]:
    """What a stage may hold that can be simulated, those of methods by their rows: each with the schema that it is found by."""
    ours = [("cloth", names.SURFACE_SIM), ("soft bodies", names.VOLUME_SIM), ("rods", names.CURVES_SIM)]
    rows = [("rigid bodies" if row.name == "rigid" else row.name, row.claims[0])
            for row in METHODS if row.claims and not row.posed]
    return [f"{what} ({how})" for what, how in [*ours, *rows]]


def _encloses_volume(mesh: Usd.Prim) -> bool:
    """Whether a Mesh encloses something; points at the same place count as one."""
    from wsim.geometry.triangulate import triangulate_polygons
    from wsim.scene.check.signed_distance import is_closed_mesh
    start, shape = Usd.TimeCode(mesh.GetStage().GetStartTimeCode()), UsdGeom.Mesh(mesh)
    values = [attribute.Get(start) for attribute in (shape.GetPointsAttr(), shape.GetFaceVertexCountsAttr(),
                                                     shape.GetFaceVertexIndicesAttr())]
    if not all(values):
        return False
    points, counts, indices = (np.array(value) for value in values)
    try:
        return is_closed_mesh(points.astype(np.float64), triangulate_polygons(points.astype(np.float64), counts, indices)[0])
    except (ValueError, IndexError):
        return False


def _new_command_hint(file: str, plural: str, kind: str, prims: list) -> str:
    """The prims that could be of a kind, and the command that makes them."""
    paths = [str(prim.GetPath()) for prim in prims]
    shown = ", ".join(paths[:8]) + (f" and {len(paths) - 8} more" if len(paths) > 8 else "")
    return (f"Its {plural}: {shown}. `wsim new {kind} {file}" + (" --prim PATH" if len(paths) > 1 else "")
            + f" -o SCENE` makes a scene with one as {'cloth' if kind == 'cloth' else 'soft body'}")
