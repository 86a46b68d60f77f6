"""The example scenes of rigid bodies; python -m tools.scenes writes them."""

from math import cos, degrees, sin

import numpy as np

from tools.scenes.cloth import cloth, material
from tools.usda import block, ground, number, pin, said, scene, settings
from wsim.scene import shapes

APIS = '["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]'
STEPS = "Contacts are soft with a frequency of a quarter of the steps': short steps make them stiff; iterations are sweeps."
WOOD = [(0.72, 0.45, 0.25), (0.80, 0.56, 0.32), (0.60, 0.36, 0.20)]


def body(prim: tuple[str, str, str], at, color, turn: float = 0.0, size=(1.0, 1.0, 1.0), more: str = "",
         comment: str = "", known: tuple[float, float] = (0.0, 0.0)) -> str:
    """A rigid body that is its own collider, turned about y [degrees]; prim: its type, name and sizes; known: mass [kg], 0 for
    1000 kg/m^3, and the thickness [m] that is kept free around it."""
    mass, keep = known
    kind, name, sizes = prim
    place = (f"double3 xformOp:translate = ({', '.join(number(v) for v in at)})\n"
             f"double xformOp:rotateY = {number(turn)}\n"
             f"double3 xformOp:scale = ({', '.join(number(v) for v in size)})\n"
             'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY", "xformOp:scale"]\n')
    colour = f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]"
    apis = APIS
    if mass:
        apis, more = APIS[:-1] + ', "PhysicsMassAPI"]', f"float physics:mass = {number(mass)}\n" + more
    if keep:
        apis, more = apis[:-1] + ', "WsimColliderAPI"]', said("Collider", 1.0, thickness=keep) + "\n" + more
    return block(kind, name, sizes + "\n" + place + more + colour, apis, comment)


def dominoes() -> str:
    """Along a bend of 3 m radius, 24 cm apart."""
    radius, gap, parts = 3.0, 0.24, []
    for k in range(30):
        a = k * gap / radius
        at = (radius * sin(a) - 2.0, 0.3, radius * (1.0 - cos(a)) - 1.0)
        parts.append(body(("Cube", f"Domino{k}", "double size = 1"), at, WOOD[k % 3], -degrees(a), (0.08, 0.6, 0.3),
                          comment="A Cube of size 1, scaled. What is no mass or density here weighs 1000 kg/m^3, as USD has it."
                          if k == 0 else ""))
    ball = body(("Sphere", "Ball", "double radius = 0.15"), (-3.0, 0.15, -1.0), (0.16, 0.30, 0.55),
                more="vector3f physics:velocity = (1.5, 0, 0)\n", comment="Rolls against the first.")
    return scene("Thirty dominoes along a bend, pushed over by a ball.", [
        settings(substeps=20, iterations=4, comment=STEPS), ground(), ball, *parts], frames=144)


def pyramid() -> str:
    """Of ten rows of boxes of 20 cm."""
    side, rows = 0.2, 10
    parts = [body(("Cube", f"Box{row}_{k}", "double size = 0.2"),
                  (side * (k + 0.5 * (row + 1 - rows)), side * (row + 0.5), 0.0), WOOD[(row + k) % 3])
             for row in range(rows) for k in range(rows - row)]
    radius, speed = 0.3, 5.0
    rolls = (f"vector3f physics:velocity = (0, 0, {number(speed)})\n"
             f"vector3f physics:angularVelocity = ({number(degrees(speed / radius))}, 0, 0)\n")
    ball = body(("Sphere", "Ball", f"double radius = {radius:g}"), (0.1, radius, -4.0 * speed), (0.16, 0.30, 0.55), more=rolls,
                comment="Rolls, without slip, and arrives after 4 s. Angular velocities are in degrees a second.")
    return scene("A pyramid of ten rows of boxes stands, and is hit by a ball that rolls, after 4 s.", [
        settings(substeps=20, iterations=4, comment=STEPS), ground(), *parts, ball], frames=144)


def humanoid() -> str:
    """Of the assets, over two steps; it is Z up there."""
    place = ("double3 xformOp:translate = (0, 2.1, 0)\n"
             "double xformOp:rotateZ = 20\n"
             "double xformOp:rotateX = -90\n"
             'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ", "xformOp:rotateX"]\n')
    man = block("Xform", "Humanoid", place, comment="16 bodies, 38 shapes, and joints with limits and drives, which act as "
                "springs; its collision groups say which parts touch. Turned from Z up.")
    man = man.replace('def Xform "Humanoid"', 'def Xform "Humanoid" (\n    prepend references = @assets/humanoid.usda@\n)', 1)
    steps = [block("Cube", f"Step{k}", "double size = 1\n"
                   f"double3 xformOp:translate = ({number(0.3 - 0.5 * k)}, {number(0.2 - 0.1 * k)}, 0)\n"
                   f"double3 xformOp:scale = (0.5, {number(0.4 - 0.2 * k)}, 1.6)\n"
                   'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n'
                   "color3f[] primvars:displayColor = [(0.62, 0.64, 0.68)]", '["PhysicsCollisionAPI"]')
             for k in (0, 1)]
    return scene("A humanoid of sixteen bodies falls on two steps.", [
        settings(substeps=20, iterations=4, comment=f"{STEPS} Joints are solved at once."), ground(), *steps, man], frames=96)


def ball_into_cloth() -> str:
    n, height = 32, 1.0
    surface = shapes.sheet(1.6, 1.6, n, n, horizontal=True, at=(0.0, height, 0.0))
    rim = np.flatnonzero(np.abs(surface[0][:, [0, 2]]).max(axis=1) > 0.799)
    return scene("Two balls and a box fall into a sheet that is held by its rim: each gives the other what it takes.", [
        settings(substeps=40, iterations=2, air_drag=0.5, comment="The heavy ball weighs six times the sheet, the light one a "
                 "tenth."),
        material("denim"),
        cloth("Sheet", surface, "denim", (0.2, 0.32, 0.52), "1.6 m square; bodies meet its points, and it meets "
                           "their shapes."),
        block("Xform", "Frame", "", comment="Where the rim is held."),
        pin("Rim", "/World/Sheet", rim, "/World/Frame", "All points of the sheet's edge."),
        ground(),
        body(("Sphere", "Heavy", "double radius = 0.2"), (0.0, 1.35, 0.0), (0.16, 0.30, 0.55), known=(6.0, 0.008),
             comment="Points keep 8 mm from it: the sheet gives 40 % there, and longer chords cut deeper."),
        body(("Sphere", "Light", "double radius = 0.12"), (-0.45, 1.3, 0.3), (0.75, 0.3, 0.05), known=(0.1, 0.008)),
        body(("Cube", "Box", "double size = 0.24"), (0.42, 1.35, -0.2), WOOD[0], 20.0, known=(2.0, 0.02),
             comment="A thread of length l passes a sharp edge where its ends keep l / sqrt(8): 18 mm for the 5 cm of this."),
    ], frames=96)


RIGID_SCENES = {"dominoes": dominoes, "pyramid": pyramid, "humanoid": humanoid, "ball_into_cloth": ball_into_cloth}
