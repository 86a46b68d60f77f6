"""Example scenes of rigid bodies that stand by statics, turn freely, bounce and roll; python -m tools.scenes writes them."""

from math import cos, degrees, pi, radians, sin

import numpy as np

from tools.scenes.rigid import APIS, STEPS, WOOD, body
from tools.usda import block, ground, listed, moved, number, scene, settings

HULL = '["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]'
BOUND = '["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "MaterialBindingAPI"]'
STONE, CARD = [(0.74, 0.72, 0.66), (0.62, 0.60, 0.55)], [(0.92, 0.9, 0.86), (0.75, 0.2, 0.16)]


def placed(at, axis: str, turn: float, size=(1.0, 1.0, 1.0)) -> str:
    return (f"double3 xformOp:translate = ({', '.join(number(v) for v in at)})\n"
            f"double xformOp:rotate{axis} = {number(turn)}\n"
            f"double3 xformOp:scale = ({', '.join(number(v) for v in size)})\n"
            f'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotate{axis}", "xformOp:scale"]\n')


def colour(color) -> str:
    return f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]"


def polygons(points, faces) -> str:
    """A mesh; faces: tuples of points."""
    return (f"point3f[] points = {listed(points)}\nint[] faceVertexCounts = {listed([len(f) for f in faces])}\n"
            f"int[] faceVertexIndices = {listed(np.concatenate(faces))}\n" 'uniform token subdivisionScheme = "none"\n')


def arch() -> str:
    """Half a ring of 1 m mean radius and 16 cm thickness, of seventeen stones."""
    stones, rho, deep = 17, np.array([0.92, 1.08]), 0.3
    a = 0.5 * pi / stones
    points = [(r * sin(s * a), r * cos(a) - 1.0, 0.5 * z * deep) for z in (-1, 1) for r in rho for s in (-1, 1)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    parts = []
    for k in range(stones):
        turn = 0.5 * pi - (2 * k + 1) * a
        parts.append(block("Mesh", f"Stone{k}", polygons(points, faces) + 'uniform token physics:approximation = "convexHull"\n'
                           + placed((-sin(turn), cos(turn), 0.0), "Z", degrees(turn)) + colour(STONE[k % 2]), HULL,
                           "A mesh of a rigid body meets others as its convex hull, which a voussoir is; without a mass it "
                           "weighs 1000 kg/m^3." if k == 0 else ""))
    radius, speed = 0.25, 4.0
    rolls = (f"vector3f physics:velocity = ({number(speed)}, 0, 0)\n"
             f"vector3f physics:angularVelocity = (0, 0, {number(-degrees(speed / radius))})\n")
    ball = body(("Sphere", "Ball", f"double radius = {radius:g}"), (-1.4 - 3.0 * speed, radius, 0.0), (0.16, 0.30, 0.55),
                more=rolls, comment="Rolls, and arrives after 3 s.")
    return scene("An arch of seventeen stones stands without mortar, and is hit by a ball after 3 s.", [
        settings(substeps=20, iterations=4, comment=STEPS + " An arch of this form stands if it is thicker than 0.108 of its "
                 "radius (Milankovitch 1907)."), ground(), *parts, ball], frames=120)


def racket() -> str:
    """A handle and a head, thrown with a turn about the axis of the middle moment."""
    head = block("Cylinder", "Head", 'uniform token axis = "Z"\ndouble radius = 0.14\ndouble height = 0.02\n'
                 + placed((0.0, 0.24, 0.0), "Z", 0.0) + colour((0.75, 0.2, 0.16)), '["PhysicsCollisionAPI"]')
    handle = block("Cube", "Handle", "double size = 1\n" + placed((0.0, -0.08, 0.0), "Z", 0.0, (0.03, 0.36, 0.03))
                   + colour(WOOD[0]), '["PhysicsCollisionAPI"]')
    whole = block("Xform", "Racket", "vector3f physics:velocity = (0, 0, 0)\n"
                  f"vector3f physics:angularVelocity = ({number(degrees(10.0))}, 0, {number(degrees(0.01))})\n"
                  + placed((0.0, 1.0, 0.0), "Z", 0.0) + "\n" + head + "\n" + handle, '["PhysicsRigidBodyAPI"]',
                  "Colliders below a prim with PhysicsRigidBodyAPI are one body; its mass, centre and inertia are theirs. It "
                  "turns about the axis of its middle moment, which no free body keeps up: it turns over, again and again.")
    settled = settings(substeps=8, iterations=2, comment="Here there is none.").replace(
        "{\n", "{\n    float physics:gravityMagnitude = 0\n", 1)
    return scene("A tennis racket without weight, which turns over as it spins.", [settled, whole], frames=144)


def balls() -> str:
    """Three that bounce, by restitution, three that roll down a slope of triangles, by inertia."""
    bouncing = [("Lively", 0.9, (0.75, 0.2, 0.16)), ("Fair", 0.7, (0.80, 0.56, 0.32)), ("Dull", 0.5, (0.2, 0.42, 0.3))]
    materials, parts = [], []
    for k, (name, part, color) in enumerate(bouncing):
        materials.append(block("Material", name, f"float physics:restitution = {part:g}\nfloat physics:staticFriction = 0.5\n"
                               "float physics:dynamicFriction = 0.5", '["PhysicsMaterialAPI"]'))
        parts.append(block("Sphere", f"{name}Ball", "double radius = 0.12\n" + placed((-1.5 + 0.4 * k, 1.2, 0.3), "Y", 0.0)
                           + f"rel material:binding:physics = </World/Materials/{name}>\n" + colour(color), BOUND,
                           "Of two restitutions the larger counts." if k == 0 else ""))
    n, m, tall, long = 24, 4, 0.9, 2.0
    points = [(long * i / n, tall * (1.0 - i / n) ** 2 + 0.001, 1.2 * (j / m - 0.5)) for i in range(n + 1)
              for j in range(m + 1)]
    faces = [(i * (m + 1) + j, i * (m + 1) + j + 1, (i + 1) * (m + 1) + j + 1, (i + 1) * (m + 1) + j)
             for i in range(n) for j in range(m)]
    slope = block("Mesh", "Slope", polygons(points, faces) + 'uniform token physics:approximation = "none"\n'
                  + moved(-0.1, 0, 0) + "\n" + colour((0.55, 0.56, 0.6)), '["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]',
                  "A mesh that stands is met as its triangles, from both sides where it is open, as here.")
    rolling = [body(prim, (0.06, 1.02, z), color, more=more) for prim, z, color, more in (
        (("Sphere", "Rolling", "double radius = 0.1"), -0.35, (0.16, 0.30, 0.55), ""),
        (("Cylinder", "Wheel", 'uniform token axis = "Z"\ndouble radius = 0.1\ndouble height = 0.12'), 0.0, WOOD[1], ""),
        (("Capsule", "Barrel", 'uniform token axis = "Z"\ndouble radius = 0.1\ndouble height = 0.1'), 0.35, WOOD[2], ""))]
    return scene("Balls bounce by their restitution; others roll down a slope of triangles.", [
        settings(substeps=20, iterations=4, comment=STEPS), ground(), block("Scope", "Materials", "\n".join(materials)),
        *parts, slope, *rolling], frames=96)


def card_house() -> str:
    """Three storeys of pairs that lean by 20 degrees, with cards across."""
    long, thin, wide, lean = 0.5, 0.012, 0.36, 20.0
    a = radians(lean)
    inner = 0.5 * long * sin(a) + 0.5 * thin * cos(a)
    rise = 0.5 * long * cos(a) + 0.5 * thin * sin(a)
    parts, apart = [], 4.0 * inner + 0.02
    for row in range(3):
        floor = row * (2.0 * rise + thin)
        for k in range(3 - row):
            x = apart * (k - 0.5 * (2 - row))
            for side in (1, -1):
                name = f"Card{row}_{k}{'L' if side > 0 else 'R'}"
                parts.append(block("Cube", name, "double size = 1\n" + placed((x - side * inner, floor + rise, 0.0), "Z",
                                                                              -side * lean, (thin, long, wide))
                                   + colour(CARD[(row + k) % 2]), APIS, "Cards hold by friction alone, 0.5 where no material "
                                   "says other: under a load a foot needs at most the tangent of its lean, 0.36."
                                   if not parts else ""))
        for k in range(2 - row):
            x = apart * (k - 0.5 * (1 - row))
            parts.append(block("Cube", f"Floor{row}_{k}", "double size = 1\n" + placed(
                (x, floor + 2.0 * rise + 0.5 * thin, 0.0), "Z", 0.0, (apart - 0.01, thin, wide)) + colour(CARD[k % 2]), APIS))
    radius = 0.12
    ball = body(("Sphere", "Ball", f"double radius = {radius:g}"), (-0.47, radius, -9.0), (0.16, 0.30, 0.55), more=(
        "vector3f physics:velocity = (0, 0, 3)\n"
        f"vector3f physics:angularVelocity = ({number(degrees(3.0 / radius))}, 0, 0)\n"),
        comment="Rolls into the lowest storey after 3 s.")
    return scene("A house of cards stands by friction until a ball takes one away.", [
        settings(substeps=20, iterations=4, comment=STEPS), ground(), *parts, ball], frames=120)


BODY_SCENES = {"arch": arch, "racket": racket, "balls": balls, "card_house": card_house}
