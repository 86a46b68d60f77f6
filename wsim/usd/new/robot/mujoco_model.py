"""What the compiled model of MuJoCo says of a robot, over the USD file of a converter: masses and moments, where bodies stand
and joints lie, weights that are taken off (gravcomp), and the pairs that collision masks exclude. The converter computes turns
in float32, by a cosine: turns of 4e-3 rad are 3e-5 rad off there.
"""

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from wsim.geometry import rotation
from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.attributes import author_attribute
from wsim.usd.new.robot.converter import run_converter
from wsim.usd.stage import StageUnits, applied_schemas

NEAR = 1e-3                     # [m], [1] between where a body stands, or its turn, in both models
MODEL = """
import json, sys
import mujoco
m = mujoco.MjModel.from_xml_path(sys.argv[1])
d = mujoco.MjData(m)
mujoco.mj_kinematics(m, d)
geoms = [[int(v) for v in row] for row in zip(m.geom_bodyid, m.geom_contype, m.geom_conaffinity)]
found = {"geoms": geoms, "places": d.xpos.tolist(), "mass": m.body_mass.tolist(), "moments": m.body_inertia.tolist(),
         "center": m.body_ipos.tolist(), "axes": m.body_iquat.tolist(), "at": m.body_pos.tolist(), "turn": m.body_quat.tolist(),
         "lifted": m.body_gravcomp.tolist(), "gravity": m.opt.gravity.tolist()}
json.dump(found, open(sys.argv[2], "w"))
"""


def read_mujoco_model(tool: Path, file: str, notes: list[Problem]) -> dict[str, Any] | None:
    """Masses, places and collision masks of the compiled MuJoCo model; None, with a warning, where MuJoCo refuses the file."""
    python = next((p for p in (tool.parent / "python", tool.parent / "python.exe") if p.exists()), Path(sys.executable))
    with tempfile.TemporaryDirectory() as place:
        result = Path(place) / "model.json"
        try:
            run_converter([python, "-c", MODEL, file, result], file, "MuJoCo")
        except SceneError as error:
            notes += [Problem(p.path, f"{p.text}; masses and collision masks are those of the converter", False)
                      for p in error.problems]
            return None
        return json.loads(result.read_text(encoding="utf-8"))


def author_mujoco_model(stage: Usd.Stage, file: str, model: dict[str, Any], units: StageUnits, notes: list[Problem]) -> None:
    """Masses and filtered pairs of a MuJoCo model over the bodies of the stage, which come in its order."""
    bodies = [prim for prim in stage.Traverse() if names.RIGID_BODY in applied_schemas(prim)]
    cache = UsdGeom.XformCache()
    places = np.array([cache.GetLocalToWorldTransform(prim).ExtractTranslation() for prim in bodies]).reshape(-1, 3)
    true = np.array(model["places"], np.float64)[1:]
    if len(true) != len(bodies) or np.abs(places * units.metres - true).max(initial=0.0) > NEAR:
        notes.append(Problem(file, f"bodies of the model ({len(true)}) and of the converted file ({len(bodies)}) differ in "
                             "number or place: masses and collisions are the converter's", fatal=False))
        return
    _author_places(stage, model, bodies, units)
    for k, prim in enumerate(bodies, 1):
        if model["mass"][k] > 0.0:
            api = UsdPhysics.MassAPI.Apply(prim)
            api.CreateMassAttr(model["mass"][k] / units.kilograms)
            api.CreateCenterOfMassAttr(Gf.Vec3f(*(np.array(model["center"][k]) / units.metres).tolist()))
            moments = np.array(model["moments"][k]) / units.factor("kg m^2")
            if moments.min() > 0.0:
                api.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
                api.CreatePrincipalAxesAttr(Gf.Quatf(*model["axes"][k]))
            if lifted := model.get("lifted", [0.0] * (k + 1))[k]:
                prim.AddAppliedSchema(names.WSIM_RIGID)
                force = -lifted * model["mass"][k] * np.array(model["gravity"])
                author_attribute(prim, "RigidBody", "force", tuple(force.tolist()), units)
    stage.GetDefaultPrim().CreateAttribute(names.JOINTS_ADD, Sdf.ValueTypeNames.Bool, False).Set(True)     # all of MuJoCo's do
    _author_pairs(stage, model, bodies)


def _author_places(stage: Usd.Stage, model: dict[str, Any], bodies: list[Usd.Prim], units: StageUnits) -> None:
    """Where bodies stand in the prims that they lie in, and frames of their joints there, by the model's doubles."""
    if "turn" not in model:
        return
    number = {prim.GetPath(): k for k, prim in enumerate(bodies, 1)}
    for k, prim in enumerate(bodies, 1):
        q = rotation.unit_quat(np.roll(model["turn"][k], -1))
        turn = prim.GetAttribute("xformOp:orient")
        if turn and abs(abs(_quaternion(turn.Get()) @ q) - 1.0) < NEAR:
            turn.Set(_like(turn.Get(), q))
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint):
            continue
        api: Any = UsdPhysics.Joint(prim)
        ends = [api.GetBody0Rel().GetTargets(), api.GetBody1Rel().GetTargets()]
        child = number.get(ends[1][0]) if ends[1] else None
        if child is None or ends[0] and ends[0][0] != bodies[child - 1].GetParent().GetPath():
            continue
        R, at = rotation.unit_quat(np.roll(model["turn"][child], -1)), np.array(model["at"][child]) / units.metres
        own = rotation.unit_quat(_quaternion(api.GetLocalRot1Attr().Get()))
        frame = rotation.quat_product(R, own)
        place = at + rotation.quat_rotate(R, np.array(api.GetLocalPos1Attr().Get(), np.float64))
        for attribute, new, old in ((api.GetLocalRot0Attr(), frame, _quaternion(api.GetLocalRot0Attr().Get())),
                                    (api.GetLocalPos0Attr(), place, np.array(api.GetLocalPos0Attr().Get(), np.float64))):
            if min(np.abs(new - old).max(), np.abs(new + old).max() if len(new) == 4 else np.inf) < NEAR / units.metres:
                attribute.Set(_like(attribute.Get(), new))


def _quaternion(value: Any) -> np.ndarray:
    """(x, y, z, w) of a quaternion of USD."""
    return np.array([*value.GetImaginary(), value.GetReal()], np.float64)


def _like(value: Any, new: np.ndarray) -> Any:
    """A value of USD of the type of another: a quaternion (x, y, z, w), or a vector."""
    if len(new) == 4:
        return type(value)(float(new[3]), *map(float, new[:3]))
    return type(value)(*map(float, new))


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
