"""Prims of a stage that cannot take what a run writes to them, found before anything is simulated.

`wsim.usd.result.kinds.rows` refuses the same prims when their first sample comes; `wsim check` and the start of a run ask here.
"""

import os
from collections.abc import Callable, Iterator
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdSkel, UsdVol

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.scene.methods import each_method_object
from wsim.scene.nodal.skin import embed_all_skins
from wsim.scene.samples import DROPS, VOLUME
from wsim.usd.result.kinds.volumes import axis_aligned_frame
from wsim.usd.result.partial import CONTROL
from wsim.usd.result.samples import PrimFrame, body_prim, transform_may_vary

FRAMES = 1000          # frames at which the transform of a prim that moves is looked at


def unwritable_prims(stage: Usd.Stage, scene: Scene) -> list[Problem]:
    """Every prim of a scene's stage that cannot take its result, with the fix."""
    found: list[Problem] = []
    if control := CONTROL.search(os.path.abspath(scene.source or "")):
        found.append(Problem(str(scene.source), f"has the control character {control[0]!r} in its path, by which no result can "
                             "name it; rename it"))
    counts = {body.path: len(body.points) for body in bodies_sampled_by_point(scene)}
    for path, count in (counts | {path: len(skin.rows) for path, skin in embed_all_skins(scene).items()}).items():
        found += _collect_problems(_check_points_writable, stage, scene, path, count)
    for body in scene.bodies():
        if body.is_counted_anew(scene):
            found += _collect_problems(_check_object_writable, stage, type(body).__name__, body.path)
    for row, thing in each_method_object(scene):
        written = getattr(thing, "written", thing.path)
        if type(thing).__name__ not in row.unseen:
            found += _collect_problems(_check_object_writable, stage, type(thing).__name__, written)
    return list(dict.fromkeys(found))


def _collect_problems(ask: Callable, *given) -> Iterator[Problem]:
    try:
        ask(*given)
    except SceneError as error:
        yield from error.problems


def _check_points_writable(stage: Usd.Stage, scene: Scene, path: str, count: int) -> None:
    """Raises SceneError where a prim is none of so many points, or they cannot be brought into its frame at some frame."""
    prim = body_prim(stage, path, count)
    rate = stage.GetTimeCodesPerSecond() / scene.fps
    for k in range(min(scene.frames, FRAMES) + 1 if transform_may_vary(prim) else 1):
        PrimFrame.of(prim, scene.start + k * rate)


def _check_object_writable(stage: Usd.Stage, kind: str, path: str) -> None:
    """Raises SceneError where a thing of another method cannot be written."""
    prim = stage.GetPrimAtPath(path)
    if not prim:
        raise SceneError(Problem(path, f"is not in {stage.GetRootLayer().identifier}; if it was added in Python, write the "
                                 "scene first with wsim.save and load that file"))
    if prim.IsInstanceProxy():
        raise SceneError(Problem(path, "is inside an instance, whose contents a layer cannot change; set instanceable = false "
                                 "there, or move it out of it"))
    expected = {"Body": UsdGeom.Xformable, "Skeleton": UsdSkel.Skeleton, "Rods": UsdGeom.PointBased}.get(kind)
    if expected and not prim.IsA(expected):
        raise SceneError(Problem(path, f"is a {prim.GetTypeName() or 'prim without type'}; the result needs a "
                                 f"{expected.__name__} there"))
    if kind == "Fluid":
        home = prim if prim.IsA(UsdVol.Volume) else _find_sibling_prim(stage, path, VOLUME, UsdVol.Volume)
        if home:
            axis_aligned_frame(home, stage.GetStartTimeCode())
    if kind == "Liquid" or kind == "Particles" and not prim.IsA(UsdGeom.Points):
        _find_sibling_prim(stage, path, DROPS, UsdGeom.Points)


def _find_sibling_prim(stage: Usd.Stage, path: str, ending: str, schema: Any) -> Usd.Prim | None:
    """The prim of the result beside one; None where there is none yet. Raises SceneError where another thing has its name."""
    found = stage.GetPrimAtPath(Sdf.Path(path + ending))
    if found and not found.IsA(schema):
        raise SceneError(Problem(path + ending, f"is a {found.GetTypeName() or 'prim without type'}, and the result of {path} "
                                 f"writes a {schema.__name__} of that name; rename one of the two"))
    return found or None
