"""The example scenes of curves: a camera that goes along a path at an even pace, and a chart of easings; python -m tools.scenes
writes them. Splines are those of USD, made of `wsim.scene.curve`."""

import json

import numpy as np
from pxr import Usd, UsdGeom

from tools.scenes.cloth import cloth, material
from tools.usda import block, ground, listed, moved, number, pin, scene, settings
from wsim.scene import shapes
from wsim.scene.curve import Curve
from wsim.scene.curve.arc import evenly
from wsim.usd.stage import StageUnits
from wsim.usd.transforms.splines import spline_from_curve

FPS, FRAMES = 24, 96
AXES = "XYZ"


def spline(attribute: str, curve: Curve) -> str:
    """`double ATTRIBUTE.spline = { ... }` as USD writes it, numbers with six digits."""
    stage = Usd.Stage.CreateInMemory()
    made = spline_from_curve(curve, StageUnits(fps=FPS))
    UsdGeom.Xform.Define(stage, "/A").AddTranslateXOp().GetAttr().SetSpline(made)
    lines = stage.GetRootLayer().ExportToString().split("\n")
    first = next(k for k, line in enumerate(lines) if ".spline" in line)
    own = lines[first:next(k for k in range(first, len(lines)) if lines[k].strip() == "}") + 1]
    text = "\n".join(line[4:] for line in own).replace("xformOp:translateX", attribute)
    return "\n".join(" ".join(_short(word) for word in line.split(" ")) for line in text.split("\n"))


def _short(word: str) -> str:
    """A number of a line with six digits; other words as they are."""
    core = word.strip("(),;:")
    try:
        return word.replace(core, number(float(core))) if core else word
    except ValueError:
        return word


def ops(*names: str) -> str:
    return "uniform token[] xformOpOrder = [" + ", ".join(f'"{name}"' for name in names) + "]"


def camera_path() -> str:
    """Once round a hanging sheet, near in front and far behind, always towards it."""
    center = np.array([0.0, 1.0, 0.0])
    keys = np.array([(0.0, 1.3, 3.0), (2.4, 1.9, 1.2), (2.0, 0.7, -2.2), (-1.8, 1.4, -2.6), (-2.2, 2.1, 1.0), (-0.5, 1.2, 2.6)])
    path = evenly(Curve(np.linspace(0.0, FRAMES / FPS, len(keys)), keys, "catmull_rom", alpha=0.5), accuracy=1e-5)
    at = np.linspace(0.0, FRAMES / FPS, 13)
    way = center - path.sampled(at)
    yaw = np.degrees(np.unwrap(np.arctan2(-way[:, 0], -way[:, 2])))
    pitch = np.degrees(np.arctan2(way[:, 1], np.hypot(way[:, 0], way[:, 2])))
    slopes = path.how["leave"]
    lines = [spline(f"xformOp:translate{AXES[k]}", Curve(path.times, path.values[:, k], "hermite", leave=slopes[:, k]))
             for k in range(3)]
    lines += [spline(f"xformOp:rotate{axis}", Curve(at, angle, "catmull_rom")) for axis, angle in (("Y", yaw), ("X", pitch))]
    names = [f"xformOp:{op}" for op in ("translateX", "translateY", "translateZ", "rotateY", "rotateX")]
    camera = "\n".join(["float focalLength = 30", *lines, ops(*names)])
    swing = spline("xformOp:translateZ", Curve([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.35, -0.3, 0.25, 0.0], "catmull_rom"))
    rail = ('uniform token axis = "X"\ndouble radius = 0.02\ndouble height = 1.3\ndouble3 xformOp:translate = (0, 1.5, 0)\n'
            f"{swing}\ncolor3f[] primvars:displayColor = [(0.45, 0.4, 0.35)]\n"
            + ops("xformOp:translate", "xformOp:translateZ"))
    n = 24
    return scene("A camera goes once round a sheet whose rail swings: splines of a key a second, at an even pace.", [
        settings(substeps=40, iterations=2, air_drag=0.3, comment="What is between keys is met in each substep."),
        material("cotton", damping=3e-4),
        cloth("Sheet", shapes.sheet(1.0, 1.0, n, n, at=(0.0, 1.0, 0.0)), "cotton", (0.16, 0.42, 0.55), "Hangs on the rail."),
        block("Cylinder", "Rail", rail, comment="Swings by a spline with five keys; its velocity is smooth."),
        pin("Rings", "/World/Sheet", np.arange(0, n + 1, 4), "/World/Rail", "Seven points of the upper edge."),
        block("Camera", "Camera", camera, comment="Splines through places that are equally far apart along the path "
              "(wsim.scene.curve.arc.evenly), and turns towards the sheet. `wsim picture` looks through it."),
        ground()], frames=FRAMES)


# what each lane of the chart shows: a name, an easing, a colour
LANES = (("Linear", "linear", (0.5, 0.5, 0.5)), ("Ease", "ease", (0.16, 0.30, 0.55)), ("EaseIn", "ease-in", (0.20, 0.45, 0.65)),
         ("EaseOut", "ease-out", (0.16, 0.55, 0.55)), ("EaseInOut", "ease-in-out", (0.25, 0.55, 0.30)),
         ("Back", (0.68, -0.6, 0.32, 1.6), (0.72, 0.55, 0.20)), ("Smoother", "smootherstep", (0.75, 0.40, 0.20)),
         ("Elastic", "elastic-out", (0.70, 0.25, 0.25)), ("Bounce", "bounce-out", (0.50, 0.25, 0.50)))
WIDE, HIGH = 0.8, 0.8                     # of a lane [m]


def lane(k: int) -> tuple[float, float]:
    return 1.15 * (k % 3 - 1), 1.45 * (2 - k // 3) + 0.75


def easing_chart() -> str:
    """Nine balls go along the graphs of nine easings, each with a ribbon."""
    times, parts = np.array([0.5, 3.0]), []
    for k, (name, easing, color) in enumerate(LANES):
        x, y = lane(k)
        along = Curve(times, [x - 0.5 * WIDE, x + 0.5 * WIDE], "linear")
        up = Curve(times, [y, y + HIGH], "eased", easing=easing)
        parts += [graph(name, along, up, color), ball(name, along, up, color, k == 0)]
        ribbon = shapes.sheet(0.1, 0.42, 2, 8, at=(along.values[0], y - 0.25, 0.0))
        parts += [cloth(f"Ribbon{name}", ribbon, "silk", color, "Hangs on the ball." if k == 0 else ""),
                  pin(f"Hold{name}", f"/World/Ribbon{name}", np.arange(3), f"/World/Ball{name}",
                      "The upper edge." if k == 0 else "")]
    return scene("Nine easings: balls that go along their graphs in 2.5 s, with ribbons that say how suddenly.", [
        settings(substeps=32, iterations=2, air_drag=1.0, comment="Ribbons show accelerations: they lag behind what hurries."),
        material("silk", damping=3e-4), *parts,
        block("Camera", "Camera", "float focalLength = 50\n" + moved(0.0, 2.45, 14.5),
              comment="From the front, so that the graphs are graphs.")], frames=FRAMES)


def graph(name: str, along: Curve, up: Curve, color) -> str:
    t = np.linspace(*along.times, 61)
    points = np.stack([along.sampled(t), up.sampled(t), np.full(61, -0.03)], 1)
    body = (f"int[] curveVertexCounts = [61]\npoint3f[] points = {listed(points)}\nuniform token type = \"linear\"\n"
            f"float3[] extent = {listed(np.array([points.min(axis=0) - 0.006, points.max(axis=0) + 0.006]))}\n"
            "float[] widths = [0.012] (\n    interpolation = \"constant\"\n)\n"
            f"color3f[] primvars:displayColor = [({', '.join(number(0.5 + 0.5 * c) for c in color)})]")
    return block("BasisCurves", f"Graph{name}", body)


def ball(name: str, along: Curve, up: Curve, color, first: bool) -> str:
    """Its place by splines; of an easing that is none, by samples with their kind beside them."""
    rises = spline("xformOp:translateY",
                   up) if spline_from_curve(up, StageUnits(fps=FPS)) is not None else sampled("xformOp:translateY", up)
    body = (f"double radius = 0.045\n{spline('xformOp:translateX', along)}\n{rises}\n"
            f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]\n"
            + ops("xformOp:translateX", "xformOp:translateY"))
    return block("Sphere", f"Ball{name}", body, comment="Evenly to the right, and up as the easing has it: handles of a "
                 "spline are those of CSS. Elastic, Bounce and Smoother are no splines of two keys: they have samples for all, "
                 "and what they are as custom data for wsim." if first else "")


def sampled(attribute: str, curve: Curve) -> str:
    how = {"kind": curve.kind, "before": curve.before, "after": curve.after, **curve.how}
    codes = np.unique(np.concatenate([curve.times * FPS, np.arange(curve.times[0] * FPS, curve.times[-1] * FPS)]))
    rows = "\n".join(f"    {number(c)}: {v:.9g}," for c, v in zip(codes, curve.sampled(codes / FPS), strict=True))
    keys = ", ".join(number(t) for t in curve.times)
    said = json.dumps(how).replace('"', '\\"')
    return (f"double {attribute} (\n    customData = {{\n        dictionary wsim = {{\n            string curve = \"{said}\"\n"
            f"            double[] times = [{keys}]\n        }}\n    }}\n)\n"
            f"double {attribute}.timeSamples = {{\n{rows}\n}}")


ANIMATION_SCENES = {"camera_path": camera_path, "easing_chart": easing_chart}
