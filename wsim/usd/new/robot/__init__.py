"""A robot of a URDF or MuJoCo file -> a small scene layer over the USD file that a converter makes of it.

The scene says what the converters leave out or round: of MuJoCo files what the compiled model has (mujoco_model.py), of URDF
files transmissions and links without mass (urdf.py).
"""

import os
import shutil
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.load import read_stage
from wsim.usd.new.mesh import relative_asset_path
from wsim.usd.new.place import author_ground
from wsim.usd.new.robot.converter import PACKAGES, convert_robot, find_converter
from wsim.usd.new.robot.mujoco_model import author_mujoco_model, read_mujoco_model
from wsim.usd.new.robot.urdf import UrdfRobot, author_urdf, read_urdf
from wsim.usd.stage import SUFFIXES, StageUnits, applied_schemas, collect_warnings, open_stage
from wsim.usd.write import author_units, new_stage

FRAMES = 96


def author_robot(file, out, *, ground: float | None = None, frames: int | None = None) -> list[Problem]:
    """Converts a robot's `file` (.urdf, or .xml of MuJoCo) to USD in the folder OUT_robot beside `out`, and writes a scene
    `out` (.usda, .usdc, .usd) over it. Returns warnings.

    ground     height [m] of a ground plane, along the up axis; None: no plane of its own
    frames     frames to simulate, 24 a second; None: 96

    Raises SceneError: no such file, another suffix, no converter, a file that it refuses, a place that cannot be written.
    """
    file, target = os.fspath(file), Path(os.fspath(out))
    package = PACKAGES.get(Path(file).suffix.lower())
    if package is None:
        raise SceneError(Problem(file, f"ends in {Path(file).suffix or 'nothing'!r}; allowed is .urdf, or .xml of MuJoCo"))
    if not os.path.isfile(file):
        raise SceneError(Problem(file, "there is no such file; give the path of a .urdf or .xml file"))
    if target.suffix not in SUFFIXES or not target.parent.is_dir():
        raise SceneError(Problem(str(target), f"is no place for a scene; allowed: {', '.join(SUFFIXES)} in an existing folder"))
    tool = find_converter(package)
    folder = target.with_name(f"{target.stem}_robot")
    replaced = folder.exists()
    notes: list[Problem] = []
    try:
        model = read_urdf(file) if package.startswith("urdf") else None
        robot = convert_robot(tool, file, folder, notes)
        compiled = read_mujoco_model(tool, file, notes) if package.startswith("mujoco") else None
        _author_scene(file, target, robot, compiled, model, notes, ground, frames or FRAMES)
    except SceneError as error:
        if not replaced:
            shutil.rmtree(folder, ignore_errors=True)
        raise SceneError([*error.problems, *notes]) from None           # a warning may say why
    return notes


def _author_scene(file: str, target: Path, robot: Path, compiled: dict | None, model: UrdfRobot | None, notes: list[Problem],
                  ground: float | None, frames: int) -> None:
    """The scene over a converted robot, with what MuJoCo's compiled model or the URDF file says."""
    with collect_warnings([]), new_stage(target) as stage:
        source = open_stage(robot)
        if not any(names.RIGID_BODY in applied_schemas(prim) for prim in source.Traverse()):
            raise SceneError(Problem(file, "has no body; allowed: at least one that moves; fix: give it bodies, or links with "
                                     "a mass"))
        stage.GetRootLayer().subLayerPaths.append(relative_asset_path(str(robot), target))
        stage.GetRootLayer().documentation = f"the robot of {os.path.basename(file)}"
        units = StageUnits(UsdGeom.GetStageMetersPerUnit(source), UsdPhysics.GetStageKilogramsPerUnit(source),
                           str(UsdGeom.GetStageUpAxis(source)))
        author_units(stage, units, frames)
        stage.SetDefaultPrim(stage.GetPrimAtPath(source.GetDefaultPrim().GetPath()))
        if compiled is not None:
            author_mujoco_model(stage, file, compiled, units, notes)
        if model is not None:
            author_urdf(stage, file, model, units, notes)
        if ground is not None:
            cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_, UsdGeom.Tokens.guide])
            box = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
            author_ground(stage, units, np.array([box.GetMin(), box.GetMax()]) * units.metres, ground, notes)
        notes += [note for note in read_stage(stage).notes if note not in notes]
