"""A robot of a URDF or MuJoCo file -> a small scene layer over the USD file that a converter makes of it.

The converters are mujoco-usd-converter and urdf-usd-converter of the Newton project. They bring an OpenUSD that conflicts with
usd-core, so they need an environment of their own: the folder WSIM_ROBOTS, else ~/.cache/wsim/robots. For a MuJoCo file the
scene also takes masses, moments and the pairs of bodies that collision masks exclude from the compiled model.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.load import read_stage
from wsim.usd.new.mesh import relative_asset_path
from wsim.usd.new.place import author_ground
from wsim.usd.stage import SUFFIXES, StageUnits, applied_schemas, collect_warnings, open_stage
from wsim.usd.write import author_units, new_stage

PACKAGES = {".xml": "mujoco-usd-converter", ".urdf": "urdf-usd-converter"}
FRAMES = 96
MADE = "wsim_robot.txt"         # says that a folder is one of these, which may be replaced
NEAR = 1e-3                     # [m] between where a body stands in both models
MODEL = """
import json, sys
import mujoco
m = mujoco.MjModel.from_xml_path(sys.argv[1])
d = mujoco.MjData(m)
mujoco.mj_kinematics(m, d)
geoms = [[int(v) for v in row] for row in zip(m.geom_bodyid, m.geom_contype, m.geom_conaffinity)]
found = {"geoms": geoms, "places": d.xpos.tolist(), "mass": m.body_mass.tolist(), "moments": m.body_inertia.tolist(),
         "center": m.body_ipos.tolist(), "axes": m.body_iquat.tolist()}
json.dump(found, open(sys.argv[2], "w"))
"""


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
    tool = _find_converter(package)
    folder = target.with_name(f"{target.stem}_robot")
    robot = _convert_robot(tool, file, folder)
    notes: list[Problem] = []
    model = _read_mujoco_model(tool, file, notes) if package.startswith("mujoco") else None
    with collect_warnings([]), new_stage(target) as stage:
        source = open_stage(robot)
        stage.GetRootLayer().subLayerPaths.append(relative_asset_path(str(robot), target))
        stage.GetRootLayer().documentation = f"the robot of {os.path.basename(file)}"
        units = StageUnits(UsdGeom.GetStageMetersPerUnit(source), UsdPhysics.GetStageKilogramsPerUnit(source),
                           str(UsdGeom.GetStageUpAxis(source)))
        author_units(stage, units, frames or FRAMES)
        stage.SetDefaultPrim(stage.GetPrimAtPath(source.GetDefaultPrim().GetPath()))
        if model is not None:
            _author_model(stage, file, model, units, notes)
        if ground is not None:
            cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_, UsdGeom.Tokens.guide])
            box = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
            author_ground(stage, units, np.array([box.GetMin(), box.GetMax()]) * units.metres, ground, notes)
        notes += [note for note in read_stage(stage).notes if note not in notes]
    return notes


def _find_converter(package: str) -> Path:
    """The converter's command. Raises SceneError that says how to get it."""
    place = Path(os.environ.get("WSIM_ROBOTS") or Path("~/.cache/wsim/robots").expanduser())
    scripts, command = place / ("Scripts" if os.name == "nt" else "bin"), package.replace("-", "_")
    found = shutil.which(command, path=str(scripts)) or shutil.which(command)
    if found is None:
        raise SceneError(Problem(package, f"is not installed; it needs an environment of its own: python3 -m venv {place} && "
                                 f"{scripts / 'pip'} install {' '.join(PACKAGES.values())}"))
    return Path(found)


def _run_converter(command: list, file: str) -> None:
    """Raises SceneError with the last words of a command that fails."""
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "PXR_PLUGINPATH_NAME")}
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, env=clean, check=False)
    if done.returncode:
        said = [line.strip() for line in (done.stdout + "\n" + done.stderr).splitlines() if line.strip()]
        raise SceneError(Problem(file, f"{Path(str(command[0])).name} refuses it: {(said or ['no reason'])[-1][:200]}"))


def _convert_robot(tool: Path, file: str, folder: Path) -> Path:
    """The USD file that a converter makes, in a folder of its own: one that was made here before is replaced, no other."""
    if folder.exists() and not (folder / MADE).is_file():
        raise SceneError(Problem(str(folder), "is there already, and not by this command; the converted robot goes here: "
                                 "move it away, or choose another name for the scene"))
    with tempfile.TemporaryDirectory(dir=folder.parent) as made:
        _run_converter([tool, "--no-layer-structure", file, made], file)
        results = sorted(Path(made).glob("*.usd*"))
        if len(results) != 1:
            raise SceneError(Problem(file, f"{tool.name} made {len(results)} USD files of it; expected: one"))
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(made, folder)
        (folder / MADE).write_text(f"made by wsim new robot of {os.path.basename(file)}\n", encoding="utf-8")
        return folder / results[0].name


def _read_mujoco_model(tool: Path, file: str, notes: list[Problem]) -> dict[str, Any] | None:
    """Masses, places and collision masks of the compiled MuJoCo model; None, with a warning, where MuJoCo refuses the file."""
    python = next((p for p in (tool.parent / "python", tool.parent / "python.exe") if p.exists()), Path(sys.executable))
    with tempfile.TemporaryDirectory() as place:
        result = Path(place) / "model.json"
        try:
            _run_converter([python, "-c", MODEL, file, result], file)
        except SceneError as error:
            notes += [Problem(p.path, f"{p.text}; masses and collision masks are those of the converter", False)
                      for p in error.problems]
            return None
        return json.loads(result.read_text(encoding="utf-8"))


def _author_model(stage: Usd.Stage, file: str, model: dict[str, Any], units: StageUnits, notes: list[Problem]) -> None:
    """Masses and filtered pairs of a MuJoCo model over the bodies of the stage, which come in its order."""
    bodies = [prim for prim in stage.Traverse() if names.RIGID_BODY in applied_schemas(prim)]
    cache = UsdGeom.XformCache()
    places = np.array([cache.GetLocalToWorldTransform(prim).ExtractTranslation() for prim in bodies]).reshape(-1, 3)
    true = np.array(model["places"], np.float64)[1:]
    if len(true) != len(bodies) or np.abs(places * units.metres - true).max(initial=0.0) > NEAR:
        notes.append(Problem(file, f"bodies of the model ({len(true)}) and of the converted file ({len(bodies)}) differ in "
                             "number or place: masses and collisions are the converter's", fatal=False))
        return
    for k, prim in enumerate(bodies, 1):
        if model["mass"][k] > 0.0:
            api = UsdPhysics.MassAPI.Apply(prim)
            api.CreateMassAttr(model["mass"][k] / units.kilograms)
            api.CreateCenterOfMassAttr(Gf.Vec3f(*(np.array(model["center"][k]) / units.metres).tolist()))
            moments = np.array(model["moments"][k]) / units.factor("kg m^2")
            if moments.min() > 0.0:
                api.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
                api.CreatePrincipalAxesAttr(Gf.Quatf(*model["axes"][k]))
    stage.GetDefaultPrim().CreateAttribute(names.JOINTS_ADD, Sdf.ValueTypeNames.Bool, False).Set(True)     # all of MuJoCo's do
    _author_pairs(stage, model, bodies)


def _author_pairs(stage: Usd.Stage, model: dict[str, Any], bodies: list[Usd.Prim]) -> None:
    """Filters the pairs of bodies, and of bodies and colliders of the world, that no masks let touch."""
    masks: dict[int, list[tuple[int, int]]] = {}
    for body, kind, others in model["geoms"]:
        masks.setdefault(body, []).append((kind, others))
    still = [prim for prim in stage.Traverse() if names.COLLISION in applied_schemas(prim)
             and not any(prim.GetPath().HasPrefix(body.GetPath()) for body in bodies)]
    world = masks.get(0, [])
    sides = [(prim, masks.get(k, [])) for k, prim in enumerate(bodies, 1)]
    sides += [(prim, [mask]) for prim, mask in zip(still, world, strict=True)] if len(still) == len(world) else []
    for k, (prim, own) in enumerate(sides[:len(bodies)]):
        apart = [other.GetPath() for other, its in sides[k + 1:] if own and its and not any(
            a[0] & b[1] or b[0] & a[1] for a in own for b in its)]
        if apart:
            rel = UsdPhysics.FilteredPairsAPI.Apply(prim).CreateFilteredPairsRel()
            rel.SetTargets([*dict.fromkeys([*rel.GetTargets(), *map(Sdf.Path, apart)])])
