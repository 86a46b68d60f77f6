"""The example scenes of soft bodies; python -m tools.scenes writes them."""

import tempfile
from math import pi, sin
from pathlib import Path

import numpy as np

from tools.scenes.cloth import cloth
from tools.scenes.cloth import material as fabric_material
from tools.usda import block, ground, listed, moved, number, pin, said, scene, settings, solid
from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.scene import shapes
from wsim.scene.solid import Bulk
from wsim.usd import load
from wsim.usd.new.softbody import author_softbody

BODY = '["PhysicsDeformableBodyAPI", "PhysicsVolumeDeformableSimAPI", "PhysicsCollisionAPI", "WsimSoftAPI", ' \
       '"MaterialBindingAPI"]'
ASSETS = Path(__file__).resolve().parents[2] / "scenes" / "assets"
CHOSEN = "wsim chooses short explicit steps where those cost less, as many as are stable. "
MATERIAL = '["PhysicsMaterialAPI", "PhysicsVolumeDeformableMaterialAPI", "WsimMaterialAPI"]'
STEPS = "Implicit steps: long ones are stable, a second Newton step solves what the first left. "


def material(name: str, bulk: Bulk, comment: str) -> str:
    """The Material of a solid: what differs from the defaults of `Bulk`, and what the proposal has without them."""
    plain = ("young", "poisson", "density", "static_friction", "dynamic_friction")
    own = [f for f in ("model", "damping") if getattr(bulk, f) != getattr(Bulk(), f)]
    return block("Material", name, said("Bulk", 1.0, **{f: getattr(bulk, f) for f in (*plain, *own)}), MATERIAL, comment)


def looks(name: str, color) -> str:
    return (f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]\n"
            f"rel material:binding:physics = </World/{name}>")


def solid_block(name: str, size, cells, of: str, color, comment: str, place: str = "", at=(0.0, 0.0, 0.0)) -> str:
    """A soft box: its tets, and the triangles of its surface, which viewers draw."""
    points, tets = shapes.block(size, cells, at=at)
    body = "\n".join(filter(None, [
        f"float3[] extent = {listed(np.array([points.min(axis=0), points.max(axis=0)]))}",
        f"point3f[] points = {listed(points)}",
        f"int4[] tetVertexIndices = {listed(tets)}", f"int3[] surfaceFaceVertexIndices = {listed(tet_surface_triangles(tets))}",
        looks(of, color), place]))
    return block("TetMesh", name, body, BODY, comment)


def samples(kind: str, attribute: str, keys) -> str:
    """An attribute over time; keys: (frame, value or values)."""
    def text(value) -> str:
        return f"({', '.join(number(v) for v in value)})" if np.ndim(value) else number(value)
    return f"{kind} {attribute}.timeSamples = {{\n" + "".join(f"    {f}: {text(v)},\n" for f, v in keys) + "}"


def eased(frame: float, first: float, last: float) -> float:
    """0 before the frame `first`, 1 after `last`, smooth between."""
    s = min(max((frame - first) / (last - first), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


def cantilever() -> str:
    nx, ny, nz = 16, 4, 4
    wall = "double size = 1\nfloat3[] extent = [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]\nfloat3 xformOp:scale = (0.2, 2, 2)\n" \
           + moved(-0.1, 2, 0, "xformOp:scale") + "\ncolor3f[] primvars:displayColor = [(0.55, 0.56, 0.6)]"
    rubber = Bulk(young=1e7, density=1000.0, damping=0.15)
    return scene("A bar of 4 x 1 x 1 m, fixed in a wall at one end, bends under its own weight.", [
        settings(comment=STEPS, substeps=2, iterations=2),
        material("Rubber", rubber, "Theory of beams (Timoshenko) has the end sink by rho g A L^4 / (8 E I) + rho g L^2 / "
                 "(2 k G) = 38 + 2 cm; linear tets, four across, give 86 % of it. Damping is what brings it to rest."),
        solid_block("Bar", (4.0, 1.0, 1.0), (nx, ny, nz), "Rubber", (0.85, 0.4, 0.05),
                    "16 x 4 x 4 cells of five tets. Four cells across is the least that bends as it should.",
                    at=(2.0, 2.0, 0.0)),
        block("Cube", "Wall", wall, comment="What the end hangs on, and to be seen: it has no PhysicsCollisionAPI."),
        pin("Clamp", "/World/Bar", np.arange((ny + 1) * (nz + 1)), "/World/Wall", "The points of the end at x = 0."),
    ], frames=72)


def twist() -> str:
    nx, ny, nz = 32, 4, 4
    end = (ny + 1) * (nz + 1)
    turn = [(f, (0.0, 0.0, 0.0) if f == 0 else (360.0 * eased(f, 6, 66), 0.0, 0.0)) for f in range(0, 73, 3)]
    grip = samples("float3", "xformOp:rotateXYZ", turn) + "\n" + moved(0.4, 0.5, 0, "xformOp:rotateXYZ")
    return scene("A rubber bar is twisted by a full turn: one end is held, the other turns with an animated Xform.", [
        settings(comment=STEPS, substeps=6, iterations=2),
        material("Rubber", Bulk(young=1e6, poisson=0.45, density=1000.0, model="neo_hookean", damping=0.005),
                 "Twisted like this, Neo-Hookean loses 3 % of its volume (K is 9.7 G at nu = 0.45); corotational loses 12 %."),
        solid_block("Bar", (0.8, 0.2, 0.2), (nx, ny, nz), "Rubber", (0.75, 0.1, 0.06), "80 x 20 x 20 cm.", at=(0.0, 0.5, 0.0)),
        block("Xform", "Left", moved(-0.4, 0.5, 0), comment="Stays."),
        block("Xform", "Right", grip, comment="Turns about the bar's axis, x, and then rests. Viewers interpolate angles "
              "between the keys, and so does wsim."),
        pin("Held", "/World/Bar", np.arange(end), "/World/Left", "The end at the least x."),
        pin("Turned", "/World/Bar", nx * end + np.arange(end), "/World/Right", "The other end."),
    ], frames=96)


def bear() -> str:
    own = "\n".join([looks("Jelly", (0.5, 0.22, 0.08)), "float3 xformOp:rotateXYZ = (0, -25, 0)",
                     "float3 xformOp:scale = (0.1, 0.1, 0.1)", moved(0, 0.05, 0, 'xformOp:rotateXYZ", "xformOp:scale')])
    mesh = block("TetMesh", "Bear", own, BODY, "The bear as it was delivered: bare tets in another file, untouched, ten metres "
                 "long; a scale makes it one metre. What makes it a soft body is authored here, over the reference.")
    there = "prepend references = @assets/bear_tet.usdc@</root/bear>\n    "
    mesh = mesh.replace("prepend apiSchemas", there + "prepend apiSchemas", 1)
    return scene("A bear of firm jelly drops on its feet, trembles and stands.", [
        settings(comment=CHOSEN, substeps=8, iterations=2),
        material("Jelly", Bulk(young=1e6, poisson=0.4, density=1000.0, static_friction=0.6, dynamic_friction=0.5), "E = 1 "
                 "MPa, as soft rubber: its legs carry it. At 200 kPa they give way. Nothing damps it: it trembles on."),
        mesh, ground(),
    ], frames=96)


def squeezed_cube() -> str:
    keys = range(0, 97, 3)
    close = {f: 0.10 * eased(f, 3, 27) - 0.14 * eased(f, 60, 72) for f in keys}
    lift = {f: 0.35 * sin(0.5 * pi * eased(f, 30, 54)) for f in keys}

    def plate(name: str, side: int, comment: str) -> str:
        path = samples("double3", "xformOp:translate", [
            (f, (side * (0.25 + 0.03 + 0.001 - close[f]), 0.3 + lift[f], 0.0)) for f in keys])
        body = ("double size = 1\nfloat3[] extent = [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]\n"
                f"float3 xformOp:scale = (0.06, 0.5, 0.7)\n{path}\n"
                'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n'
                "rel material:binding:physics = </World/Grip>")
        return solid("Cube", name, body, comment=comment, apis=', "MaterialBindingAPI"')

    friction = ("float physics:staticFriction = 1\nfloat physics:dynamicFriction = 0.9")
    return scene("Two plates squeeze a soft cube, lift it by friction, and let it fall.", [
        settings(comment=CHOSEN, substeps=8, iterations=2),
        material("Foam", Bulk(young=2e4, poisson=0.35, density=60.0, static_friction=1.0, dynamic_friction=0.9, damping=0.005),
                 "A foam of 60 kg/m^3: the cube weighs 7.5 kg."),
        block("Material", "Grip", friction, '["PhysicsMaterialAPI"]', "Rubber-faced plates."),
        solid_block("Cube", (0.5, 0.5, 0.5), (6, 6, 6), "Foam", (0.8, 0.3, 0.04), "50 cm, six cells a side.",
                    at=(0.0, 0.25, 0.0)),
        plate("Left", -1, "A box collider that moves: it closes by 10 cm, rises, and opens. Squeezed by 40 % the cube presses "
              "with 2 kN on each plate, and friction carries its 74 N."),
        plate("Right", 1, "The mirror image."),
        ground(),
    ], frames=96)


def trampoline() -> str:
    side, n, above = 0.4, 16, 0.8
    points, _ = shapes.block((side,) * 3, (4, 4, 4), at=(0.0, above + 0.5 * side, 0.0))
    surface = shapes.sheet(1.6, 1.6, n, n, horizontal=True, at=(0.0, above, 0.0))
    away = np.linalg.norm(surface[0][:, None] - points[None], axis=2)
    shared = np.flatnonzero(away.min(axis=1) < 1e-6)
    rim = np.flatnonzero(np.abs(surface[0]).max(axis=1, where=[True, False, True], initial=0.0) > 0.799)
    tie = "\n".join(["rel physics:src0 = </World/Sheet>", f"int[] physics:indices0 = {listed(shared)}",
                     'uniform token physics:type0 = "point"', "rel physics:src1 = </World/Jelly>",
                     f"int[] physics:indices1 = {listed(away.argmin(axis=1)[shared])}",
                     'uniform token physics:type1 = "point"'])
    return scene("A cube of jelly bounces on a sheet of rubber, with which it shares the points of its lower side.", [
        settings(comment=CHOSEN, substeps=8, iterations=2),
        material("Gel", Bulk(young=3e4, poisson=0.4, density=300.0), "E = 30 kPa: a pudding of 19 kg."),
        fabric_material("rubber"),
        solid_block("Jelly", (side,) * 3, (4, 4, 4), "Gel", (0.75, 0.3, 0.05), "40 cm, four cells a side.",
                    at=(0.0, above + 0.5 * side, 0.0)),
        cloth("Sheet", surface, "rubber", (0.2, 0.32, 0.52), "1.6 m square, 1 mm thick."),
        block("PhysicsAttachment", "Laid", tie, comment="Point to point: each pair is one particle, with the mass and the "
              "forces of both."),
        block("Xform", "Frame", "", comment="Where the rim is held."),
        pin("Rim", "/World/Sheet", rim, "/World/Frame", "All points of the sheet's edge."),
    ], frames=72)


def bunny() -> str:
    with tempfile.TemporaryDirectory() as folder:            # the cage that `wsim new softbody` makes, in the bunny's own frame
        made = Path(folder) / "cage.usda"
        author_softbody(ASSETS / "bunny.usd", made, cells=8)
        cage = load(made).softs[0]
    points = cage.motion.points(cage.points)
    tets = "\n".join(['uniform token purpose = "guide"',
                      f"float3[] extent = {listed(np.array([points.min(axis=0), points.max(axis=0)]))}",
                      f"point3f[] points = {listed(points)}", f"int4[] tetVertexIndices = {listed(cage.tets)}",
                      f"int3[] surfaceFaceVertexIndices = {listed(tet_surface_triangles(cage.tets))}",
                      f"float[] wsim:filled = {listed(np.round(cage.filled, 3))}",
                      "rel material:binding:physics = </World/Jelly>"])
    look = block("Mesh", "Look", "color3f[] primvars:displayColor = [(0.62, 0.3, 0.2)]", comment="The bunny as it was "
                 "delivered, untouched: what is seen. Each of its points follows the tet it lies in.")
    look = look.replace('def Mesh "Look"', 'def "Look" (\n    prepend references = @assets/bunny.usd@</root/bunny>\n)', 1)
    place = ("float3 xformOp:rotateXYZ = (0, -20, 12)\nfloat3 xformOp:scale = (0.5, 0.5, 0.5)\n"
             + moved(-0.05, 0.75, 0, 'xformOp:rotateXYZ", "xformOp:scale'))
    body = BODY.replace('"PhysicsDeformableBodyAPI", ', "")
    cage_prim = block("TetMesh", "Cage", tets, body, "What is simulated: cells of a lattice around the mesh, of which "
                      "wsim:filled says how much is bunny (`wsim new softbody` makes both).")
    step = ("double size = 1\nfloat3[] extent = [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]\n"
            "float3 xformOp:scale = (0.5, 0.3, 0.7)\n" + moved(-0.22, 0.15, 0, "xformOp:scale"))
    return scene("A bunny of jelly in a cage of tets falls on a step, askew, and tumbles to the floor.", [
        settings(comment=CHOSEN, substeps=8, iterations=2),
        material("Jelly", Bulk(young=3e5, poisson=0.4, density=1000.0, damping=1e-3, static_friction=0.6, dynamic_friction=0.5),
                 "E = 300 kPa: a firm jelly sweet; a damping time of 1 ms takes the trembling."),
        block("Xform", "Bunny", place + "\n" + look + cage_prim, '["PhysicsDeformableBodyAPI"]'),
        solid("Cube", "Step", step, (0.42, 0.5, 0.52), "50 x 30 x 70 cm."), ground(),
    ], frames=72)


SOFT_SCENES = {"cantilever": cantilever, "twist": twist, "bear": bear, "bunny": bunny, "squeezed_cube": squeezed_cube,
               "trampoline": trampoline}
