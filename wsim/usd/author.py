"""A bare mesh -> a small scene layer in which it is cloth.

The mesh's file stays as it is: the new layer has it as a sublayer, by a relative path, and holds opinions over it, a
PhysicsScene, a fabric and perhaps a ground. Its rest angles are its own, since a garment is modelled in its folds and
not sewn from a flat pattern; those of a flat mesh are flat. Units are those of the new root layer (a sublayer's
do not count), so that meters_per_unit says how large the mesh is without touching a point.
"""

import os
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.fabric import FABRICS, Fabric
from wsim.fabric import fabric as preset
from wsim.scene import Cloth, Problem, Scene, SceneError
from wsim.usd import names
from wsim.usd.attributes import author
from wsim.usd.cloth import apply_cloth
from wsim.usd.load import read_stage
from wsim.usd.material import author_fabric, bind
from wsim.usd.save import author_units, new_stage
from wsim.usd.stage import Units, open_stage, quiet

TALL = 4.0                         # [m]: a garment beyond is probably in other units than its file says
THIN = 1e-4                        # thickness of a flat mesh against its extent; what is thicker was shaped


@dataclass(frozen=True)
class Bare:
    """The mesh to make cloth: its file, its prim, units, frames, its bounds in the world [m], (2, 3), and whether it
    lies in a plane."""

    file: str
    path: Sdf.Path
    units: Units
    frames: int
    bounds: np.ndarray
    root: str
    flat: bool


def author_cloth(mesh_file, out, fabric: Fabric | str = "cotton", prim: str | None = None, *, weld: float | None = None,
                 ground: float | None = None, meters_per_unit: float | None = None,
                 frames: int | None = None) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a mesh of `mesh_file` is cloth. Returns warnings.

    fabric          a Fabric (taken to seven digits), or the name of a preset of `wsim.fabric`
    prim            path of the mesh, or of what holds it alone, or its name; None: the only mesh of the file
    weld            points closer than this [m] become one particle
    ground          a ground plane this far [m] below the lowest point; None: no ground
    meters_per_unit overrules what the file says (USD's fallback is 0.01)
    frames          frames to simulate; None: those of the file, else the default of `Scene`

    Raises SceneError: no such file or mesh, an unknown fabric, a mesh that cannot be simulated, a place that cannot be
    written.
    """
    material, name = _fabric(fabric)
    material = replace(material, **{f.name: float(f"{getattr(material, f.name):.7g}") for f in fields(Fabric)})
    notes: list[Problem] = []
    source = open_stage(mesh_file, notes=notes)
    bare = _bare(source, os.fspath(mesh_file), prim, meters_per_unit, frames)
    if any(_same_file(layer.realPath, out) for layer in source.GetUsedLayers()):
        raise SceneError(Problem(os.fspath(out), "is a file that the mesh is made of; choose another output"))
    notes += _size(source, bare, meters_per_unit)
    del source
    with quiet([]), new_stage(out) as stage:                   # what USD says of the source is in notes already
        stage.GetRootLayer().subLayerPaths.append(_relative(bare.file, out))
        stage.GetRootLayer().documentation = f"{os.path.basename(bare.file)} with {bare.path} as cloth ({name})"
        author_units(stage, bare.units, bare.frames)
        stage.SetDefaultPrim(stage.GetPrimAtPath(bare.root))
        _author(stage, bare, material, name, weld or 0.0, ground)
        notes += [note for note in read_stage(stage).notes if note not in notes]
    return notes


def _fabric(fabric: Fabric | str) -> tuple[Fabric, str]:
    if isinstance(fabric, Fabric):
        return fabric, next((name for name, known in FABRICS.items() if known == fabric), "fabric")
    try:
        return preset(fabric), fabric.lower()
    except ValueError as error:
        raise SceneError(Problem("fabric", str(error))) from None


def _bare(stage: Usd.Stage, file: str, prim: str | None, meters_per_unit: float | None, frames: int | None) -> Bare:
    """The mesh that is meant. Raises SceneError if there is none, or more than one and none is named."""
    mesh = _mesh(stage, file, prim)
    units = Units.of(stage)
    if meters_per_unit is not None:
        if not (np.isfinite(meters_per_unit) and meters_per_unit > 0):
            raise SceneError(Problem(file, f"meters_per_unit is {meters_per_unit:g}; allowed is a finite number > 0"))
        units = Units(meters_per_unit, units.kilograms, units.up, units.fps, units.start)
    points = UsdGeom.Mesh(mesh).GetPointsAttr().Get(Usd.TimeCode(units.start))
    if not points:
        raise SceneError(Problem(str(mesh.GetPath()), "has no points (is a payload or reference missing?)"))
    M = np.array(UsdGeom.XformCache(Usd.TimeCode(units.start)).GetLocalToWorldTransform(mesh))
    world = (np.array(points, np.float64) @ M[:3, :3] + M[3, :3]) * units.metres
    if frames is None:
        authored = round(stage.GetEndTimeCode() - stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else 0
        frames = authored if authored > 0 else Scene().frames
    root = stage.GetDefaultPrim().GetPath() if stage.HasDefaultPrim() else mesh.GetPath().GetPrefixes()[0]
    bounds = np.array([world.min(axis=0), world.max(axis=0)])
    return Bare(file, mesh.GetPath(), units, frames, bounds, str(root), _is_flat(world))


def _is_flat(points: np.ndarray) -> bool:
    """Whether points (n, 3) lie in one plane, to THIN of their extent."""
    away = points[np.isfinite(points).all(axis=1)]
    away = away - away.mean(axis=0) if len(away) else np.zeros((1, 3))
    spread = np.linalg.eigvalsh(away.T @ away)                 # squared, ascending
    return bool(spread[0] <= THIN**2 * spread[2])


def _mesh(stage: Usd.Stage, file: str, prim: str | None) -> Usd.Prim:
    meshes = [p for p in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Mesh)]
    if not meshes:
        raise SceneError(Problem(file, "has no Mesh to make cloth of"))
    chosen = meshes if prim is None else _named(meshes, prim)
    if not chosen:
        raise SceneError(Problem(file, f"has no Mesh at {prim}; its meshes: {_listed(meshes)}"))
    if len(chosen) > 1:
        raise SceneError(Problem(file, f"has {len(chosen)} meshes{f' under {prim}' if prim else ''}; name one by prim "
                                 f"(--prim): {_listed(chosen)}"))
    if chosen[0].IsInstanceProxy():
        instance = chosen[0]
        while not instance.IsInstance():
            instance = instance.GetParent()
        text = (f"lies in the instance {instance.GetPath()}, which cannot be written over; author instanceable = false "
                f"on {instance.GetPath()}")
        raise SceneError(Problem(str(chosen[0].GetPath()), text))
    return chosen[0]


def _listed(meshes: list[Usd.Prim]) -> str:
    return ", ".join(str(p.GetPath()) for p in meshes[:8]) + (f" and {len(meshes) - 8} more" if len(meshes) > 8 else "")


def _named(meshes: list[Usd.Prim], name: str) -> list[Usd.Prim]:
    """The mesh at that path; else those below it; else those whose own name it is."""
    for meant in (lambda p: str(p.GetPath()) == name, lambda p: str(p.GetPath()).startswith(name.rstrip("/") + "/"),
                  lambda p: p.GetName() == name):
        found = [p for p in meshes if meant(p)]
        if found:
            return found
    return []


def _size(source: Usd.Stage, bare: Bare, meters_per_unit: float | None) -> list[Problem]:
    """Warns of a size that is unlikely for a garment, and of units that nobody stated."""
    size, path = bare.bounds[1] - bare.bounds[0], str(bare.path)
    found = f"is {size.max():.3g} m large at metersPerUnit = {bare.units.metres:g}"
    if meters_per_unit is None and not UsdGeom.StageHasAuthoredMetersPerUnit(source):
        text = (f"{found}, which is USD's fallback: the file authors none. Give meters_per_unit (--meters-per-unit) if "
                "that is not meant")
        return [Problem(path, text, fatal=False)]
    if size.max() > TALL and meters_per_unit is None:
        text = (f"{found}: large for a garment (more than {TALL:g} m). If its numbers are centimetres, give "
                "meters_per_unit = 0.01 (--meters-per-unit 0.01)")
        return [Problem(path, text, fatal=False)]
    return []


def _author(stage: Usd.Stage, bare: Bare, material: Fabric, name: str, weld: float, ground: float | None) -> None:
    mesh = stage.OverridePrim(bare.path)
    none = np.zeros(0)
    sheet = Cloth(str(bare.path), none, none, none, material=material, weld=weld, flat=bare.flat)
    apply_cloth(mesh, sheet, bare.units)
    fabric = author_fabric(stage, _free(stage, f"/materials/{name}"), material, bare.units)
    bind(mesh, fabric)
    if not any(prim.GetTypeName() == names.PHYSICS_SCENE for prim in stage.Traverse()):
        settings = stage.DefinePrim(_free(stage, "/physicsScene"), names.PHYSICS_SCENE)
        settings.AddAppliedSchema(names.WSIM_SCENE)
        for field in ("substeps", "iterations"):               # gravity stays the standard's: 9.81 m/s^2 downwards
            author(settings, "Scene", field, getattr(Scene(), field))
    if ground is not None:
        _author_ground(stage, bare, ground)


def _author_ground(stage: Usd.Stage, bare: Bare, below: float) -> None:
    """A plane `below` [m] under the lowest point, seen as wide as the mesh is large."""
    up = 2 if bare.units.up == "Z" else 1
    place = bare.bounds.mean(axis=0)
    place[up] = bare.bounds[0, up] - below
    plane = UsdGeom.Plane.Define(stage, _free(stage, "/ground"))
    plane.CreateAxisAttr(bare.units.up)
    width = 4.0 * float((bare.bounds[1] - bare.bounds[0]).max()) / bare.units.metres
    plane.CreateWidthAttr(width)
    plane.CreateLengthAttr(width)
    plane.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(plane, Usd.TimeCode.Default()))
    plane.AddTranslateOp().Set(tuple(place / bare.units.metres))
    plane.GetPrim().AddAppliedSchema(names.COLLISION)


def _free(stage: Usd.Stage, path: str) -> str:
    candidate, i = path, 0
    while stage.GetPrimAtPath(candidate):
        i += 1
        candidate = f"{path}_{i}"
    return candidate


def _same_file(layer: str, out) -> bool:
    return bool(layer) and os.path.exists(out) and os.path.exists(layer) and os.path.samefile(layer, out)


def _relative(file: str, out) -> str:
    """Path of a file as seen from the folder of `out`, anchored there ("./"), in USD's spelling."""
    try:
        path = Path(os.path.relpath(file, Path(os.fspath(out)).resolve().parent)).as_posix()
    except ValueError:                                         # another drive
        return Path(file).resolve().as_posix()
    return path if path.startswith("../") else f"./{path}"
