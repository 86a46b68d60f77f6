"""Example scenes of rods: hair on a shaken head, a knot that is pulled tight, a rope that falls into a cloth, a bridge."""

import numpy as np

from tools.scenes.cloth import cloth
from tools.scenes.cloth import material as fabric
from tools.scenes.rigid import WOOD, body
from tools.scenes.soft import eased, samples
from tools.usda import block, listed, number, pin, said, scene, settings, solid
from wsim.scene import shapes

STRANDS, POINTS, FOLLOWERS = 100, 18, (260, 9)
HEAD, RADIUS, LENGTH = np.array([0.0, 0.3, 0.0]), 0.1, 0.24


def golden(n: int, least: float) -> np.ndarray:
    """Directions (n, 3) spread evenly over the part of a sphere with y above `least`."""
    k = np.arange(n) + 0.5
    y = 1.0 - (1.0 - least) * k / n
    turn = np.pi * (1.0 + 5.0**0.5) * k
    out = np.sqrt(1.0 - y * y)
    return np.stack([out * np.cos(turn), y, out * np.sin(turn)], axis=1)


def combed(strands: int, points: int) -> np.ndarray:
    """Hairs on a head, combed down and out, (strands, points, 3) [m]."""
    n = golden(strands, 0.05)
    s = np.linspace(0.0, 1.0, points)[None, :, None]
    out = n * (1.0, 0.0, 1.0) / np.linalg.norm(n * (1.0, 0.0, 1.0), axis=1, keepdims=True)
    down = (out * 0.25 - (0.0, 1.0, 0.0))[:, None]
    return HEAD + n[:, None] * (RADIUS - 0.004 + 0.5 * LENGTH * s * (2.0 - s)) + 0.5 * LENGTH * s**2 * down


def shaken_head() -> str:
    points, hairs = combed(STRANDS, POINTS), combed(*FOLLOWERS)
    edge = np.arange(STRANDS) * POINTS
    keys = [(f, 55.0 * np.sin(2.0 * np.pi * (f - 12) / 16.0) * min((f - 12) / 8.0, (76 - f) / 8.0, 1.0))
            for f in range(12, 77, 2)]
    turn = "".join(f"    {f}: {number(a)},\n" for f, a in [(0, 0.0), *keys])
    head = ("double3 xformOp:translate = (0, 0.3, 0)\ndouble xformOp:rotateY.timeSamples = {\n" + turn + "}\n"
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]\n'
            + solid("Sphere", "Skull", f"double radius = {RADIUS}", (0.82, 0.66, 0.54)))
    material = block("Material", "hair", "\n".join([
        said("RodMaterial", 1.0, young=5e7, poisson=0.3), said("Friction", 1.0, density=1300.0, static_friction=0.3,
                                                               dynamic_friction=0.3)]),
        '["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"]',
        "Strands are tufts of hairs, 1.5 mm thick; a single hair is 0.08 mm thick and 60 times stiffer.")
    curves = "\n".join([
        'uniform token type = "linear"', f"int[] curveVertexCounts = {listed(np.full(STRANDS, POINTS))}",
        f"point3f[] points = {listed(points.reshape(-1, 3))}", "float[] widths = [0.0015] (interpolation = \"constant\")",
        "float[] physics:thicknesses = [0.0015]    # m", "rel material:binding:physics = </World/hair>",
        "color3f[] primvars:displayColor = [(0.22, 0.11, 0.05)]"])
    follow = "\n".join([
        'uniform token type = "linear"', f"int[] curveVertexCounts = {listed(np.full(*FOLLOWERS))}",
        f"point3f[] points = {listed(hairs.reshape(-1, 3).round(4))}",
        "float[] widths = [0.001] (interpolation = \"constant\")", "rel wsim:guides = </World/Hair>",
        "color3f[] primvars:displayColor = [(0.27, 0.14, 0.06)]"])
    return scene("Hair on a head that is shaken.", [
        settings(), material, block("Xform", "Head", head, comment="It turns to and fro, three times in two seconds."),
        block("BasisCurves", "Hair", curves,
              '["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "MaterialBindingAPI"]',
              "A curve a strand, in the shape in which it is without strain."),
        block("BasisCurves", "Follow", follow, '["WsimRodsAPI"]', "Not simulated: each goes along with the three whose roots "
              "are nearest."),
        pin("Roots", "/World/Hair", np.sort(np.concatenate([edge, edge + 1])), "/World/Head",
            "The first two points of every strand go with the head: it is clamped there, and its twist too."),
    ], frames=96)


def overhand(edge: float) -> np.ndarray:
    """An open overhand knot of 24 cm in edges of that length [m], its ends 1.1 m apart along x, (n, 3).

    Shastri's curve (t^3 - 3 t, t^4 - 4 t^2), which crosses itself at t = +-sqrt(3) and at two pairs of +-1.932, -+0.518, over
    and under in turn; its ends turn into x."""
    t, at = np.linspace(-2.02, 2.02, 4000), np.array([-2.1, -1.932, -1.732, -0.518, 0.518, 1.732, 1.932, 2.1])
    high = np.array([0.0, -0.5, 0.5, -0.5, 0.5, -0.5, 0.5, 0.0])
    k = np.clip(np.searchsorted(at, t) - 1, 0, len(at) - 2)
    part = 0.5 - 0.5 * np.cos(np.pi * (t - at[k]) / (at[k + 1] - at[k]))
    body = np.stack([t**3 - 3.0 * t, t**4 - 4.0 * t**2, high[k] + part * (high[k + 1] - high[k])], axis=1)
    s = np.linspace(0.0, 5.0, 2000)[1:]
    way = body[-1] - body[-2]
    angle = np.maximum(np.arctan2(way[1], way[0]) - s, 0.0)
    tail = np.stack([np.cumsum(np.cos(angle)) * s[0], np.cumsum(np.sin(angle)) * s[0],
                     body[-1, 2] * (0.5 + 0.5 * np.cos(np.pi * np.minimum(0.5 * s, 1.0)) - 1.0)], axis=1)
    right = body[-1] + tail
    return evenly(0.05 * np.concatenate([(right * (-1.0, 1.0, -1.0))[::-1], body, right]), edge)


def evenly(curve: np.ndarray, edge: float) -> np.ndarray:
    """A curve (m, 3) in edges of that length or a little more [m], (n, 3)."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    places = np.linspace(0.0, along[-1], int(along[-1] / edge) + 1)
    return np.stack([np.interp(places, along, curve[:, c]) for c in range(3)], axis=1)


def rope_knot() -> str:
    thick, frames = 0.012, 96
    x = overhand(1.02 * thick)
    n = len(x)
    x[:, 1] += 0.4 - x[0, 1]
    straight = np.zeros_like(x)
    straight[:, 0] = np.arange(n) * np.linalg.norm(x[1] - x[0])
    curves = "\n".join([
        'uniform token type = "linear"', f"int[] curveVertexCounts = [{n}]", f"point3f[] points = {listed(x)}",
        f"normal3f[] normals = {listed(untwisted(x))}", f"point3f[] physics:restShapePoints = {listed(straight)}",
        f'float[] widths = [{thick}] (interpolation = "constant")', f"float[] physics:thicknesses = [{thick}]    # m",
        said("Rods", 1.0, self_collision=True), "rel material:binding:physics = </World/cord>",
        "color3f[] primvars:displayColor = [(0.78, 0.6, 0.32)]"])

    def grip(name: str, end: int, side: float) -> str:
        keys = [(f, (float(x[end, 0]) + side * 0.42 * eased(f, 6, 78), float(x[end, 1]), 0.0)) for f in range(0, frames + 1, 3)]
        return block("Xform", name, samples("double3", "xformOp:translate", keys)
                     + '\nuniform token[] xformOpOrder = ["xformOp:translate"]', comment="A hand that pulls.")
    material = block("Material", "cord", "\n".join([
        said("RodMaterial", 1.0, young=1e7, poisson=0.3, bend=5e-4, twist=5e-4),
        said("Friction", 1.0, density=900.0, static_friction=0.15, dynamic_friction=0.15)]),
        '["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"]', "Softer in bending than a solid rod is: strands slide.")
    return scene("An overhand knot in a rope is pulled tight.", [
        settings(substeps=8), material, grip("Left", 0, -1.0), grip("Right", -1, 1.0),
        block("BasisCurves", "Rope", curves,
              '["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "WsimRodsAPI", "MaterialBindingAPI"]',
              "1.7 m, 12 mm thick, straight at rest. wsim:selfCollision: it does not pass through itself."),
        pin("LeftEnd", "/World/Rope", [0, 1], "/World/Left", "Its first edge."),
        pin("RightEnd", "/World/Rope", [n - 2, n - 1], "/World/Right", "Its last edge."),
    ], frames=frames)


def untwisted(x: np.ndarray) -> np.ndarray:
    """A director of each edge of a curve (n, 3) that goes along without twist; the last point's is that before."""
    t = np.diff(x, axis=0)
    t /= np.linalg.norm(t, axis=1)[:, None]
    found = [np.cross(t[0], (0.0, 0.0, 1.0))]
    for a, b in zip(t[:-1], t[1:], strict=True):
        m, k = found[-1], np.cross(a, b)
        m = m + np.cross(k, m) + np.cross(k, np.cross(k, m)) / (1.0 + a @ b)
        found.append(m - b * (m @ b))
    return np.array([*found, found[-1]])


def rope_on_cloth() -> str:
    thick, cells, side = 0.014, 24, 0.6
    surface = shapes.sheet(side, side, cells, cells, horizontal=True, at=(0.0, 0.5, 0.0))
    last = cells * (cells + 1)
    corners = [k for c, row, beside in ((0, 1, 1), (cells, 1, -1), (last, -1, 1), (last + cells, -1, -1))
               for k in (c, c + beside, c + row * (cells + 1))]
    s = np.linspace(0.0, 1.0, 2000)
    turn, radius = 2.0 * np.pi * 2.2 * s, 0.07 + 0.1 * s                              # a loose coil, which rises
    x = evenly(np.stack([radius * np.cos(turn), 0.58 + 0.12 * s, radius * np.sin(turn)], axis=1), 0.02)
    curves = "\n".join([
        'uniform token type = "linear"', f"int[] curveVertexCounts = [{len(x)}]", f"point3f[] points = {listed(x.round(5))}",
        f'float[] widths = [{thick}] (interpolation = "constant")', f"float[] physics:thicknesses = [{thick}]    # m",
        said("Rods", 1.0, self_collision=True), "rel material:binding:physics = </World/cord>",
        "color3f[] primvars:displayColor = [(0.78, 0.6, 0.32)]"])
    cord = block("Material", "cord", "\n".join([
        said("RodMaterial", 1.0, young=5e6, poisson=0.3, bend=2e-4, twist=2e-4),
        said("Friction", 1.0, density=900.0, static_friction=0.4, dynamic_friction=0.4)]),
        '["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"]')
    return scene("A coil of rope falls into a cloth that hangs by its corners.", [
        settings(solver="xpbd", substeps=16, iterations=6, air_drag=0.5), cord, fabric("cotton", damping=1e-4),
        cloth("Cloth", surface, "cotton", (0.3, 0.42, 0.6), "60 x 60 cm. wsim:selfCollision: rods that say so too do not pass "
              "through it.", self_collision=True),
        block("BasisCurves", "Rope", curves,
              '["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "WsimRodsAPI", "MaterialBindingAPI"]',
              "1.7 m, 14 mm thick. wsim:selfCollision: it passes neither through the cloth nor through itself."),
        block("Xform", "Frame", "", comment="What the corners hang on."),
        pin("Corners", "/World/Cloth", corners, "/World/Frame", "All four, three points of each."),
    ], frames=72)


def rope_bridge() -> str:
    planks, each, half = 14, 0.2, 0.4
    n, middle = 3 * planks + 1, each * (np.arange(planks) - 0.5 * (planks - 1))
    x = np.linspace(-0.5, 0.5, n) * planks * each

    def height(at):
        return 1.0 - 0.35 * (1.0 - (at / x[-1]) ** 2)
    ropes = np.concatenate([np.stack([x, height(x), np.full(n, z)], axis=1) for z in (-half, half)])
    under = middle[planks // 2 - 1]
    hangs = np.stack([np.full(9, under), height(under) - 0.035 - np.linspace(0.0, 0.4, 9), np.zeros(9)], axis=1)

    def curves(name: str, points: np.ndarray, counts: list[int], thick: float, comment: str) -> str:
        return block("BasisCurves", name, "\n".join([
            'uniform token type = "linear"', f"int[] curveVertexCounts = {listed(counts)}",
            f"point3f[] points = {listed(points)}", f'float[] widths = [{thick}] (interpolation = "constant")',
            f"float[] physics:thicknesses = [{thick}]    # m", "rel material:binding:physics = </World/cord>",
            "color3f[] primvars:displayColor = [(0.78, 0.6, 0.32)]"]),
            '["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "MaterialBindingAPI"]', comment)

    def tie(k: int) -> str:
        a, b = 3 * k + 1, 3 * k + 2
        return pin(f"Tie{k:02d}", "/World/Ropes", [a, b, n + a, n + b], f"/World/Plank{k:02d}",
                   "Attachments to rigid bodies hold both ways: planks hang on the ropes." * (k == 0))

    def post(k: int, a: float, b: float) -> str:
        at = f"double3 xformOp:translate = ({number(a)}, 0.96, {number(b)})"
        return solid("Cube", f"Post{k}", f'double size = 0.16\n{at}\nuniform token[] xformOpOrder = ["xformOp:translate"]',
                     (0.4, 0.33, 0.27))
    cord = block("Material", "cord", "\n".join([
        said("RodMaterial", 1.0, young=2e8, poisson=0.3, bend=0.01, twist=0.01, damping=0.02),
        said("Friction", 1.0, density=800.0)]),
        '["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI", "WsimMaterialAPI"]')
    floor = [body(("Cube", f"Plank{k:02d}", "double size = 1"), (a, height(a) - 0.02, 0.0), WOOD[k % 3],
                  size=(0.16, 0.03, 0.9), known=(1.5, 0.0)) for k, a in enumerate(middle)]
    posts = [post(2 * k + m, a, b) for k, a in enumerate((x[0] - 0.1, x[-1] + 0.1)) for m, b in enumerate((-half, half))]
    return scene("A bridge of planks on two ropes bears a ball, and a weight that hangs on it.", [
        settings(substeps=8, iterations=12), cord, block("Xform", "Posts", "".join(posts)), *floor,
        curves("Ropes", ropes, [n, n], 0.02, "Two ropes of 2.9 m."), curves("Cord", hangs, [9], 0.012, "40 cm, below a plank."),
        pin("Ends", "/World/Ropes", [0, n - 1, n, 2 * n - 1], "/World/Posts", "Both ends of both."), *map(tie, range(planks)),
        pin("Knot", "/World/Cord", [0], f"/World/Plank{planks // 2 - 1:02d}", "Its upper end, below the plank."),
        pin("Hook", "/World/Cord", [8], "/World/Weight", "Its lower end."),
        body(("Sphere", "Weight", "double radius = 0.1"), hangs[-1] - (0.0, 0.1, 0.0), (0.35, 0.37, 0.42), known=(20.0, 0.0),
             more="vector3f physics:velocity = (0, 0, 1.2)\n", comment="It swings at first."),
        body(("Sphere", "Ball", "double radius = 0.15"), (-0.9, 1.04, 0.05), (0.16, 0.3, 0.55), known=(8.0, 0.0)),
    ], frames=120)


ROD_SCENES = {"shaken_head": shaken_head, "rope_knot": rope_knot, "rope_on_cloth": rope_on_cloth, "rope_bridge": rope_bridge}
