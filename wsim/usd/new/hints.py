"""What can be made of a stage in which nothing is simulated, in words."""

import os

import numpy as np
from pxr import Usd, UsdGeom

from wsim.scene import Problem
from wsim.scene.methods import METHODS
from wsim.scene.solids import SOLIDS
from wsim.usd import names

SEEN = 8              # meshes that are looked at: a set may have thousands


def nothing(stage: Usd.Stage, simulated: list, meshes: list, tet_meshes: list) -> Problem:
    """The error of a stage with nothing to simulate."""
    file = stage.GetRootLayer().realPath or stage.GetRootLayer().identifier
    left_out = [str(prim.GetPath()) for prim in simulated]
    text = "nothing in it can be simulated: no cloth, spring net or soft body" + (
        f" (left out: {', '.join(left_out)})" if left_out else
        f" (no prim has {names.BODY} and {names.SURFACE_SIM} or {names.VOLUME_SIM})")
    hints = [_hint(os.path.basename(file), *kind) for kind in (
        ("meshes", "cloth", meshes), ("closed meshes", "softbody", [m for m in meshes[:SEEN] if _closed(m)]),
        ("TetMeshes", "softbody", tet_meshes)) if kind[2]]
    if not hints:
        hints = [f"A scene may hold: {'; '.join(could())}"] if not left_out else []
        text += "; it has no Mesh and no TetMesh to make one of"
    return Problem(file, ". ".join([text, *hints]))


def could() -> list[str]:
    """Text of what a stage may hold and by which schemas it is found: a line for each kind of thing, those of methods by their
    rows."""
    shapes = ", ".join(dict.fromkeys(solid.written[0] for solid in SOLIDS))
    ours = [("cloth", f"a Mesh with {names.BODY} and {names.SURFACE_SIM}"),
            ("spring net", f"a BasisCurves with {names.BODY} and {names.WSIM_SPRINGS} or {names.CURVES_SIM}"),
            ("soft body", f"a TetMesh with {names.BODY} and {names.VOLUME_SIM}"),
            ("collider", f"{names.COLLISION} on {shapes}, Mesh or TetMesh"), ("pin or tie", names.ATTACHMENT),
            ("load", names.WSIM_LOAD)]
    rows = [(name.lower(), " or ".join(row.claims)) for row in METHODS for name in row.owns if row.claims]
    return [f"{what} ({how})" for what, how in [*ours, *rows]]


def _closed(mesh: Usd.Prim) -> bool:
    """Whether a Mesh encloses something; points at the same place count as one."""
    from wsim.geometry.triangulate import triangulate
    from wsim.scene.check.signed_distance import closed
    start, shape = Usd.TimeCode(mesh.GetStage().GetStartTimeCode()), UsdGeom.Mesh(mesh)
    values = [attribute.Get(start) for attribute in (shape.GetPointsAttr(), shape.GetFaceVertexCountsAttr(),
                                                     shape.GetFaceVertexIndicesAttr())]
    if not all(values):
        return False
    points, counts, indices = (np.array(value) for value in values)
    try:
        return closed(points.astype(np.float64), triangulate(points.astype(np.float64), counts, indices)[0])
    except (ValueError, IndexError):
        return False


def _hint(file: str, plural: str, kind: str, prims: list) -> str:
    """The prims that could be of a kind, and the command that makes them."""
    paths = [str(prim.GetPath()) for prim in prims]
    shown = ", ".join(paths[:8]) + (f" and {len(paths) - 8} more" if len(paths) > 8 else "")
    return (f"Its {plural}: {shown}. `wsim new {kind} {file}" + (" --prim PATH" if len(paths) > 1 else "")
            + f" -o SCENE` makes a scene with one as {'cloth' if kind == 'cloth' else 'soft body'}")
