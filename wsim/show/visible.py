"""What a stage shows: its visible prims as triangle meshes in world space [m], at any time code. Reads by pxr.

Drawn are Mesh, TetMesh (its surface, unless meshes of its soft body are seen instead), the analytic shapes, BasisCurves
(control polygons, as tubes) and Points (as balls of their widths), with the texture of a bound preview material (PNG, as finely
as the mesh is cut), else their display colours, else the diffuse colour of that material, else a palette by what they are;
volumes with an OpenVDB density are smoke. Skinned meshes move with their skeleton.
Guides and proxies are drawn only where a stage shows nothing else, domains of fluids never. Point instancers are not drawn, and
`VisibleStage.notes` says so.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom, UsdSkel

from wsim.scene import Problem, SceneError
from wsim.scene.samples import DROPS
from wsim.show.prim import DrawnPrim, drawn_by, prim_to_world_matrix, shape_is_animated, triangulate_prim
from wsim.show.shading import PALETTE
from wsim.usd import names
from wsim.usd.prims.surface import OF
from wsim.usd.stage import applied_schemas, read_unfinished_layer, usd_error_text

if TYPE_CHECKING:
    from wsim.show.smoke.read import SmokeVolume


@dataclass
class VisibleStage:
    """A stage as it is seen. `floor(time code)` is the height [m] of its highest level plane, None if it has none."""

    stage: Usd.Stage                                      # kept: the functions below read it
    up: str                                               # "Y" or "Z"
    fps: float                                            # time codes a second
    times: list[float]                                    # time codes of the frames
    drawn: list[DrawnPrim]
    floor: Callable[[float], float] | None = None
    cameras: dict[str, Callable[[float], Gf.Camera]] = field(default_factory=dict)   # in stage units
    meters: float = 1.0                                   # [m] of a stage unit
    notes: list[str] = field(default_factory=list)
    smoke: list["SmokeVolume"] = field(default_factory=list)


def open_composed_stage(path) -> Usd.Stage:
    """The composed stage of a file. FileNotFoundError, or SceneError when it is no USD file."""
    if not Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file; give a .usd, .usda, .usdc or .usdz file")
    try:
        return Usd.Stage.Open(read_unfinished_layer(str(path)) or str(path))
    except OSError as error:
        raise SceneError(Problem(str(path), f"cannot be read: {error}")) from None
    except Tf.ErrorException as error:
        raise SceneError(Problem(str(path), f"not a readable USD stage ({usd_error_text(error)}); give a USD file")) from None


def read_visible_stage(path) -> VisibleStage:
    """All that a stage shows. Raises SceneError naming the prim when a mesh is broken or nothing can be drawn."""
    stage = open_composed_stage(path)
    up = str(UsdGeom.GetStageUpAxis(stage))
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    _bake_skinning(stage)
    prims, notes = _visible_prims(stage)
    prims, smoke = _separate_smoke_volumes(prims, os.path.dirname(os.path.abspath(path)), meters, notes)
    solid = [p for p in prims if p.IsA(UsdGeom.Gprim) or drawn_by(p)]
    shown = [p for p in solid if _imageable_purpose(p) in ("default", "render")]
    planes = [p for p in prims if p.IsA(UsdGeom.Plane)]
    shown = shown or solid
    times = _time_codes_of_stage(stage, shown, sorted({t for each in smoke for t in each.times}))
    level = [p for p in planes if _is_level(p, up, times[0])]
    drawn = _all_drawn(_without_cages([p for p in shown if p not in level]), times[0], meters)
    if not drawn and not level and not smoke:
        raise SceneError(Problem(str(path), "nothing visible to draw; it needs a mesh, curves, points or a shape"))
    floor_height_at = None
    if level:
        index = "XYZ".index(up)
        def floor_height_at(t: float) -> float:
            return meters * max(prim_to_world_matrix(p, t)[index, 3] for p in level)
    cameras = {str(p.GetPath()): UsdGeom.Camera(p).GetCamera for p in prims if p.IsA(UsdGeom.Camera)}
    return VisibleStage(stage, up, stage.GetTimeCodesPerSecond(), times, drawn, floor_height_at, cameras, meters, notes, smoke)


def _visible_prims(stage: Usd.Stage) -> tuple[list[Usd.Prim], list[str]]:
    """Visible prims of the stage, instances too, and what is left out."""
    found, notes = [], []
    walk = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            notes.append(f"{prim.GetPath()}: point instancers are not drawn")
            walk.PruneChildren()
        elif prim.IsA(UsdGeom.Imageable):
            if UsdGeom.Imageable(prim).ComputeVisibility(stage.GetStartTimeCode()) == UsdGeom.Tokens.invisible:
                walk.PruneChildren()
            else:
                found.append(prim)
    return found, notes


def _imageable_purpose(prim: Usd.Prim) -> str:
    return str(UsdGeom.Imageable(prim).ComputePurpose())


def _bake_skinning(stage: Usd.Stage) -> None:
    """Turns skinned meshes into points over time, in the session layer only."""
    roots = [p for p in stage.Traverse() if p.IsA(UsdSkel.Root)]
    if roots:
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            for root in roots:
                UsdSkel.BakeSkinning(UsdSkel.Root(root), Gf.Interval(stage.GetStartTimeCode(), stage.GetEndTimeCode()))


def _separate_smoke_volumes(prims: list[Usd.Prim], folder: str, meters: float, notes: list[str]) -> tuple[list[Usd.Prim],
                                                                                                          list["SmokeVolume"]]:
    """The prims without volumes and domains of fluids; the volumes that are smoke."""
    volumes = [p for p in prims if p.GetTypeName() == "Volume"]
    others = [p for p in prims if p.GetTypeName() != "Volume"
              and not {names.WSIM_DOMAIN, names.WSIM_LIQUID, names.WSIM_DRAIN} & set(applied_schemas(p))
              and not _is_seen_by_particles(p)]
    if not volumes:
        return others, []
    from wsim.show.smoke.read import read_smoke_volume
    return others, [found for p in volumes if (found := read_smoke_volume(p, folder, meters, notes))]


def _is_seen_by_particles(prim: Usd.Prim) -> bool:
    """Whether a shape is that of particles which a result has beside it."""
    drops = prim.GetStage().GetPrimAtPath(f"{prim.GetPath()}{DROPS}")
    filled = {names.WSIM_GRAINS, names.WSIM_PARTICLES} & set(applied_schemas(prim))
    return bool(filled and drops) and drops.HasAttribute("points")


def _time_codes_of_stage(stage: Usd.Stage, prims: list[Usd.Prim], volumes: list[float]) -> list[float]:
    """Whole time codes of the authored range, else of the samples of points and volumes; one if nothing moves."""
    if not any(shape_is_animated(p) for p in prims) and len(volumes) < 2:
        return [stage.GetStartTimeCode()]
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not stage.HasAuthoredTimeCodeRange():
        samples = [t for p in prims if p.IsA(UsdGeom.PointBased)
                   for t in UsdGeom.PointBased(p).GetPointsAttr().GetTimeSamples()] + volumes
        start, end = (min(samples), max(samples)) if samples else (0.0, 0.0)
    return [float(t) for t in np.arange(start, max(end, start) + 0.5)]


def _is_level(prim: Usd.Prim, up: str, time: float) -> bool:
    """Whether a plane faces up, so that the picture's ground can stand for it."""
    normal = prim_to_world_matrix(prim, time)[:3, "XYZ".index(str(UsdGeom.Plane(prim).GetAxisAttr().Get()))]
    return normal["XYZ".index(up)] > 0.9999 * np.linalg.norm(normal)


def _soft_body(prim: Usd.Prim) -> Usd.Prim | None:
    """The soft body that a prim belongs to: the deformable body at or above it, if that is simulated by tets."""
    while prim and not prim.IsPseudoRoot():
        if names.BODY in applied_schemas(prim):
            return prim if any(names.VOLUME_SIM in applied_schemas(p) for p in (prim, *prim.GetChildren())) else None
        prim = prim.GetParent()
    return None


def _has_active_collision(prim: Usd.Prim) -> bool:
    enabled = prim.GetAttribute("physics:collisionEnabled")
    return names.COLLISION in applied_schemas(prim) and not (enabled and enabled.Get() is False)


def _without_cages(prims: list[Usd.Prim]) -> list[Usd.Prim]:
    """The prims but for the tets of soft bodies that are seen by their skins. (What collides by itself is no skin.)"""
    skinned = {body.GetPath() for p in prims if p.IsA(UsdGeom.Mesh) and (body := _soft_body(p))
               and not _has_active_collision(p)}
    return [p for p in prims
            if not (p.IsA(UsdGeom.TetMesh) and (body := _soft_body(p)) and body.GetPath() in skinned)]


def _simulated_kind(prim: Usd.Prim) -> str:
    """What a prim is in a simulation, by its applied schemas, known to USD or not."""
    schemas = applied_schemas(prim)
    if prim.IsA(UsdGeom.BasisCurves):
        return "springs"
    if prim.IsA(UsdGeom.Points):
        return "particles"
    if prim.IsA(UsdGeom.TetMesh) or prim.IsA(UsdGeom.PointBased) and (_soft_body(prim) or prim.GetCustomDataByKey(OF)):
        return "soft"
    if any(name.endswith("DeformableSimAPI") for name in schemas):
        return "cloth"
    if "PhysicsCollisionAPI" in schemas:
        return "collider"
    samples = prim.IsA(UsdGeom.PointBased) and UsdGeom.PointBased(prim).GetPointsAttr().ValueMightBeTimeVarying()
    return "cloth" if samples else "plain"


def _all_drawn(prims: list[Usd.Prim], time: float, meters: float) -> list[DrawnPrim]:
    kinds = {prim.GetPath(): _simulated_kind(prim) for prim in prims}
    if not {"cloth", "springs", "soft", "particles"} & set(kinds.values()):     # nothing else: shapes get the warm colours
        kinds = {path: "cloth" if kind == "plain" else kind for path, kind in kinds.items()}
    drawn, numbers = [], dict.fromkeys(PALETTE, 0)
    for prim in prims:
        kind = kinds[prim.GetPath()]
        one = triangulate_prim(prim, kind, numbers[kind], time, meters)
        if one is not None:
            drawn.append(one)
            numbers[kind] += 1
    return drawn
