"""Prims of a stage that cannot take what a run writes to them, found before anything is simulated.

`wsim.usd.result.kinds.rows` refuses the same prims when their first sample comes; `wsim check` and the start of a run ask here.
"""

import os
from collections.abc import Callable, Iterator
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdSkel, UsdVol

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.methods import every
from wsim.scene.nodal.skin import held
from wsim.scene.samples import DROPS, VOLUME
from wsim.usd.result.kinds.volumes import straight
from wsim.usd.result.partial import CONTROL
from wsim.usd.result.samples import Frame, body_prim, moves

FRAMES = 1000          # frames at which the transform of a prim that moves is looked at


def refused(stage: Usd.Stage, scene: Scene) -> list[Problem]:
    """Every prim of a scene's stage that cannot take its result, with the fix."""
    found: list[Problem] = []
    if control := CONTROL.search(os.path.abspath(scene.source or "")):
        found.append(Problem(str(scene.source), f"has the control character {control[0]!r} in its path, by which no result can "
                             "name it; rename it"))
    counts = {body.path: len(body.points) for body in scene.bodies()}
    for path, count in (counts | {path: len(skin.rows) for path, skin in held(scene).items()}).items():
        found += _said(_points, stage, scene, path, count)
    for row, thing in every(scene):
        written = getattr(thing, "written", thing.path)
        if type(thing).__name__ not in row.unseen:
            found += _said(_thing, stage, type(thing).__name__, written)
    return list(dict.fromkeys(found))


def _said(ask: Callable, *given) -> Iterator[Problem]:
    try:
        ask(*given)
    except SceneError as error:
        yield from error.problems


def _points(stage: Usd.Stage, scene: Scene, path: str, count: int) -> None:
    """Raises SceneError where a prim is none of so many points, or they cannot be brought into its frame at some frame."""
    prim = body_prim(stage, path, count)
    rate = stage.GetTimeCodesPerSecond() / scene.fps
    for k in range(min(scene.frames, FRAMES) + 1 if moves(prim) else 1):
        Frame.of(prim, scene.start + k * rate)


def _thing(stage: Usd.Stage, kind: str, path: str) -> None:
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
        home = prim if prim.IsA(UsdVol.Volume) else _beside(stage, path, VOLUME, UsdVol.Volume)
        if home:
            straight(home, stage.GetStartTimeCode())
    if kind == "Liquid":
        _beside(stage, path, DROPS, UsdGeom.Points)


def _beside(stage: Usd.Stage, path: str, ending: str, schema: Any) -> Usd.Prim | None:
    """The prim of the result beside one; None where there is none yet. Raises SceneError where another thing has its name."""
    found = stage.GetPrimAtPath(Sdf.Path(path + ending))
    if found and not found.IsA(schema):
        raise SceneError(Problem(path + ending, f"is a {found.GetTypeName() or 'prim without type'}, and the result of {path} "
                                 f"writes a {schema.__name__} of that name; rename one of the two"))
    return found or None
