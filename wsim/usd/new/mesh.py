"""What `wsim new` starts from and what every new scene has: the bare mesh, its units and size; settings and a ground.

The mesh's file stays as it is: the new layer has it as a sublayer, by a relative path, and holds opinions over it. Units are
those of the new root layer (a sublayer's do not count), so that meters_per_unit says how large the mesh is without touching a
point.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.scene import Problem, Scene, SceneError
from wsim.usd.load import read_stage
from wsim.usd.result.dependencies import describe_overwrite
from wsim.usd.stage import StageUnits, collect_warnings, open_stage
from wsim.usd.write import author_units, new_stage


@dataclass(frozen=True)
class BareMesh:
    """The mesh that is meant: its file, its prim, units, frames, its points in the world at the start [m], (n, 3) float64, and
    the root of its stage."""

    file: str
    path: Sdf.Path
    kind: str                                # "Mesh" or "TetMesh"
    units: StageUnits
    frames: int
    world: np.ndarray
    root: str

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner [m], (2, 3)."""
        return np.array([self.world.min(axis=0), self.world.max(axis=0)])


@dataclass(frozen=True)
class NewSceneOptions:
    """The wishes that `wsim new` is given, whatever the mesh becomes.

    prim            path of the mesh, or of what holds it alone, or its name; None: the only mesh of the file
    ground          height [m] of a ground plane, along the up axis; None: no ground
    meters_per_unit overrules what the file says (USD's fallback is 0.01)
    frames          frames to simulate; None: those of the file, or of an animated collider's, else the default of `Scene`
    pins            points to hold, see `wsim.usd.new.pins`
    colliders       prims or files that collide, see `wsim.usd.new.colliders`
    bound           path or name of a physics material of the file, see `wsim.usd.new.material`
    """

    prim: str | None = None
    ground: float | None = None
    meters_per_unit: float | None = None
    frames: int | None = None
    pins: tuple[str, ...] = ()
    colliders: tuple[str, ...] = ()
    bound: str | None = None


def find_bare_mesh(source: Usd.Stage, file, out, kinds: tuple[str, ...], wanted: NewSceneOptions, what: str) -> BareMesh:
    """The mesh that is meant, of one of `kinds` ("Mesh", "TetMesh"); `what` it shall become, in words.

    Raises SceneError if there is none, or more than one and none is named, if a layer cannot be written over it, or if `out`
    is a file that it is made of."""
    mesh, file, given = (_choose_mesh_prim(source, os.fspath(file), kinds, wanted.prim, what), os.fspath(file),
                         wanted.meters_per_unit)
    units = StageUnits.of(source)
    if given is not None:
        if not (np.isfinite(given) and given > 0):
            raise SceneError(Problem(file, f"meters_per_unit is {given:g}; allowed is a finite number > 0"))
        units = StageUnits(given, units.kilograms, units.up, units.fps, units.start)
    if not len(outline_points(mesh, units.start)):
        raise SceneError(Problem(str(mesh.GetPath()), "has no points (is a payload or reference missing?)"))
    if describe_overwrite(out, file):
        raise SceneError(Problem(os.fspath(out), "is a file that the mesh is made of; choose another output"))
    world = world_points(mesh, units, units.start)
    units, frames = _choose_frame_range(source, units, wanted)
    default = source.GetDefaultPrim()
    root = default.GetPath() if default and mesh.GetPath().HasPrefix(default.GetPath()) else mesh.GetPath().GetPrefixes()[0]
    return BareMesh(file, mesh.GetPath(), str(mesh.GetTypeName()), units, frames, world, str(root))


def outline_points(prim: Usd.Prim, time: float) -> np.ndarray:
    """Points of a mesh, of Points those at the sides of their balls, corners of the extent of any other shape, (n, 3), own
    frame, in stage units."""
    if prim.IsA(UsdGeom.PointBased):
        points = UsdGeom.PointBased(prim).GetPointsAttr().Get(Usd.TimeCode(time))
        if points and prim.IsA(UsdGeom.Points):
            half = 0.5 * np.max(UsdGeom.Points(prim).GetWidthsAttr().Get(Usd.TimeCode(time)) or [0.0])
            points = np.concatenate([np.array(points) - half, np.array(points) + half])
    else:
        ends = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode(time))
        points = None if ends is None else [[ends[k >> a & 1][a] for a in range(3)] for k in range(8)]
    return np.array([] if points is None else points, np.float64).reshape(-1, 3)


def world_points(prim: Usd.Prim, units: StageUnits, time: float) -> np.ndarray:
    """Those points in the world at a time code, (n, 3) float64 [m]."""
    M = np.array(UsdGeom.XformCache(Usd.TimeCode(time)).GetLocalToWorldTransform(prim))
    return (outline_points(prim, time) @ M[:3, :3] + M[3, :3]) * units.metres


def _choose_frame_range(source: Usd.Stage, units: StageUnits, wanted: NewSceneOptions) -> tuple[StageUnits, int]:
    """Start, rate and number of frames: of the mesh's file, or, where that has no range, of a collider's."""
    stages = [source, *(open_stage(file) for file in wanted.colliders if os.path.isfile(file))]
    timed = next((s for s in stages if s.HasAuthoredTimeCodeRange()), source)
    if timed is not source:
        units = replace(units, fps=timed.GetTimeCodesPerSecond(), start=timed.GetStartTimeCode())
    authored = round(timed.GetEndTimeCode() - timed.GetStartTimeCode()) if timed.HasAuthoredTimeCodeRange() else 0
    return units, wanted.frames or (authored if authored > 0 else Scene().frames)


def _choose_mesh_prim(stage: Usd.Stage, file: str, kinds: tuple[str, ...], prim: str | None, what: str) -> Usd.Prim:
    meshes = [p for p in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
              if any(p.IsA(getattr(UsdGeom, kind)) for kind in kinds)]
    called = " or ".join(kinds)
    if not meshes:
        raise SceneError(Problem(file, f"has no {called} to make {what} of"))
    chosen = _prims_of_first_kind(meshes, kinds) if prim is None else _match_mesh_name(meshes, prim)
    if not chosen:
        raise SceneError(Problem(file, f"has no {called} at {prim}; its meshes: {_list_mesh_paths(meshes)}"))
    if len(chosen) > 1:
        raise SceneError(Problem(file, f"has {len(chosen)} meshes{f' under {prim}' if prim else ''}; name one by prim "
                                 f"(--prim): {_list_mesh_paths(chosen)}"))
    if chosen[0].IsInstanceProxy():
        instance = chosen[0]
        while not instance.IsInstance():
            instance = instance.GetParent()
        text = (f"lies in the instance {instance.GetPath()}, which cannot be written over; author instanceable = false "
                f"on {instance.GetPath()}")
        raise SceneError(Problem(str(chosen[0].GetPath()), text))
    return chosen[0]


def _prims_of_first_kind(meshes: list[Usd.Prim], kinds: tuple[str, ...]) -> list[Usd.Prim]:
    """Those of the first kind that there is."""
    return next(found for kind in kinds if (found := [p for p in meshes if p.IsA(getattr(UsdGeom, kind))]))


def _list_mesh_paths(meshes: list[Usd.Prim]) -> str:
    return ", ".join(str(p.GetPath()) for p in meshes[:8]) + (f" and {len(meshes) - 8} more" if len(meshes) > 8 else "")


def _match_mesh_name(meshes: list[Usd.Prim], name: str) -> list[Usd.Prim]:
    """The mesh at that path; else those below it; else those whose own name it is."""
    for meant in (lambda p: str(p.GetPath()) == name, lambda p: str(p.GetPath()).startswith(name.rstrip("/") + "/"),
                  lambda p: p.GetName() == name):
        found = [p for p in meshes if meant(p)]
        if found:
            return found
    return []


def warn_unlikely_size(source: Usd.Stage, bare: BareMesh, wanted: NewSceneOptions, tall: float, what: str) -> list[Problem]:
    """Warns of units that nobody stated, and of a size above `tall` [m], which is unlikely for `what` it is."""
    extent, path = bare.bounds[1] - bare.bounds[0], str(bare.path)
    found = f"is {extent.max():.3g} m large at metersPerUnit = {bare.units.metres:g}"
    if wanted.meters_per_unit is None and not UsdGeom.StageHasAuthoredMetersPerUnit(source):
        text = (f"{found}, which is USD's fallback: the file authors none. Give meters_per_unit (--meters-per-unit) if "
                "that is not meant")
        return [Problem(path, text, fatal=False)]
    if extent.max() > tall and wanted.meters_per_unit is None:
        text = (f"{found}: large for {what} (more than {tall:g} m). If its numbers are centimetres, give "
                "meters_per_unit = 0.01 (--meters-per-unit 0.01)")
        return [Problem(path, text, fatal=False)]
    return []


@contextmanager
def new_scene_over_mesh(bare: BareMesh, out, documentation: str, notes: list[Problem]) -> Iterator[Usd.Stage]:
    """A new stage over the mesh's file, written to `out` when the block ends well and what it holds can be loaded; the
    loader's warnings are added to `notes`. What USD says of the source must be in notes already."""
    with collect_warnings([]), new_stage(out) as stage:
        stage.GetRootLayer().subLayerPaths.append(relative_asset_path(bare.file, out))
        stage.GetRootLayer().documentation = documentation
        author_units(stage, bare.units, bare.frames)
        yield stage
        notes += [note for note in read_stage(stage).notes if note not in notes]


def relative_asset_path(file: str, out) -> str:
    """Path of a file as seen from the folder of `out`, anchored there ("./"), in USD's spelling."""
    try:
        path = Path(os.path.relpath(file, Path(os.fspath(out)).resolve().parent)).as_posix()
    except ValueError:                                         # another drive
        return Path(file).resolve().as_posix()
    return path if path.startswith("../") else f"./{path}"
