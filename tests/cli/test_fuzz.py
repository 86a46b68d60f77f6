"""Wrong values of attributes, drawn by chance: a stage is loaded, or refused in plain lines, whatever stands in it."""

import random

import pytest
from pxr import Gf, Sdf, Usd, Vt

from tests.make.cli.check import stage
from tests.make.cli.faults import VALID
from wsim import load
from wsim.scene import SceneError
from wsim.scene.check.scene import check_scene
from wsim.usd.result.kinds.places import unwritable_prims
from wsim.usd.settings import warn_missing_frame_rate

NUMBERS = [float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 1e38, -1.0, 0.0, 1e-300, 1e16]
T = Sdf.ValueTypeNames
OTHERS = {T.String: "x", T.Double: 1.5, T.FloatArray: Vt.FloatArray([1, 2]), T.Token: "bad", T.Int: -7, T.Bool: True,
          T.Float3: Gf.Vec3f(1, 2, 3), T.Asset: Sdf.AssetPath("x.usd"), T.IntArray: Vt.IntArray([-5, 7]),
          T.Quatf: Gf.Quatf(0), T.Matrix4d: Gf.Matrix4d(0), T.TimeCode: Sdf.TimeCode(3), T.TokenArray: Vt.TokenArray(["q"]),
          T.Point3fArray: Vt.Vec3fArray(1)}
UNITS = ("metersPerUnit", "kilogramsPerUnit", "timeCodesPerSecond", "startTimeCode", "endTimeCode")


def wrong(value, rng: random.Random):
    """Another value of the same type: out of range, too short, too long, empty, no number."""
    kind = type(value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice([-1, 0, -2**31, 2**31 - 1, 10**6 + 1])
    if isinstance(value, float):
        return rng.choice(NUMBERS)
    if isinstance(value, str):
        return rng.choice(["", "bad", "X", "none"])
    if hasattr(value, "GetImaginary"):
        return kind(rng.choice([0.0, float("nan"), 5.0]))
    items = list(value) if hasattr(value, "__len__") else []
    if "Array" in kind.__name__:
        shape = rng.choice([[], items[:-1], items + items[-1:], None, None])
        if shape is not None:
            return kind(shape)
    if not items:
        return value
    k, new = rng.randrange(len(items)), kind(value)
    new[k] = wrong(items[k], rng) if "Array" in kind.__name__ else rng.choice(NUMBERS)
    return new


def spoil(file: str, rng: random.Random) -> str:
    """Puts one wrong value into a stage; says which."""
    opened = Usd.Stage.Open(file)
    opened.Reload()
    layer = opened.GetRootLayer()
    if rng.random() < 0.1:
        name = rng.choice(UNITS)
        opened.SetMetadata(name, rng.choice(NUMBERS))
        said = name
    else:
        attributes = [a for prim in opened.Traverse() for a in prim.GetAttributes() if a.Get() is not None]
        attribute = rng.choice(attributes)
        said = str(attribute.GetPath())
        if rng.random() < 0.25:
            prim, name, kind = layer.GetPrimAtPath(attribute.GetPrim().GetPath()), attribute.GetName(), rng.choice(list(OTHERS))
            if name in prim.properties:
                del prim.properties[name]
            Sdf.AttributeSpec(prim, name, kind).default = OTHERS[kind]
            said += f" of type {kind}"
        else:
            value = wrong(attribute.Get(), rng)
            attribute.Set(value, *((2.0,) if rng.random() < 0.15 else ()))
            said += f" = {value}"
    layer.Save()
    return said


@pytest.mark.parametrize("seed", range(6))
def test_a_wrong_value_is_refused_in_lines_or_taken(tmp_path, seed):
    rng = random.Random(seed)
    for _ in range(30):
        name = rng.choice(list(VALID))
        file = stage(tmp_path, VALID[name])
        what = spoil(file, rng)
        try:
            scene = load(file)
            found = [*check_scene(scene), *unwritable_prims(Usd.Stage.Open(file), scene), *warn_missing_frame_rate(file)]
        except SceneError as error:
            found = error.problems
        except Exception as error:
            raise AssertionError(f"{name}: {what}: {error!r}") from error
        for problem in found:
            assert "\n" not in str(problem) and "please report" not in str(problem), (name, what)
